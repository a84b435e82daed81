#include "core/events/mode.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_rank = 1e-10;  ///< relative singular values below count as zero
constexpr int most_derivatives = 2;

// The derivative without its part of y, which is c.x B.
Jet derivative(const Jet& c, const Matrix& A) {
  return {c.x * A, c.x, c.f, Matrix::Zero(c.g.rows(), c.g.cols()), c.g, c.dg};
}

// Rows of E y + C u = 0 with a largest coefficient of y of 1 to 2, and the factors: powers of two, which round nothing.
// Rows of rounding are zero.
Vector balance_rows(Matrix& E, Jet& C, const Vector& size) {
  Vector by = Vector::Ones(E.rows());
  for (Index i = 0; i < E.rows(); ++i) {
    const double largest = E.row(i).cwiseAbs().maxCoeff();
    if (largest > 64 * double(E.rows()) * epsilon * size[i])
      by[i] = std::ldexp(1.0, -std::ilogb(largest));
    else
      E.row(i).setZero();
  }
  E = by.asDiagonal() * E;
  C = Matrix(by.asDiagonal()) * C;
  return by;
}

// Of each row the largest coefficient.
Vector largest_of(const Jet& c) {
  return c.x.cwiseAbs()
      .rowwise()
      .maxCoeff()
      .cwiseMax(c.f.cwiseAbs().rowwise().maxCoeff())
      .cwiseMax(c.g.cwiseAbs().rowwise().maxCoeff())
      .cwiseMax(c.dg.cwiseAbs().rowwise().maxCoeff());
}

// Rows and columns that the nonzero entries of a matrix connect.
struct Block {
  std::vector<Index> rows, columns;
};

std::vector<Block> blocks_of(const Matrix& A) {
  std::vector<Block> blocks;
  std::vector<char> seen(std::size_t(A.rows() + A.cols()), 0);  // rows, then columns
  const auto take = [&](Index first) {
    Block& block = blocks.emplace_back();
    std::vector<Index> open{first};
    seen[std::size_t(first)] = 1;
    while (!open.empty()) {
      const Index at = open.back(), i = at < A.rows() ? at : at - A.rows();
      open.pop_back();
      const bool row = at < A.rows();
      (row ? block.rows : block.columns).push_back(i);
      for (Index k = 0; k < (row ? A.cols() : A.rows()); ++k) {
        const Index next = row ? A.rows() + k : k;
        if (seen[std::size_t(next)] || (row ? A(i, k) : A(k, i)) == 0) continue;
        seen[std::size_t(next)] = 1;
        open.push_back(next);
      }
    }
    std::sort(block.rows.begin(), block.rows.end());
    std::sort(block.columns.begin(), block.columns.end());
  };
  for (Index i = 0; i < A.rows() + A.cols(); ++i)
    if (!seen[std::size_t(i)]) take(i);
  return blocks;
}

// With more columns, zero but for these rows.
void append(Matrix& columns, const std::vector<Index>& rows, const Matrix& values) {
  const Index before = columns.cols();
  columns.conservativeResize(Eigen::NoChange, before + values.cols());
  columns.rightCols(values.cols()).setZero();
  for (std::size_t i = 0; i < rows.size(); ++i) columns.row(rows[i]).tail(values.cols()) = values.row(Index(i));
}

// Orthonormal columns that span those of A, and the others.
struct RowRank {
  Matrix range, rest;

  explicit RowRank(const Matrix& A) : range(A.rows(), 0), rest(A.rows(), 0) {
    for (const Block& b : blocks_of(A)) {
      const Index rows = Index(b.rows.size()), most = std::min(rows, Index(b.columns.size()));
      if (most == 0) {
        append(rest, b.rows, Matrix::Identity(rows, rows));
        continue;
      }
      const Eigen::JacobiSVD<Matrix> svd(A(b.rows, b.columns), Eigen::ComputeFullU);
      Index rank = 0;
      while (rank < most && svd.singularValues()[rank] > same_rank) ++rank;
      append(range, b.rows, svd.matrixU().leftCols(rank));
      append(rest, b.rows, svd.matrixU().rightCols(rows - rank));
    }
  }
};

