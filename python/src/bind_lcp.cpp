// Complementarity problems without dynamics.

#include "arrays.hpp"
#include "bromwich/friction_problem.hpp"
#include "bromwich/lcp_batch.hpp"
#include "calls.hpp"
#include "core/lcp/class_traits.hpp"
#include "machine.hpp"
#include "module.hpp"
#include "owned_arrays.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <mutex>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

namespace bromwich::python {
namespace {

using Array3 = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Sparse = std::tuple<Index, Index, Array1, Indices, Indices>;

LcpBatchOptions options_of(const std::string& lcp_class, const std::optional<Array2>& start) {
  LcpBatchOptions options;
  for (const LcpClassTraits& t : lcp_class_table)
    if (lcp_class == t.name) options.lcp_class = t.lcp_class;
  if (start) options.start = as_matrix(*start);
  return options;
}

/// (y, w, words of status, residual, margin, iterations, words of classes).
nb::tuple as_arrays(LcpBatchResult result) {
  std::vector<std::string> status, classes;
  for (const LcpStatus s : result.status) status.emplace_back(to_string(s));
  for (const LcpClass c : result.classes) classes.emplace_back(to_string(c));
  return nb::make_tuple(owned(std::move(result.y)), owned(std::move(result.w)), status,
                        owned(std::move(result.residual)), owned(std::move(result.margin)), result.iterations, classes);
}

template <class Matrices>
nb::tuple solved(const Matrices& M, const Array2& q, const LcpBatchOptions& options, const Wanted& wanted) {
  const RowMatrix right = as_matrix(q);
  LcpBatchResult result;
  {
    const nb::gil_scoped_release released;
    const auto machine = machine_for(wanted, Scene(), Options());
    const std::lock_guard lock(machine->busy);
    result = lcp_batch(M, right, *machine->backend, options);
  }
  return as_arrays(std::move(result));
}

}  // namespace

void bind_lcp(nb::module_& m) {
  m.def(
      "lcp_dense",
      [](const Array2& M, const Array2& q, const std::string& c, std::optional<Array2> start, const Wanted& wanted) {
        return solved(LcpMatrix(Matrix(as_matrix(M))), q, options_of(c, start), wanted);
      },
      nb::arg("M"), nb::arg("q"), nb::arg("lcp_class"), nb::arg("start").none(), nb::arg("wanted"));
  m.def(
      "lcp_tridiagonal",
      [](const Array1& lower, const Array1& diagonal, const Array1& upper, const Array2& q, const std::string& c,
         std::optional<Array2> start, const Wanted& wanted) {
        const Tridiagonal M{as_vector(lower), as_vector(diagonal), as_vector(upper)};
        return solved(LcpMatrix(M), q, options_of(c, start), wanted);
      },
      nb::arg("lower"), nb::arg("diagonal"), nb::arg("upper"), nb::arg("q"), nb::arg("lcp_class"),
      nb::arg("start").none(), nb::arg("wanted"));
  m.def(
      "lcp_sparse",
      [](const Sparse& M, const Array2& q, const std::string& c, std::optional<Array2> start, const Wanted& wanted) {
        const auto& [rows, cols, values, row, begin] = M;
        return solved(LcpMatrix(SparseLcpMatrix(as_sparse(rows, cols, values, row, begin))), q, options_of(c, start),
                      wanted);
      },
      nb::arg("M"), nb::arg("q"), nb::arg("lcp_class"), nb::arg("start").none(), nb::arg("wanted"));
  m.def(
      "lcp_own",
      [](const Array3& M, const Array2& q, const std::string& c, std::optional<Array2> start, const Wanted& wanted) {
        std::vector<Matrix> each;
        const auto rows = Index(M.shape(1)), cols = Index(M.shape(2));
        for (Index k = 0; k < Index(M.shape(0)); ++k)
          each.emplace_back(Eigen::Map<const RowMatrix>(M.data() + k * rows * cols, rows, cols));
        return solved(each, q, options_of(c, start), wanted);
      },
      nb::arg("M"), nb::arg("q"), nb::arg("lcp_class"), nb::arg("start").none(), nb::arg("wanted"));
  m.def(
      "friction_problem",
      [](const Array2& W, const Array1& q, const Array1& mu, double tolerance, Index most_sweeps) {
        const Matrix all = as_matrix(W);
        const Vector right = as_vector(q), friction = as_vector(mu);
        FrictionResult result;
        {
          const nb::gil_scoped_release released;
          result = solve_friction(all, right, friction, {tolerance, most_sweeps});
        }
        return nb::make_tuple(owned(std::move(result.r)), owned(std::move(result.u)), to_string(result.status),
                              result.residual, result.newton, result.sweeps);
      },
      nb::arg("W"), nb::arg("q"), nb::arg("mu"), nb::arg("tolerance"), nb::arg("most_sweeps"));
}

}  // namespace bromwich::python
