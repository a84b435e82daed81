#include "core/scene/port_hamiltonian.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/scene/descriptor.hpp"

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseLU>

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

constexpr Index largest_dense_port = 256;                 // as of scene files: above, A stays sparse
constexpr std::size_t most_inverse_entries = 50'000'000;  // of E^{-1} (J - R) Q; 1.6 GB with what makes them

SparseMatrix or_identity(const SparseMatrix& matrix, Index m) {
  if (matrix.size() > 0) return matrix;
  SparseMatrix identity(m, m);
  identity.setIdentity();
  return identity;
}

void require_square(const char* member, const SparseMatrix& found, Index m) {
  if (found.rows() != m || found.cols() != m)
    throw Error(member, text("is %td x %td", found.rows(), found.cols()), text("give %td x %td, as J", m, m));
}

void require_finite_entries(const char* member, const SparseMatrix& values) {
  for (Index j = 0; j < values.outerSize(); ++j)
    for (SparseMatrix::InnerIterator entry(values, j); entry; ++entry)
      if (!std::isfinite(entry.value()))
        throw Error(member, text("entry (%td,%td) is %g", Index(entry.row()), j, entry.value()),
                    "make every entry finite");
}

/// The first entry by which X differs from `sign` X^T, beyond the rounding of entries that were computed.
void require_symmetry(const char* member, const SparseMatrix& X, double sign, const char* word) {
  const SparseMatrix gap = X - sign * SparseMatrix(X.transpose());
  const double rounding = 64 * epsilon;
  for (Index j = 0; j < gap.outerSize(); ++j)
    for (SparseMatrix::InnerIterator entry(gap, j); entry; ++entry) {
      const double a = X.coeff(entry.row(), j), b = X.coeff(j, entry.row());
      if (std::abs(entry.value()) > rounding * std::max(std::abs(a), std::abs(b)))
        throw Error(member,
                    text("is not %s: entry (%td,%td) is %g and (%td,%td) is %g", word, Index(entry.row()), j, a, j,
                         Index(entry.row()), b),
                    text("make it %s", word));
    }
}

/// Symmetric X = D (scaled) D with unit diagonal: scaled + shift I must have a Cholesky factor. What the units of the
/// rows are does not matter.
void require_semidefinite(const char* member, const SparseMatrix& X) {
  const Index m = X.rows();
  Vector scale(m);
  for (Index i = 0; i < m; ++i) {
    const double d = X.coeff(i, i);
    if (d < 0)
      throw Error(member, text("is not positive semidefinite: entry (%td,%td) is %g", i, i, d),
                  "make it positive semidefinite");
    scale[i] = d > 0 ? 1 / std::sqrt(d) : 0;
  }
  for (Index j = 0; j < m; ++j)
    for (SparseMatrix::InnerIterator entry(X, j); entry; ++entry)
      if (entry.value() != 0 && (scale[j] == 0 || scale[entry.row()] == 0))
        throw Error(member,
                    text("is not positive semidefinite: entry (%td,%td) is %g beside a zero on the diagonal",
                         Index(entry.row()), j, entry.value()),
                    "make it positive semidefinite");
  SparseMatrix scaled = scale.asDiagonal() * X * scale.asDiagonal();
  const double shift = 128 * double(std::max<Index>(m, 8)) * epsilon;
  SparseMatrix identity(m, m);
  identity.setIdentity();
  scaled += shift * identity;
  for (Index i = 0; i < m; ++i)
    if (scale[i] == 0) scaled.coeffRef(i, i) = 1;
  const Eigen::SimplicialLDLT<SparseMatrix> factors(scaled);
  if (factors.info() != Eigen::Success || factors.vectorD().minCoeff() <= 0)
    throw Error(member, "is not positive semidefinite: it has a negative eigenvalue", "make it positive semidefinite");
}

/// E^{-1} X by blocks of columns, their zeros left out.
SparseMatrix solved_by_columns(const Eigen::SparseLU<SparseMatrix>& E, const SparseMatrix& X) {
  std::vector<Eigen::Triplet<double>> entries;
  const Index width = 64;
  for (Index first = 0; first < X.cols(); first += width) {
    const Matrix block = E.solve(Matrix(X.middleCols(first, std::min(width, X.cols() - first))));
    for (Index j = 0; j < block.cols(); ++j)
      for (Index i = 0; i < block.rows(); ++i)
        if (block(i, j) != 0) entries.emplace_back(int(i), int(first + j), block(i, j));
    if (entries.size() > most_inverse_entries)
      throw Error("E",
                  text("is not diagonal: E^{-1} (J - R) Q has more than %.0e entries", double(most_inverse_entries)),
                  "give an E with small blocks or fewer states");
  }
  SparseMatrix solution(X.rows(), X.cols());
  solution.setFromTriplets(entries.begin(), entries.end());
  return solution;
}

}  // namespace

