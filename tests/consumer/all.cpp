// What a program that reads recordings and detects markers includes.
#include <opencv2/aruco.hpp>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "evmarker/camera.hpp"

int main() {
  std::thread([] {}).join();
  const cv::Ptr<cv::aruco::Dictionary> dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
  return dictionary->bytesList.rows == 50 ? 0 : 1;
}
