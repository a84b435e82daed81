// N (zI - A)^{-1} B for A = X^{-1} (I ⊗ across + V diag(mu) V^{-1} ⊗ I) X. With the points k that N sees and the points
// j that B enters, N_k and B_j the parts of N X^{-1} and X B there (rows x lines, lines x columns),
//
//     N (zI - A)^{-1} B = Σ_k (N_k V) Σ_j diag_l(G_l(k, j)) (V^{-1} B_j),   G_l = ((z - mu_l) I - across)^{-1}.
//
// Columns that enter many points (x0, F) are transformed once, to lines x points, and solved line by line.
//
// symbol      variable          shape
// N_k V       Seen::NV          rows x lines, for each k
// V^{-1} B_j  Entered::VB       lines x columns, for each j
// G_l         LineSolver        one factorization of a line for each z and l
//
// A column (zI - A) u, u = ±1, whose answer N u is known, is solved along. Where a node misses it, the elimination of
// the sparse matrices takes all nodes: A was changed, or a line would need pivots.

#include "core/dynamics/grid_system.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <utility>

namespace bromwich {

namespace {

constexpr Index most_lines = 4096;        ///< V takes 128 MiB
constexpr double most_oblique = 1e4;      ///< condition number of V: four of sixteen digits
constexpr Index most_points = 8;          ///< that N sees, and that most columns of B enter
constexpr Index most_dense_columns = 64;  ///< x0, F
constexpr double accepted_miss = 1e-8;    ///< as in sparse_solves.cpp

struct Axis {
  Matrix V, inverse;
  Vector mu;
  double oblique = 1;
};

// T = D S D^{-1}, S symmetric, D_i/D_{i-1} = sqrt(T_{i,i-1}/T_{i-1,i}); both are positive where |v| dx < 2 c.
Axis axis_of(const SparseMatrix& T) {
  const Index n = T.rows();
  Axis axis;
  Vector diagonal = T.diagonal(), off(std::max<Index>(n - 1, 0)), logarithm = Vector::Zero(n);
  for (Index i = 1; i < n; ++i) {
    const double before = T.coeff(i, i - 1), after = T.coeff(i - 1, i);
    off[i - 1] = std::sqrt(before * after);
    logarithm[i] = logarithm[i - 1] + std::log(before / after) / 2;
  }
  axis.oblique = std::exp(logarithm.maxCoeff() - logarithm.minCoeff());
  Eigen::SelfAdjointEigenSolver<Matrix> solver;
  solver.computeFromTridiagonal(diagonal, off);
  const Vector D = (logarithm.array() - (logarithm.maxCoeff() + logarithm.minCoeff()) / 2).exp();
  axis.V = D.asDiagonal() * solver.eigenvectors();
  axis.inverse = solver.eigenvectors().transpose() * D.cwiseInverse().asDiagonal();
  axis.mu = solver.eigenvalues();
  return axis;
}

Matrix kronecker(const Matrix& a, const Matrix& b) {
  Matrix all(a.rows() * b.rows(), a.cols() * b.cols());
  for (Index j = 0; j < a.cols(); ++j)
    for (Index i = 0; i < a.rows(); ++i) all.block(i * b.rows(), j * b.cols(), b.rows(), b.cols()) = a(i, j) * b;
  return all;
}

// ((z - mu) I - across)^{-1} by elimination without exchanges.
class LineSolver {
 public:
  explicit LineSolver(const GridModes& g) : g_(g), pivot_(g.points()) {}

  void factorize(Complex shift) {
    for (Index i = 0; i < g_.points(); ++i) {
      const Complex lost = i > 0 ? g_.before[i] * g_.after[i - 1] * pivot_[i - 1] : Complex(0);
      pivot_[i] = 1.0 / (shift - g_.at[i] - lost);
    }
  }
  template <class Column>
  void solve(Column&& v) const {
    const Index n = g_.points();
    for (Index i = 1; i < n; ++i) v[i] += g_.before[i] * pivot_[i - 1] * v[i - 1];
    v[n - 1] *= pivot_[n - 1];
    for (Index i = n - 1; i-- > 0;) v[i] = pivot_[i] * (v[i] + g_.after[i] * v[i + 1]);
  }

 private:
  const GridModes& g_;
  ComplexVector pivot_;
};

// What N sees at one point of all lines.
struct Seen {
  Index point = 0;
  std::vector<Index> rows;
  Matrix NV;  ///< rows x lines
};

struct Entered {
  Index point = 0;
  RowMatrix VB;  ///< lines x columns
};

// A column that enters many points: lines x points, in modes.
struct DenseColumn {
  Index column = 0;
  RowMatrix values;
};

using Entries = std::map<Index, std::vector<Eigen::Triplet<double>>>;  ///< by the point of a line

// The parts of N and B in modes.
class Parts {
 public:
  Parts(const SparseDynamics& d, const GridModes& g, const Vector& X) : g_(g), X_(X), columns_(d.B.cols()) {
    split_outputs(d.N);
    split_inputs(d.B);
    Vector u(d.A.rows());
    unsigned long long random = 1;
    for (double& value : u) {
      random = random * 6364136223846793005ULL + 1442695040888963407ULL;
      value = random >> 63 ? 1 : -1;
    }
    known = d.N * u;
    scale = d.N.cwiseAbs() * Vector::Ones(u.size());
    test = in_modes(u);
    A_test = in_modes(d.A * u);
  }

