#pragma once
// The topics of a ROS recording, and the one whose events are read.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/io/event_message.hpp"
#include "evmarker/io/recording_error.hpp"

namespace evmarker::io {

/// Chooses the topic that is named, or else the only one of events.
class EventTopics {
 public:
  /// @param path only named in errors
  /// @param chosen name of the topic; empty for the only one
  EventTopics(std::filesystem::path path, std::string chosen) : path_(std::move(path)), chosen_(std::move(chosen)) {}

  /// Adds a topic, or another connection of it.
  /// @param id of its messages in the recording
  /// @throws RecordingError where there are so many, or of so long a name, that they are no recording's
  void add(std::uint32_t id, std::string_view name, std::string_view type, bool is_cdr) {
    if (ids_.size() == kMost || name.size() > kMost || type.size() > kMost)
      throw RecordingError(path_, "garbled: more than " + std::to_string(kMost) + " topics, or one of so long a name");
    const auto format = find_event_message(type, is_cdr);
    auto& names = format ? of_events_ : others_;
    if (std::ranges::find(names, name) == names.end()) names.emplace_back(name);
    ids_[id] = format && (chosen_.empty() || name == chosen_) ? format : std::nullopt;
  }

  /// @throws RecordingError where several topics have events and none is chosen
  void require_one() const {
    if (chosen_.empty() && of_events_.size() > 1)
      throw RecordingError(path_, "several topics of events, " + list(of_events_) + ": name one, --topic " +
                                      of_events_[0] + " (in the options: topic)");
  }

  /// @throws RecordingError where the topic, of all that the recording has, is not there
  void require_chosen() const {
    const bool missing = !chosen_.empty() && std::ranges::find(of_events_, chosen_) == of_events_.end();
    if (missing && !of_events_.empty())
      throw RecordingError(path_,
                           "topic is '" + chosen_ + "', of which no events are in it, but of " + list(of_events_));
    if (of_events_.empty())
      throw RecordingError(path_, "no topic of events in it (event_camera_msgs/EventPacket, dvs_msgs/EventArray)" +
                                      (others_.empty() ? "" : ", but " + list(others_)));
  }

  /// The format of the messages of a connection; nothing where they are not of the topic.
  std::optional<EventMessageFormat> find(std::uint32_t id) const {
    const auto found = ids_.find(id);
    return found == ids_.end() ? std::nullopt : found->second;
  }

 private:
  static constexpr std::size_t kMost = 4096;

  static std::string list(const std::vector<std::string>& names) {
    constexpr std::size_t shown = 20;
    std::string text;
    for (std::size_t i = 0; i < std::min(names.size(), shown); ++i)
      text += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
    return text + (names.size() > shown ? " and others" : "");
  }

  std::filesystem::path path_;
  std::string chosen_;
  std::vector<std::string> of_events_, others_;
  std::map<std::uint32_t, std::optional<EventMessageFormat>> ids_;
};

}  // namespace evmarker::io
