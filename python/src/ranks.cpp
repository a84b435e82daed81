#include "ranks.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/dynamics.hpp"
#include "core/lcp/matrix.hpp"
#include "module.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/shared_ptr.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace bromwich::python {
namespace {

using Values = nb::ndarray<nb::numpy, double>;

// A view without an owner: Python uses it during the call alone.
nb::object shown(double* values, Index count) {
  static double none = 0;
  return nb::cast(Values(count > 0 ? values : &none, {std::size_t(count)}, nb::handle()), nb::rv_policy::reference);
}

// A sum in which every place counts otherwise.
template <class Table>
double weighted(const Table& table) {
  double sum = 0;
  for (Index j = 0; j < table.cols(); ++j)
    for (Index i = 0; i < table.rows(); ++i) sum += std::cos(1. + double(i) + 7 * double(j)) * table(i, j);
  return sum;
}
double weighted(const SparseMatrix& table) {
  double sum = 0;
  for (Index j = 0; j < table.outerSize(); ++j)
    for (SparseMatrix::InnerIterator it(table, j); it; ++it)
      sum += std::cos(1. + double(it.row()) + 7 * double(j)) * it.value();
  return sum;
}

double sum_of_A(const LinearSystem& system) {
  if (const DenseDynamics* dense = system.small_state()) return weighted(dense->A);
  if (const KroneckerDynamics* sum = system.modes())
    return weighted(Matrix(sum->face_eigenvalues())) + double(sum->across.points) * sum->across.spacing;
  if (const SparseDynamics* sparse = system.matrices()) return weighted(sparse->A);
  return 0;
}

std::vector<double> facts_of(const Scene& scene, const Options& o) {
  const Index n = scene.constraints();
  std::vector<double> facts{double(scene.states()),
                            double(n),
                            scene.T,
                            double(steps_of(scene, o)),
                            double(o.method),
                            o.iteration_tolerance,
                            double(o.max_iterations),
                            double(o.states),
                            double(o.components.size()),
                            double(scene.breakpoints.size()),
                            sum_of_A(*scene.dynamics),
                            weighted(scene.dynamics->inputs()),
                            weighted(scene.dynamics->outputs()),
                            weighted(Matrix(scene.x0)),
                            weighted(Matrix(multiply(scene.M, Vector::LinSpaced(n, 1, 2))))};
  for (const auto& [source, width] : {std::pair(&scene.f, scene.sources()), {&scene.g, n}})
    for (const double part : {0., 0.3, 1.}) {
      Vector value = Vector::Zero(*source ? width : 0);
      if (*source) (*source)(part * scene.T, value);
      facts.push_back(weighted(Matrix(value)));
    }
  return facts;
}

}  // namespace

PythonRanks::PythonRanks(nb::object ranks)
    : Communicator(nb::cast<int>(ranks.attr("rank")), nb::cast<int>(ranks.attr("size"))), ranks_(std::move(ranks)) {}

void PythonRanks::do_shift(const Vector& right, Vector& left) {
  const nb::gil_scoped_acquire lock;
  ranks_.attr("shift")(shown(const_cast<double*>(right.data()), right.size()), shown(left.data(), left.size()));
}

void PythonRanks::do_gather(const Vector& values, RowMatrix& all) {
  const nb::gil_scoped_acquire lock;
  ranks_.attr("gather")(shown(const_cast<double*>(values.data()), values.size()), shown(all.data(), all.size()));
}

void PythonRanks::do_maximum(Vector& values) {
  const nb::gil_scoped_acquire lock;
  ranks_.attr("maximum")(shown(values.data(), values.size()));
}

void PythonRanks::do_broadcast(double* values, Index count, int root) {
  const nb::gil_scoped_acquire lock;
  ranks_.attr("broadcast")(shown(values, count), root);
}

void check_same(Communicator& ranks, const Scene& scene, const Options& options) {
  const std::vector<double> own = facts_of(scene, options);
  const RowMatrix all = ranks.gather(Eigen::Map<const Vector>(own.data(), Index(own.size())));
  for (Index r = 1; r < all.rows(); ++r)
    for (Index i = 0; i < all.cols(); ++i)
      if (all(r, i) != all(0, i) && !(std::isnan(all(r, i)) && std::isnan(all(0, i))))
        throw Error("ranks", "the scene or the options of rank " + std::to_string(r) + " differ from those of rank 0",
                    "give all ranks the same");
}

void bind_ranks(nb::module_& m) {
  nb::class_<PythonRanks>(m, "Ranks", "The ranks of a job, as the library talks to them.")
      .def(nb::init<nb::object>(), nb::arg("ranks"));
}

}  // namespace bromwich::python
