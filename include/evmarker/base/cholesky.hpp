#pragma once
// Solves symmetric systems of a few equations.
#include <array>
#include <cmath>
#include <cstddef>

namespace evmarker {

/// Cholesky's factors A = L L^T of a symmetric, positive definite N x N matrix; if A is not positive definite,
/// solutions are not finite. Eigen's solvers of fixed size take long to compile, a dozen types for each row.
template <std::size_t N>
class Cholesky {
 public:
  using Vector = std::array<double, N>;
  using Matrix = std::array<Vector, N>;

  /// @param A of which only the lower triangle, A[row][column] with column <= row, is used
  explicit Cholesky(const Matrix& A) noexcept {
    for (std::size_t k = 0; k < N; ++k)
      for (std::size_t i = 0; i <= k; ++i) {
        double rest = A[k][i];
        for (std::size_t j = 0; j < i; ++j) rest -= L_[k][j] * L_[i][j];
        L_[k][i] = i < k ? rest / L_[i][i] : std::sqrt(rest);
      }
  }

  /// The x for which A x = b.
  Vector solve(Vector b) const noexcept {
    for (std::size_t i = 0; i < N; ++i) {
      for (std::size_t j = 0; j < i; ++j) b[i] -= L_[i][j] * b[j];
      b[i] /= L_[i][i];
    }
    for (std::size_t i = N; i-- > 0;) {
      for (std::size_t j = i + 1; j < N; ++j) b[i] -= L_[j][i] * b[j];
      b[i] /= L_[i][i];
    }
    return b;
  }

 private:
  Matrix L_{};  // lower triangle
};

}  // namespace evmarker
