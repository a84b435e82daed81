// Branches of periodic states. The interpreter's lock is taken for each scene, and released in between.

#include "arrays.hpp"
#include "calls.hpp"
#include "module.hpp"
#include "owned_arrays.hpp"

#include "bromwich/continuation.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

namespace bromwich::python {
namespace {

/// A row for each point.
template <class Value>
auto table_of(const Branch& b, Index width, const Value& value) {
  using Scalar = typename std::decay_t<decltype(value(b.points[0]))>::value_type;
  Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> all(Index(b.points.size()), width);
  for (Index i = 0; i < all.rows(); ++i) {
    const auto row = value(b.points[std::size_t(i)]);
    for (Index j = 0; j < width; ++j) all(i, j) = row[std::size_t(j)];
  }
  return bromwich::python::owned(std::move(all));
}

std::vector<double> numbers(const Vector& v) { return {v.begin(), v.end()}; }

nb::dict dict_of_branch(const Branch& b) {
  const Index m = b.points.empty() ? 0 : b.points[0].x0.size();
  nb::dict d;
  d["parameter"] = table_of(b, 1, [](const BranchPoint& p) { return std::vector<double>{p.parameter}; });
  d["T"] = table_of(b, 1, [](const BranchPoint& p) { return std::vector<double>{p.T}; });
  d["x0"] = table_of(b, m, [](const BranchPoint& p) { return numbers(p.x0); });
  d["least"] = table_of(b, m, [](const BranchPoint& p) { return numbers(p.least); });
  d["largest"] = table_of(b, m, [](const BranchPoint& p) { return numbers(p.largest); });
  d["multipliers"] = table_of(b, m, [](const BranchPoint& p) { return p.multipliers; });
  nb::list stable, impacts, marks;
  for (const BranchPoint& p : b.points) {
    stable.append(p.stable);
    impacts.append(p.impacts);
  }
  for (const BranchMark& k : b.marks)
    marks.append(nb::make_tuple(to_string(k.event), k.parameter, numbers(k.x0), k.after, k.component));
  d["stable"] = stable;
  d["impacts"] = impacts;
  d["marks"] = marks;
  d["complete"] = b.complete;
  d["reason"] = b.reason;
  d["integrations"] = b.integrations;
  return d;
}

nb::dict follow(const nb::object& scene_of, double start, double end, double longest_step, double tolerance,
                Index max_points, const std::optional<Array1>& x0) {
  ContinuationOptions options;
  options.longest_step = longest_step;
  options.tolerance = tolerance;
  options.max_points = max_points;
  if (x0) options.x0 = as_vector(*x0);
  options.interrupted = [] {
    check_interruption();
    return false;
  };
  const auto scene = [&](double p) {
    const nb::gil_scoped_acquire lock;
    return nb::cast<std::shared_ptr<const Model>>(scene_of(p))->scene;
  };
  return dict_of_branch(interruptible([&] { return continuation(scene, start, end, options); }));
}

}  // namespace

void bind_continuation(nb::module_& m) {
  m.def("continuation", &follow, nb::arg("scene_of"), nb::arg("start"), nb::arg("end"), nb::arg("longest_step"),
        nb::arg("tolerance"), nb::arg("max_points"), nb::arg("x0").none());
}

}  // namespace bromwich::python
