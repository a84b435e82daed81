#include "sources.hpp"

#include "arrays.hpp"
#include "core/base/error.hpp"
#include "core/base/time_function.hpp"

#include <nanobind/eigen/dense.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <utility>

namespace bromwich::python {
namespace {

/// Values of a Python function on uniform grids t_j = j T/J, asked for in one call where the solve walks through a
/// grid: two calls in a row at neighbouring points of it, and all of it is asked for.
class Walked {
 public:
  Walked(Kept one, Kept many, Index width, double T)
      : one_(std::move(one)), many_(std::move(many)), width_(width), T_(T) {}

  void operator()(double t, Eigen::Ref<Vector> value) {
    if (many_) {
      const std::lock_guard lock(mutex_);
      if (find(t, value)) return;
    }
    const nb::gil_scoped_acquire gil;
    if (const Index J = many_ ? walked_grid(t) : 0; J > 0) {
      fill(J);
      const std::lock_guard lock(mutex_);
      if (find(t, value)) return;
    }
    const nb::object values = one_.get()(t);
    value = as_vector(nb::cast<Array1>(values));
  }

  void forget() {
    const std::lock_guard lock(mutex_);
    grids_.clear();
    before_ = -1;
  }

 private:
  struct Grid {
    Index J;
    RowMatrix values;
  };

  static constexpr Index largest_grid = Index(1) << 23;  ///< values that are kept of one grid: 64 MiB
  static constexpr std::size_t kept_grids = 4;

  double point(Index J, double j) const { return T_ * j / double(J); }
  bool on(Index J, double t) const { return point(J, std::round(t / T_ * double(J))) == t; }

  bool find(double t, Eigen::Ref<Vector> value) const {
    for (const Grid& grid : grids_)
      if (on(grid.J, t)) {
        value = grid.values.row(Index(std::round(t / T_ * double(grid.J)))).transpose();
        return true;
      }
    return false;
  }

  /// Steps of the grid of which t and the time before it are neighbours, or every second point; 0: there is none.
  Index walked_grid(double t) {
    const std::lock_guard lock(mutex_);
    const double before = std::exchange(before_, t);
    if (!(t > before) || !(before >= 0)) return 0;
    const double steps = std::round(T_ / (t - before));
    if (!(steps >= 2) || 2 * steps * double(width_) > double(largest_grid)) return 0;
    for (const Index J : {Index(steps), 2 * Index(steps)})
      if (on(J, before) && on(J, t)) return J;
    return 0;
  }

  void fill(Index J) {
    Vector times(J + 1);
    for (Index j = 0; j <= J; ++j) times[j] = point(J, double(j));
    const nb::object values = many_.get()(nb::ndarray<nb::numpy, double>(times.data(), {std::size_t(J + 1)}).cast());
    Grid grid{J, as_matrix(nb::cast<Array2>(values))};
    const std::lock_guard lock(mutex_);
    if (grids_.size() == kept_grids) grids_.erase(grids_.begin());
    grids_.push_back(std::move(grid));
  }

  Kept one_, many_;
  Index width_;
  double T_;
  std::mutex mutex_;  ///< two solves may share a scene; never held while Python runs
  std::vector<Grid> grids_;
  double before_ = -1;
};

}  // namespace

Source constant_source(const Vector& value) {
  const SeparableSource one{value, one_at_all_times()};
  Source source{TimeFunction(one), value.size(), {}, true};
  source.state = [value] { return nb::make_tuple("constant", value); };
  return source;
}

Source table_source(const Vector& times, const RowMatrix& values, bool kinks) {
  Source source;
  source.width = values.cols();
  source.breakpoints_are_all = true;
  for (Index i = 1; i + 1 < times.size(); ++i) {
    const bool jump = times[i] == times[i + 1], first = times[i] > times[i - 1];
    if (first && (kinks || jump)) source.breakpoints.push_back(times[i]);
  }
  const auto kept_times = std::make_shared<const Vector>(times);
  const auto kept_values = std::make_shared<const RowMatrix>(values);
  source.state = [kept_times, kept_values, kinks] { return nb::make_tuple("table", *kept_times, *kept_values, kinks); };
  source.function = [times = kept_times, values = kept_values](double t, Eigen::Ref<Vector> out) {
    const double *first = times->data(), *end = first + times->size();
    const double* above = std::upper_bound(first, end, t);  // of two rows at t the second one counts
    const Index i = above - first;
    if (i == 0 || i == times->size()) {
      out = values->row(std::min(i, times->size() - 1)).transpose();
      return;
    }
    const double share = (t - first[i - 1]) / (first[i] - first[i - 1]);
    out = values->row(i - 1).transpose();
    if (share > 0) out += share * (values->row(i) - values->row(i - 1)).transpose();
  };
  return source;
}

Source python_source(const Kept& one, const Kept& many, Index width, double T) {
  const auto walked = std::make_shared<Walked>(one, many, width, T);
  return {[walked](double t, Eigen::Ref<Vector> out) { (*walked)(t, out); },
          width,
          {},
          false,
          {one, many},
          [walked] { walked->forget(); },
          [one, many, width, T] {
            return nb::make_tuple("function", one.get(), many ? many.get() : nb::none(), width, T);
          }};
}

std::vector<double> merged(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> all;
  std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(all));
  return all;
}

}  // namespace bromwich::python
