// Operations on whole arrays for the hierarchy of time grids.

#include "core/numerics/alternation.hpp"
#include "cpu/parts.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>

namespace bromwich::cpu {

namespace {

constexpr Index parallel_size = 1 << 14;  ///< values; below it, other threads save less than ten microseconds

}  // namespace

void write_product(const RowMatrix& amplitudes, const Matrix& shapes, RowMatrix& to, Team& team) {
  team.each(amplitudes.rows(), to.size() > parallel_size, [&](Index j) {
    to.row(j) = amplitudes(j, 0) * shapes.col(0).transpose();
    for (Index i = 1; i < shapes.cols(); ++i) to.row(j) += amplitudes(j, i) * shapes.col(i).transpose();
  });
}

void inject(const RowMatrix& fine, RowMatrix& coarse, Team& team) {
  const Index last = coarse.rows() - 1, ratio = (fine.rows() - 1) / last;
  team.each(last + 1, coarse.size() > parallel_size, [&](Index i) { coarse.row(i) = fine.row(i * ratio); });
}

void interpolate(const RowMatrix& coarse, const RowMatrix* old, RowMatrix& fine, Team& team) {
  const Index last = coarse.rows() - 1, ratio = (fine.rows() - 1) / last;
  team.each(last + 1, fine.size() > parallel_size, [&](Index i) {
    for (Index k = 0; k < (i == last ? 1 : ratio); ++k) {
      const double right = double(k) / double(ratio), left = 1 - right;
      auto row = fine.row(ratio * i + k);
      row += left * coarse.row(i);
      if (k > 0) row += right * coarse.row(i + 1);
      if (!old) continue;
      row -= left * old->row(i);
      if (k > 0) row -= right * old->row(i + 1);
    }
  });
}

void restrict_problem(const RowMatrix& r, const RowMatrix& v, const RowMatrix& y, const RowMatrix& coarse_v,
                      RowMatrix& coarse_r, RowMatrix& coarse_y, RowMatrix& old, Team& team) {
  const Index rows = coarse_y.rows(), ratio = (y.rows() - 1) / (rows - 1);
  team.each(rows, coarse_y.size() > parallel_size, [&](Index i) {
    coarse_r.row(i) = r.row(ratio * i) + v.row(ratio * i) - coarse_v.row(i);
    coarse_y.row(i) = y.row(ratio * i);
    old.row(i) = y.row(ratio * i);
  });
}

void take_stages(const RowMatrix& stages, RowMatrix& first, RowMatrix& second, Team& team) {
  first.row(0).setZero();
  second.row(0) = stages.row(0);
  team.each(first.rows() - 1, stages.size() > parallel_size, [&](Index step) {
    const Index j = step + 1;
    first.row(j) = stages.row(2 * j - 1);
    second.row(j) = stages.row(2 * j);
  });
}

void put_stages(const RowMatrix& first, const RowMatrix& second, RowMatrix& stages, Team& team) {
  stages.row(0) = second.row(0);
  team.each(first.rows() - 1, stages.size() > parallel_size, [&](Index step) {
    const Index j = step + 1;
    stages.row(2 * j - 1) = first.row(j);
    stages.row(2 * j) = second.row(j);
  });
}

void sweep_stages(const StageDivisors& d, const RowMatrix& r, const RowMatrix& v, RowMatrix& y, Team& team) {
  const Index steps = (y.rows() - 1) / 2;
  const double first = 1 / d.first, second = 1 / d.second;
  team.each(steps, y.size() > parallel_size, [&](Index step) {
    const Index j = step + 1;
    for (Index i = 0; i < y.cols(); ++i) {
      const double before = y(2 * j - 1, i),
                   after = std::max(0.0, before - first * (r(2 * j - 1, i) + v(2 * j - 1, i)));
      const double q = r(2 * j, i) + v(2 * j, i) + d.second_by_first * (after - before);
      y(2 * j - 1, i) = after;
      y(2 * j, i) = std::max(0.0, y(2 * j, i) - second * q);
    }
  });
}

void restrict_stages(const RowMatrix& r, const RowMatrix& v, const RowMatrix& y, const RowMatrix& coarse_v,
                     RowMatrix& coarse_r, RowMatrix& coarse_y, RowMatrix& old, Team& team) {
  restrict_problem(r, v, y, coarse_v, coarse_r, coarse_y, old, team);
  team.each(coarse_y.rows() - 1, coarse_y.size() > parallel_size, [&](Index step) {
    const Index j = step + 1;
    for (Index i = 0; i < coarse_y.cols(); ++i)
      if ((y(2 * j - 1, i) > 0) == (y(2 * j, i) > 0))
        coarse_r(j, i) += 0.75 * (r(2 * j - 1, i) + v(2 * j - 1, i) - r(2 * j, i) - v(2 * j, i));
  });
}

void add(const RowMatrix& b, double s, const RowMatrix& c, RowMatrix& a, Team& team) {
  team.each(a.rows(), a.size() > parallel_size, [&](Index j) { a.row(j) = b.row(j) + s * c.row(j); });
}

namespace {

double difference(const RowMatrix& a, const RowMatrix& b, Team& team) {
  std::atomic<double> worst = 0;
  team.ranges(a.rows(), a.size() > parallel_size, [&](Index begin, Index end) {
    double mine = 0;
    for (Index j = begin; j < end; ++j) {
      const double gap = (a.row(j) - b.row(j)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
      const double relative = gap / std::max(1.0, a.row(j).cwiseAbs().maxCoeff());
      mine = std::max(mine, std::isfinite(relative) ? relative : INFINITY);  // a maximum may drop a NaN
    }
    Team::raise(worst, mine);
  });
  return std::isinf(worst) ? NAN : worst.load();
}

class HostDifferences final : public Differences {
 public:
  HostDifferences(std::size_t slots, Team& team) : values_(slots, 0), team_(team) {}
  void submit(std::size_t slot, const Array& a, const Array& b) override {
    values_[slot] = difference(host(a), host(b), team_);
  }
  const std::vector<double>& collect() override { return values_; }
  std::size_t bytes() const override { return values_.size() * sizeof(double); }

 private:
  std::vector<double> values_;
  Team& team_;
};

}  // namespace

std::unique_ptr<Differences> make_differences(std::size_t slots, Team& team) {
  return std::make_unique<HostDifferences>(slots, team);
}

bool alternates(const RowMatrix& y, Index run, double part, Team& team) {
  const bool enough = y.size() > parallel_size;
  Vector largest = Vector::Zero(y.cols());
  std::mutex mutex;
  team.ranges(y.rows(), enough, [&](Index begin, Index end) {
    Vector mine = Vector::Zero(y.cols());
    largest_of_columns(y, begin, end, mine);
    const std::lock_guard lock(mutex);
    largest = largest.cwiseMax(mine);
  });
  std::atomic<bool> found = false;
  team.ranges(y.rows(), enough, [&](Index begin, Index end) {
    if (bromwich::alternates(y, begin, end, part * largest, run)) found = true;
  });
  return found;
}

}  // namespace bromwich::cpu
