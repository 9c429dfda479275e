#pragma once
// Identification of the marker in a quadrilateral of an image by its cells.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/opencv/dark_quads.hpp"

namespace evmarker::opencv {

/// Identifies markers by their codes. Bits may be unknown or wrong, as long as a quadrilateral with random cells would
/// hardly be taken for a marker.
class CodeBook {
 public:
  /// A marker that was identified.
  struct Reading {
    MarkerId id = 0;
    Quad corners;        ///< from the marker's top left clockwise
    double clarity = 0;  ///< 1 if all of its outline is seen and all samples of its cells are right; less otherwise
  };

  /// @param border_cells width of the markers' black border
  explicit CodeBook(int border_cells = 1) : border_(border_cells), cells_(2 * border_cells) {}

  /// Adds a marker. The codes of all markers must be squares of the same size, at most 8 x 8 cells.
  void add(MarkerId id, const CodeBits& code) {
    cells_ = static_cast<int>(code.rows()) + 2 * border_;
    CodeBits seen = code;
    for (std::size_t turn = 0; turn < 4; ++turn) {
      entries_.push_back({word_of(seen), id, turn});
      CodeBits turned(seen.cols(), seen.rows());  // a quarter turn to the right
      for (Eigen::Index row = 0; row < turned.rows(); ++row)
        for (Eigen::Index column = 0; column < turned.cols(); ++column)
          turned(row, column) = seen(seen.rows() - 1 - column, row);
      seen = turned;
    }
    allowed_.clear();
    for (int bits = 0; bits <= inside() * inside(); ++bits) allowed_.push_back(allowed_errors(bits));
  }

  /// Identifies the marker in a quadrilateral; empty if no code, or more than one, agrees best with its cells, or if
  /// none agrees well enough.
  /// @param image 8 bit: 0 dark, 255 bright, 128 unknown
  std::optional<Reading> read(const cv::Mat& image, const DarkQuad& quad) const {
    const Cells cells = sample_cells(image, quad.corners);
    if (cells.border < kLeastBorder) return std::nullopt;
    const int known = std::popcount(cells.known);
    // If the code is so short that even without errors it could be random, it is accepted without errors if its outline
    // is seen well.
    const bool complete = known == inside() * inside() && quad.seen >= kOutlineSeen;
    const int allowed = std::max(allowed_[static_cast<std::size_t>(known)], complete ? 0 : -1);
    int best = allowed + 1;
    const Entry* found = nullptr;
    bool unique = true;
    for (const Entry& entry : entries_) {
      const int errors = std::popcount((entry.code ^ cells.white) & cells.known);
      if (errors > best) continue;
      unique = errors < best;
      if (unique) best = errors, found = &entry;
    }
    if (found == nullptr || !unique || best > allowed) return std::nullopt;
    Quad corners = quad.corners;
    std::rotate(corners.begin(), corners.begin() + static_cast<std::ptrdiff_t>(found->turn), corners.end());
    return Reading{found->id, corners, quad.seen * clarity(cells, found->code)};
  }

 private:
  struct Entry {
    std::uint64_t code;
    MarkerId id;
    std::size_t turn;  // which corner of the quadrilateral is the marker's top left
  };
  struct Cells {
    std::uint64_t white = 0, known = 0;  // one bit per cell inside, the last cell in the lowest bit
    double border = 0;                   // share of the border's cells that are dark
    int border_sum = 0;                  // of the samples of the border: 1 bright, -1 dark, 0 unknown
    std::array<int, 64> sums;            // of the samples of each cell inside, from the last cell to the first
  };
  static constexpr double kLeastBorder = 0.75;  // of Cells::border
  static constexpr double kOutlineSeen = 0.8;   // of DarkQuad::seen, for short codes
  static constexpr double kFalseAlarms = 1e-4;  // share of quadrilaterals with random cells
  static constexpr int kSide = 3;               // of the grid of samples of a cell

  // Number of cells along a side, without the border.
  int inside() const { return cells_ - 2 * border_; }

  // The bits of a code row by row, the last one in the lowest bit.
  static std::uint64_t word_of(const CodeBits& bits) {
    std::uint64_t word = 0;
    for (Eigen::Index row = 0; row < bits.rows(); ++row)
      for (Eigen::Index column = 0; column < bits.cols(); ++column)
        word = word << 1 | (bits(row, column) != 0 ? 1u : 0u);
    return word;
  }

  // The largest number of errors in so many known bits at which random bits would agree with a code of the book in at
  // most kFalseAlarms of the cases; -1 if even bits without errors would do so more often.
  int allowed_errors(int bits) const {
    const double codes = static_cast<double>(entries_.size());
    double ways = 1, sum = 0;
    int errors = -1;
    for (; errors < bits; ++errors) {
      sum += ways;
      if (codes * sum * std::exp2(-bits) > kFalseAlarms) break;
      ways *= static_cast<double>(bits - errors - 1) / (errors + 2);
    }
    return errors;
  }

  // Share of right minus share of wrong samples, given the code.
  double clarity(const Cells& cells, std::uint64_t code) const {
    int sum = -cells.border_sum;
    for (int i = 0; i < inside() * inside(); ++i)
      sum += (code >> i & 1) != 0 ? cells.sums[static_cast<std::size_t>(i)] : -cells.sums[static_cast<std::size_t>(i)];
    return sum / static_cast<double>(cells_ * cells_ * kSide * kSide);
  }

  // Samples all cells of a quadrilateral.
  Cells sample_cells(const cv::Mat& image, const Quad& quad) const {
    const auto side = static_cast<float>(cells_);
    const cv::Point2f square[4] = {{0, 0}, {side, 0}, {side, side}, {0, side}};
    cv::Point2f corners[4];
    for (std::size_t i = 0; i < 4; ++i) corners[i] = {static_cast<float>(quad[i].x), static_cast<float>(quad[i].y)};
    const cv::Matx33d H = cv::getPerspectiveTransform(square, corners);
    const auto brightness = [&](double u, double v) {
      const cv::Vec3d p = H * cv::Vec3d(u, v, 1);
      const int x = cvRound(p[0] / p[2]), y = cvRound(p[1] / p[2]);
      if (x < 0 || y < 0 || x >= image.cols || y >= image.rows) return 0;
      const int seen = image.at<uchar>(y, x);
      return (seen > 128) - (seen < 128);
    };
    constexpr int kKnown = 2;  // least difference between bright and dark samples of a known cell
    Cells cells;
    int dark_border = 0, inner = inside() * inside();
    for (int row = 0; row < cells_; ++row)
      for (int column = 0; column < cells_; ++column) {
        int sum = 0;
        for (int i = 0; i < kSide; ++i)
          for (int j = 0; j < kSide; ++j)
            sum += brightness(column + 0.25 + 0.5 * j / (kSide - 1), row + 0.25 + 0.5 * i / (kSide - 1));
        if (std::min({row, column, cells_ - 1 - row, cells_ - 1 - column}) < border_) {
          dark_border += sum < 0;
          cells.border_sum += sum;
        } else {
          cells.sums[static_cast<std::size_t>(--inner)] = sum;
          cells.white = cells.white << 1 | (sum > 0 ? 1u : 0u);
          cells.known = cells.known << 1 | (std::abs(sum) >= kKnown ? 1u : 0u);
        }
      }
    cells.border = dark_border / static_cast<double>(cells_ * cells_ - inside() * inside());
    return cells;
  }

  std::vector<Entry> entries_;
  std::vector<int> allowed_;  // allowed errors, by number of known bits
  int border_;                // number of cells across the border
  int cells_;                 // number of cells along a side, border included
};

}  // namespace evmarker::opencv
