// Solves on arrays of other libraries where they lie: g and f are read, y and w written in the memory of the backend,
// and handed over by DLPack.

#include "arrays.hpp"
#include "calls.hpp"
#include "core/base/error.hpp"
#include "core/seam/shared_memory.hpp"
#include "core/solve/array_solver.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "machine.hpp"
#include "module.hpp"
#include "shared_arrays.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <string>
#include <tuple>
#include <utility>

namespace bromwich::python {
namespace {

/// What a solve has left in the memory of its backend.
struct SharedAnswer {
  std::shared_ptr<Machine> machine;
  Result result;
  std::shared_ptr<double> y, w;
  Index rows = 0, cols = 0;
  bool by_keyboard = false;

  ~SharedAnswer() {  // memory before the backend
    y.reset();
    w.reset();
  }
};

nb::ndarray<double> capsule_of(const std::shared_ptr<SharedAnswer>& answer, const std::string& name) {
  double* const numbers = (name == "y" ? answer->y : answer->w).get();
  return handed_over(answer, numbers, {answer->rows, answer->cols}, shared(*answer->machine).place());
}

class PreparedArrays {
 public:
  PreparedArrays(std::shared_ptr<const Model> model, const Options& options, const Wanted& wanted)
      : machine_(machine_for(wanted, model->scene, options, true)),
        solver_(model->scene, *machine_->backend, listened(options)) {}

  std::tuple<int, int, std::uintptr_t> place() const {
    const SharedMemory::Place place = shared(*machine_).place();
    return {place.kind, place.number, place.stream};
  }

  void set_x0(const Array1& x0) {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(machine_->busy);
    solver_.set_x0(as_vector(x0));
  }

  std::shared_ptr<SharedAnswer> solve(std::optional<AnyTable> g, std::optional<AnyTable> f, nb::object progress,
                                      nb::object stop) {
    if (g) check(*g, "g");
    if (f) check(*f, "f");
    Calls calls(std::move(progress), std::move(stop));
    return unlocked(calls, [&] {
      const std::lock_guard lock(machine_->busy);
      calls_ = &calls;
      const struct Forget {
        Calls*& calls;
        ~Forget() { calls = nullptr; }
      } forget{calls_};
      return solved(g, f);
    });
  }

 private:
  void check(const AnyTable& table, const std::string& name) const {
    check_place(shared(*machine_).place(), table.device_type(), table.device_id(), name);
    const Index rows = solver_.steps() + 1, cols = solver_.scene().constraints();
    if (Index(table.shape(0)) == rows && Index(table.shape(1)) == cols) return;
    throw Error(name, "has shape (" + std::to_string(table.shape(0)) + ", " + std::to_string(table.shape(1)) + ")",
                "give (" + std::to_string(rows) + ", " + std::to_string(cols) + "), a row for each time point");
  }

  // Tables that are not given stay as they were; at first they are zero.
  std::shared_ptr<SharedAnswer> solved(const std::optional<AnyTable>& g, const std::optional<AnyTable>& f) {
    SharedMemory& memory = shared(*machine_);
    if (g) memory.read(g->data(), solver_.g());
    if (f) memory.read(f->data(), solver_.phi());
    auto answer = std::make_shared<SharedAnswer>();
    answer->machine = machine_;
    answer->result = solver_.solve();
    answer->rows = solver_.y().rows(), answer->cols = solver_.y().cols();
    for (const auto& [numbers, array] : {std::pair(&answer->y, &solver_.y()), std::pair(&answer->w, &solver_.w())}) {
      *numbers = memory.numbers(answer->rows * answer->cols);
      memory.write(*array, numbers->get());
    }
    machine_->backend->wait();
    return answer;
  }

  Options listened(Options options) {
    options.progress = [this](const Progress& p) {
      if (calls_) calls_->progress(p);
    };
    options.interrupted = [this] { return calls_ && calls_->interrupted(); };
    return options;
  }

  std::shared_ptr<Machine> machine_;
  Calls* calls_ = nullptr;  ///< of the solve that runs
  ArraySolver solver_;
};

nb::dict facts(const SharedAnswer& answer) {
  const Result& r = answer.result;
  nb::dict d;
  d["status"] = to_string(r.status);
  d["reason"] = r.reason;
  d["backend"] = r.backend;
  d["method"] = to_string(r.method);
  d["kernel"] = r.kernel;
  d["residual"] = r.residual;
  d["kernel_error"] = r.kernel_error;
  d["iterations"] = r.iterations;
  d["history"] = nb::cast(r.history);
  d["infeasible_at"] = r.infeasible_at;
  d["seconds"] = r.seconds.total;
  d["by_keyboard"] = answer.by_keyboard;
  return d;
}

/// A device for copies alone, made when it is first needed.
Machine& copier() {
  static Machine* made = new Machine(make_cuda_backend(make_cpu_backend(1)));  // never destroyed, as in machine.cpp
  return *made;
}

std::uintptr_t stream_of_copies() { return shared(copier()).place().stream; }

/// Bytes of an array of the CUDA device.
nb::bytes to_host(const nb::ndarray<nb::ro, nb::c_contig>& array) {
  Machine& machine = copier();
  SharedMemory& memory = shared(machine);
  check_place(memory.place(), array.device_type(), array.device_id(), "array");
  std::string copied(array.nbytes(), '\0');
  {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(machine.busy);
    memory.to_host(array.data(), copied.size(), copied.data());
  }
  return nb::bytes(copied.data(), copied.size());
}

}  // namespace

void bind_arrays(nb::module_& m) {
  nb::class_<SharedAnswer>(m, "SharedAnswer", "Results in the memory of a backend.")
      .def_prop_ro("facts", &facts)
      .def_prop_ro("t",
                   [](nb::handle_t<SharedAnswer> self) { return view(nb::cast<SharedAnswer&>(self).result.t, self); })
      .def_prop_ro("shape", [](const SharedAnswer& a) { return std::pair(a.rows, a.cols); })
      .def_prop_ro("place",
                   [](const SharedAnswer& a) {
                     const SharedMemory::Place place = shared(*a.machine).place();
                     return std::pair(place.kind, place.number);
                   })
      .def(
          "address",
          [](const SharedAnswer& a, const std::string& name) {
            return reinterpret_cast<std::uintptr_t>((name == "y" ? a.y : a.w).get());
          },
          nb::arg("name"))
      .def("capsule", &capsule_of, nb::arg("name"), "A DLPack capsule of y or w.");
  nb::class_<PreparedArrays>(m, "PreparedArrays")
      .def(nb::init<std::shared_ptr<const Model>, const Options&, const Wanted&>(), nb::arg("model"),
           nb::arg("options"), nb::arg("wanted"))
      .def_prop_ro("place", &PreparedArrays::place, "Kind and number of the device, and its stream.")
      .def("set_x0", &PreparedArrays::set_x0, nb::arg("x0"))
      .def("solve", &PreparedArrays::solve, nb::arg("g").none(), nb::arg("f").none(), nb::arg("progress").none(),
           nb::arg("stop").none());
  m.def("stream_of_copies", &stream_of_copies, "The stream on which `to_host` copies.");
  m.def("to_host", &to_host, nb::arg("array"), "The bytes of an array of a CUDA device.");
}

}  // namespace bromwich::python
