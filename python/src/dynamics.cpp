#include "dynamics.hpp"

#include "core/base/error.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/complex.h>
#include <nanobind/stl/string.h>

#include <string>
#include <utility>

namespace bromwich::python {
namespace {

template <class Scalar>
using Columns = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

/// Calls `function` with a copy of X and returns what it returns, which has to have as many rows and columns.
template <class Scalar>
Columns<Scalar> applied(const nb::object& function, const Columns<Scalar>& X, const char* name) {
  const std::size_t rows = std::size_t(X.rows()), cols = std::size_t(X.cols());
  nb::ndarray<nb::numpy, const Scalar> seen(X.data(), {rows, cols}, {}, {1, std::int64_t(rows)});
  const nb::object argument = seen.cast(nb::rv_policy::copy);
  const nb::object found =
      nb::module_::import_("bromwich._dynamics").attr("returned")(function(argument), argument, name);
  const auto values = nb::cast<nb::ndarray<const Scalar, nb::ndim<2>, nb::f_contig, nb::device::cpu>>(found);
  return Eigen::Map<const Columns<Scalar>>(values.data(), X.rows(), X.cols());
}

bool says_singular(const nb::python_error& error) {
  return nb::cast<bool>(nb::module_::import_("bromwich._dynamics").attr("says_singular")(error.value()));
}

[[noreturn]] void singular(Complex z, const nb::python_error& error) {
  throw SingularShift(
      "shifted",
      "found no solve at z = " + std::to_string(z.real()) + " + " + std::to_string(z.imag()) + "i: " + error.what(),
      "state the bound of the spectrum, or check the dynamics");
}

/// With the lock held; what says that zE - A is singular becomes SingularShift.
template <class Work>
auto with_shift(Complex z, const Work& work) {
  const nb::gil_scoped_acquire lock;
  try {
    return work();
  } catch (const nb::python_error& error) {
    if (says_singular(error)) singular(z, error);
    throw;
  }
}

}  // namespace

SuppliedDynamics supplied_dynamics(Index states, SparseMatrix B, SparseMatrix N, Kept shifted, Kept mass,
                                   std::optional<SpectralBound> bound) {
  SuppliedDynamics d;
  d.states = states;
  d.B = std::move(B);
  d.N = std::move(N);
  d.bound = bound;
  d.shifted = [shifted](Complex z) -> ShiftedSolve {
    const Kept solve = with_shift(z, [&] { return Kept(shifted.get()(z)); });
    return [solve, z](const ComplexMatrix& R) -> ComplexMatrix {
      return with_shift(z, [&] { return applied<Complex>(solve.get(), R, "shifted"); });
    };
  };
  if (mass)
    d.mass = [mass](const Matrix& X) -> Matrix {
      const nb::gil_scoped_acquire lock;
      return applied<double>(mass.get(), X, "mass");
    };
  return d;
}

}  // namespace bromwich::python
