// Solves of many small scenes on arrays of other libraries where they lie, and their gradients: tables of the size of
// the time points stay in the memory of the backend and are handed over by DLPack. Gradients with respect to A, B, N
// and M go through the host.

#include "arrays.hpp"
#include "batch/array_scenes.hpp"
#include "calls.hpp"
#include "machine.hpp"
#include "module.hpp"
#include "shared_arrays.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace bromwich::python {
namespace {

/// A table in the memory of a backend, for other libraries.
struct SharedTable {
  std::shared_ptr<Machine> machine;
  std::shared_ptr<double> numbers;
  Index rows = 0, cols = 0;

  ~SharedTable() { numbers.reset(); }  // memory before the backend
};

/// One matrix of every scene, owned by NumPy: K rows.
nb::object stacked(const std::vector<Matrix>& matrices) {
  const Index size = matrices.empty() ? 0 : matrices[0].size();
  auto* all = new RowMatrix(Index(matrices.size()), size);
  const nb::capsule owner(all, [](void* p) noexcept { delete static_cast<RowMatrix*>(p); });
  for (Index k = 0; k < all->rows(); ++k) {
    const RowMatrix by_rows = matrices[std::size_t(k)];
    all->row(k) = Eigen::Map<const Eigen::RowVectorXd>(by_rows.data(), size);
  }
  return nb::cast(view(*all, owner));
}

class PreparedScenes {
 public:
  PreparedScenes(std::shared_ptr<const Model> model, const Options& options, const Wanted& wanted, Index scenes)
      : machine_(machine_for(wanted, model->scene, options)) {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(machine_->busy);
    shared(*machine_);
    scenes_ = std::make_unique<ArrayScenes>(model->scene, *machine_->backend, options.steps, scenes);
  }
  ~PreparedScenes() {  // arrays before the backend
    const nb::gil_scoped_release released;
    const std::lock_guard lock(machine_->busy);
    scenes_.reset();
    x0_.reset(), f_.reset(), g_.reset();
  }
  PreparedScenes(const PreparedScenes&) = delete;
  PreparedScenes& operator=(const PreparedScenes&) = delete;

  std::tuple<int, int, std::uintptr_t> place() const {
    const SharedMemory::Place place = shared(*machine_).place();
    return {place.kind, place.number, place.stream};
  }
  std::string backend() const { return machine_->backend->name(); }

  std::vector<std::string> solve(const AnyTable& x0, const std::optional<AnyTable>& f,
                                 const std::optional<AnyTable>& g) {
    const Index m = scenes_->states(), n = scenes_->constraints();
    check(x0, "x0", 1, m);
    if (f) check(*f, "f", rows(), m);
    if (g) check(*g, "g", rows(), n);
    const nb::gil_scoped_release released;
    const std::lock_guard lock(machine_->busy);
    take(&x0, x0_), take(f ? &*f : nullptr, f_), take(g ? &*g : nullptr, g_);
    return scenes_->solve({x0_.get(), f_.get(), g_.get()});
  }

  /// "y", "x" or "w" of the last solve: K (J+1) rows.
  std::shared_ptr<SharedTable> table(const std::string& name) {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(machine_->busy);
    auto found = written(name == "y" ? scenes_->y() : name == "x" ? scenes_->x() : scenes_->w());
    machine_->backend->wait();
    return found;
  }

