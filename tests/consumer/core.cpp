// What a program that needs only the core includes.
#include <cstdio>

#include "evmarker/model/camera.hpp"

int main() {
  const evmarker::PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
  const auto pixel = camera.project(Eigen::Vector3d(0, 0, 1));
  std::printf("%g %g\n", pixel.x(), pixel.y());
  return pixel.x() == 319.5 && pixel.y() == 239.5 ? 0 : 1;
}
