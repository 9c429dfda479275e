#pragma once
// AprilTag 3, the reference implementation, as a detector for the accuracy comparison.
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "frame_methods.hpp"

namespace evmarker::bench {

/// Tags of the family 36h11 at full resolution with refined edges; one thread.
class AprilTag {
 public:
  AprilTag() {
    detector_->quad_decimate = 1;
    apriltag_detector_add_family(detector_.get(), family_.get());
  }

  std::vector<PlanarHypotheses> find(const cv::Mat& image) const {
    image_u8_t view{image.cols, image.rows, static_cast<std::int32_t>(image.step[0]), image.data};
    const std::unique_ptr<zarray_t, decltype(&apriltag_detections_destroy)> detections(
        apriltag_detector_detect(detector_.get(), &view), &apriltag_detections_destroy);
    std::vector<PlanarHypotheses> found;
    for (int i = 0; i < zarray_size(detections.get()); ++i) {
      apriltag_detection_t* detection = nullptr;
      zarray_get(detections.get(), i, &detection);
      PlanarHypotheses marker{detection->id, {}};
      // Its corners run the other way round, OpenCV prints the family upside down, and its pixel (0, 0) has its centre
      // at (0.5, 0.5).
      for (std::size_t corner = 0; corner < 4; ++corner) {
        const double* p = detection->p[(5 - corner) % 4];
        marker.corners[corner] = {p[0] - 0.5, p[1] - 0.5};
      }
      found.push_back(marker);
    }
    return found;
  }

 private:
  std::unique_ptr<apriltag_family_t, decltype(&tag36h11_destroy)> family_{tag36h11_create(), &tag36h11_destroy};
  std::unique_ptr<apriltag_detector_t, decltype(&apriltag_detector_destroy)> detector_{apriltag_detector_create(),
                                                                                       &apriltag_detector_destroy};
};

}  // namespace evmarker::bench
