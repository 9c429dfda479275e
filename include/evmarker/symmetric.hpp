#pragma once
// Floor 0. Small symmetric matrices by their lower triangle: inverse without waiting, loops that unroll.
#include <Eigen/Core>

namespace evmarker {

/// Calls `use(i, j)` for every i >= j of an N x N matrix.
template <int N, typename Use>
constexpr void for_lower(const Use& use) noexcept {
#pragma GCC unroll 8
  for (int j = 0; j < N; ++j)
#pragma GCC unroll 8
    for (int i = j; i < N; ++i) use(i, j);
}

/// Copies the lower triangle to the upper one.
template <int N>
void mirror_lower(Eigen::Matrix<double, N, N>& A) noexcept {
  for_lower<N>([&](int i, int j) { A(j, i) = A(i, j); });
}

/// Turns the lower triangle of A into that of -A^-1; the upper one is left alone. False if the matrix is not definite
/// of the given sign: then the numbers mean nothing.
template <int N>
bool sweep_lower(Eigen::Matrix<double, N, N>& A, double sign = 1) noexcept {
  // Gauss-Jordan, symmetric: each sweep exchanges one unknown with its right hand side. One division for a pivot is all
  // that the next one waits for; a Cholesky decomposition has a root besides, and two triangular solves to come.
  bool definite = true;
#pragma GCC unroll 8
  for (int k = 0; k < N; ++k) {
    const double pivot = A(k, k), inverse = 1 / pivot;
    definite = definite && sign * pivot > 0;
    Eigen::Matrix<double, N, 1> u, v;  // the pivot's column, and divided by the pivot
#pragma GCC unroll 8
    for (int i = 0; i < N; ++i) u(i) = i < k ? A(k, i) : A(i, k);
#pragma GCC unroll 8
    for (int i = 0; i < N; ++i) v(i) = inverse * u(i);
    for_lower<N>([&](int i, int j) {
      if (i != k && j != k) A(i, j) -= v(j) * u(i);
    });
#pragma GCC unroll 8
    for (int i = 0; i < N; ++i) (i < k ? A(k, i) : A(i, k)) = v(i);
    A(k, k) = -inverse;
  }
  return definite;
}

/// The same for the inverse itself of a positive definite matrix.
template <int N>
bool invert_lower(Eigen::Matrix<double, N, N>& A) noexcept {
  const bool positive = sweep_lower(A);
  for_lower<N>([&](int i, int j) { A(i, j) = -A(i, j); });
  return positive;
}

}  // namespace evmarker
