#include "core/scene/natural_sizes.hpp"

#include "core/numerics/irregular.hpp"
#include "core/scene/size_terms.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr Index most_unknowns = 4000;       ///< above: one size for all states, one for y and one for w
constexpr std::size_t most_terms = 100000;  ///< likewise
constexpr double strong = 1e-6;  ///< of the rates of two states: pairs of larger entries determine the symmetric shape
constexpr double alike = 1e-6;   ///< of two logarithms
constexpr double same_size = 1.5;  ///< decimal logarithms that a shape may move

double positive_or(double value, double otherwise) { return value > 0 && std::isfinite(value) ? value : otherwise; }

// The unknowns: decimal logarithms of X, Y, W, all of them or one for each kind.
class Sizes {
 public:
  Sizes(Index m, Index n, double terms)
      : m_(m), n_(n), each_(m + 2 * n <= most_unknowns && terms <= double(most_terms)) {}
  Index x(Index i) const { return each_ ? i : 0; }
  Index y(Index i) const { return each_ ? m_ + i : 1; }
  Index w(Index i) const { return each_ ? m_ + n_ + i : 2; }
  bool each() const { return each_; }

  void add(double value, double unit, Index of, Index in) {
    terms_.add(std::log10(std::abs(value)) - std::log10(unit), of, in);
  }
  // Entries ij and ji of A.
  void add_of_pair(double value, double back, double unit, Index of, Index in) {
    const double size = std::log10(std::abs(value)) - std::log10(unit);
    terms_.add_of_pair(size, 0.5 * (size + std::log10(std::abs(back)) - std::log10(unit)), of, in);
  }
  Vector solve() const { return terms_.solve(each_ ? m_ + 2 * n_ : 3); }

 private:
  Index m_, n_;
  bool each_;
  SizeTerms terms_;
};

template <typename Entry>
void for_entries(const SparseMatrix& A, const Entry& entry) {
  for (Index j = 0; j < A.outerSize(); ++j)
    for (SparseMatrix::InnerIterator a(A, j); a; ++a)
      if (a.value() != 0) entry(a.row(), j, a.value());
}

SparseMatrix as_sparse(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return dense->sparseView(0, 0);
  if (const auto* sparse = sparse_of(M)) return *sparse;
  std::vector<Eigen::Triplet<double>> entries;
  each_entry(std::get<Tridiagonal>(M), [&](Index i, Index j, double value) { entries.emplace_back(i, j, value); });
  SparseMatrix sparse(size(M), size(M));
  sparse.setFromTriplets(entries.begin(), entries.end());
  return sparse;
}

// The rate of a state by itself, at least 1/T.
Vector own_rates(const SparseMatrix& A, double T) {
  return Vector(A.diagonal()).cwiseAbs().cwiseMax(Vector::Constant(A.rows(), 1 / T));
}

// |x0|, or bounds from the rows of a boundary condition.
Vector initial_sizes(const Scene& scene) {
  if (!scene.boundary) return scene.x0.cwiseAbs();
  const BoundaryCondition& c = *scene.boundary;
  Vector sizes = Vector::Constant(scene.states(), INFINITY);
  for (Index i = 0; i < c.b.size(); ++i)
    for (Index j = 0; j < sizes.size(); ++j) {
      const double entry = std::max(std::abs(c.E0(i, j)), std::abs(c.ET(i, j)));
      if (entry > 0 && c.b[i] != 0) sizes[j] = std::min(sizes[j], std::abs(c.b[i]) / entry);
    }
  return sizes.unaryExpr([](double a) { return std::isfinite(a) ? a : 0; });
}

// x_i = shape_i times a factor of its component makes |A| symmetric, where that is possible.
struct SymmetricShape {
  Vector shape;
  std::vector<Index> component;  ///< -1: of none
  Index components = 0;
};

