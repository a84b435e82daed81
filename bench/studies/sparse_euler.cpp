// symbol          variable        shape
// P               order_          position -> state; the contact states are last
// L_rr, L_cr      start_, row_, value_     columns of the states before the contacts, rows behind the diagonal
// S_c             contact_        n x n, Schur complement of the contact states
// W               W               n x n, N_c S_c^{-1} B_c

#include "bench/studies/sparse_euler.hpp"

#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/host/step_lcp.hpp"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>

namespace bromwich::app {

namespace {

// The state of every contact, and the entry there.
struct Contacts {
  std::vector<Index> state;
  Vector n, b;

  explicit Contacts(const SparseDynamics& d) : n(d.N.rows()), b(d.N.rows()) {
    const Eigen::SparseMatrix<double, Eigen::RowMajor> rows = d.N;
    for (Index i = 0; i < rows.rows(); ++i) {
      Eigen::SparseMatrix<double, Eigen::RowMajor>::InnerIterator in_n(rows, i);
      SparseMatrix::InnerIterator in_b(d.B, i);
      if (!in_n || !in_b || in_n.col() != in_b.row()) throw Error("scene", "contacts are not at states", "");
      state.push_back(in_n.col());
      n[i] = in_n.value();
      b[i] = in_b.value();
    }
  }
};

class Factors {
 public:
  Factors(const SparseMatrix& S, const std::vector<Index>& last) : m_(S.rows()), n_(Index(last.size())) {
    set_order(S, last);
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> place(m_);
    for (Index i = 0; i < m_; ++i) place.indices()[order_[std::size_t(i)]] = int(i);
    SparseMatrix permuted;
    permuted = S.twistedBy(place);
    const Eigen::SimplicialLDLT<SparseMatrix, Eigen::Lower, Eigen::NaturalOrdering<int>> ldlt(permuted);
    if (ldlt.info() != Eigen::Success) throw Error("scene", "E/h - A has no factorization", "");
    take(ldlt.matrixL().nestedExpression(), ldlt.vectorD());
  }

  Index entries() const { return Index(value_.size()); }
  Index position(Index state) const { return position_[std::size_t(state)]; }
  Index state(Index position) const { return order_[std::size_t(position)]; }
  Index before() const { return m_ - n_; }

  // L^{-1} for the states before the contacts; the last n entries become the right-hand side of the Schur complement.
  void forward(Vector& v) const {
    for (Index k = 0; k < before(); ++k) {
      const double s = v[k];
      for (int a = start_[std::size_t(k)]; a < start_[std::size_t(k) + 1]; ++a)
        v[row_[std::size_t(a)]] -= value_[std::size_t(a)] * s;
    }
  }
  // The states before the contacts, from those of the contacts in the last n entries.
  void backward(Vector& v) const {
    for (Index k = before() - 1; k >= 0; --k) {
      double s = v[k] * reciprocal_[k];
      for (int a = start_[std::size_t(k)]; a < start_[std::size_t(k) + 1]; ++a)
        s -= value_[std::size_t(a)] * v[row_[std::size_t(a)]];
      v[k] = s;
    }
  }
  const Matrix& contact() const { return contact_; }

 private:
  void set_order(const SparseMatrix& S, const std::vector<Index>& last) {
    std::vector<int> inner(std::size_t(m_), 0);
    for (const Index state : last) inner[std::size_t(state)] = -1;
    std::vector<Index> others;
    for (Index i = 0; i < m_; ++i)
      if (inner[std::size_t(i)] == 0) inner[std::size_t(i)] = int(others.size()), others.push_back(i);
    std::vector<Eigen::Triplet<double>> entries;
    for (Index k = 0; k < S.outerSize(); ++k)
      for (SparseMatrix::InnerIterator a(S, k); a; ++a)
        if (inner[std::size_t(a.row())] >= 0 && inner[std::size_t(k)] >= 0)
          entries.emplace_back(inner[std::size_t(a.row())], inner[std::size_t(k)], a.value());
    SparseMatrix rest{Index(others.size()), Index(others.size())};
    rest.setFromTriplets(entries.begin(), entries.end());
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> from;
    Eigen::AMDOrdering<int>()(rest.selfadjointView<Eigen::Lower>(), from);
    for (Index i = 0; i < from.size(); ++i) order_.push_back(others[std::size_t(from.indices()[i])]);
    order_.insert(order_.end(), last.begin(), last.end());
    position_.resize(std::size_t(m_));
    for (Index i = 0; i < m_; ++i) position_[std::size_t(order_[std::size_t(i)])] = i;
  }