  /// Lines of the scenes, gradients by x0 (K x m), f and g (K (J+1) rows), and by A, B, N and M, K rows each.
  nb::tuple vjp(const std::optional<AnyTable>& y, const std::optional<AnyTable>& x, const std::optional<AnyTable>& w) {
    const Index m = scenes_->states(), n = scenes_->constraints(), K = scenes_->scenes();
    if (y) check(*y, "y", rows(), n);
    if (x) check(*x, "x", rows(), m);
    if (w) check(*w, "w", rows(), n);
    std::vector<std::string> reasons;
    std::shared_ptr<SharedTable> of_x0, of_f, of_g;
    ArrayScenes::ByMatrices by;
    {
      const nb::gil_scoped_release released;
      const std::lock_guard lock(machine_->busy);
      Backend& backend = *machine_->backend;
      std::unique_ptr<Array> of_y, of_x, of_w;
      take(y ? &*y : nullptr, of_y), take(x ? &*x : nullptr, of_x), take(w ? &*w : nullptr, of_w);
      const auto bar_x0 = backend.array(K, m), bar_f = backend.array(K * rows(), m),
                 bar_g = backend.array(K * rows(), n);
      reasons = scenes_->vjp({of_y.get(), of_x.get(), of_w.get()}, {bar_x0.get(), bar_f.get(), bar_g.get()}, &by);
      of_x0 = written(*bar_x0), of_f = written(*bar_f), of_g = written(*bar_g);
      backend.wait();
    }
    return nb::make_tuple(reasons, of_x0, of_f, of_g, stacked(by.A), stacked(by.B), stacked(by.N), stacked(by.M));
  }

 private:
  Index rows() const { return scenes_->steps() + 1; }

  void check(const AnyTable& table, const std::string& name, Index rows, Index cols) const {
    check_place(shared(*machine_).place(), table.device_type(), table.device_id(), name);
    const Index all = rows * scenes_->scenes(), found = Index(table.shape(0));
    if ((found == rows || found == all) && Index(table.shape(1)) == cols) return;
    throw Error(name, "has shape (" + std::to_string(found) + ", " + std::to_string(table.shape(1)) + ")",
                "give (" + std::to_string(rows) + ", " + std::to_string(cols) + ") for all scenes, or (" +
                    std::to_string(all) + ", " + std::to_string(cols) + ")");
  }

  // Into an array of its own; it is kept from one call to the next.
  void take(const AnyTable* from, std::unique_ptr<Array>& to) {
    if (!from) return to.reset();
    const Index rows = Index(from->shape(0)), cols = Index(from->shape(1));
    if (!to || to->rows() != rows || to->cols() != cols) to = machine_->backend->array(rows, cols);
    shared(*machine_).read(from->data(), *to);
  }

  std::shared_ptr<SharedTable> written(const Array& from) {
    auto made = std::make_shared<SharedTable>();
    made->machine = machine_;
    made->rows = from.rows(), made->cols = from.cols();
    made->numbers = shared(*machine_).numbers(from.rows() * from.cols());
    shared(*machine_).write(from, made->numbers.get());
    return made;
  }

  std::shared_ptr<Machine> machine_;
  std::unique_ptr<ArrayScenes> scenes_;
  std::unique_ptr<Array> x0_, f_, g_;
};

}  // namespace

void bind_scene_arrays(nb::module_& m) {
  nb::class_<SharedTable>(m, "SharedTable", "A table in the memory of a backend.")
      .def_prop_ro("shape", [](const SharedTable& t) { return std::pair(t.rows, t.cols); })
      .def_prop_ro("place",
                   [](const SharedTable& t) {
                     const SharedMemory::Place place = shared(*t.machine).place();
                     return std::pair(place.kind, place.number);
                   })
      .def_prop_ro("address", [](const SharedTable& t) { return reinterpret_cast<std::uintptr_t>(t.numbers.get()); })
      .def(
          "capsule",
          [](const std::shared_ptr<SharedTable>& t) {
            return handed_over(t, t->numbers.get(), {t->rows, t->cols}, shared(*t->machine).place());
          },
          "A DLPack capsule.");
  nb::class_<PreparedScenes>(m, "PreparedScenes")
      .def(nb::init<std::shared_ptr<const Model>, const Options&, const Wanted&, Index>(), nb::arg("model"),
           nb::arg("options"), nb::arg("wanted"), nb::arg("scenes"))
      .def_prop_ro("place", &PreparedScenes::place, "Kind and number of the device, and its stream.")
      .def_prop_ro("backend", &PreparedScenes::backend)
      .def("solve", &PreparedScenes::solve, nb::arg("x0"), nb::arg("f").none(), nb::arg("g").none())
      .def("table", &PreparedScenes::table, nb::arg("name"))
      .def("vjp", &PreparedScenes::vjp, nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none());
}

}  // namespace bromwich::python
