// symbol          variable        shape
// [B F E x0]      Wide::B         m x inputs: n for y, k for phi (if f has its own columns), 1 for E x0 unless zero
// [N; I]          Wide::N         (n + c) x m
// z_p             nodes           of all windows and of the contours used for comparison, concatenated
// resolvents      R               nodes x (outputs inputs), row by row

#include "core/kernel/sparse_kernel.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/kernel/rough_response.hpp"
#include "core/kernel/wide_system.hpp"
#include "core/numerics/elimination.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double degree = std::numbers::pi / 180;

// A shift sigma loses a factor e^{sigma T} of accuracy, at most 3000.
constexpr double largest_growth = 8;

// Rows of W_d, S_d and of [N; I] e^{A t_d} x0.
struct Rows {
  RowMatrix W, S, x0;
};

// A window and the index of its first node.
struct Placed {
  LagWindow window;
  Index at = 0;

  Index nodes() const { return window.contour.nodes.size(); }
};

class Attempt {
 public:
  Attempt(const DiscreteProblem& p, const Wide& wide, const ContourParameters& parameters, double shift)
      : p_(p), wide_(wide), P_(parameters.P), shift_(shift) {
    for (LagWindow& window : p.shared->windows(parameters, p.h, p.J, shift)) place(windows_, std::move(window));
    const auto other = [&](const LagWindow& w) { place(others_, other_window(w, parameters)); };
    other(windows_.front().window);
    if (windows_.size() > 1) other(windows_.back().window);
    ComplexVector nodes(count_);
    for (const auto* list : {&windows_, &others_})
      for (const Placed& w : *list) nodes.segment(w.at, w.nodes()) = w.window.contour.nodes;
    const ComplexMatrix R = p.shared->resolvents(p.backend, wide.dynamics, nodes);
    const Index lag_inputs = wide.lag_inputs(), outputs = wide.outputs();
    lags_.resize(count_, outputs * lag_inputs);
    x0_.resize(count_, wide.states * outputs);
    for (Index i = 0; i < outputs; ++i) {
      lags_.middleCols(i * lag_inputs, lag_inputs) = R.middleCols(i * wide.inputs(), lag_inputs);
      if (wide.states > 0) x0_.col(i) = R.col(i * wide.inputs() + lag_inputs);
    }
    tabulate();
    compare();
  }

  const Rows& table() const { return table_; }
  double error() const { return error_; }

  std::string describe() const {
    return text("contours of %td nodes, %zu windows, %td shifted solves", P_ + 1, windows_.size(), count_) +
           (shift_ > 0 ? text(", shifted by %.3g", shift_) : "");
  }

 private:
  void place(std::vector<Placed>& list, LagWindow window) {
    list.push_back({std::move(window), count_});
    count_ += list.back().nodes();
  }

  // The same lags on another contour: that of the next sector, or after the last sector the same with an earlier start.
  LagWindow other_window(const LagWindow& w, const ContourParameters& parameters) const {
    const auto wider = contour_parameters(parameters.half_angle + degree);
    const double start = (wider ? 1 : 0.8) * w.contour.t0;
    const ContourParameters& used = wider ? *wider : parameters;
    Contour contour = w.first == 0 ? near_contour(used, start) : window_contour(used, start);
    contour.nodes.array() += shift_;
    return lag_window(contour, p_.h, w.first, w.last);
  }

  // Lags first..last from the nodes of `w` and the given factors.
  Rows rows_of(const Placed& w, const LagWindow& factors, Index first, Index last) const {
    const Index count = last - first + 1, from = first - factors.first;
    Rows rows{RowMatrix(count, lags_.cols()), RowMatrix(count, lags_.cols()), RowMatrix(count, x0_.cols())};
    const ComplexMatrix R = lags_.middleRows(w.at, w.nodes());
    real_product(factors.F.middleRows(from, count), R, rows.W);
    real_product(factors.S.middleRows(from, count), R, rows.S);
    if (wide_.states > 0)
      real_product(exponential_factors(factors.contour, p_.h, first, last), x0_.middleRows(w.at, w.nodes()), rows.x0);
    return rows;
  }

  void tabulate() {
    table_ = {RowMatrix(p_.J + 1, lags_.cols()), RowMatrix(p_.J + 1, lags_.cols()), RowMatrix(p_.J + 1, x0_.cols())};
    for (const Placed& w : windows_) {
      const Rows rows = rows_of(w, w.window, w.window.first, w.window.last);
      table_.W.middleRows(w.window.first, rows.W.rows()) = rows.W;
      table_.S.middleRows(w.window.first, rows.S.rows()) = rows.S;
      table_.x0.middleRows(w.window.first, rows.x0.rows()) = rows.x0;
    }
    table_.S.row(0).setZero();
    if (wide_.states > 0)  // no contour covers t = 0
      table_.x0.row(0) = (wide_.dynamics->outputs() * p_.scene.x0).transpose();
  }

