#include "core/lcp/stencil.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

std::optional<Stencil> of_bands(const Tridiagonal& M, const std::vector<Index>& extents) {
  const Index n = M.diagonal.size();
  if (extents.size() != 1 || extents[0] != n || n == 0) return std::nullopt;
  const Stencil s{extents, M.diagonal[0], {n > 1 ? M.upper[0] : 0}};
  for (Index i = 0; i < n; ++i)
    if (M.diagonal[i] != s.centre || (i > 0 && M.lower[i] != s.beside[0]) || (i + 1 < n && M.upper[i] != s.beside[0]))
      return std::nullopt;
  return s;
}

}  // namespace

std::optional<Stencil> stencil_of(const SparseMatrix& M, const std::vector<Index>& extents) {
  const Index n = M.rows();
  std::vector<Index> strides(extents.size());
  Index points = 1;
  for (std::size_t d = extents.size(); d-- > 0; points *= extents[d]) strides[d] = points;
  if (points != n || n == 0) return std::nullopt;
  Stencil s{extents, M.coeff(0, 0), std::vector<double>(extents.size(), 0)};
  Index expected = s.centre != 0 ? n : 0;
  for (std::size_t d = 0; d < extents.size(); ++d) {
    if (extents[d] < 2) continue;
    s.beside[d] = M.coeff(0, strides[d]);
    expected += s.beside[d] != 0 ? 2 * (n / extents[d]) * (extents[d] - 1) : 0;
  }
  Index found = 0;
  for (Index j = 0; j < M.outerSize(); ++j)
    for (SparseMatrix::InnerIterator a(M, j); a; ++a) {
      if (a.value() == 0) continue;
      ++found;
      bool fits = a.row() == j && a.value() == s.centre;
      for (std::size_t d = 0; d < extents.size() && a.row() != j; ++d) {
        const Index low = std::min<Index>(a.row(), j), high = std::max<Index>(a.row(), j);
        fits = fits ||
               (high - low == strides[d] && low / strides[d] % extents[d] + 1 < extents[d] && a.value() == s.beside[d]);
      }
      if (!fits) return std::nullopt;
    }
  return found == expected ? std::optional(s) : std::nullopt;
}

Vector Stencil::eigenvalues() const {
  Vector sums = Vector::Constant(1, centre);
  for (std::size_t d = 0; d < extents.size(); ++d) {
    const Vector before = sums;
    const Index n = extents[d];
    Vector own(n);
    for (Index l = 0; l < n; ++l) own[l] = 2 * beside[d] * std::cos(std::numbers::pi * double(l + 1) / double(n + 1));
    sums.resize(before.size() * n);
    for (Index i = 0; i < before.size(); ++i) sums.segment(i * n, n) = own.array() + before[i];
  }
  return sums;
}

double Stencil::jacobi_radius() const {
  double sum = 0;
  for (std::size_t d = 0; d < extents.size(); ++d)
    sum += 2 * std::abs(beside[d]) * std::cos(std::numbers::pi / double(extents[d] + 1));
  return sum / centre;
}

Stencil Stencil::shifted(double D) const {
  Stencil s = *this;
  s.centre += D;
  return s;
}

std::optional<Stencil> stencil_of(const LcpMatrix& M, const std::vector<Index>& extents) {
  if (const auto* bands = std::get_if<Tridiagonal>(&M)) {
    if (extents.size() == 1) return of_bands(*bands, extents);
    SparseMatrix entries(bands->diagonal.size(), bands->diagonal.size());
    std::vector<Eigen::Triplet<double>> all;
    each_entry(*bands, [&](Index i, Index j, double value) {
      if (value != 0) all.emplace_back(i, j, value);
    });
    entries.setFromTriplets(all.begin(), all.end());
    return stencil_of(entries, extents);
  }
  const SparseMatrix* sparse = sparse_of(M);
  return sparse ? stencil_of(*sparse, extents) : std::nullopt;
}

std::optional<Stencil> stencil_in(const FaceBasis& basis, const LcpMatrix& M) {
  auto stencil = stencil_of(M, basis.extents());
  const auto zero = [](double b) { return b == 0; };
  if (stencil && !basis.is_sine() && !std::all_of(stencil->beside.begin(), stencil->beside.end(), zero))
    return std::nullopt;
  return stencil;
}

std::optional<Vector> eigenvalues_in(const FaceBasis& basis, const LcpMatrix& matrix) {
  const auto* dense = std::get_if<Matrix>(&matrix);
  const auto stencil = stencil_in(basis, dense ? LcpMatrix(SparseLcpMatrix(dense->sparseView(0, 0))) : matrix);
  if (stencil) return stencil->eigenvalues();
  if (basis.size() != 1 || basis.is_sine()) return std::nullopt;
  constexpr double rounding = 1e-12;
  const SparseMatrix M = to_dense(matrix).sparseView(0, 0);
  const Matrix V = basis.matrix(), MV = M * V;
  const Vector values = V.cwiseProduct(MV).colwise().sum();
  const double apart = (MV - V * values.asDiagonal()).cwiseAbs().maxCoeff();
  return apart <= rounding * M.norm() ? std::optional(values) : std::nullopt;
}

double best_relaxation(const Stencil& s) {
  const double rho = s.jacobi_radius();
  return 2 / (1 + std::sqrt(std::max(0.0, 1 - rho * rho)));
}

InstantShift instant_shift(const Vector& eigenvalues_of_M, const Vector& w0) {
  constexpr int candidates = 240;
  constexpr double least_diagonal = 0.05;  // M + D I keeps this part of the smallest eigenvalue of M
  const auto contraction = [&](double D) {
    return ((w0.array() - D).abs() / (eigenvalues_of_M.array() + D)).maxCoeff();
  };
  InstantShift best{0, contraction(0)};
  const double lowest = std::max(w0.minCoeff(), (least_diagonal - 1) * eigenvalues_of_M.minCoeff());
  const double highest = std::max(w0.maxCoeff(), lowest);
  for (int i = 0; i <= candidates; ++i) {
    const double D = lowest + (highest - lowest) * double(i) / candidates;
    if (const double c = contraction(D); c < best.contraction) best = {D, c};
  }
  return best;
}

}  // namespace bromwich
