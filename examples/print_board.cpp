// Draws a board, single markers or a grid of markers at true scale for a printer, as SVG or PDF.
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <evmarker/io/board_writer.hpp>
#include <evmarker/io/output_file.hpp>
#include <evmarker/opencv/aruco_shim.hpp>
#include <evmarker/opencv/board.hpp>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "board_faces.hpp"
#include "console.hpp"
#include "distinct_files.hpp"
#include "print_drawing.hpp"
#include "print_layout.hpp"

using namespace evmarker;

namespace {

// Accepts columns or rows of a grid, what is left and right of its x.
CLI::Validator grid_side() {
  return {[](std::string& text) {
            int side = 0;
            const bool good = CLI::detail::lexical_cast(text, side) && side >= 1 && side <= 1000;
            return good ? std::string() : text + " is no number from 1 to 1000; a grid is columns x rows, as 4x3";
          },
          "1..1000"};
}

struct Options {
  std::string file, output, board, dictionary, paper = "A4";
  std::vector<int> ids, grid;  // columns and rows
  double marker_length = 0, spacing = 0;
  int first_id = 0;

  void add_to(CLI::App& app) {
    CLI::Option* read = app.add_option(
        "file", file, "board file to draw, as track_file --board reads it: its markers, not a chessboard around them");
    CLI::Option* single =
        app.add_option("--ids", ids, "in its place single markers, as 3,7")->delimiter(',')->excludes(read);
    CLI::Option* of_grid = app.add_option("--grid", grid, "in its place a grid of markers, columns x rows, as 4x3")
                               ->delimiter('x')
                               ->expected(2)
                               ->check(grid_side())
                               ->excludes(read)
                               ->excludes(single);
    app.add_option("--marker-length", marker_length, "of --ids and --grid: side of the black square [m]")
        ->check(console::marker_length())
        ->excludes(read);
    app.add_option("--spacing", spacing, "white between two markers of the grid [m]; default: two cells")
        ->check(console::positive_number())
        ->needs(of_grid);
    app.add_option("--first-id", first_id, "of the grid's top left marker; the others follow row by row")
        ->check(CLI::NonNegativeNumber)
        ->capture_default_str()
        ->needs(of_grid);
    app.add_option("--board", board, "board file of the grid to write, for track_file --board")->needs(of_grid);
    app.add_option("--dictionary", dictionary, "OpenCV's name of the ArUco or AprilTag dictionary")
        ->default_str("that of the file, or " + std::string(opencv::kDefaultDictionary));
    app.add_option("--output", output, "picture to write, .svg or .pdf")->required();
    std::vector<std::string> papers{"fit"};
    for (const PaperSize& size : kPaperSizes) papers.emplace_back(size.name);
    app.add_option("--paper", paper, "size of the pages; fit: one page, as large as needed")
        ->check(CLI::IsMember(papers))
        ->capture_default_str();
    app.footer("Exit codes: 0 done, 1 error");
  }

