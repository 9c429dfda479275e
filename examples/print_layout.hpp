#pragma once
// Faces of boards side by side on pages of paper.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "board_faces.hpp"

/// All lengths on paper are in millimetres, x right, y down.
struct PaperSize {
  std::string_view name;
  double width, height;
};

inline constexpr auto kPaperSizes =
    std::to_array<PaperSize>({{"A4", 210, 297}, {"letter", 215.9, 279.4}, {"A3", 297, 420}});

/// A face whose rim, one cell wide, has its top left corner at a place of the page.
struct PlacedFace {
  evmarker::BoardFace face;
  std::string caption;  ///< below it
  Eigen::Vector2d corner;
};

struct Page {
  double width, height;
  std::vector<PlacedFace> faces;
};

inline constexpr double kPageMargin = 10, kGap = 4, kCaption = 5, kFooter = 15, kRuler = 100;

/// A face with the text that is printed below it, which may be empty.
struct CaptionedFace {
  evmarker::BoardFace face;
  std::string caption;

  double width() const { return 1000 * face.size.x(); }
  double height() const { return 1000 * face.size.y() + (caption.empty() ? 0 : kCaption); }
};

/// Fills pages of so much room, row by row; empty if a face is larger than that.
inline std::vector<Page> fill_pages(const std::vector<CaptionedFace>& faces, double width, double height) {
  constexpr double kRounding = 1e-6;
  std::vector<Page> pages;
  double x = 0, y = 0, row = 0;
  for (const CaptionedFace& face : faces) {
    if (face.width() > width + kRounding || face.height() > height + kRounding) return {};
    if (x + face.width() > width + kRounding) {
      y += row + kGap;
      x = row = 0;
    }
    if (pages.empty() || y + face.height() > height + kRounding) {
      pages.push_back({width + 2 * kPageMargin, height + 2 * kPageMargin + kFooter, {}});
      x = y = row = 0;
    }
    pages.back().faces.push_back({face.face, face.caption, {kPageMargin + x, kPageMargin + y}});
    x += face.width() + kGap;
    row = std::max(row, face.height());
  }
  return pages;
}

/// One page that is as large as its faces need.
inline Page fitting_page(const std::vector<CaptionedFace>& faces) {
  const double columns = std::ceil(std::sqrt(static_cast<double>(faces.size())));
  double widest = 0;
  for (const CaptionedFace& face : faces) widest = std::max(widest, face.width());
  Page page = fill_pages(faces, columns * (widest + kGap), 1e9).front();
  double right = kPageMargin + kRuler, bottom = 0;
  for (const PlacedFace& placed : page.faces) {
    right = std::max(right, placed.corner.x() + 1000 * placed.face.size.x());
    bottom =
        std::max(bottom, placed.corner.y() + 1000 * placed.face.size.y() + (placed.caption.empty() ? 0 : kCaption));
  }
  page.width = right + kPageMargin;
  page.height = bottom + kFooter + kPageMargin;
  return page;
}

/// Fills sheets of a paper, upright or on their side, whichever needs fewer; empty if a face is too large.
inline std::vector<Page> fill_sheets(const std::vector<CaptionedFace>& faces, const PaperSize& paper) {
  const auto fill = [&](double width, double height) {
    return fill_pages(faces, width - 2 * kPageMargin, height - 2 * kPageMargin - kFooter);
  };
  std::vector<Page> upright = fill(paper.width, paper.height), on_side = fill(paper.height, paper.width);
  const bool turned = !on_side.empty() && (upright.empty() || on_side.size() < upright.size());
  return turned ? on_side : upright;
}

/// Lays faces out.
/// @param paper a name of kPaperSizes, or `fit` for one page that is as large as needed
/// @throws std::invalid_argument where a face is too large for the paper
inline std::vector<Page> lay_out(const std::vector<CaptionedFace>& faces, std::string_view paper) {
  if (paper == "fit") return {fitting_page(faces)};
  const auto size = std::ranges::find(kPaperSizes, paper, &PaperSize::name);
  std::vector<Page> pages = fill_sheets(faces, *size);
  if (!pages.empty()) return pages;
  double width = 0, height = 0;
  for (const CaptionedFace& face : faces) {
    width = std::max(width, face.width());
    height = std::max(height, face.height());
  }
  std::string advice = "--paper fit makes a page of the size that it needs";
  for (const PaperSize& other : kPaperSizes)
    if (other.name != paper && !fill_sheets(faces, other).empty())
      advice = "--paper " + std::string(other.name) + " is large enough";
  const auto show = [](double mm) { return std::to_string(static_cast<int>(std::ceil(mm - 1e-6))); };
  throw std::invalid_argument("--paper " + std::string(paper) + ": has room for " +
                              show(size->width - 2 * kPageMargin) + " x " +
                              show(size->height - 2 * kPageMargin - kFooter) + " mm, but " + show(width) + " x " +
                              show(height) + " mm are needed: " + advice);
}
