#pragma once
// Settings of the detector of ArUco and AprilTag markers.
#include <map>
#include <string>
#include <vector>

#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/opencv/aruco_shim.hpp"

namespace evmarker::opencv {

/// Which markers to find, and how much of a marker a frame must show.
struct ArucoDetectorSettings {
  std::string dictionary{kDefaultDictionary};  ///< OpenCV's name of a predefined dictionary
  double marker_length = 0.10;                 ///< side of the black square [m]
  std::map<MarkerId, double> lengths = {};     ///< sides of the markers that differ from marker_length [m]
  int border_cells = 1;                        ///< width of the markers' black border: 1, or 2 as Kalibr prints them
  std::vector<MarkerId> ids = {};              ///< the markers to find; empty: the whole dictionary
  double min_side_px = 15;                     ///< smaller markers are ignored
  double min_agreement = 0.9;          ///< least share of the marker's area that agrees with its code, see `read_code`
  double min_edge_support = 0.7;       ///< least share of its edges that the frame shows, see `FrameFit::support`
  double max_alternative_ratio = 2.0;  ///< largest ratio of costs at which the second planar pose is reported

  /// Side of a marker's black square [m].
  double length(MarkerId id) const {
    const auto own = lengths.find(id);
    return own != lengths.end() ? own->second : marker_length;
  }
};

}  // namespace evmarker::opencv