SymmetricShape symmetric_shape(const SparseMatrix& A, const Vector& rate) {
  const Index m = A.rows();
  const SparseMatrix transposed = A.transpose();
  // log of x_j/x_i, infinite where only one of the two entries is there.
  std::vector<std::vector<std::pair<Index, double>>> next;
  next.resize(std::size_t(m));
  for (Index j = 0; j < m; ++j) {
    SparseMatrix::InnerIterator back(transposed, j);
    for (SparseMatrix::InnerIterator a(A, j); a; ++a) {
      const Index i = a.row();
      while (back && back.row() < i) ++back;
      const double there = std::abs(a.value()), here = back && back.row() == i ? std::abs(back.value()) : 0;
      if (i == j || there == 0) continue;
      const double least = strong * std::sqrt(rate[i]) * std::sqrt(rate[j]);
      if (here == 0) next[std::size_t(j)].emplace_back(i, INFINITY);
      if (here == 0) next[std::size_t(i)].emplace_back(j, INFINITY);
      if (std::sqrt(there) * std::sqrt(here) > least)
        next[std::size_t(j)].emplace_back(i, 0.5 * (std::log(there) - std::log(here)));
    }
  }
  SymmetricShape s{Vector::Zero(m), std::vector<Index>(std::size_t(m), -1), 0};
  std::vector<char> seen(std::size_t(m), 0);
  for (Index root = 0; root < m; ++root) {
    if (seen[std::size_t(root)]) continue;
    bool consistent = true;
    std::vector<Index> members{root};
    seen[std::size_t(root)] = 1;
    for (std::size_t k = 0; k < members.size(); ++k)
      for (const auto& [i, ratio] : next[std::size_t(members[k])]) {
        const double found = s.shape[members[k]] + (std::isfinite(ratio) ? ratio : 0);
        if (!seen[std::size_t(i)]) {
          seen[std::size_t(i)] = 1;
          s.shape[i] = found;
          members.push_back(i);
        }
        consistent = consistent && std::isfinite(ratio) && std::abs(s.shape[i] - found) <= alike;
      }
    double largest = s.shape[root], smallest = largest;
    for (const Index i : members) largest = std::max(largest, s.shape[i]), smallest = std::min(smallest, s.shape[i]);
    if (!consistent || largest - smallest > 300) continue;
    for (const Index i : members) {
      s.shape[i] = std::exp(s.shape[i] - largest);
      s.component[std::size_t(i)] = s.components;
    }
    ++s.components;
  }
  return s;
}

// The response of a grid line to its constraint, in the slowest mode along the face.
Vector line_response(const KroneckerDynamics& d, double T) {
  const double c = d.across.diffusivity / (d.across.spacing * d.across.spacing);
  const double diagonal = 1 / T - d.face_eigenvalues().maxCoeff() + 2 * c + d.across.decay;
  const Index k = d.across.points;
  Vector upper(k), z(k);
  for (Index i = 0; i < k; ++i) {
    const double pivot = diagonal - c * (i > 0 ? upper[i - 1] : d.across.first) - (i + 1 == k ? c * d.across.last : 0);
    upper[i] = c / pivot;
    z[i] = (std::abs(d.b[i]) + (i > 0 ? c * z[i - 1] : 0)) / pivot;
  }
  for (Index i = k - 2; i >= 0; --i) z[i] += upper[i] * z[i + 1];
  return z;
}

// Gives the states of a component the sizes that make |A| symmetric, if their own sizes are close to them.
void take_symmetric_shape(const SymmetricShape& s, Vector& x) {
  Vector sum = Vector::Zero(s.components), count = sum, worst = sum;
  const auto each = [&](const auto& take) {
    for (Index i = 0; i < x.size(); ++i)
      if (const Index c = s.component[std::size_t(i)]; c >= 0) take(i, c, std::log10(s.shape[i]));
  };
  each([&](Index i, Index c, double shape) { sum[c] += x[i] - shape, count[c] += 1; });
  each([&](Index i, Index c, double shape) {
    worst[c] = std::max(worst[c], std::abs(x[i] - shape - sum[c] / count[c]));
  });
  each([&](Index i, Index c, double shape) {
    if (worst[c] <= same_size) x[i] = sum[c] / count[c] + shape;
  });
}

