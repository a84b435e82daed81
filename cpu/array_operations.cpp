// Operations on whole arrays for the hierarchy of time grids.

#include "core/numerics/alternation.hpp"
#include "cpu/parts.hpp"

#include <omp.h>

#include <algorithm>
#include <cmath>

namespace bromwich::cpu {

namespace {

constexpr Index parallel_size = 1 << 14;  ///< values; below it, starting the threads costs more than they save

}  // namespace

void write_product(const RowMatrix& amplitudes, const Matrix& shapes, RowMatrix& to, int threads) {
#pragma omp parallel for num_threads(threads) schedule(static) if (to.size() > parallel_size)
  for (Index j = 0; j < amplitudes.rows(); ++j) {
    to.row(j) = amplitudes(j, 0) * shapes.col(0).transpose();
    for (Index i = 1; i < shapes.cols(); ++i) to.row(j) += amplitudes(j, i) * shapes.col(i).transpose();
  }
}

void inject(const RowMatrix& fine, RowMatrix& coarse, int threads) {
  const Index last = coarse.rows() - 1, ratio = (fine.rows() - 1) / last;
#pragma omp parallel for num_threads(threads) schedule(static) if (coarse.size() > parallel_size)
  for (Index i = 0; i <= last; ++i) coarse.row(i) = fine.row(i * ratio);
}

void interpolate(const RowMatrix& coarse, const RowMatrix* old, RowMatrix& fine, int threads) {
  const Index last = coarse.rows() - 1, ratio = (fine.rows() - 1) / last;
#pragma omp parallel for num_threads(threads) schedule(static) if (fine.size() > parallel_size)
  for (Index i = 0; i <= last; ++i)
    for (Index k = 0; k < (i == last ? 1 : ratio); ++k) {
      const double right = double(k) / double(ratio), left = 1 - right;
      auto row = fine.row(ratio * i + k);
      row += left * coarse.row(i);
      if (k > 0) row += right * coarse.row(i + 1);
      if (!old) continue;
      row -= left * old->row(i);
      if (k > 0) row -= right * old->row(i + 1);
    }
}

void restrict_problem(const RowMatrix& r, const RowMatrix& v, const RowMatrix& y, const RowMatrix& coarse_v,
                      RowMatrix& coarse_r, RowMatrix& coarse_y, RowMatrix& old, int threads) {
  const Index rows = coarse_y.rows(), ratio = (y.rows() - 1) / (rows - 1);
#pragma omp parallel for num_threads(threads) schedule(static) if (coarse_y.size() > parallel_size)
  for (Index i = 0; i < rows; ++i) {
    coarse_r.row(i) = r.row(ratio * i) + v.row(ratio * i) - coarse_v.row(i);
    coarse_y.row(i) = y.row(ratio * i);
    old.row(i) = y.row(ratio * i);
  }
}

void take_stages(const RowMatrix& stages, RowMatrix& first, RowMatrix& second, int threads) {
  first.row(0).setZero();
  second.row(0) = stages.row(0);
#pragma omp parallel for num_threads(threads) schedule(static) if (stages.size() > parallel_size)
  for (Index j = 1; j < first.rows(); ++j) {
    first.row(j) = stages.row(2 * j - 1);
    second.row(j) = stages.row(2 * j);
  }
}

void put_stages(const RowMatrix& first, const RowMatrix& second, RowMatrix& stages, int threads) {
  stages.row(0) = second.row(0);
#pragma omp parallel for num_threads(threads) schedule(static) if (stages.size() > parallel_size)
  for (Index j = 1; j < first.rows(); ++j) {
    stages.row(2 * j - 1) = first.row(j);
    stages.row(2 * j) = second.row(j);
  }
}

void sweep_stages(const StageDivisors& d, const RowMatrix& r, const RowMatrix& v, RowMatrix& y, int threads) {
  const Index steps = (y.rows() - 1) / 2;
  const double first = 1 / d.first, second = 1 / d.second;
#pragma omp parallel for num_threads(threads) schedule(static) if (y.size() > parallel_size)
  for (Index j = 1; j <= steps; ++j)
    for (Index i = 0; i < y.cols(); ++i) {
      const double before = y(2 * j - 1, i),
                   after = std::max(0.0, before - first * (r(2 * j - 1, i) + v(2 * j - 1, i)));
      const double q = r(2 * j, i) + v(2 * j, i) + d.second_by_first * (after - before);
      y(2 * j - 1, i) = after;
      y(2 * j, i) = std::max(0.0, y(2 * j, i) - second * q);
    }
}

void restrict_stages(const RowMatrix& r, const RowMatrix& v, const RowMatrix& y, const RowMatrix& coarse_v,
                     RowMatrix& coarse_r, RowMatrix& coarse_y, RowMatrix& old, int threads) {
  restrict_problem(r, v, y, coarse_v, coarse_r, coarse_y, old, threads);
#pragma omp parallel for num_threads(threads) schedule(static) if (coarse_y.size() > parallel_size)
  for (Index j = 1; j < coarse_y.rows(); ++j)
    for (Index i = 0; i < coarse_y.cols(); ++i)
      if ((y(2 * j - 1, i) > 0) == (y(2 * j, i) > 0))
        coarse_r(j, i) += 0.75 * (r(2 * j - 1, i) + v(2 * j - 1, i) - r(2 * j, i) - v(2 * j, i));
}

void add(const RowMatrix& b, double s, const RowMatrix& c, RowMatrix& a, int threads) {
#pragma omp parallel for num_threads(threads) schedule(static) if (a.size() > parallel_size)
  for (Index j = 0; j < a.rows(); ++j) a.row(j) = b.row(j) + s * c.row(j);
}

namespace {

double difference(const RowMatrix& a, const RowMatrix& b, int threads) {
  double worst = 0;
#pragma omp parallel for num_threads(threads) schedule(static) reduction(max : worst) if (a.size() > parallel_size)
  for (Index j = 0; j < a.rows(); ++j) {
    const double gap = (a.row(j) - b.row(j)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
    const double relative = gap / std::max(1.0, a.row(j).cwiseAbs().maxCoeff());
    worst = std::max(worst, std::isfinite(relative) ? relative : INFINITY);  // a max reduction may drop a NaN
  }
  return std::isinf(worst) ? NAN : worst;
}

class HostDifferences final : public Differences {
 public:
  HostDifferences(std::size_t slots, int threads) : values_(slots, 0), threads_(threads) {}
  void submit(std::size_t slot, const Array& a, const Array& b) override {
    values_[slot] = difference(host(a), host(b), threads_);
  }
  const std::vector<double>& collect() override { return values_; }
  std::size_t bytes() const override { return values_.size() * sizeof(double); }

 private:
  std::vector<double> values_;
  int threads_;
};

}  // namespace

std::unique_ptr<Differences> make_differences(std::size_t slots, int threads) {
  return std::make_unique<HostDifferences>(slots, threads);
}

bool alternates(const RowMatrix& y, Index run, double part, int threads) {
  const Index rows = y.rows();
  Vector largest = Vector::Zero(y.cols());
  bool found = false;
#pragma omp parallel num_threads(threads) if (y.size() > parallel_size)
  {
    const Index count = omp_get_num_threads(), thread = omp_get_thread_num();
    const Index begin = thread * rows / count, end = (thread + 1) * rows / count;
    Vector mine = Vector::Zero(y.cols());
    largest_of_columns(y, begin, end, mine);
#pragma omp critical(largest_values)
    largest = largest.cwiseMax(mine);
#pragma omp barrier
    const bool here = bromwich::alternates(y, begin, end, part * largest, run);
#pragma omp critical(largest_values)
    found = found || here;
  }
  return found;
}

}  // namespace bromwich::cpu