  // N X^{-1} and X B have so few points that the parts pay.
  static bool few(const SparseDynamics& d, Index points) {
    std::vector<char> seen(std::size_t(points), 0), entered(seen);
    Index dense = 0;
    for (Index c = 0; c < d.N.cols(); ++c)
      if (SparseMatrix::InnerIterator(d.N, c)) seen[std::size_t(c % points)] = 1;
    for (Index c = 0; c < d.B.cols(); ++c) {
      if (is_dense(d.B, c, points)) {
        ++dense;
        continue;
      }
      for (SparseMatrix::InnerIterator b(d.B, c); b; ++b) entered[std::size_t(b.row() % points)] = 1;
    }
    const auto count = [](const std::vector<char>& which) { return std::count(which.begin(), which.end(), 1); };
    return dense <= most_dense_columns && count(seen) <= most_points && count(entered) <= most_points;
  }

  std::vector<Seen> seen;
  std::vector<Entered> entered;
  std::vector<DenseColumn> dense;
  RowMatrix test, A_test;  ///< u and A u in modes
  Vector known, scale;     ///< N u, |N| 1

 private:
  double factor(Index state) const { return X_.size() > 0 ? X_[state] : 1; }

  static bool is_dense(const SparseMatrix& B, Index column, Index points) {
    Index entries = 0, first = -1, spread = 0;
    for (SparseMatrix::InnerIterator b(B, column); b; ++b, ++entries) {
      if (first < 0) first = b.row() / points;
      spread = std::max(spread, std::abs(b.row() / points - first));
    }
    return entries > most_points || spread > 0;
  }

  RowMatrix in_modes(Vector v) const {
    if (X_.size() > 0) v = v.cwiseProduct(X_);
    return g_.inverse * Eigen::Map<const RowMatrix>(v.data(), g_.lines(), g_.points());
  }

  void split_outputs(const SparseMatrix& N) {
    Entries entries;
    for (Index state = 0; state < N.cols(); ++state)
      for (SparseMatrix::InnerIterator e(N, state); e; ++e)
        entries[state % g_.points()].emplace_back(e.row(), state / g_.points(), e.value() / factor(state));
    for (const auto& [point, list] : entries) {
      Seen part{point, {}, {}};
      for (const auto& e : list) part.rows.push_back(e.row());
      std::sort(part.rows.begin(), part.rows.end());
      part.rows.erase(std::unique(part.rows.begin(), part.rows.end()), part.rows.end());
      part.NV = Matrix::Zero(Index(part.rows.size()), g_.lines());
      for (const auto& e : list) {
        const auto at = std::lower_bound(part.rows.begin(), part.rows.end(), Index(e.row())) - part.rows.begin();
        part.NV.row(at) += e.value() * g_.V.row(e.col());
      }
      seen.push_back(std::move(part));
    }
  }

  void split_inputs(const SparseMatrix& B) {
    Entries entries;
    for (Index c = 0; c < B.cols(); ++c) {
      if (is_dense(B, c, g_.points())) {
        dense.push_back({c, in_modes(Vector(B.col(c)))});
        continue;
      }
      for (SparseMatrix::InnerIterator e(B, c); e; ++e)
        entries[e.row() % g_.points()].emplace_back(e.row() / g_.points(), c, e.value() * factor(e.row()));
    }
    for (const auto& [point, list] : entries) {
      Entered part{point, RowMatrix::Zero(g_.lines(), columns_)};
      for (const auto& e : list) part.VB.col(e.col()) += e.value() * g_.inverse.col(e.row());
      entered.push_back(std::move(part));
    }
  }

