#include "evmarker/detection/marker_detector.hpp"

#include <doctest/doctest.h>

#include <span>
#include <vector>

using evmarker::MarkerDetection;
using evmarker::MarkerDetector;
using evmarker::MarkerId;
using evmarker::MarkerModel;
using evmarker::PolarityFrame;

namespace {

// Sees a marker wherever the frame has a bright pixel.
struct BrightPixelDetector {
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
    std::vector<MarkerDetection> found;
    for (const std::uint8_t pixel : frame.pixels())
      if (pixel == PolarityFrame::kOn) found.push_back({.id = 7, .t = frame.t()});
    return found;
  }
  MarkerModel model(MarkerId) const { return evmarker::make_square_marker(0.1); }
};

struct SpanDetector {
  std::span<const MarkerDetection> detect(const PolarityFrame&);
  const MarkerModel& model(MarkerId);
};
struct OwnDetection : MarkerDetection {
  double score = 0;
};
struct RicherDetector {
  std::vector<OwnDetection> detect(const PolarityFrame&);
  MarkerModel model(MarkerId);
};
struct WithoutModel {
  std::vector<MarkerDetection> detect(const PolarityFrame&);
};
struct WithoutDetect {
  MarkerModel model(MarkerId);
};
struct DetectsIds {
  std::vector<MarkerId> detect(const PolarityFrame&);
  MarkerModel model(MarkerId);
};
struct DetectsOne {
  MarkerDetection detect(const PolarityFrame&);
  MarkerModel model(MarkerId);
};
struct WritesFrame {
  std::vector<MarkerDetection> detect(PolarityFrame&);
  MarkerModel model(MarkerId);
};
struct ModelWithoutId {
  std::vector<MarkerDetection> detect(const PolarityFrame&);
  MarkerModel model();
};

}  // namespace

static_assert(MarkerDetector<BrightPixelDetector>);
static_assert(MarkerDetector<SpanDetector>);
static_assert(MarkerDetector<RicherDetector>);
static_assert(!MarkerDetector<PolarityFrame>);
static_assert(!MarkerDetector<WithoutModel>);
static_assert(!MarkerDetector<WithoutDetect>);
static_assert(!MarkerDetector<DetectsIds>);
static_assert(!MarkerDetector<DetectsOne>);
static_assert(!MarkerDetector<WritesFrame>);
static_assert(!MarkerDetector<ModelWithoutId>);

TEST_CASE("a detector of one's own finds what the frame shows") {
  BrightPixelDetector detector;
  PolarityFrame frame({4, 3});
  CHECK(detector.detect(frame).empty());
  frame.update({2, 1, 1, 1234});
  const auto found = detector.detect(frame);
  REQUIRE(found.size() == 1);
  CHECK(found[0].id == 7);
  CHECK(found[0].t == 1234);
}

TEST_CASE("a detection has one pose, no alternative and no corners until they are set") {
  const MarkerDetection detection;
  CHECK(detection.T_camera_marker.isApprox(Eigen::Isometry3d::Identity()));
  CHECK_FALSE(detection.T_camera_marker_alternative.has_value());
  for (const Eigen::Vector2d& corner : detection.corners_px) CHECK(corner == Eigen::Vector2d::Zero());
}
