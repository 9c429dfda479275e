#pragma once
// The mean of many estimates of one pose, as of one body in another's frame.
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "evmarker/base/median.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/pose_perturbation.hpp"

namespace evmarker {

/// A robust mean, and how far it can be relied on. Perturbations are as in PoseEstimate.
struct MeanPose {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();  ///< in place of T_camera_marker
  /// Covariance of the mean. It allows for errors that last for up to about a twentieth of the poses.
  Matrix6d covariance = Matrix6d::Zero();
  /// Spread of the single poses: root mean square distance from the mean, wrong ones left out by their weight.
  double spread_m = 0, spread_rad = 0;
  std::size_t poses = 0;
};

/// Averages poses in the order of their times, each weighted by its whole covariance, or all alike if one has none.
/// Wrong poses have next to no weight (the loss of Geman and McClure, twice as wide as the median residual). The
/// covariance is by the scatter of twenty parts of the time, since poses that follow each other err alike.
/// @throws std::invalid_argument if there are none
class PoseAverage {
 public:
  /// Adds the next pose.
  void add(const PoseEstimate& pose) {
    const bool known = pose.covariance && Eigen::LLT<Matrix6d>(*pose.covariance).info() == Eigen::Success;
    weighted_ = weighted_ && known;
    poses_.push_back({pose.T_camera_marker, known ? *pose.covariance : Matrix6d::Identity()});
  }

  std::size_t size() const noexcept { return poses_.size(); }

  MeanPose mean() const {
    if (poses_.empty()) throw std::invalid_argument("mean of no poses");
    MeanPose mean{.T = start(), .poses = poses_.size()};
    std::vector<Matrix6d> information;
    for (const Sample& sample : poses_)
      information.push_back(weighted_ ? Matrix6d(sample.covariance.llt().solve(Matrix6d::Identity())) : alike());
    double scale2 = 0;
    for (int round = 0; round < kRounds; ++round) {
      scale2 = loss_width2(mean.T, information);
      Matrix6d H = Matrix6d::Zero();
      Vector6d g = Vector6d::Zero();
      for (std::size_t i = 0; i < poses_.size(); ++i) {
        const Vector6d e = pose_difference(mean.T, poses_[i].T);
        const Matrix6d W = weight(e, information[i], scale2) * information[i];
        H += W;
        g += W * e;
      }
      const Vector6d step = H.llt().solve(g);
      perturb(mean.T, step);
      if (step.norm() < 1e-12) break;
    }
    describe(mean, information, scale2);
    return mean;
  }

 private:
  struct Sample {
    Eigen::Isometry3d T;
    Matrix6d covariance;
  };
  static constexpr int kRounds = 50;
  static constexpr std::size_t kParts = 20, kMostTried = 50;

  // A millimetre counts as much as 0.1 deg.
  static Matrix6d alike() {
    Vector6d diagonal;
    diagonal << Eigen::Vector3d::Constant(1e6), Eigen::Vector3d::Constant(3.3e5);
    return diagonal.asDiagonal();
  }

  static double share(const Vector6d& e, const Matrix6d& information, double scale2) {
    return 1 / (1 + e.dot(information * e) / scale2);
  }
  static double weight(const Vector6d& e, const Matrix6d& information, double scale2) {
    const double root = share(e, information, scale2);
    return root * root;
  }

  // One of the poses: that with the least sum of distances from the others.
  Eigen::Isometry3d start() const {
    const std::size_t every = (poses_.size() + kMostTried - 1) / kMostTried;
    double least = std::numeric_limits<double>::infinity();
    Eigen::Isometry3d best = poses_.front().T;
    for (std::size_t i = 0; i < poses_.size(); i += every) {
      double sum = 0;
      for (std::size_t k = 0; k < poses_.size(); k += every) {
        const Vector6d e = pose_difference(poses_[i].T, poses_[k].T);
        sum += std::sqrt(e.dot(alike() * e));
      }
      if (sum < least) best = poses_[i].T;
      least = std::min(least, sum);
    }
    return best;
  }

  // Square of the width of the loss: twice the median residual.
  double loss_width2(const Eigen::Isometry3d& T, const std::vector<Matrix6d>& information) const {
    std::vector<double> squares;
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      const Vector6d e = pose_difference(T, poses_[i].T);
      squares.push_back(e.dot(information[i] * e));
    }
    return 4 * std::max(median(std::move(squares)), 1e-12);
  }

  // Sets covariance and spread. The covariance is A^-1 G A^-1 with the derivative A of the weighted sum of residuals by
  // the mean and the scatter G of the parts of that sum; with fewer poses than parts, each is a part.
  void describe(MeanPose& mean, const std::vector<Matrix6d>& information, double scale2) const {
    const std::size_t parts = std::min(kParts, poses_.size());
    Matrix6d G = Matrix6d::Zero(), A = Matrix6d::Zero();
    double sum = 0;
    for (std::size_t part = 0, i = 0; part < parts; ++part) {
      Vector6d g = Vector6d::Zero();
      for (; i < (part + 1) * poses_.size() / parts; ++i) {
        const Vector6d e = pose_difference(mean.T, poses_[i].T);
        const double w = weight(e, information[i], scale2);
        const Vector6d pull = information[i] * e;
        A += w * information[i] - 4 / scale2 * w * share(e, information[i], scale2) * pull * pull.transpose();
        g += w * pull;
        sum += w;
        mean.spread_m += w * e.head<3>().squaredNorm();
        mean.spread_rad += w * e.tail<3>().squaredNorm();
      }
      G += g * g.transpose();
    }
    mean.spread_m = std::sqrt(mean.spread_m / sum);
    mean.spread_rad = std::sqrt(mean.spread_rad / sum);
    const Matrix6d inverse = A.ldlt().solve(Matrix6d::Identity());
    const double n = static_cast<double>(parts);
    mean.covariance = parts > 1 ? Matrix6d(n / (n - 1) * inverse * G * inverse)
                                : Matrix6d::Constant(std::numeric_limits<double>::infinity());
  }

  std::vector<Sample> poses_;
  bool weighted_ = true;
};

}  // namespace evmarker
