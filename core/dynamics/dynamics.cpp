#include "core/dynamics/dynamics.hpp"

#include "core/base/error.hpp"

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

namespace bromwich {

namespace {

constexpr Index largest_dense_state = 4096;  // A takes 128 MiB

Matrix to_dense(const SecondDifference& d) {
  const double scale = d.diffusivity / (d.spacing * d.spacing);
  Matrix D = Matrix::Zero(d.points, d.points);
  D.diagonal().setConstant(-2 * scale);
  D.diagonal(1).setConstant(scale);
  D.diagonal(-1).setConstant(scale);
  return D;
}

DenseDynamics to_dense(const KroneckerDynamics& d) {
  const Index lines = d.along.points, length = d.across.points, m = lines * length;
  if (m > largest_dense_state)
    throw Error("dynamics", "has " + std::to_string(m) + " states",
                "give at most " + std::to_string(largest_dense_state) + " for a dense form");
  const Matrix along = to_dense(d.along), across = to_dense(d.across);
  DenseDynamics dense{Matrix::Zero(m, m), Matrix::Zero(m, lines), Matrix::Zero(lines, m)};
  for (Index l = 0; l < lines; ++l) {
    for (Index k = 0; k < lines; ++k)
      dense.A.block(l * length, k * length, length, length).diagonal().setConstant(along(l, k));
    dense.A.block(l * length, l * length, length, length) += across;
    dense.B.block(l * length, l, length, 1) = d.b;
    dense.N.block(l, l * length, 1, length) = d.n.transpose();
  }
  return dense;
}

DenseDynamics to_dense(const SparseDynamics& d) {
  if (d.A.rows() > largest_dense_state)
    throw Error("dynamics", "has " + std::to_string(d.A.rows()) + " states",
                "give at most " + std::to_string(largest_dense_state) + " for a dense form");
  return {Matrix(d.A), Matrix(d.B), Matrix(d.N), Matrix(d.E)};
}

DenseDynamics to_dense(const SuppliedDynamics&) {
  throw Error("dynamics", "is supplied by callbacks", "give A, B and N as matrices if a dense form is needed");
}

template <typename... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <class... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

}  // namespace

Vector SecondDifference::eigenvalues() const {
  const double scale = -4 * diffusivity / (spacing * spacing);
  Vector lambda(points);
  for (Index k = 1; k <= points; ++k) {
    const double s = std::sin(double(k) * std::numbers::pi / (2 * double(points + 1)));
    lambda[k - 1] = scale * s * s;
  }
  return lambda;
}

Index states(const Dynamics& dynamics) {
  return std::visit(Overloaded{[](const DenseDynamics& d) { return d.A.rows(); },
                               [](const KroneckerDynamics& d) { return d.along.points * d.across.points; },
                               [](const SparseDynamics& d) { return d.A.rows(); },
                               [](const SuppliedDynamics& d) { return d.states; }},
                    dynamics);
}

Index constraints(const Dynamics& dynamics) {
  return std::visit(Overloaded{[](const DenseDynamics& d) { return d.B.cols(); },
                               [](const KroneckerDynamics& d) { return d.along.points; },
                               [](const SparseDynamics& d) { return d.B.cols(); },
                               [](const SuppliedDynamics& d) { return d.B.cols(); }},
                    dynamics);
}

DenseDynamics to_dense(const Dynamics& dynamics) {
  return std::visit(
      Overloaded{[](const DenseDynamics& d) { return d; }, [](const KroneckerDynamics& d) { return to_dense(d); },
                 [](const SparseDynamics& d) { return to_dense(d); },
                 [](const SuppliedDynamics& d) { return to_dense(d); }},
      dynamics);
}

SparseDynamics to_sparse(const KroneckerDynamics& d) {
  const Index lines = d.along.points, length = d.across.points, m = lines * length;
  const double along = d.along.diffusivity / (d.along.spacing * d.along.spacing);
  const double across = d.across.diffusivity / (d.across.spacing * d.across.spacing);
  std::vector<Eigen::Triplet<double>> A, B, N;
  for (Index l = 0; l < lines; ++l)
    for (Index k = 0; k < length; ++k) {
      const Index i = l * length + k;
      A.emplace_back(i, i, -2 * (along + across));
      if (k > 0) A.emplace_back(i, i - 1, across);
      if (k + 1 < length) A.emplace_back(i, i + 1, across);
      if (l > 0) A.emplace_back(i, i - length, along);
      if (l + 1 < lines) A.emplace_back(i, i + length, along);
      if (d.b[k] != 0) B.emplace_back(i, l, d.b[k]);
      if (d.n[k] != 0) N.emplace_back(l, i, d.n[k]);
    }
  SparseDynamics sparse{SparseMatrix(m, m), SparseMatrix(m, lines), SparseMatrix(lines, m)};
  sparse.A.setFromTriplets(A.begin(), A.end());
  sparse.B.setFromTriplets(B.begin(), B.end());
  sparse.N.setFromTriplets(N.begin(), N.end());
  return sparse;
}

bool has_mass(const Dynamics& dynamics) {
  return std::visit(
      Overloaded{[](const KroneckerDynamics&) { return false; }, [](const SuppliedDynamics& d) { return bool(d.mass); },
                 [](const auto& d) { return d.E.rows() > 0; }},
      dynamics);
}

Vector times_mass(const Dynamics& dynamics, const Vector& x) {
  if (!has_mass(dynamics)) return x;
  return std::visit(Overloaded{[&](const KroneckerDynamics&) { return x; },
                               [&](const SuppliedDynamics& d) { return Vector(d.mass(x)); },
                               [&](const auto& d) { return Vector(d.E * x); }},
                    dynamics);
}

namespace {

SparseMatrix sparse_map(const Dynamics& dynamics, bool inputs) {
  const auto of = [inputs](const auto& d) -> const auto& { return inputs ? d.B : d.N; };
  return std::visit(Overloaded{[&](const DenseDynamics& d) -> SparseMatrix { return of(d).sparseView(); },
                               [&](const KroneckerDynamics& d) -> SparseMatrix { return of(to_sparse(d)); },
                               [&](const auto& d) -> SparseMatrix { return of(d); }},
                    dynamics);
}

}  // namespace

SparseMatrix sparse_inputs(const Dynamics& dynamics) { return sparse_map(dynamics, true); }
SparseMatrix sparse_outputs(const Dynamics& dynamics) { return sparse_map(dynamics, false); }

Dynamics with_inputs_and_outputs(Dynamics dynamics, const SparseMatrix& B, const SparseMatrix& N) {
  std::visit(Overloaded{[](KroneckerDynamics&) {
                          throw Error("dynamics", "are a Kronecker sum", "write them out to give other B and N");
                        },
                        [&](auto& d) { d.B = B, d.N = N; }},
             dynamics);
  return dynamics;
}

bool has_matrices(const Dynamics& dynamics) { return !std::holds_alternative<SuppliedDynamics>(dynamics); }

Vector observe(const Dynamics& dynamics, const Vector& x) {
  return std::visit(
      Overloaded{[&](const KroneckerDynamics& d) -> Vector {
                   // It may see the first points of a line alone.
                   Index seen = d.n.size();
                   while (seen > 1 && d.n[seen - 1] == 0) --seen;
                   return Eigen::Map<const RowMatrix>(x.data(), d.along.points, d.across.points).leftCols(seen) *
                          d.n.head(seen);
                 },
                 [&](const auto& d) -> Vector { return d.N * x; }},
      dynamics);
}

Vector observed_terms(const Dynamics& dynamics, const Vector& x) {
  return std::visit(
      Overloaded{[&](const KroneckerDynamics& d) -> Vector {
                   return Eigen::Map<const RowMatrix>(x.data(), d.along.points, d.across.points).cwiseAbs() *
                          d.n.cwiseAbs();
                 },
                 [&](const auto& d) -> Vector { return d.N.cwiseAbs() * x.cwiseAbs(); }},
      dynamics);
}

}  // namespace bromwich
