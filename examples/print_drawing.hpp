#pragma once
// Draws pages of markers with cairo, as SVG or PDF.
#include <cairo-pdf.h>
#include <cairo-svg.h>
#include <cairo.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "print_layout.hpp"

/// The outlines of a marker's black cells: closed lines through corners of cells, (column, row) from the top left
/// corner of its border. Cells are not drawn one by one, as thin white lines would show between them.
inline std::vector<std::vector<std::pair<int, int>>> black_outlines(const evmarker::CodeBits& bits) {
  using Corner = std::pair<int, int>;
  const int cells = static_cast<int>(bits.rows()) + 2;
  const auto black = [&](int column, int row) {
    if (column < 0 || row < 0 || column >= cells || row >= cells) return false;
    if (column == 0 || row == 0 || column == cells - 1 || row == cells - 1) return true;
    return bits(row - 1, column - 1) == 0;
  };
  std::multimap<Corner, Corner> edges;  // with the black cell on their right
  for (int row = 0; row < cells; ++row)
    for (int column = 0; column < cells; ++column) {
      if (!black(column, row)) continue;
      const Corner corners[] = {{column, row}, {column + 1, row}, {column + 1, row + 1}, {column, row + 1}};
      const Corner neighbours[] = {{column, row - 1}, {column + 1, row}, {column, row + 1}, {column - 1, row}};
      for (int i = 0; i < 4; ++i)
        if (!black(neighbours[i].first, neighbours[i].second)) edges.emplace(corners[i], corners[(i + 1) % 4]);
    }
  std::vector<std::vector<Corner>> outlines;
  while (!edges.empty()) {
    std::vector<Corner>& outline = outlines.emplace_back();
    for (auto edge = edges.begin(); edge != edges.end(); edge = edges.find(outline.back())) {
      const auto [from, to] = *edge;
      const bool straight = outline.size() > 1 && (outline[outline.size() - 2].first == to.first ||
                                                   outline[outline.size() - 2].second == to.second);
      if (straight) outline.pop_back();
      if (outline.empty()) outline.push_back(from);
      outline.push_back(to);
      edges.erase(edge);
    }
    outline.pop_back();  // the first corner again
  }
  return outlines;
}