  // The dictionary where no file names one.
  std::string own_dictionary() const {
    return dictionary.empty() ? std::string(opencv::kDefaultDictionary) : dictionary;
  }
};

// Single markers, each as a board of its own.
opencv::BoardFile make_single_markers(const Options& o) {
  opencv::BoardFile made{{}, o.own_dictionary()};
  const cv::aruco::Dictionary codes = opencv::make_dictionary(made.dictionary);
  for (const int id : o.ids)
    made.boards.push_back(
        {id, {{id, o.marker_length, opencv::marker_bits(codes, id, made.dictionary), Eigen::Isometry3d::Identity()}}});
  return made;
}

// Markers in rows from top to bottom; the board's origin is in the middle.
opencv::BoardFile make_grid(const Options& o) {
  opencv::BoardFile made{{}, o.own_dictionary()};
  const cv::aruco::Dictionary codes = opencv::make_dictionary(made.dictionary);
  const double cell = o.marker_length / (codes.markerSize + 2), spacing = o.spacing > 0 ? o.spacing : 2 * cell;
  if (spacing < cell)
    throw std::invalid_argument("--spacing: " + number_text(spacing) + " m is less than a cell of the markers (" +
                                number_text(cell) + " m), which must be white around each");
  Board board{.id = opencv::free_board_id(codes), .markers = {}};
  const double pitch = o.marker_length + spacing;
  const auto to_nm = [](double metres) { return std::round(1e9 * metres) / 1e9; };  // the file is read by people, too
  for (int row = 0; row < o.grid[1]; ++row)
    for (int column = 0; column < o.grid[0]; ++column) {
      const int id = o.first_id + row * o.grid[0] + column;
      Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
      T.translation() << to_nm(pitch * (column - 0.5 * (o.grid[0] - 1))), to_nm(pitch * (0.5 * (o.grid[1] - 1) - row)),
          0;
      board.markers.push_back({id, o.marker_length, opencv::marker_bits(codes, id, made.dictionary), T});
    }
  made.boards.push_back(board);
  return made;
}

opencv::BoardFile make_boards(const Options& o) {
  if (!o.file.empty()) return opencv::load_boards(o.file, o.dictionary);
  if (o.ids.empty() && o.grid.empty())
    throw std::invalid_argument("a board file, --ids or --grid is required (see --help)");
  if (o.marker_length == 0) throw std::invalid_argument("--marker-length is required (see --help)");
  return o.ids.empty() ? make_grid(o) : make_single_markers(o);
}

std::string direction_text(const Eigen::Vector3d& direction) {
  std::string text;
  for (const double number : direction) {
    char rounded[32];
    std::snprintf(rounded, sizeof rounded, "%.3g", std::abs(number) < 5e-4 ? 0.0 : number);
    text += (text.empty() ? "(" : ", ") + std::string(rounded);
  }
  return text + ")";
}

// All faces of all boards. The faces of a body say how they are mounted.
std::vector<CaptionedFace> make_faces(const std::vector<Board>& boards) {
  std::vector<CaptionedFace> all;
  for (const Board& board : boards) {
    const std::vector<BoardFace> faces = split_into_faces(board);
    for (std::size_t i = 0; i < faces.size(); ++i) {
      const Eigen::Matrix3d axes = faces[i].T_board_face.linear();
      std::string caption = boards.size() > 1 && board.markers.size() > 1 ? "board " + std::to_string(board.id) : "";
      if (faces.size() > 1)
        caption = "board " + std::to_string(board.id) + ", face " + std::to_string(i + 1) + ": right is " +
                  direction_text(axes.col(0)) + ", up " + direction_text(axes.col(1));
      all.push_back({faces[i], caption});
    }
  }
  return all;
}

void print_board(const Options& o) {
  require_distinct({{"the board", o.file}}, {{"--output", o.output}, {"--board", o.board}});
  require_ending({"--output", o.output}, {".svg", ".pdf"});
  require_ending({"--board", o.board}, kBoardEndings);
  const bool pdf = std::filesystem::path(o.output).extension() == ".pdf";
  const opencv::BoardFile made = make_boards(o);
  const std::vector<Page> pages = lay_out(make_faces(made.boards), o.paper);
  if (!pdf && pages.size() > 1)
    throw std::invalid_argument("--output " + o.output + ": " + std::to_string(pages.size()) + " pages of " + o.paper +
                                " are needed, but an SVG has one: write a .pdf, or take --paper fit");
  Drawing drawing(pdf, pages.front());
  for (const Page& page : pages) drawing.add(page, made.dictionary);
  io::OutputFile picture(o.output);
  picture.write(drawing.finish());
  if (!o.board.empty()) io::save_board(o.board, made.boards.front(), made.dictionary);
  picture.close();
  std::size_t markers = 0;
  for (const Board& board : made.boards) markers += board.markers.size();
  std::printf("%s: %zu markers of %s on %zu page%s of %.0f x %.0f mm\n", o.output.c_str(), markers,
              made.dictionary.c_str(), pages.size(), pages.size() == 1 ? "" : "s", pages.front().width,
              pages.front().height);
  if (!made.beside.empty())
    std::printf("only markers are drawn, without %s, which nothing here needs\n", made.beside.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("print_board", "Draws boards and markers at true scale, for a printer.", argc, argv,
                               print_board);
}
