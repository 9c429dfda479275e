#include "evmarker/io/board_writer.hpp"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <numbers>
#include <stdexcept>

#include "evmarker/opencv/board.hpp"
#include "message_of.hpp"
#include "random_pose.hpp"
#include "test_support.hpp"

using namespace evmarker;
using namespace evmarker::io::test;

namespace {

Board some_board() {
  const auto dictionary = opencv::make_dictionary("DICT_4X4_50");
  SeededNumbers random(1);
  Board board{100, {}};
  for (const MarkerId id : {3, 7, 49}) {
    BoardMarker marker{id, random(0.01, 0.2), opencv::marker_bits(dictionary, id)};
    marker.T_board_marker = random_pose(random, 1e-6, std::numbers::pi);
    board.markers.push_back(marker);
  }
  return board;
}

}  // namespace

TEST_CASE("save_board: a board reads back as it was") {
  const TemporaryFolder folder;
  const Board board = some_board();
  io::save_board(folder / "board.yml", board);
  CHECK_FALSE(std::filesystem::exists(folder / "board.yml.part"));
  const Board read = opencv::load_board((folder / "board.yml").string(), "DICT_4X4_50");
  CHECK(read.id == 100);
  REQUIRE(read.markers.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(read.markers[i].id == board.markers[i].id);
    CHECK(read.markers[i].length == board.markers[i].length);
    CHECK(read.markers[i].bits == board.markers[i].bits);
    const Eigen::Isometry3d &there = read.markers[i].T_board_marker, &here = board.markers[i].T_board_marker;
    CHECK(there.translation() == here.translation());
    CHECK((there.linear() - here.linear()).norm() < 1e-14);
  }
}

TEST_CASE("save_board: the exact text, and a board that is none leaves no file") {
  const TemporaryFolder folder;
  Board board{5, {BoardMarker{.id = 2, .length = 0.05, .bits = some_board().markers[0].bits}}};
  board.markers[0].T_board_marker.translation() = Eigen::Vector3d(0.1, -0.25, 1e-7);
  io::save_board(folder / "board.yml", board);
  CHECK(read_file(folder / "board.yml") ==
        "board: 5\nmarkers:\n  - { id: 2, length: 0.05, rotation: [0, 0, 0], translation: [0.1, -0.25, 1e-07] }\n");
  io::save_board(folder / "board.yml", board, "DICT_4X4_100");
  CHECK(read_file(folder / "board.yml").starts_with("dictionary: DICT_4X4_100\nboard: 5\nmarkers:\n"));
  board.markers.push_back(board.markers[0]);
  CHECK(message_of([&] { io::save_board(folder / "twice.yml", board); }) == "board 5: marker 2 is there twice");
  CHECK(folder.files() == 1);
}
