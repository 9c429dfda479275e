#include "evmarker/opencv/wireframe.hpp"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <sstream>
#include <string>

#include "evmarker/base/so3.hpp"
#include "random_pose.hpp"
#include "settings_text.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;

namespace {

const std::string kBody = R"(# A wedge.
wireframe: 200
vertices: [[0, 0, 0], [0.1, 0, 0], [0.1, 0.2, 0], [0, 0.2, 0.05]]
edges:
  - { from: 0, to: 1 }
  - { from: 1, to: 2, dark_side: [-1, 0, 0] }
  - { from: 2, to: 3, dark_side: [-0.3, -0.8, 0.1], face_normal: [0, 2, 0] }
  - from: 3
    to: 0
start:
  rotation: [0, 1.5707963267948966, 0]
  translation: [0.01, -0.02, 0.6]
)";

std::string body_refused(const std::string& content) {
  const std::string path = write("body.yml", content);
  std::string message = "accepted";
  try {
    opencv::load_wireframe(path);
  } catch (const std::exception& error) {
    message = error.what();
  }
  if (const auto at = message.find(path); at != std::string::npos) message.replace(at, path.size(), "FILE");
  return message;
}

std::string body_refused(const std::string& from, const std::string& to) {
  return body_refused(replaced(kBody, from, to));
}

}  // namespace

TEST_CASE("a wireframe is read as it is written, with and without the YAML directive") {
  for (const std::string head : {"", "%YAML:1.0\n---\n"}) {
    const Wireframe body = opencv::load_wireframe(write("body.yml", head + kBody));
    CHECK(body.id == 200);
    REQUIRE(body.model.vertices.size() == 4);
    CHECK(body.model.vertices[1] == Eigen::Vector3d(0.1, 0, 0));
    CHECK(body.model.vertices[3] == Eigen::Vector3d(0, 0.2, 0.05));
    CHECK(body.model.cells == 0);
    REQUIRE(body.model.segments.size() == 4);
    const auto& edges = body.model.segments;
    CHECK(edges[0].from == 0);
    CHECK(edges[0].to == 1);
    CHECK(edges[0].dark_side.isZero());
    CHECK(edges[0].face_normal.isZero());
    CHECK(edges[1].dark_side == Eigen::Vector3d(-1, 0, 0));
    CHECK(edges[3].from == 3);
    CHECK(edges[3].to == 0);
    REQUIRE(body.start.has_value());
    CHECK(body.start->translation() == Eigen::Vector3d(0.01, -0.02, 0.6));
    // A quarter turn about y: the body's z looks along the camera's x.
    CHECK((body.start->linear() * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitX()).norm() < 1e-12);
  }
}

TEST_CASE("of a dark side that leans along its edge the part across it counts, and a face normal gets length 1") {
  const Wireframe body = opencv::load_wireframe(write("body.yml", kBody));
  const MarkerSegment& edge = body.model.segments[2];
  const Eigen::Vector3d along = Eigen::Vector3d(-0.1, 0, 0.05).normalized(), stated(-0.3, -0.8, 0.1);
  CHECK(std::abs(edge.dark_side.dot(along)) < 1e-12);
  CHECK(edge.dark_side.norm() == doctest::Approx(1));
  CHECK(edge.dark_side.dot(stated) > 0.7 * stated.norm());
  CHECK(std::abs(edge.dark_side.dot(along.cross(stated))) < 1e-12);  // in the plane of both
  CHECK(edge.face_normal == Eigen::Vector3d(0, 1, 0));
}

TEST_CASE("what was written comes back to the last digit") {
  SeededNumbers random(11);
  for (int round = 0; round < 20; ++round) {
    std::ostringstream text;
    text.precision(17);
    const auto list = [&](const Eigen::Vector3d& v) { text << "[" << v.x() << ", " << v.y() << ", " << v.z() << "]"; };
    const auto any = [&] { return Eigen::Vector3d(random(-1, 1), random(-1, 1), random(-1, 1)); };
    std::vector<Eigen::Vector3d> vertices(5), sides;
    text << "wireframe: " << round << "\nvertices:\n";
    for (Eigen::Vector3d& vertex : vertices) {
      vertex = any();
      text << "  - ";
      list(vertex);
      text << "\n";
    }
    text << "edges:\n";
    for (std::size_t i = 0; i < 5; ++i) {
      const Eigen::Vector3d along = vertices[(i + 1) % 5] - vertices[i];
      sides.push_back(any().cross(along).normalized());
      text << "  - { from: " << i << ", to: " << (i + 1) % 5 << ", dark_side: ";
      list(sides.back());
      text << " }\n";
    }
    const Eigen::Vector3d turn = any(), place(0.1, -0.2, 5);
    text << "start: { rotation: ";
    list(turn);
    text << ", translation: ";
    list(place);
    text << " }\n";
    const Wireframe body = opencv::load_wireframe(write("body.yml", text.str()));
    CHECK(body.id == round);
    CHECK(body.model.vertices == vertices);
    REQUIRE(body.model.segments.size() == 5);
    for (std::size_t i = 0; i < 5; ++i) CHECK((body.model.segments[i].dark_side - sides[i]).norm() < 1e-12);
    CHECK(body.start->translation() == place);
    CHECK((body.start->linear() - so3_exp(turn)).norm() < 1e-12);
  }
}