  void compare() {
    set_scales();
    for (const Placed& other : others_) {
      const LagWindow& w = other.window;
      for (const Index d : std::array{w.first, (w.first + w.last) / 2, w.last}) deviation(rows_of(other, w, d, d), d);
    }
    // Checks the first lag of each window against the contour of the window before it (lags 0 and 1 excepted).
    for (std::size_t i = 2; i < windows_.size(); ++i) {
      const Placed& before = windows_[i - 1];
      const Index d = windows_[i].window.first;
      deviation(rows_of(before, lag_window(before.window.contour, p_.h, d, d), d, d), d);
    }
  }

  // Largest weight of each block (constraints or components) x (y or sources), the same for x0; at least 1e-6 of the
  // scale h |N_i| |B_j|.
  void set_scales() {
    const SparseMatrix rows = wide_.dynamics->outputs().transpose(), inputs_of = wide_.dynamics->inputs();
    const Index inputs = wide_.lag_inputs();
    scale_.resize(lags_.cols());
    x0_scale_.resize(x0_.cols());
    for (const auto& [i0, i1] : {std::pair{Index(0), wide_.n}, {wide_.n, wide_.outputs()}}) {
      for (const auto& [j0, j1] : {std::pair{Index(0), wide_.n}, {wide_.n, inputs}}) {
        double largest = 0;
        for (Index i = i0; i < i1; ++i)
          for (Index j = j0; j < j1; ++j)
            largest = std::max({largest, table_.W.col(i * inputs + j).cwiseAbs().maxCoeff(),
                                1e-6 * p_.h * rows.col(i).norm() * inputs_of.col(j).norm()});
        for (Index i = i0; i < i1; ++i) scale_.segment(i * inputs + j0, j1 - j0).setConstant(largest);
      }
      if (wide_.states == 0 || i0 == i1) continue;
      const double largest = table_.x0.middleCols(i0, i1 - i0).cwiseAbs().maxCoeff();
      x0_scale_.segment(i0, i1 - i0).setConstant(largest);
      for (Index i = i0; i < i1; ++i)
        x0_scale_[i] = std::max(x0_scale_[i], 1e-6 * rows.col(i).norm() * p_.scene.x0.norm());
    }
  }

  void deviation(const Rows& rows, Index d) {
    const auto take = [&](const RowMatrix& row, const RowMatrix& table, const Vector& scale) {
      for (Index c = 0; c < row.cols(); ++c) {
        const double difference = std::abs(row(0, c) - table(d, c));
        if (!std::isfinite(difference)) error_ = INFINITY;
        if (scale[c] > 0) error_ = std::max(error_, difference / scale[c]);
      }
    };
    take(rows.W, table_.W, scale_);
    if (d > 0) take(rows.S, table_.S, scale_);
    if (d > 0) take(rows.x0, table_.x0, x0_scale_);
  }

  const DiscreteProblem& p_;
  const Wide& wide_;
  Index P_;
  double shift_;
  std::vector<Placed> windows_, others_;
  Index count_ = 0;
  ComplexMatrix lags_, x0_;  ///< resolvents of the columns [B F], and of x0
  Rows table_;
  Vector scale_, x0_scale_;
  double error_ = 0;
};

// The block of a table with outputs i0.. and inputs j0..
LagTable block(const Rows& table, const Wide& wide, Index i0, Index outputs, Index j0, Index inputs) {
  const Index rows = table.W.rows();
  LagTable out{outputs, inputs, false, RowMatrix(rows, outputs * inputs), RowMatrix(rows, outputs * inputs)};
  for (Index i = 0; i < outputs; ++i) {
    const Index from = (i0 + i) * wide.lag_inputs() + j0;
    out.W.middleCols(i * inputs, inputs) = table.W.middleCols(from, inputs);
    out.S.middleCols(i * inputs, inputs) = table.S.middleCols(from, inputs);
  }
  return out;
}