Vector powers_of_ten(const Vector& logarithms) {
  return logarithms.unaryExpr([](double a) { return std::pow(10.0, a); });
}

void add_f(const SparseDynamics& d, const Scene& scene, const Vector& rate, Sizes& sizes) {
  if (!scene.f) return;
  const Vector phi = largest_values(scene.f, scene.sources(), scene);
  const Vector f = scene.f_entry == SourceEntry::through_F   ? Vector(scene.F.cwiseAbs() * phi)
                   : scene.f_entry == SourceEntry::through_B ? Vector(d.B.cwiseAbs() * phi)
                                                             : phi;
  for (Index i = 0; i < f.size(); ++i) sizes.add(f[i], rate[i], -1, sizes.x(i));
}

void add_matrices(const SparseDynamics& d, const SparseMatrix& M, const Vector& rate, Sizes& sizes) {
  if (sizes.each())
    for_entries(d.A, [&](Index i, Index j, double a) {
      if (i == j) return;
      if (const double back = d.A.coeff(j, i); back != 0)
        sizes.add_of_pair(a, back, std::sqrt(rate[i]) * std::sqrt(rate[j]), sizes.x(j), sizes.x(i));
      else
        sizes.add(a, rate[i], sizes.x(j), sizes.x(i));
    });
  for_entries(d.B, [&](Index i, Index j, double b) { sizes.add(b, rate[i], sizes.y(j), sizes.x(i)); });
  for_entries(d.N, [&](Index i, Index j, double a) { sizes.add(a, 1, sizes.x(j), sizes.w(i)); });
  for_entries(M, [&](Index i, Index j, double a) { sizes.add(a, 1, sizes.y(j), sizes.w(i)); });
}

// What modes with memory add to the scene, and where they set a state.
void add_modes(const Scene& scene, const Vector& rate, Sizes& sizes) {
  const Index m = scene.states(), n = scene.constraints();
  const auto sparse = [](const Matrix& a, Index rows, Index columns) {
    return a.size() > 0 ? SparseMatrix(a.sparseView(0, 0)) : SparseMatrix(rows, columns);
  };
  for (const Memory& memory : scene.memories)
    for (const Memory::Mode& mode : memory.modes) {
      add_matrices({sparse(mode.A, m, m), sparse(mode.B, m, n), sparse(mode.N, n, m)}, sparse(mode.M, n, n), rate,
                   sizes);
      const Vector f = largest_values(mode.f, m, scene), g = largest_values(mode.g, n, scene);
      for (Index i = 0; i < m; ++i) sizes.add(f[i], rate[i], -1, sizes.x(i));
      for (Index i = 0; i < n; ++i) sizes.add(g[i], 1, -1, sizes.w(i));
      for (const Memory::Leave& leave : mode.leave)
        for (const Memory::Jump& jump : leave.set) sizes.add(std::abs(jump.value), 1, -1, sizes.x(jump.state));
    }
}

// `terms`: number of entries of the matrices. Above the limit, or if the iteration fails: common sizes.
NaturalSizes sizes_of(const SparseDynamics& d, const SparseMatrix& M, const Scene& scene, double terms) {
  const Index m = scene.states(), n = scene.constraints();
  const Vector rate = own_rates(d.A, scene.T), x0 = initial_sizes(scene), g = largest_values(scene.g, n, scene);
  Sizes sizes(m, n, terms);
  add_matrices(d, M, rate, sizes);
  for (Index i = 0; i < m; ++i) sizes.add(x0[i], 1, -1, sizes.x(i));
  add_modes(scene, rate, sizes);
  for (Index i = 0; i < n; ++i) sizes.add(g[i], 1, -1, sizes.w(i));
  add_f(d, scene, rate, sizes);
  const Vector u = sizes.solve();
  if (u.size() == 0) return sizes_of(d, M, scene, INFINITY);
  Vector x(m), y(n), w(n);
  for (Index i = 0; i < m; ++i) x[i] = u[sizes.x(i)];
  for (Index i = 0; i < n; ++i) y[i] = u[sizes.y(i)], w[i] = u[sizes.w(i)];
  if (sizes.each()) take_symmetric_shape(symmetric_shape(d.A, rate), x);
  return {powers_of_ten(x), powers_of_ten(y), powers_of_ten(w)};
}