  void take(const SparseMatrix& L, const Vector& D) {
    start_.push_back(0);
    for (Index k = 0; k < before(); ++k) {
      for (SparseMatrix::InnerIterator a(L, k); a; ++a)
        if (a.row() > k) row_.push_back(int(a.row())), value_.push_back(a.value());
      start_.push_back(int(row_.size()));
    }
    reciprocal_ = D.head(before()).cwiseInverse();
    const Matrix Lc = Matrix(L.bottomRightCorner(n_, n_)).triangularView<Eigen::UnitLower>();
    contact_ = Lc * D.tail(n_).asDiagonal() * Lc.transpose();
  }

  Index m_, n_;
  std::vector<Index> order_, position_;
  std::vector<int> start_, row_;
  std::vector<double> value_;
  Vector reciprocal_;
  Matrix contact_;
};

// E/h, and columns of F by positions.
SparseMatrix scaled_mass(const SparseDynamics& d, double h) {
  SparseMatrix E = d.E;
  if (E.size() == 0) {
    E.resize(d.A.rows(), d.A.rows());
    E.setIdentity();
  }
  return E / h;
}

SparseMatrix ordered(const SparseMatrix& matrix, const Factors& factors, bool columns) {
  std::vector<Eigen::Triplet<double>> entries;
  for (Index k = 0; k < matrix.outerSize(); ++k)
    for (SparseMatrix::InnerIterator a(matrix, k); a; ++a)
      entries.emplace_back(int(factors.position(a.row())), int(columns ? factors.position(k) : k), a.value());
  SparseMatrix result(matrix.rows(), matrix.cols());
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

}  // namespace

SparseEuler solve_by_sparse_euler(const Scene& scene, Index steps, const std::function<bool()>& stop) {
  Timer timer;
  const SparseDynamics& d = get<SparseDynamics>(scene.dynamics);
  const Index m = d.A.rows(), n = d.N.rows();
  const double h = scene.T / double(steps);
  const Contacts contacts(d);
  const SparseMatrix mass = scaled_mass(d, h);
  const Factors factors(mass - d.A, contacts.state);
  const Eigen::LLT<Matrix> schur(factors.contact());
  const Matrix X = schur.solve(Matrix(contacts.b.asDiagonal()));  // x_c is free + X y
  const Matrix S_inverse = schur.solve(Matrix::Identity(n, n));
  const Matrix M = to_dense(scene.M);
  host::StepLcp lcp(M + contacts.n.asDiagonal() * X, M, scene.lcp_class);
  const SparseMatrix E = ordered(mass, factors, true);
  const bool sourced = bool(scene.f);
  const SparseMatrix F = sourced ? ordered(scene.F, factors, false) : SparseMatrix();
  SparseEuler out;
  out.y = RowMatrix::Zero(steps + 1, n);
  out.w.resize(steps + 1, n);
  Vector x(m), v(m), g(n), q(n), y = Vector::Zero(n), phi(sourced ? F.cols() : 0), free(n);
  for (Index i = 0; i < m; ++i) x[i] = scene.x0[factors.state(i)];
  scene.g(0, g);
  out.w.row(0) = (contacts.n.cwiseProduct(x.tail(n)) + g).transpose();
  out.setup = timer.lap();
  MarchReport report;
  for (Index j = 1; j <= steps; ++j) {
    if (stop && stop()) {
      out.solve = timer.lap();
      return out;
    }
    const double t = double(j) * h;
    v.noalias() = E * x;
    if (sourced) {
      scene.f(t, phi);
      v.noalias() += F * phi;
    }
    scene.g(t, g);
    factors.forward(v);
    free.noalias() = S_inverse * v.tail(n);
    q = g + contacts.n.cwiseProduct(free);
    if (!lcp.solve(q, y, j, report)) return out;
    v.tail(n).noalias() = free + X * y;
    factors.backward(v);
    x.swap(v);
    out.y.row(j) = y.transpose();
    out.w.row(j) = (contacts.n.cwiseProduct(x.tail(n)) + g + multiply(scene.M, y)).transpose();
  }
  out.solve = timer.lap();
  out.factor_entries = factors.entries();
  out.bytes = 12 * std::size_t(factors.entries()) + 12 * std::size_t(E.nonZeros()) + lcp.bytes() +
              sizeof(double) * std::size_t(3 * n * n + 2 * out.y.size() + 4 * m);
  out.solved = true;
  return out;
}

}  // namespace bromwich::app