// Contribution of x0 and f to outputs i0..
RowMatrix free_part(const DiscreteProblem& p, const Rows& table, const Wide& wide, Index i0, Index outputs) {
  RowMatrix free = RowMatrix::Zero(p.J + 1, outputs);
  if (outputs == 0) return free;
  if (wide.states > 0) free = table.x0.middleCols(i0, outputs);
  if (p.f.size() == 0) return free;
  const bool through_B = wide.sources == 0;
  const LagTable response = block(table, wide, i0, outputs, through_B ? 0 : wide.n, through_B ? wide.n : wide.sources);
  const auto phi = p.backend.array(p.J + 1, p.f.cols()), answer = p.backend.array(p.J + 1, outputs);
  upload(p.backend, p.f, *phi);
  p.backend.convolution(response, p.J + 1)->apply(*phi, *answer, 0);
  RowMatrix v;
  p.backend.download(*answer, v);
  if (p.sources) v += rough_response(p, response);
  return free + v;
}

std::size_t bytes(const LagTable& table) { return sizeof(double) * std::size_t(table.W.size() + table.S.size()); }

SparseKernel finish(const DiscreteProblem& p, const Wide& wide, const Attempt& attempt, const Spectrum& spectrum) {
  const Rows& table = attempt.table();
  SparseKernel kernel;
  kernel.weights = block(table, wide, 0, wide.n, 0, wide.n);
  kernel.free = free_part(p, table, wide, 0, wide.n);
  kernel.seen = block(table, wide, wide.n, wide.components, 0, wide.n);
  kernel.seen_free = free_part(p, table, wide, wide.n, wide.components);
  kernel.description = attempt.describe() + "; spectrum " + spectrum.describe();
  kernel.error = attempt.error();
  kernel.bytes = bytes(kernel.weights) + bytes(kernel.seen) +
                 sizeof(double) * std::size_t(kernel.free.size() + kernel.seen_free.size());
  return kernel;
}

}  // namespace

ContourChoices contours_to_try(const Spectrum& s, double T) {
  ContourChoices choices;
  choices.shift = std::min(s.abscissa > 16 * epsilon * s.radius ? s.abscissa : 0, largest_growth / T);
  const double start = choices.shift > 0 ? 0 : std::min(s.half_angle, 60 * degree);
  for (const double sector : {0, 15, 30, 45, 60})
    if (sector * degree >= start * (1 - epsilon)) choices.half_angles.push_back(sector * degree);
  return choices;
}

std::optional<SparseKernel> sparse_kernel(const DiscreteProblem& p, const std::vector<Index>& components) {
  const Wide wide = widen(p, components);
  const Spectrum s = p.shared->spectrum();
  const ContourChoices choices = contours_to_try(s, p.scene.T);
  for (const double half_angle : choices.half_angles) {
    try {
      const Attempt attempt(p, wide, *contour_parameters(half_angle), choices.shift);
      if (attempt.error() <= accepted_contour_error) return finish(p, wide, attempt, s);
    } catch (const SingularShift&) {  // a node is an eigenvalue to rounding: the contour runs through the spectrum
    }
  }
  return std::nullopt;
}

RowMatrix sparse_states(const DiscreteProblem& p, const SparseKernel& kernel, const RowMatrix& y) {
  const Index rows = p.J + 1, c = kernel.seen_free.cols();
  if (c == 0) return RowMatrix(rows, 0);
  const auto in = p.backend.array(rows, y.cols()), out = p.backend.array(rows, c);
  p.backend.upload(y, *in);
  p.backend.convolution(kernel.seen, rows)->apply(*in, *out, 0);
  RowMatrix x;
  p.backend.download(*out, x);
  x += kernel.seen_free;
  return x;
}

double predicted_elimination_bytes(const SparseDynamics& d, Index n_inputs, int threads) {
  constexpr double lane_group = 8 * sizeof(Complex);  // eight nodes are eliminated together
  const Elimination plan = analyse(d.E.rows() > 0 ? SparseMatrix(d.A + 0 * d.E) : d.A, d.B, d.N,
                                   std::max<Index>(n_inputs - d.B.cols(), 0) + 1);
  const double matrix = 24 * double(d.A.nonZeros());
  return lane_group * double(std::max(threads, 1)) * double(plan.entries()) + 6 * matrix;
}

double predicted_sparse_bytes(const SparseDynamics& d, Index J, Index n_inputs, Index n_outputs, int threads) {
  const double windows = 2 + std::log(double(std::max<Index>(J, 1))) / std::log(window_ratio),
               nodes = 81 * (windows + 2);
  const double entries = double(n_inputs) * double(n_outputs);
  return predicted_elimination_bytes(d, n_inputs, threads) + 4 * sizeof(double) * double(J + 1) * entries +
         2 * sizeof(Complex) * nodes * entries;
}

}  // namespace bromwich