// K with independent rows K c: those that the others imply, or that are zero but for rounding, are left out.
Matrix independent(const Jet& c, const Vector& size) {
  if (c.x.rows() == 0) return Matrix::Zero(0, 0);
  const Index m = c.x.cols(), n = c.g.cols();
  Matrix all(c.x.rows(), 2 * m + 2 * n);
  all << c.x, c.f, c.g, c.dg;
  for (Index i = 0; i < all.rows(); ++i) all.row(i) /= std::max(size[i], 1e-290);
  const RowRank found(all);
  return found.range.transpose() * size.cwiseMax(1e-290).cwiseInverse().asDiagonal();
}

struct Split {
  Matrix from;      ///< the constraints are from * C
  Jet constraints;  ///< on the state: their rows of x are independent
  Jet conditions;   ///< on f and g alone
  Jet terms;        ///< of the conditions: absolute values, those of x before they cancelled
};

// The rows U C, which have to vanish.
Split split(const Matrix& U, const Jet& C) {
  const Jet rows = U * C, sum = Matrix(U.cwiseAbs()) * absolute(C);
  const Index k = rows.x.rows();
  if (k == 0) return {U, rows, rows, rows};
  const Vector size = U.cwiseAbs() * largest_of(C), size_x = sum.x.rowwise().maxCoeff();
  Vector by(k);
  for (Index i = 0; i < k; ++i) by[i] = 1 / std::max(size_x[i] > 0 ? size_x[i] : size[i], 1e-290);
  const RowRank found(by.asDiagonal() * rows.x);
  const Matrix range = found.range.transpose() * by.asDiagonal(), rest = found.rest.transpose() * by.asDiagonal();
  Jet conditions = rest * rows;
  conditions.x.setZero();
  const Matrix K = independent(conditions, rest.cwiseAbs() * size);
  return {range * U, range * rows, K * conditions, Matrix((K * rest).cwiseAbs()) * sum};
}

// E of E y + C u = 0, rows with a largest entry of 1 or 0, by blocks: zeros between them stay. So a y_i that the others
// do not enter, such as the friction of an open contact, stays zero.
struct Factors {
  std::vector<Index> rows;  ///< of E: independent, and they span the others
  Matrix left;              ///< U with U E = 0: combinations of rows without y
  Matrix open;              ///< orthonormal columns that span the null space
  Matrix inverse;           ///< E^+
  Matrix terms;             ///< what cancels in it, by absolute values

  explicit Factors(const Matrix& E) : open(E.cols(), 0), inverse(Matrix::Zero(E.cols(), E.rows())), terms(inverse) {
    Matrix others(E.rows(), 0);
    for (const Block& b : blocks_of(E)) add(b, E(b.rows, b.columns), others);
    std::sort(rows.begin(), rows.end());
    left = others.transpose();
  }