TEST_CASE("a body that is none is refused in one line with file, vertex or edge, field and value") {
  REQUIRE(body_refused(kBody) == "accepted");
  CHECK(body_refused("wireframe: 200", "body: 200") == "wireframe FILE: no field wireframe");
  CHECK(body_refused("wireframe: 200", "wireframe: big") == "wireframe FILE: wireframe is \"big\", not a number");
  CHECK(body_refused("wireframe: 200", "wireframe: 1.5") ==
        "wireframe FILE: wireframe is 1.5, not a whole number from 0 on");
  CHECK(body_refused("vertices:", "corners:") == "wireframe FILE: no field vertices");
  CHECK(body_refused("edges:", "lines:") == "wireframe FILE: no field edges");
  CHECK(body_refused("wireframe: 1\nvertices: 5\nedges: []\n") == "wireframe FILE: vertices is not a list");
  CHECK(body_refused("wireframe: 1\nvertices: [5]\nedges: []\n") ==
        "wireframe FILE: vertices[0] is not a list of 3 numbers");
  CHECK(body_refused("wireframe: 1\nvertices: [[0, 0, 0], [1, 0, 0]]\nedges: 7\n") ==
        "wireframe FILE: edges is not a list");
  CHECK(body_refused("wireframe: 1\nvertices: [[0, 0, 0], [1, 0, 0]]\nedges: [7]\n") ==
        "wireframe FILE: edges[0] is not a map of from and to");
  CHECK(body_refused("[0.1, 0, 0]", "[0.1, 0]") == "wireframe FILE: vertices[1] is not a list of 3 numbers");
  CHECK(body_refused("[0.1, 0, 0]", "[0.1, wide, 0]") == "wireframe FILE: vertices[1][1] is \"wide\", not a number");
  CHECK(body_refused("{ from: 0, to: 1 }", "{ from: 0 }") == "wireframe FILE: edges[0] has no field to");
  CHECK(body_refused("{ from: 0, to: 1 }", "{ from: -1, to: 1 }") ==
        "wireframe FILE: edges[0] from is -1, not a whole number from 0 on");
  CHECK(body_refused("{ from: 0, to: 1 }", "{ from: 0, to: 4 }") ==
        "wireframe FILE: edges[0] to is 4, but there are only 4 vertices");
  CHECK(body_refused("{ from: 0, to: 1 }", "{ from: 1, to: 1 }") == "wireframe FILE: edges[0] has no length");
  CHECK(body_refused("[0.1, 0, 0]", "[0, 0, 0]") == "wireframe FILE: edges[0] has no length");
  CHECK(body_refused("from: 3\n    to: 0", "from: 2\n    to: 1") ==
        "wireframe FILE: edges[3] joins the same vertices as edges[1]");
  CHECK(body_refused("dark_side: [-1, 0, 0]", "dark_side: [-1, 0]") ==
        "wireframe FILE: edges[1] dark_side is not a list of 3 numbers");
  CHECK(body_refused("dark_side: [-1, 0, 0]", "dark_side: [0, 0, 0]") ==
        "wireframe FILE: edges[1] dark_side is zero: leave it out where it is not known");
  CHECK(body_refused("dark_side: [-1, 0, 0]", "dark_side: [0, 1, 0.01]") ==
        "wireframe FILE: edges[1] dark_side lies along the edge: it must point to one of its sides");
  CHECK(body_refused("dark_side: [-1, 0, 0]", "darkside: [-1, 0, 0]") ==
        "wireframe FILE: edges[1] has a field darkside, which no edge has (from, to, dark_side, face_normal)");
  CHECK(body_refused("face_normal: [0, 2, 0]", "face_normal: [0, 0, 2]") ==
        "wireframe FILE: edges[2] face_normal is not perpendicular to the edge, which then is not on that face");
  CHECK(body_refused("wireframe: 1\nvertices: [[0, 0, 0], [1, 0, 0]]\nedges: []\n") ==
        "wireframe FILE: marker model: no segments");
  CHECK(body_refused("rotation: [0, 1.5707963267948966, 0]", "turn: [0, 0, 0]") ==
        "wireframe FILE: start has no field rotation");
  CHECK(body_refused("translation: [0.01, -0.02, 0.6]", "translation: 0.6") ==
        "wireframe FILE: start translation is not a list of 3 numbers");
  CHECK(body_refused("translation: [0.01, -0.02, 0.6]", "translation: [0.01, -0.02, 0.05]") ==
        "wireframe FILE: start puts vertex 1 not in front of the camera, but at z = -0.05 m");
  CHECK(body_refused("") == "wireframe FILE: is empty");
  CHECK(body_refused("- 1\n- 2\n").starts_with("wireframe FILE: is neither"));
  CHECK_THROWS_WITH(opencv::load_wireframe("/nowhere/body.yml"),
                    "wireframe /nowhere/body.yml: cannot be read: No such file or directory");
}

TEST_CASE("the pyramid's file is read") {
  const std::filesystem::path path = std::filesystem::path(EVMARKER_SHARED_DATA) / "pyramid/wireframe.yml";
  if (!std::filesystem::exists(path)) {
    MESSAGE("skipped: no " << path.string());
    return;
  }
  const Wireframe pyramid = opencv::load_wireframe(path.string());
  CHECK(pyramid.id == 200);
  CHECK(pyramid.model.vertices.size() == 4);
  CHECK(pyramid.model.segments.size() == 6);
  CHECK_FALSE(pyramid.start.has_value());
}
