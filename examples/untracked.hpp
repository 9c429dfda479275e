#pragma once
// Why no marker was tracked, where what was seen tells.
#include <cstddef>
#include <cstdint>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// Some of the frames in which nothing is tracked, spread over the recording.
class UntrackedFrames {
 public:
  void add(const evmarker::PolarityFrame& frame) {
    if (seen_++ % every_ != 0) return;
    if (frames_.size() == kMost) {  // from here on, half as many
      for (std::size_t i = 1; i < kMost / 2; ++i) frames_[i] = std::move(frames_[2 * i]);
      frames_.erase(frames_.begin() + kMost / 2, frames_.end());
      every_ *= 2;
    }
    frames_.push_back(frame);
  }

  const std::vector<evmarker::PolarityFrame>& get() const { return frames_; }

 private:
  static constexpr std::size_t kMost = 8;
  std::vector<evmarker::PolarityFrame> frames_;
  std::uint64_t seen_ = 0, every_ = 1;
};

namespace detail {

inline evmarker::PolarityFrame changed(const evmarker::PolarityFrame& frame, bool mirrored, bool swapped) {
  evmarker::PolarityFrame changed(frame.sensor_size());
  const int width = frame.sensor_size().width;
  for (std::size_t i = 0; i < frame.pixels().size(); ++i) {
    if (frame.pixels()[i] == evmarker::PolarityFrame::kUntouched) continue;
    const int x = static_cast<int>(i) % width, y = static_cast<int>(i) / width;
    const bool on = frame.pixels()[i] == evmarker::PolarityFrame::kOn;
    changed.update({static_cast<std::uint16_t>(mirrored ? width - 1 - x : x), static_cast<std::uint16_t>(y),
                    static_cast<std::int16_t>(on != swapped), static_cast<evmarker::Timestamp>(frame.times()[i])});
  }
  return changed;
}

// How many frames show each marker that a detector finds.
inline std::map<evmarker::MarkerId, int> read_markers(const std::vector<evmarker::PolarityFrame>& frames,
                                                      const evmarker::PinholeCamera& camera,
                                                      std::string_view dictionary, int border_cells) {
  evmarker::opencv::ArucoDetector detector(camera,
                                           {.dictionary = std::string(dictionary), .border_cells = border_cells});
  std::map<evmarker::MarkerId, int> shown;
  for (const evmarker::PolarityFrame& frame : frames)
    for (const auto& found : detector.detect(frame)) ++shown[found.id];
  return shown;
}

inline std::string list_ids(const std::map<evmarker::MarkerId, int>& shown) {
  std::string text;
  for (const auto& [id, frames] : shown) text += (text.empty() ? "" : ", ") + std::to_string(id);
  return text;
}

// The smallest dictionary that begins like one of 1000 markers, and has all markers up to an id.
inline std::string_view smallest_dictionary(std::string_view largest, evmarker::MarkerId id) {
  const std::string_view kind = largest.substr(0, largest.find("1000"));
  for (const auto& [name, index] : evmarker::opencv::kDictionaries)
    if (name.starts_with(kind) && id < evmarker::opencv::dictionary_size(evmarker::opencv::make_dictionary(name)))
      return name;
  return largest;
}

// Tries every other dictionary; with a border of two cells, those that Kalibr prints. A line on the one most of whose
// markers are read, in two frames at least each, as among a thousand codes one may be read by chance; empty if there is
// none.
inline std::string of_other_dictionary(const std::vector<evmarker::PolarityFrame>& frames,
                                       const evmarker::PinholeCamera& camera,
                                       const evmarker::opencv::ArucoDetectorSettings& looked_for) {
  std::vector<evmarker::PolarityFrame> some;  // every dictionary takes its time
  const std::size_t step = frames.size() < 6 ? 1 : 2;
  for (std::size_t i = 0; i < frames.size(); i += step) some.push_back(frames[i]);
  std::map<evmarker::MarkerId, int> most;
  std::string_view dictionary;
  int border_cells = 1;
  const auto try_one = [&](std::string_view name, int border) {
    std::map<evmarker::MarkerId, int> shown = read_markers(some, camera, name, border);
    std::erase_if(shown, [](const auto& marker) { return marker.second < 2; });
    if (shown.size() <= most.size()) return;
    most = std::move(shown);
    dictionary = name;
    border_cells = border;
  };
  for (const char* name : {"DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL"})
    try_one(name, 1);
  for (const char* name : {"DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11"})
    for (const int border : {1, 2}) try_one(name, border);
  if (most.empty()) return {};
  dictionary = smallest_dictionary(dictionary, most.rbegin()->first);
  std::string text =
      "some of another dictionary are read: " + list_ids(most) + "; give --dictionary " + std::string(dictionary);
  if (border_cells != looked_for.border_cells) text += ", and a --board with border: " + std::to_string(border_cells);
  return text;
}

}  // namespace detail

/// Reads all markers of the dictionary in the frames, as they are, mirrored and with swapped polarities, then those of
/// all other dictionaries.
/// @param looked_for what was not found
/// @returns a line on what is wrong; empty where nothing is read
inline std::string why_untracked(const std::vector<evmarker::PolarityFrame>& frames,
                                 const evmarker::PinholeCamera& camera,
                                 const evmarker::opencv::ArucoDetectorSettings& looked_for) {
  const auto read = [&](bool mirrored, bool swapped) {
    std::vector<evmarker::PolarityFrame> changed;
    for (const evmarker::PolarityFrame& frame : frames) changed.push_back(detail::changed(frame, mirrored, swapped));
    return detail::read_markers(changed, camera, looked_for.dictionary, looked_for.border_cells);
  };
  const auto as_is = read(false, false);
  if (!as_is.empty() && looked_for.ids.empty()) return {};  // it was read, but not often enough
  for (const evmarker::MarkerId id : looked_for.ids)
    if (as_is.contains(id)) return {};
  const std::string none = "no marker was tracked, but ";
  if (!as_is.empty())
    return none + "others were read: " + detail::list_ids(as_is) +
           "; name them in --ids, and give their --marker-length";
  if (const auto mirrored = read(true, false); !mirrored.empty())
    return none + "some are read in the mirrored image: " + detail::list_ids(mirrored) + "; is there a mirror?";
  if (const auto swapped = read(false, true); !swapped.empty())
    return none + "some are read with ON and OFF exchanged: " + detail::list_ids(swapped) +
           "; are the polarities of the recording reversed?";
  const std::string other = detail::of_other_dictionary(frames, camera, looked_for);
  return other.empty() ? other : none + other;
}