 private:
  void add(const Block& b, const Matrix& E, Matrix& others) {
    if (E.size() == 0) {
      append(others, b.rows, Matrix::Identity(E.rows(), E.rows()));
      append(open, b.columns, Matrix::Identity(E.cols(), E.cols()));
      return;
    }
    const Eigen::JacobiSVD<Matrix> svd(E, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Vector& values = svd.singularValues();
    Index rank = 0;
    while (rank < values.size() && values[rank] > same_rank * std::max(1.0, values[0])) ++rank;
    const Matrix &U = svd.matrixU(), &V = svd.matrixV();
    const Matrix scaled = values.head(rank).cwiseInverse().asDiagonal() * U.leftCols(rank).transpose();
    const bool regular = rank == E.rows() && rank == E.cols();
    inverse(b.columns, b.rows) = regular ? Matrix(E.partialPivLu().inverse()) : Matrix(V.leftCols(rank) * scaled);
    terms(b.columns, b.rows) = V.leftCols(rank).cwiseAbs() * scaled.cwiseAbs();
    // Rows themselves and no combinations of them, which would add rounding of large values of y to every row.
    const auto order = Eigen::ColPivHouseholderQR<Matrix>(E.transpose()).colsPermutation().indices();
    for (Index k = 0; k < rank; ++k) rows.push_back(b.rows[std::size_t(order[k])]);
    append(open, b.columns, V.rightCols(E.cols() - rank));
    // An error of E of its rounding, eps ||E||, moves U by that times E^+; entries of rounding are zero, or states that
    // rest would get coefficients of others.
    Matrix left = U.rightCols(E.rows() - rank);
    const Vector rounding = 4 * double(E.rows()) * epsilon * values[0] * scaled.colwise().norm().transpose();
    for (Index j = 0; j < left.cols(); ++j)
      left.col(j) = (left.col(j).cwiseAbs().array() > rounding.array()).select(left.col(j), 0.0);
    append(others, b.rows, left);
  }
};

using Precise = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

Matrix product(const Precise& left, const Matrix& right) {
  return left.lazyProduct(right.cast<long double>()).cast<double>();
}

// Entries of Y up to 64 eps times these can go, and E Y + C = 0 still holds but for rounding of its terms.
Matrix unseen(const Matrix& E, const Matrix& Y, const Matrix& C) {
  const Matrix terms = E.cwiseAbs() * Y.cwiseAbs() + C.cwiseAbs();
  Matrix least = Matrix::Constant(Y.rows(), Y.cols(), INFINITY);
  for (Index j = 0; j < E.cols(); ++j)
    for (Index i = 0; i < E.rows(); ++i)
      if (E(i, j) != 0) least.row(j) = least.row(j).cwiseMin(terms.row(i) / std::abs(E(i, j)));
  return least;
}

// y_S = -E^+ C, of least norm. Directions that E leaves open may not move the state. They may move w elsewhere, as of
// relays that act alike: then the set lasts as long as w stays nonnegative.
bool determine_y(const SystemMatrices& s, const std::vector<Index>& active, const Matrix& E, const Factors& factors,
                 const Jet& C, Jet& y) {
  const Matrix B = s.B(Eigen::all, active);
  const Matrix moved = B * factors.open;
  if (moved.size() > 0 && moved.cwiseAbs().maxCoeff() > 1e-8 * B.cwiseAbs().maxCoeff()) return false;
  // Two steps of Newton's method (Schulz), so that an E near a singular one does not leave the coefficients of y with
  // fewer digits than E has. Zeros between blocks of E are known to rounding of the largest block: they are entries
  // that the first step changes as much as what it leaves.
  const Precise found = factors.inverse.cast<long double>(), precise_E = E.cast<long double>();
  const Precise twice = 2 * Precise::Identity(E.rows(), E.rows()),
                refined = found.lazyProduct(Precise(twice - precise_E.lazyProduct(found)));
  const auto zero = (refined.cwiseAbs().array() <= 2 * (refined - found).cwiseAbs().array()).eval();
  const Precise inverse = zero.select(0, Precise(refined.lazyProduct(Precise(twice - precise_E.lazyProduct(refined)))));
  const Jet of_active = of_blocks([&inverse](const Matrix& c) { return product(-inverse, c); }, C);
  // Coefficients of rounding are zero: values of y that vanish in the mode would have a sign otherwise.
  y = of_blocks(
      [&](const Matrix& Y, const Matrix& of_C) {
        const Matrix size = (factors.terms * of_C.cwiseAbs()).cwiseMin(unseen(E, Y, of_C));
        Matrix all = Matrix::Zero(s.constraints(), Y.cols());
        all(active, Eigen::all) = (Y.cwiseAbs().array() > 64 * epsilon * size.array()).select(Y, 0.0);
        return all;
      },
      of_active, C);
  return true;
}

// w without y.
Jet seen_by(const SystemMatrices& s) {
  Jet seen = Jet::zero(s.constraints(), s.states(), s.constraints());
  seen.x = s.N;
  seen.g.setIdentity();
  return seen;
}

// Impulses that bring the state onto the constraints: [M_SS; K B] p = [0; -k], rows with a largest entry of 1.
Matrix impulses(const SystemMatrices& s, const std::vector<Index>& active, const Jet& constraints) {
  const Index a = Index(active.size()), c = constraints.x.rows();
  const Matrix B = s.B(Eigen::all, active);
  Matrix system(a + c, a), right = Matrix::Zero(a + c, c);
  system << s.M(active, active), constraints.x * B;
  right.bottomRows(c) = -Matrix::Identity(c, c);
  const Matrix terms = constraints.x.cwiseAbs() * B.cwiseAbs();
  for (Index i = 0; i < a + c; ++i) {
    const double largest = system.row(i).cwiseAbs().maxCoeff();
    const bool moved = largest > (i < a ? 0.0 : 64 * double(s.states()) * epsilon * terms.row(i - a).maxCoeff());
    system.row(i) *= moved ? 1 / largest : 0;
    right.row(i) *= moved ? 1 / largest : 0;
  }
  Matrix p = Eigen::CompleteOrthogonalDecomposition<Matrix>(system).solve(right);
  // Entries of rounding are zero: their signs would count. They are compared by what they move in the rows.
  const Vector moves = system.cwiseAbs().colwise().maxCoeff().transpose();
  for (Index j = 0; j < c; ++j) {
    const Vector size = p.col(j).cwiseAbs().cwiseProduct(moves);
    for (Index i = 0; i < a; ++i)
      if (size[i] <= 1e-12 * size.maxCoeff()) p(i, j) = 0;
  }
  Matrix impulse = Matrix::Zero(s.constraints(), c);
  for (Index i = 0; i < a; ++i) impulse.row(active[std::size_t(i)]) = p.row(i);
  return impulse;
}

}  // namespace

