// Step-by-step solution with lag weights alone,
//
//     y_j in SOL(M + W_0, r_j + h_j),   h_j = Σ_{d=1}^{j-1} W_d y_{j-d} + S_j y_0,   v_j = h_j + W_0 y_j.
//
// The history h is a convolution whose input becomes known row by row (Hairer, Lubich, Schlichte, SIAM J. Sci. Stat.
// Comput. 6, 1985). Rows are cut into blocks of b; within a block the sums are direct. When k blocks are complete and
// 2^s is the largest power of 2 that divides k, the last L = 2^s b rows contribute to the next L by one FFT of length
// 2L:
//
//     source  |      k-2^s .. k      |   Every pair of a row and a later one belongs to exactly one such product, that
//     target          | k .. k+2^s   |   of the smallest dyadic interval that contains both.
//
// O(J log^2 J) operations per entry of W.

#include "core/base/error.hpp"
#include "cpu/march_step.hpp"
#include "cpu/parts.hpp"
#include "cpu/real_fft.hpp"

#include <bit>
#include <vector>

namespace bromwich::cpu {

using host::invalidate;
using host::Poll;

namespace {

// The product of one level: from L rows of y to the L rows after them.
class Level {
 public:
  Level(const LagTable& table, double sigma, Index L, Team& team)
      : n_(table.outputs),
        L_(L),
        fft_(2 * L),
        damping_(damping(sigma, 2 * L)),
        weights_(n_ * n_, fft_.frequencies()),
        spectra_(n_ + team.threads(), padded(fft_.frequencies())),
        real_(team.threads(), 2 * L),
        team_(team) {
    const Index lags = std::min<Index>(2 * L, table.W.rows());
    Vector padded(2 * L);
    for (Index c = 0; c < weights_.rows(); ++c) {
      padded.setZero();
      for (Index d = 1; d < lags; ++d) padded[d] = damping_[d] * table.W(d, c) / double(2 * L);
      fft_.forward(padded.data(), weights_.row(c).data());
    }
  }

  // v(from + L ..) += Σ_d W_d y with the rows from .. from + L - 1 of y; rows past the end of v are skipped.
  void apply(const RowMatrix& y, Index from, RowMatrix& v) {
    const Index rows = std::min(L_, v.rows() - from - L_);
    team_.share(n_, n_ * L_ >= parallel_size, [&](Index c, int thread) {
      double* real = real_.row(thread).data();
      for (Index i = 0; i < L_; ++i) real[i] = damping_[i] * y(from + i, c);
      std::fill(real + L_, real + 2 * L_, 0.0);
      fft_.forward(real, spectra_.row(c).data());
    });
    team_.share(n_, n_ * L_ >= parallel_size, [&](Index i, int thread) {
      double* real = real_.row(thread).data();
      auto sum = spectra_.row(n_ + thread).head(fft_.frequencies());
      sum.setZero();
      for (Index c = 0; c < n_; ++c)
        sum.array() += weights_.row(i * n_ + c).array() * spectra_.row(c).head(sum.size()).array();
      fft_.backward(sum.data(), real);
      // The first half of the product has wrapped around; the second half belongs to the target rows.
      for (Index j = 0; j < rows; ++j) v(from + L_ + j, i) += real[L_ + j] / damping_[L_ + j];
    });
  }

  std::size_t bytes() const {
    return sizeof(double) * std::size_t(2 * weights_.size() + 2 * spectra_.size() + real_.size() + damping_.size());
  }

 private:
  static constexpr Index parallel_size = 1 << 15;  ///< below it, other threads save less than ten microseconds

  Index n_, L_;
  RealFft fft_;
  Vector damping_;
  Spectra weights_, spectra_;
  RowMatrix real_;
  Team& team_;
};

class LagMarch final : public ImmediateMarch {
 public:
  LagMarch(const MarchProblem& problem, Index rows, Team& team, const LinearStep& linear)
      : table_(*problem.lags),
        n_(table_.outputs),
        asked_to_stop_(problem),
        response_(host(*problem.r)),
        M_(to_dense(*problem.M)),
        W0_(weight(table_.W, 0)),
        step_(problem, linear, M_, [this] { return Matrix(M_ + W0_); }),
        q_(n_),
        y_(n_) {
    const double sigma = growth(table_.W);
    for (Index L = block; L < rows - 1; L *= 2) levels_.push_back(std::make_unique<Level>(table_, sigma, L, team));
  }

  MarchReport run(Array& y_array, Array& v_array) override {
    const FlushDenormals flush;
    RowMatrix &Y = host(y_array), &V = host(v_array);
    MarchReport report;
    report.well_posed = step_.well_posed();
    y_ = Y.row(0).transpose();
    step_.start_from(y_);
    V.row(0).setZero();
    for (Index j = 1; j < Y.rows(); ++j) V.row(j).transpose().noalias() = weight(table_.S, j) * y_;
    for (Index j = 1; j < Y.rows(); ++j) {
      if (asked_to_stop_(j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      // Row 1 begins the first block.
      const Index begin = 1 + (j - 1) / block * block;
      for (Index l = begin; l < j; ++l)
        V.row(j).transpose().noalias() += weight(table_.W, j - l) * Y.row(l).transpose();
      q_ = (response_.row(j) + V.row(j)).transpose();
      if (!step_.solve(q_, y_, j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      Y.row(j) = y_.transpose();
      V.row(j).transpose().noalias() += W0_ * y_;
      if (j % block == 0) act_on_later_rows(j, Y, V);
    }
    return report;
  }

  std::size_t bytes() const override {
    std::size_t sum = sizeof(double) * std::size_t(M_.size() + W0_.size()) + step_.bytes();
    for (const auto& level : levels_) sum += level->bytes();
    return sum;
  }

 private:
  static constexpr Index block = 64;

  Eigen::Map<const RowMatrix> weight(const RowMatrix& rows, Index d) const {
    return {rows.row(d).data(), table_.outputs, table_.inputs};
  }

  // Rows 1..j are known, j a multiple of `block`.
  void act_on_later_rows(Index j, const RowMatrix& Y, RowMatrix& V) {
    const int s = std::countr_zero(std::size_t(j / block));
    const Index L = block << s;
    if (j + 1 < Y.rows()) levels_[std::size_t(s)]->apply(Y, j + 1 - L, V);
  }

  const LagTable& table_;
  Index n_;
  Poll asked_to_stop_;
  const RowMatrix& response_;
  Matrix M_, W0_;
  MarchStep step_;
  std::vector<std::unique_ptr<Level>> levels_;
  Vector q_, y_;
};

}  // namespace

std::unique_ptr<March> make_lag_march(const MarchProblem& problem, Index rows, Team& team, const LinearStep& linear) {
  return std::make_unique<LagMarch>(problem, rows, team, linear);
}

}  // namespace bromwich::cpu
