// Rules of the inverse Laplace transform, as arrays: python/bromwich/_invert.py applies them to the values of F, whose
// arrays may be those of JAX.

#include "core/numerics/inversion_rule.hpp"
#include "module.hpp"
#include "owned_arrays.hpp"

#include <nanobind/stl/complex.h>
#include <nanobind/stl/vector.h>

namespace bromwich::python {
namespace {

/// (points, weights, sizes of errors).
nb::tuple as_arrays(InversionRule& rule, InversionWeights& weights) {
  return nb::make_tuple(owned(rule.points()), owned(std::move(weights.value)), owned(std::move(weights.error)));
}

InversionOptions options_of(std::vector<Complex> singularities, bool real, double accuracy) {
  InversionOptions options;
  options.singularities = std::move(singularities);
  options.real = real;
  options.accuracy = accuracy;
  return options;
}

nb::list windows(const Array1& t, std::vector<Complex> singularities, bool real, double accuracy) {
  nb::list all;
  for (InversionWindow& w : inversion_windows(as_vector(t), options_of(std::move(singularities), real, accuracy))) {
    std::vector<Index> rows = w.rows;
    all.append(
        nb::make_tuple(owned(Eigen::Matrix<Index, Eigen::Dynamic, 1>(
                           Eigen::Map<Eigen::Matrix<Index, Eigen::Dynamic, 1>>(rows.data(), Index(rows.size())))),
                       as_arrays(w.rule, w.weights), as_arrays(w.second, w.second_weights)));
  }
  return all;
}

/// Points, weights and sizes of errors, a row for each t.
nb::tuple talbot(const Array1& t, std::vector<Complex> singularities, bool real, double accuracy) {
  const Vector times = as_vector(t);
  const std::vector<InversionRule> rules = talbot_rules(times, options_of(std::move(singularities), real, accuracy));
  const Index points = rules.empty() ? 0 : rules[0].size();
  ComplexMatrix s(times.size(), points), value(times.size(), points);
  Matrix error(times.size(), points);
  for (Index i = 0; i < times.size(); ++i) {
    const InversionRule& rule = rules[std::size_t(i)];
    const InversionWeights weights = inversion_weights(rule, times.segment(i, 1), accuracy);
    s.row(i) = rule.points().transpose();
    value.row(i) = weights.value;
    error.row(i) = weights.error;
  }
  return nb::make_tuple(owned(std::move(s)), owned(std::move(value)), owned(std::move(error)));
}

}  // namespace

void bind_inversion(nb::module_& m) {
  m.def("inversion_windows", &windows, nb::arg("t"), nb::arg("singularities"), nb::arg("real"), nb::arg("accuracy"));
  m.def("talbot", &talbot, nb::arg("t"), nb::arg("singularities"), nb::arg("real"), nb::arg("accuracy"));
}

}  // namespace bromwich::python