  const GridModes& g_;
  const Vector& X_;
  Index columns_;
};

// The values of one node, or false where the known column is missed.
bool solve_node(const Parts& parts, const GridModes& g, Complex z, Eigen::Ref<Eigen::RowVectorXcd> out, Index columns) {
  const Index lines = g.lines(), rows = parts.known.size(), places = Index(parts.seen.size());
  // For each point that is seen: lines x (columns, test), real parts and imaginary parts.
  std::vector<RowMatrix> W[2];
  for (auto& part : W) part.assign(std::size_t(places), RowMatrix::Zero(lines, columns + 1));
  LineSolver line(g);
  ComplexVector v(g.points());
  const auto add = [&](Index l, Index k, Index c, Complex value) {
    W[0][std::size_t(k)](l, c) += value.real();
    W[1][std::size_t(k)](l, c) += value.imag();
  };
  const auto point = [&](Index k) { return parts.seen[std::size_t(k)].point; };
  for (Index l = 0; l < lines; ++l) {
    line.factorize(z - g.mu[l]);
    for (const Entered& in : parts.entered) {
      v.setZero();
      v[in.point] = 1;
      line.solve(v);
      for (Index k = 0; k < places; ++k) {
        W[0][std::size_t(k)].row(l).head(columns) += v[point(k)].real() * in.VB.row(l);
        W[1][std::size_t(k)].row(l).head(columns) += v[point(k)].imag() * in.VB.row(l);
      }
    }
    for (const DenseColumn& column : parts.dense) {
      v = column.values.row(l).transpose().cast<Complex>();
      line.solve(v);
      for (Index k = 0; k < places; ++k) add(l, k, column.column, v[point(k)]);
    }
    v = z * parts.test.row(l).transpose().cast<Complex>() - parts.A_test.row(l).transpose().cast<Complex>();
    line.solve(v);
    for (Index k = 0; k < places; ++k) add(l, k, columns, v[point(k)]);
  }
  ComplexMatrix R = ComplexMatrix::Zero(rows, columns + 1);
  for (Index k = 0; k < places; ++k) {
    const Seen& seen = parts.seen[std::size_t(k)];
    const Matrix real = seen.NV * W[0][std::size_t(k)], imaginary = seen.NV * W[1][std::size_t(k)];
    for (Index i = 0; i < Index(seen.rows.size()); ++i) {
      R.row(seen.rows[std::size_t(i)]).real() += real.row(i);
      R.row(seen.rows[std::size_t(i)]).imag() += imaginary.row(i);
    }
  }
  for (Index i = 0; i < rows; ++i) {
    if (!(std::abs(R(i, columns) - parts.known[i]) <= accepted_miss * parts.scale[i])) return false;
    out.segment(i * columns, columns) = R.row(i).head(columns);
  }
  return out.allFinite();
}

}  // namespace

std::shared_ptr<const GridModes> GridModes::of(const std::vector<SparseMatrix>& directions, double reaction) {
  Index lines = 1;
  for (std::size_t i = 0; i + 1 < directions.size(); ++i) lines *= directions[i].rows();
  if (lines > most_lines) return nullptr;
  auto g = std::make_shared<GridModes>();
  g->V = g->inverse = Matrix::Identity(1, 1);
  g->mu = Vector::Zero(1);
  double oblique = 1;
  for (std::size_t i = 0; i + 1 < directions.size(); ++i) {
    const Axis axis = axis_of(directions[i]);
    oblique *= axis.oblique;
    if (!(oblique <= most_oblique)) return nullptr;
    g->V = kronecker(g->V, axis.V);
    g->inverse = kronecker(g->inverse, axis.inverse);
    const Vector slower = g->mu;
    g->mu.resize(slower.size() * axis.mu.size());
    for (Index k = 0; k < slower.size(); ++k)
      g->mu.segment(k * axis.mu.size(), axis.mu.size()) = axis.mu.array() + slower[k];
  }
  const SparseMatrix& across = directions.back();
  const Index points = across.rows();
  g->at = across.diagonal().array() - reaction;
  g->before = g->after = Vector::Zero(points);
  for (Index i = 1; i < points; ++i) {
    g->before[i] = across.coeff(i, i - 1);
    g->after[i - 1] = across.coeff(i - 1, i);
  }
  return g;
}

GridSystem::GridSystem(SparseDynamics d, std::shared_ptr<const GridModes> modes, Vector X,
                       std::shared_ptr<const SymmetricForm> form)
    : SparseSystem(std::move(d)), modes_(std::move(modes)), X_(std::move(X)), form_(std::move(form)) {}

std::shared_ptr<LinearSystem> GridSystem::with_inputs_and_outputs(const SparseMatrix& B, const SparseMatrix& N) const {
  return std::make_shared<GridSystem>(SparseDynamics{d.A, B, N, d.E}, modes_, X_);
}

std::shared_ptr<LinearSystem> GridSystem::in_units(SparseDynamics scaled, const Vector& unit) const {
  return std::make_shared<GridSystem>(std::move(scaled), modes_, X_.size() > 0 ? Vector(X_.cwiseProduct(unit)) : unit);
}

bool GridSystem::solves_in_modes() const {
  return modes_ && !has_mass() && d.A.rows() == modes_->lines() * modes_->points() && Parts::few(d, modes_->points());
}

ComplexMatrix GridSystem::solve_at(const ComplexVector& nodes, const HostThreads& threads) const {
  if (!solves_in_modes()) return SparseSystem::solve_at(nodes, threads);
  const Parts parts(d, *modes_, X_);
  const Index columns = d.B.cols();
  ComplexMatrix R(nodes.size(), d.N.rows() * columns);
  std::atomic<bool> missed = false;
  share(threads, nodes.size(), 1, [&](Index first, Index last) {
    Eigen::RowVectorXcd row(R.cols());
    for (Index p = first; p < last && !missed; ++p) {
      if (!solve_node(parts, *modes_, nodes[p], row, columns)) missed = true;
      R.row(p) = row;
    }
  });
  return missed ? SparseSystem::solve_at(nodes, threads) : R;
}

}  // namespace bromwich