Vector openings(const SystemMatrices& s) {
  Vector found = Vector::Zero(s.constraints());
  for (Index i = 0; i < s.pairs(); ++i) {
    const double rate = s.N.row(i).dot(s.B.col(i)), terms = s.N.row(i).cwiseAbs().dot(s.B.col(i).cwiseAbs());
    if (s.M.row(i).isZero(0) && std::abs(rate) <= 64 * epsilon * terms)
      found[i] = std::max(0.0, (s.N.row(i) * s.A).dot(s.B.col(i)));
  }
  return found;
}

Jet rates_of_w(const SystemMatrices& s) { return derivative(seen_by(s), s.A); }

Jet rebound(const SystemMatrices& s, const SwitchedMode& mode, const Vector& e) {
  if (e.size() == 0) return Jet::zero(mode.constraints.x.rows(), s.states(), s.constraints());
  return Matrix(mode.velocities * e.asDiagonal()) * rates_of_w(s);
}

namespace {

std::optional<SwitchedMode> determined_mode(const SystemMatrices& s, const std::vector<Index>& active) {
  const Index m = s.states(), n = s.constraints(), a = Index(active.size());
  const Jet none = Jet::zero(0, m, n);
  const Jet seen = seen_by(s);
  SwitchedMode mode;
  mode.active = active;
  mode.A = s.A;
  mode.y = Jet::zero(n, m, n);
  mode.w = seen;
  mode.constraints = mode.conditions = mode.condition_terms = none;
  mode.impulse = Matrix::Zero(n, 0);
  mode.velocities = Matrix::Zero(0, n);
  if (a == 0) return mode;
  const Matrix B = s.B(Eigen::all, active);
  Matrix E = s.M(active, active);
  Jet C = Jet::zero(a, m, n);
  C.x = s.N(active, Eigen::all);
  for (Index i = 0; i < a; ++i) C.g(i, active[std::size_t(i)]) = 1;
  Vector size = s.M(active, Eigen::all).cwiseAbs().rowwise().maxCoeff();
  // Parts of the rows of C that are values of w_S, and derivatives of these.
  Matrix values_of_w = Matrix::Identity(a, a), velocities = Matrix::Zero(a, a);
  for (int derived = 0;; ++derived) {
    const Vector by = balance_rows(E, C, size);
    values_of_w = by.asDiagonal() * values_of_w;
    velocities = by.asDiagonal() * velocities;
    const Factors factors(E);
    const Split vanish = split(factors.left, C);
    const Jet& constraints = vanish.constraints;
    mode.conditions = stacked(mode.conditions, vanish.conditions);
    mode.condition_terms = stacked(mode.condition_terms, vanish.terms);
    if (constraints.x.rows() == 0) {
      if (!determine_y(s, active, E, factors, C, mode.y)) return std::nullopt;
      break;
    }
    if (derived == most_derivatives) return std::nullopt;
    mode.constraints = stacked(mode.constraints, constraints);
    Matrix of_all = Matrix::Zero(constraints.x.rows(), n);
    of_all(Eigen::all, active) = vanish.from * velocities;
    mode.velocities.conservativeResize(mode.constraints.x.rows(), n);
    mode.velocities.bottomRows(of_all.rows()) = of_all;
    const std::vector<Index>& kept = factors.rows;
    const Index rank = Index(kept.size());
    const Matrix derived_rows = vanish.from * values_of_w;
    values_of_w =
        (Matrix(rank + derived_rows.rows(), a) << values_of_w(kept, Eigen::all), Matrix::Zero(derived_rows.rows(), a))
            .finished();
    velocities = (Matrix(rank + derived_rows.rows(), a) << velocities(kept, Eigen::all), derived_rows).finished();
    size = Vector::Ones(rank + constraints.x.rows());
    size.tail(constraints.x.rows()) = constraints.x.cwiseAbs() * B.cwiseAbs().rowwise().maxCoeff();
    Matrix next(size.size(), a);
    next << E(kept, Eigen::all), constraints.x * B;
    C = stacked(rows_of(C, kept), derivative(constraints, s.A));
    E = next;
  }
  mode.A = (s.A.cast<long double>() + s.B.cast<long double>().lazyProduct(mode.y.x.cast<long double>())).cast<double>();
  mode.w = seen + s.M * mode.y;
  for (const Jet* rows : {&mode.y, &mode.conditions}) {
    mode.uses_df = mode.uses_df || (rows->df.array() != 0).any();
    mode.uses_dg = mode.uses_dg || (rows->dg.array() != 0).any();
    mode.uses_ddg = mode.uses_ddg || (rows->ddg.array() != 0).any();
  }
  if (mode.constraints.x.rows() == 0) return mode;
  mode.impulse = impulses(s, active, mode.constraints);
  std::vector<Index> held;
  for (Index i = 0; i < mode.constraints.x.rows(); ++i)
    if (mode.constraints.dg.row(i).isZero(0)) held.push_back(i);
  mode.onto = Matrix::Zero(s.states(), mode.constraints.x.rows());
  if (held.empty()) return mode;
  const Matrix rows = mode.constraints.x(held, Eigen::all);
  const Matrix inverse = rows.completeOrthogonalDecomposition().pseudoInverse();
  mode.onto(Eigen::all, held) = inverse;
  return mode;
}

}  // namespace

std::optional<SwitchedMode> make_switched_mode(const SystemMatrices& s, const std::vector<Index>& active) {
  std::optional<SwitchedMode> mode = determined_mode(s, active);
  if (!mode) return mode;
  mode->sum_y = JetCombination(mode->y);
  mode->sum_constraints = JetCombination(mode->constraints);
  mode->sum_conditions = JetCombination(mode->conditions);
  return mode;
}

}  // namespace bromwich
