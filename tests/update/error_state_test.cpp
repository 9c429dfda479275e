#include "evmarker/update/error_state.hpp"

#include <doctest/doctest.h>

#include <random>

#include "evmarker/simd/wide_vectors.hpp"

using evmarker::ErrorCovariance;
using evmarker::Matrix12d;
using evmarker::MotionStep;
using evmarker::Vector12d;
namespace simd = evmarker::simd;

TEST_CASE("time that passes makes the textbook's covariance, in vectors of any width") {
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (const double carried : {0.5, -0.25, 0.0}) {
    CAPTURE(carried);
    Vector6d kept, carried_by;  // along each axis
    kept << 0.75, 0.5, 1, 0.25, 0.9, 0;
    carried_by = carried * (Vector6d() << 1, 2, 3, 0.5, 0, -1).finished();
    const Matrix12d root = Matrix12d::NullaryExpr([&] { return normal(random); });
    ErrorCovariance before;
    before.xx = root * root.transpose();
    for (Vector12d& column : before.xb) column = Vector12d::NullaryExpr([&] { return normal(random); });
    before.bb = {{{3, 0.5}, {0.5, 2}}};
    MotionStep motion{
        .q_pose = {1.5, 1, 2, 3, 0.5, 0}, .q_cross = {-0.5, 1, 0, 0.2, 2, 3}, .q_velocity = {7, 6, 5, 4, 3, 2}};
    Vector6d::Map(motion.pose_by_velocity.data()) = carried_by;
    Vector6d::Map(motion.velocity_kept.data()) = kept;
    const std::array<double, 6> q{1, 2, 3, 0.1, 0.2, 0.3};
    const Vector6d density = Eigen::Map<const Vector6d>(q.data());

    Matrix12d F = Matrix12d::Identity(), Q = Matrix12d::Zero();
    F.topRightCorner<6, 6>().diagonal() = carried_by;
    F.bottomRightCorner<6, 6>().diagonal() = kept;
    const auto noise = [&](const std::array<double, 6>& of_unit) -> Vector6d {
      return density.cwiseProduct(Eigen::Map<const Vector6d>(of_unit.data()));
    };
    Q.diagonal() << noise(motion.q_pose), noise(motion.q_velocity);
    Q.topRightCorner<6, 6>().diagonal() = noise(motion.q_cross);
    Q.bottomLeftCorner<6, 6>().diagonal() = noise(motion.q_cross);
    const Matrix12d expected = F * before.xx * F.transpose() + Q;
    REQUIRE((expected - before.xx).norm() > 1);

    ErrorCovariance narrow = before, wide = before;
    narrow.predict<128>(motion, q);
    evmarker::simd::in_packs([&](auto bits) __attribute__((always_inline)) { wide.predict<bits>(motion, q); });
    for (const ErrorCovariance& P : {narrow, wide}) {
      CHECK((P.xx - expected).norm() < 1e-13 * expected.norm());
      for (std::size_t b = 0; b < evmarker::kBiases; ++b)
        CHECK((P.xb[b] - F * before.xb[b]).norm() < 1e-14 * before.xb[b].norm());
      CHECK(P.bb == before.bb);
    }
  }
}