/// An SVG or PDF file in memory.
class Drawing {
 public:
  /// @param pdf else SVG, which has one page
  Drawing(bool pdf, const Page& first) : scale_(pdf ? kPointsPerMm : 1) {
    const double width = scale_ * first.width, height = scale_ * first.height;
    surface_.reset(pdf ? cairo_pdf_surface_create_for_stream(append, &content_, width, height)
                       : cairo_svg_surface_create_for_stream(append, &content_, width, height));
    if (!pdf) cairo_svg_surface_set_document_unit(surface_.get(), CAIRO_SVG_UNIT_MM);
    cairo_.reset(cairo_create(surface_.get()));
    cairo_select_font_face(cairo_.get(), "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
  }

  /// @param title stands beside the ruler
  void add(const Page& page, const std::string& title) {
    if (scale_ != 1) cairo_pdf_surface_set_size(surface_.get(), scale_ * page.width, scale_ * page.height);
    cairo_identity_matrix(cairo_.get());
    cairo_scale(cairo_.get(), scale_, scale_);
    cairo_set_source_rgb(cairo_.get(), 1, 1, 1);
    cairo_paint(cairo_.get());
    for (const PlacedFace& placed : page.faces) draw(placed);
    draw_ruler(kPageMargin, page.height - kPageMargin - 0.5 * kFooter, title);
    cairo_show_page(cairo_.get());
  }

  /// The whole file.
  /// @throws std::runtime_error where cairo could not draw
  std::string finish() {
    cairo_status_t status = cairo_status(cairo_.get());
    cairo_surface_finish(surface_.get());
    if (status == CAIRO_STATUS_SUCCESS) status = cairo_surface_status(surface_.get());
    if (status != CAIRO_STATUS_SUCCESS)
      throw std::runtime_error(std::string("cairo: ") + cairo_status_to_string(status));
    return std::move(content_);
  }

 private:
  static constexpr double kPointsPerMm = 72 / 25.4;
  struct Destroy {
    void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
    void operator()(cairo_t* cairo) const { cairo_destroy(cairo); }
  };

  static cairo_status_t append(void* content, const unsigned char* data, unsigned int size) {
    static_cast<std::string*>(content)->append(reinterpret_cast<const char*>(data), size);
    return CAIRO_STATUS_SUCCESS;
  }

  void grey(double shade) { cairo_set_source_rgb(cairo_.get(), shade, shade, shade); }

  void line(double x0, double y0, double x1, double y1) {
    cairo_move_to(cairo_.get(), x0, y0);
    cairo_line_to(cairo_.get(), x1, y1);
    cairo_stroke(cairo_.get());
  }

  void text(double x, double y, double size, const std::string& words) {
    cairo_set_font_size(cairo_.get(), size);
    cairo_move_to(cairo_.get(), x, y);
    cairo_show_text(cairo_.get(), words.c_str());
  }

  // The line to cut along, ids, markers.
  void draw(const PlacedFace& placed) {
    const Eigen::Vector2d size = 1000 * placed.face.size, middle = placed.corner + 0.5 * size;
    grey(0.75);
    cairo_set_line_width(cairo_.get(), 0.1);
    cairo_rectangle(cairo_.get(), placed.corner.x(), placed.corner.y(), size.x(), size.y());
    cairo_stroke(cairo_.get());
    grey(0.4);
    text(placed.corner.x(), placed.corner.y() + size.y() + 0.7 * kCaption, 2.5, placed.caption);
    grey(0.55);  // hardly makes events
    for (const evmarker::BoardMarker& marker : placed.face.markers.markers) draw_id(marker, middle);
    grey(0);
    for (const evmarker::BoardMarker& marker : placed.face.markers.markers) draw_marker(marker, middle);
  }

  // In the white rim, below the left end of the marker.
  void draw_id(const evmarker::BoardMarker& marker, const Eigen::Vector2d& middle) {
    const Eigen::Matrix2d R = marker.T_board_marker.linear().topLeftCorner<2, 2>();
    const double half = 500 * marker.length * R.cwiseAbs().rowwise().sum().maxCoeff();
    const Eigen::Vector2d centre = 1000 * marker.T_board_marker.translation().head<2>();
    const double cell = 1000 * evmarker::cell_of(marker), height = std::min(0.7 * cell, 3.0);
    text(middle.x() + centre.x() - half, middle.y() - centre.y() + half + 0.2 * cell + 0.75 * height, height,
         std::to_string(marker.id));
  }

  void draw_marker(const evmarker::BoardMarker& marker, const Eigen::Vector2d& middle) {
    const Eigen::Isometry3d& T = marker.T_board_marker;
    const double cell = 1000 * evmarker::cell_of(marker), half = 500 * marker.length;
    const auto place = [&](const std::pair<int, int>& corner) {  // the paper's y is down
      const Eigen::Vector3d p =
          T.linear() * Eigen::Vector3d(corner.first * cell - half, half - corner.second * cell, 0);
      return Eigen::Vector2d(middle.x() + 1000 * T.translation().x() + p.x(),
                             middle.y() - 1000 * T.translation().y() - p.y());
    };
    for (const auto& outline : black_outlines(marker.bits)) {
      cairo_new_sub_path(cairo_.get());
      for (const auto& corner : outline) cairo_line_to(cairo_.get(), place(corner).x(), place(corner).y());
      cairo_close_path(cairo_.get());
    }
    cairo_fill(cairo_.get());
  }

  void draw_ruler(double x, double y, const std::string& title) {
    grey(0);
    cairo_set_line_width(cairo_.get(), 0.2);
    line(x, y, x + kRuler, y);
    for (int i = 0; i <= 10; ++i) line(x + 10 * i, y, x + 10 * i, y - (i % 5 == 0 ? 3 : 2));
    text(x, y + 3.5, 2.8, "100 mm: measure it, and print without scaling if it is not. " + title);
  }

  std::string content_;
  double scale_;  // units of the file per mm
  std::unique_ptr<cairo_surface_t, Destroy> surface_;
  std::unique_ptr<cairo_t, Destroy> cairo_;
};
