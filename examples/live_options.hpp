#pragma once
// The options of the programs that track on threads, and the last line of their output.
#include <cinttypes>
#include <cstddef>
#include <cstdio>
#include <evmarker/live/pipeline.hpp>
#include <map>
#include <span>
#include <string>

#include "track_options.hpp"

struct LiveOptions : TrackOptions {
  std::string policy = "drop-oldest";
  std::string priority = "automatic";
  std::string triggers;
  std::size_t queue_events = evmarker::live::PipelineSettings<>{}.queue_events;

  void add_to(CLI::App& app) {
    TrackOptions::add_to(app);
    app.get_option("--output")->description("poses of every marker (also --poses)");
    app.add_option("--poses", output, "poses of every marker")->excludes("--output");
    app.add_option("--policy", policy, "when events come too fast: block, drop-oldest or thin")
        ->check(CLI::IsMember({"block", "drop-oldest", "thin"}))
        ->capture_default_str();
    app.add_option("--queue-events", queue_events, "that may wait at most")
        ->check(CLI::Range(1024, 1 << 28))
        ->capture_default_str();
    app.add_option("--priority", priority, "of the tracking: automatic (real-time where that is permitted) or normal")
        ->check(CLI::IsMember({"automatic", "normal"}))
        ->capture_default_str();
    app.add_option("--triggers", triggers, "the camera's external trigger events as CSV");
  }

  evmarker::live::TrackingPriority tracking_priority() const {
    using evmarker::live::TrackingPriority;
    return priority == "normal" ? TrackingPriority::normal : TrackingPriority::automatic;
  }

  /// @param output_poses takes the poses at a fixed rate, if they are wanted so
  template <evmarker::PoseUpdateRule Rule>
  evmarker::live::PipelineSettings<Rule> pipeline_settings(const typename Rule::Settings& rule,
                                                           PoseOutput& output_poses) const {
    using evmarker::live::OverloadPolicy;
    const std::map<std::string, OverloadPolicy> policies{
        {"block", OverloadPolicy::block}, {"drop-oldest", OverloadPolicy::drop_oldest}, {"thin", OverloadPolicy::thin}};
    evmarker::live::PipelineSettings<Rule> pipeline{.tracker = settings<Rule>(rule),
                                                    .overload = policies.at(policy),
                                                    .queue_events = queue_events,
                                                    .priority = tracking_priority()};
    if (const auto every = interval()) {
      pipeline.tick_interval = *every;
      pipeline.on_tick = [&output_poses](evmarker::Timestamp, std::span<const evmarker::PoseEstimate> poses) {
        output_poses.write(poses);
      };
    }
    return pipeline;
  }
};

inline void print_last_line(const evmarker::live::Status& s) {
  std::printf("latency_us p50=%.0f p99=%.0f max=%.0f events=%" PRIu64 " filtered=%" PRIu64 " dropped=%" PRIu64
              " poses=%" PRIu64 "\n",
              s.push_to_pose.p50_us, s.push_to_pose.p99_us, s.push_to_pose.max_us, s.events, s.filtered, s.dropped,
              s.poses);
}
