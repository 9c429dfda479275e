#include "evmarker/opencv/board.hpp"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <numbers>
#include <string>

#include "settings_text.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;

namespace {

const std::string kBoard = R"(board: 100
markers:
  - { id: 3, length: 0.04, rotation: [0, 1.5707963267948966, 0], translation: [0.1, -0.02, 0.003] }
  - id: 7
    length: 0.1
    rotation: [0, 0, 0]
    translation: [0, 0, 1]
)";

std::string board_refused(const std::string& content, const std::string& dictionary = "DICT_4X4_50") {
  const std::string path = write("board.yml", content);
  std::string message = "accepted";
  try {
    opencv::load_board(path, dictionary);
  } catch (const std::exception& error) {
    message = error.what();
  }
  if (const auto at = message.find(path); at != std::string::npos) message.replace(at, path.size(), "FILE");
  return message;
}

}  // namespace

TEST_CASE("a board is read as it is written, with and without the YAML directive") {
  for (const std::string head : {"", "%YAML:1.0\n---\n"}) {
    const std::string path = write("board.yml", head + kBoard);
    const Board board = opencv::load_board(path, "DICT_4X4_50");
    CHECK(board.id == 100);
    REQUIRE(board.markers.size() == 2);
    const BoardMarker& a = board.markers[0];
    CHECK(a.id == 3);
    CHECK(a.length == 0.04);
    CHECK(a.T_board_marker.translation() == Eigen::Vector3d(0.1, -0.02, 0.003));
    // A quarter turn about y: the marker's z looks along the board's x.
    CHECK((a.T_board_marker.linear() * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitX()).norm() < 1e-12);
    CHECK((a.T_board_marker.linear() * Eigen::Vector3d::UnitX() + Eigen::Vector3d::UnitZ()).norm() < 1e-12);
    CHECK(a.bits == opencv::marker_bits(opencv::make_dictionary("DICT_4X4_50"), 3));
    CHECK(board.markers[1].id == 7);
    CHECK(board.markers[1].length == 0.1);
    CHECK(board.markers[1].T_board_marker.linear().isIdentity());
  }
}

TEST_CASE("a board that is none is refused in one line with file, field and value") {
  REQUIRE(board_refused(kBoard) == "accepted");
  CHECK(board_refused(replaced(kBoard, "board:", "plate:")) == "board FILE: no field board");
  CHECK(board_refused(replaced(kBoard, "board: 100", "board: big")) == "board FILE: board is \"big\", not a number");
  CHECK(board_refused(replaced(kBoard, "board: 100", "board: -1")) ==
        "board FILE: board is -1, not a whole number from 0 on");
  CHECK(board_refused(replaced(kBoard, "markers:", "tags:")) == "board FILE: no field markers");
  CHECK(board_refused("board: 1\nmarkers: 5\n") == "board FILE: markers is not a list");
  CHECK(board_refused("board: 1\nmarkers: [5]\n") ==
        "board FILE: markers[0] is not a map of id, length, rotation and translation");
  CHECK(board_refused(replaced(kBoard, "id: 3, ", "")) == "board FILE: markers[0] has no field id");
  CHECK(board_refused(replaced(kBoard, "id: 7", "id: 7.5")) ==
        "board FILE: markers[1] id is 7.5, not a whole number from 0 on");
  CHECK(board_refused(replaced(kBoard, "id: 7", "id: 50"))
            .starts_with("board FILE: markers[1]: marker id 50 is not in DICT_4X4_50, which has 50 markers"));
  CHECK(board_refused(replaced(kBoard, "id: 7", "id: 3")) == "board FILE: board 100: marker 3 is there twice");
  CHECK(board_refused(replaced(kBoard, "length: 0.04", "length: 0")) ==
        "board FILE: markers[0] length is 0, not positive");
  CHECK(board_refused(replaced(kBoard, "length: 0.04", "length: wide")) ==
        "board FILE: markers[0] length is \"wide\", not a number");
  CHECK(board_refused(replaced(kBoard, "rotation: [0, 0, 0]", "rotation: [0, 0]")) ==
        "board FILE: markers[1] rotation is not a list of 3 numbers");
  CHECK(board_refused(replaced(kBoard, "rotation: [0, 0, 0]", "rotation: 0")) ==
        "board FILE: markers[1] rotation is not a list of 3 numbers");
  const std::string no_number = board_refused(replaced(kBoard, "[0.1, -0.02, 0.003]", "[0.1, .Nan, 0.003]"));
  CHECK(no_number.starts_with("board FILE: markers[0] translation[1] is "));
  CHECK(no_number.ends_with("nan, not a finite number"));  // or -nan
  CHECK(board_refused(replaced(kBoard, "translation: [0, 0, 1]", "place: [0, 0, 1]")) ==
        "board FILE: markers[1] has no field translation");
  CHECK(board_refused("") == "board FILE: is empty");
  CHECK(board_refused("[1, 2]\n").starts_with("board FILE: is neither"));
  CHECK(board_refused(std::string("\x01\x02{[\x00garbage", 12)).starts_with("board FILE: is neither"));
  CHECK(board_refused(kBoard, "DICT_9X9").starts_with("dictionary: no \"DICT_9X9\""));
  CHECK_THROWS_WITH(opencv::load_board("/nowhere/board.yml", "DICT_4X4_50"),
                    "board /nowhere/board.yml: cannot be read: No such file or directory");
}
