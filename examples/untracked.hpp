#pragma once
// Why no marker was tracked, where what was seen tells.
#include <cstddef>
#include <cstdint>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <set>
#include <string>
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

}  // namespace detail

/// Reads all markers of the dictionary in the frames, as they are, mirrored and with swapped polarities.
/// @param looked_for what was not found
/// @returns a line on what is wrong; empty where nothing is read
inline std::string why_untracked(const std::vector<evmarker::PolarityFrame>& frames,
                                 const evmarker::PinholeCamera& camera,
                                 const evmarker::opencv::ArucoDetectorSettings& looked_for) {
  evmarker::opencv::ArucoDetector detector(
      camera, {.dictionary = looked_for.dictionary, .border_cells = looked_for.border_cells});
  const auto read = [&](bool mirrored, bool swapped) {
    std::set<evmarker::MarkerId> ids;
    for (const evmarker::PolarityFrame& frame : frames)
      for (const auto& found : detector.detect(detail::changed(frame, mirrored, swapped))) ids.insert(found.id);
    std::string text;
    for (const evmarker::MarkerId id : ids) text += (text.empty() ? "" : ", ") + std::to_string(id);
    return std::pair(ids, text);
  };
  const auto [ids, text] = read(false, false);
  if (!ids.empty() && looked_for.ids.empty()) return {};  // it was read, but not often enough
  for (const evmarker::MarkerId id : looked_for.ids)
    if (ids.contains(id)) return {};
  if (!ids.empty())
    return "no marker was tracked, but others were read: " + text +
           "; name them in --ids, and give their --marker-length";
  if (const std::string mirrored = read(true, false).second; !mirrored.empty())
    return "no marker was tracked, but some are read in the mirrored image: " + mirrored + "; is there a mirror?";
  if (const std::string swapped = read(false, true).second; !swapped.empty())
    return "no marker was tracked, but some are read with ON and OFF exchanged: " + swapped +
           "; are the polarities of the recording reversed?";
  return {};
}