void PortHamiltonian::validate() const {
  const Index m = J.rows();
  if (m < 1) throw Error("J", "has no rows", "give at least one state");
  if (J.cols() != m) throw Error("J", text("is %td x %td", m, J.cols()), "give a square matrix");
  require_square("R", R, m);
  if (E.size() > 0) require_square("E", E, m);
  if (Q.size() > 0) require_square("Q", Q, m);
  if (B.rows() != m && B.size() > 0)
    throw Error("B", text("has %td rows", B.rows()), text("give %td, one per state", m));
  for (const auto& [name, matrix] :
       {std::pair("E", &E), std::pair("J", &J), std::pair("R", &R), std::pair("Q", &Q), std::pair("B", &B)})
    require_finite_entries(name, *matrix);
  require_symmetry("J", J, -1, "skew-symmetric");
  require_symmetry("R", R, 1, "symmetric");
  require_semidefinite("R", R);
  const char* of_energy = E.size() == 0 ? "Q" : Q.size() == 0 ? "E" : "Q^T E";
  require_symmetry(of_energy, energy_matrix(), 1, "symmetric");
  require_semidefinite(of_energy, energy_matrix());
  if (E.size() > 0 && !is_regular(E))
    throw Error("E", "is singular, " + describe_singular(E, state_matrix()),
                "eliminate the algebraic unknowns and give a regular E");
  if (u && B.cols() == 0) throw Error("B", "is missing beside u", "give one column per entry of u");
}

SparseMatrix PortHamiltonian::state_matrix() const { return (J - R) * or_identity(Q, states()); }

SparseMatrix PortHamiltonian::energy_matrix() const {
  const Index m = states();
  return SparseMatrix(or_identity(Q, m).transpose()) * or_identity(E, m);
}

SparseMatrix PortHamiltonian::dissipation_matrix() const {
  const SparseMatrix q = or_identity(Q, states());
  return SparseMatrix(q.transpose()) * R * q;
}

SparseMatrix PortHamiltonian::output_matrix() const { return SparseMatrix(or_identity(Q, states()).transpose()) * B; }

double PortHamiltonian::energy(const Vector& x) const { return x.dot(energy_matrix() * x) / 2; }

StateSpace state_space(const PortHamiltonian& port) {
  const Index m = port.states();
  StateSpace s{port.state_matrix(), port.B};
  if (s.F.rows() != m) s.F = SparseMatrix(m, 0);
  if (port.E.size() == 0) return s;
  if (is_diagonal(port.E)) {
    const Vector inverse = port.E.diagonal().cwiseInverse();
    s.A = SparseMatrix(inverse.asDiagonal() * s.A);
    s.F = SparseMatrix(inverse.asDiagonal() * s.F);
  } else {
    Eigen::SparseLU<SparseMatrix> factors(port.E);
    s.A = solved_by_columns(factors, s.A);
    if (s.F.cols() > 0) s.F = solved_by_columns(factors, s.F);
  }
  return s;
}

Scene make_scene(PortHamiltonian port, const Vector& x0, double T) {
  port.validate();
  const Index m = port.states();
  StateSpace s = state_space(port);
  Scene scene;
  if (m <= largest_dense_port)
    scene.dynamics = DenseDynamics{Matrix(s.A), Matrix(m, 0), Matrix(0, m)};
  else
    scene.dynamics = SparseDynamics{s.A, SparseMatrix(m, 0), SparseMatrix(0, m)};
  scene.M = Matrix(0, 0);
  scene.lcp_class = LcpClass::P;
  if (port.u) {
    scene.f = port.u;
    scene.f_entry = SourceEntry::through_F;
    scene.F = s.F;
  }
  scene.x0 = x0;
  scene.T = T;
  scene.port = std::make_shared<const PortHamiltonian>(std::move(port));
  return scene;
}

Scene with_idle_constraint(Scene scene) {
  const Index m = scene.states();
  scene.dynamics = Dynamics(scene.dynamics->with_inputs_and_outputs(SparseMatrix(m, 1), SparseMatrix(1, m)));
  scene.M = Matrix(Matrix::Identity(1, 1));
  scene.lcp_class = LcpClass::P;
  return scene;
}

std::vector<double> input_jumps(const PortHamiltonian& port, double T, Index samples) {
  std::vector<double> found;
  for (const double t : port.jumps)
    if (t > 0 && t < T) found.push_back(t);
  if (!port.u) return found;
  const auto value = [&](double t) {
    Vector u(port.ports());
    port.u(t, u);
    return u;
  };
  const auto change = [](const Vector& a, const Vector& b) { return (b - a).cwiseAbs().maxCoeff(); };
  const auto time = [&](Index i) { return T * double(i) / double(samples); };
  Vector changes = Vector::Zero(samples + 2);  // of interval i at i + 1
  Vector before = value(0);
  for (Index i = 0; i < samples; ++i) {
    const Vector behind = value(time(i + 1));
    changes[i + 1] = change(before, behind);
    before = behind;
  }
  for (Index i = 0; i < samples; ++i) {
    const double beside = std::max(changes[i], changes[i + 2]);
    if (changes[i + 1] <= 2 * beside) continue;  // a smooth u changes about as much in the neighbours
    double left = time(i), right = time(i + 1);
    Vector a = value(left), b = value(right);
    while (right - left > 2 * epsilon * T) {
      const double middle = (left + right) / 2;
      const Vector c = value(middle);
      const bool first = change(a, c) > change(c, b);
      (first ? right : left) = middle;
      (first ? b : a) = c;
    }
    if (change(a, b) > 0.25 * changes[i + 1] && left > 0 && right < T) found.push_back(left);
  }
  std::sort(found.begin(), found.end());
  const double apart = 16 * epsilon * T;
  found.erase(std::unique(found.begin(), found.end(), [&](double a, double b) { return b - a <= apart; }), found.end());
  return found;
}

}  // namespace bromwich
