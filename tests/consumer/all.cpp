// What a program that reads recordings and detects markers includes.
#include <cstdio>
#include <vector>

#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/io/event_reader.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "evmarker/live/pipeline.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/aruco_detector.hpp"

int main() {
  const std::vector<evmarker::Event> events{{1, 2, 1, 100}, {3, 4, 0, 200}};
  evmarker::io::RawWriter writer("consumer.raw", {640, 480});
  writer.write(events);
  writer.close();

  evmarker::io::EventReader reader("consumer.raw");
  const auto batch = reader.next_batch();
  const bool same = std::vector(batch.begin(), batch.end()) == events;

  const evmarker::PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
  evmarker::opencv::ArucoDetector detector(camera, {.dictionary = "DICT_4X4_50", .marker_length = 0.10});
  const auto detections = detector.detect(evmarker::PolarityFrame(camera.sensor_size()));

  evmarker::live::Pipeline pipeline(camera, detector, [](const evmarker::PoseEstimate&) {});
  pipeline.push(events);
  pipeline.flush();
  const bool taken = pipeline.status().events == events.size();
  pipeline.stop();

  std::printf("recording %s, %zu markers in an empty frame\n", same ? "read back" : "differs", detections.size());
  return same && taken && detections.empty() ? 0 : 1;
}