// Rows divided by the largest entry of E in them, which has to do for E^{-1}: only sizes are wanted.
SparseDynamics with_lumped_mass(const SparseDynamics& d) {
  Vector largest = Vector::Zero(d.A.rows());
  for_entries(d.E, [&](Index i, Index, double e) { largest[i] = std::max(largest[i], std::abs(e)); });
  const Vector inverse = largest.unaryExpr([](double e) { return e > 0 ? 1 / e : 1; });
  return {inverse.asDiagonal() * d.A, inverse.asDiagonal() * d.B, d.N};
}

NaturalSizes sizes_of(const SparseDynamics& given, const Scene& scene) {
  const SparseDynamics d = given.E.rows() > 0 ? with_lumped_mass(given) : given;
  const SparseMatrix M = as_sparse(scene.M);
  return sizes_of(d, M, scene, double(d.A.nonZeros() + d.B.nonZeros() + d.N.nonZeros() + M.nonZeros()));
}

NaturalSizes sizes_of(const Scene& scene) {
  const Index m = scene.states(), n = scene.constraints();
  if (const auto* d = scene.dynamics->small_state())
    return sizes_of({d->A.sparseView(0, 0), d->B.sparseView(0, 0), d->N.sparseView(0, 0)}, scene);
  if (const auto* d = scene.dynamics->matrices()) return sizes_of(*d, scene);
  const auto* modes = scene.dynamics->modes();
  const CommonSizes s = modes ? common_sizes(*modes, scene) : CommonSizes{1, 1, 1};
  return {Vector::Constant(m, s.x), Vector::Constant(n, s.y), Vector::Constant(n, s.w)};
}

}  // namespace

Vector largest_values(const TimeFunction& function, Index width, const Scene& scene) {
  Vector largest = Vector::Zero(width);
  if (!function) return largest;
  constexpr int samples = 16;
  Vector value(width);
  for (int k = 0; k <= samples; ++k) {
    value.setZero();
    function(irregular(k) * scene.T, value);
    for (Index i = 0; i < width; ++i)
      if (std::isfinite(value[i])) largest[i] = std::max(largest[i], std::abs(value[i]));
  }
  return largest;
}

CommonSizes common_sizes(const KroneckerDynamics& d, const Scene& scene) {
  const Index n = scene.constraints();
  const Vector z = line_response(d, scene.T), g = largest_values(scene.g, n, scene);
  const double phi = scene.f ? largest_values(scene.f, scene.sources(), scene).maxCoeff() : 0;
  const double gain = diagonal(scene.M).cwiseAbs().maxCoeff() + d.n.cwiseAbs().dot(z);
  const double of_x0 = scene.boundary ? initial_sizes(scene).maxCoeff() : scene.x0.cwiseAbs().maxCoeff(),
               at_start = scene.boundary ? 0 : observe(scene.dynamics, scene.x0).cwiseAbs().maxCoeff();
  const double w = positive_or(std::max({g.maxCoeff(), at_start, d.n.cwiseAbs().dot(z) * phi}), 1);
  const double y = positive_or(w / gain, 1);
  const double x = positive_or(std::max(of_x0, z.maxCoeff() * std::max(y, phi)), 1);
  return {x, y, w};
}

NaturalSizes natural_sizes(const Scene& scene) {
  NaturalSizes s = sizes_of(scene);
  for (Vector* some : {&s.x, &s.y, &s.w})
    for (double& size : *some) size = positive_or(size, 1);
  return s;
}

}  // namespace bromwich
