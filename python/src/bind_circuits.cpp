// Netlists: their scene, and outputs of its results.

#include "answer.hpp"
#include "app/backend_choice.hpp"
#include "arrays.hpp"
#include "calls.hpp"
#include "circuits/balance.hpp"
#include "circuits/measures.hpp"
#include "circuits/operating_map.hpp"
#include "circuits/probe.hpp"
#include "circuits/responses.hpp"
#include "core/base/error.hpp"
#include "machine.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/complex.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <mutex>

namespace bromwich::python {
namespace {

using Settings = std::map<std::string, double>;

nb::tuple with_model(const Circuit& read) {
  const auto circuit = std::make_shared<const Circuit>(read);
  const auto model = std::make_shared<Model>(circuit->scene);
  constexpr double tolerance = 1e-4;  // of the states: y of ideal switches need not be unique
  model->scene.default_tolerance = tolerance;
  return nb::make_tuple(model, circuit);
}

nb::tuple read(const std::string& file, const Settings& settings, std::optional<double> period) {
  return with_model([&] {
    const nb::gil_scoped_release unlocked;
    return read_circuit(std::filesystem::path(file), settings, period);
  }());
}

nb::tuple parse(const std::string& text, const std::string& name, const std::string& folder, const Settings& settings,
                std::optional<double> period) {
  return with_model([&] {
    const nb::gil_scoped_release unlocked;
    return parse_circuit(text, name, std::filesystem::path(folder), settings, period);
  }());
}

template <class Values>
View owned(Values found) {
  auto* values = new Values(std::move(found));
  return view(*values, nb::capsule(values, [](void* p) noexcept { delete static_cast<Values*>(p); }));
}

nb::dict reduction(const Circuit& c) {
  nb::dict d;
  d["summary"] = c.reduction.summary;
  d["states"] = c.reduction.states;
  d["pairs"] = c.reduction.pairs;
  d["open"] = c.reduction.open;
  d["loops"] = c.reduction.loops;
  d["cutsets"] = c.reduction.cutsets;
  d["windings"] = c.reduction.windings;
  return d;
}

std::vector<std::pair<std::string, std::string>> outputs(const Circuit& c) {
  std::vector<std::pair<std::string, std::string>> all;
  for (const CircuitOutput& output : c.outputs) all.emplace_back(output.name, output.unit);
  return all;
}

/// What `work` makes of the waveforms of a result.
template <class Work>
auto of_waveforms(const Circuit& c, const Answer& answer, double from, double to, const Work& work) {
  return interruptible([&] {
    const std::lock_guard lock(answer.machine->busy);
    return work(CircuitWaveforms(c, *answer.machine->backend, answer.result, from, to, "start"));
  });
}

std::map<std::string, double> measures_of(const Circuit& c, const Answer& answer) {
  const std::vector<MeasuredValue> found = interruptible([&] {
    const std::lock_guard lock(answer.machine->busy);
    return measured(c, *answer.machine->backend, answer.result);
  });
  std::map<std::string, double> all;
  for (const MeasuredValue& m : found) all[m.name] = m.value;
  return all;
}

nb::dict balance_of(const Circuit& c, const Answer& answer, double from, double to) {
  const CircuitBalance b = of_waveforms(c, answer, from, to, [&](const CircuitWaveforms& w) { return balance(c, w); });
  nb::dict elements;
  for (const ElementPower& e : b.elements) elements[e.name.c_str()] = nb::make_tuple(e.power, e.mean, e.rms, e.peak);
  nb::dict d;
  d["supplied"] = b.supplied;
  d["stored"] = b.stored;
  d["dissipated"] = b.dissipated;
  d["error"] = b.error;
  d["load"] = b.load;
  d["efficiency"] = b.efficiency;
  d["elements"] = elements;
  return d;
}

/// A netlist as circuit() has read it.
struct NetlistSource {
  std::string text, name, folder;
  Settings settings;
  std::optional<double> period;

  Circuit with(const Settings& point) const {
    Settings all = settings;
    for (const auto& [name, value] : point) all[name] = value;
    return parse_circuit(text, name, folder, all, period);
  }
};

nb::dict map_of(const NetlistSource& source, std::vector<std::pair<std::string, std::vector<double>>> steps,
                std::vector<std::string> columns, const Options& given, const Wanted& wanted, nb::object progress,
                nb::object stop) {
  Calls calls(std::move(progress), std::move(stop));
  const auto found = unlocked(calls, [&] {
    struct Found {
      OperatingMap map;
      std::string backend;
      bool by_keyboard = false;
    };
    auto answer = std::make_shared<Found>();
    std::vector<CircuitStep> all;
    for (auto& [name, values] : steps) all.push_back({name, std::move(values)});
    const ReadCircuit read = [&](const Settings& point) { return source.with(point); };
    const Circuit circuit = first_point(read, all, "columns");
    if (columns.empty()) columns = map_columns(circuit);
    Options options = given;
    const auto machine = machine_for(wanted, circuit.scene, options);
    options.progress = [&](const Progress& p) { calls.progress(p); };
    options.interrupted = [&] { return calls.interrupted(); };
    const std::lock_guard lock(machine->busy);
    answer->backend = machine->backend->name();
    if (!machine->beside) machine->beside = app::backends_beside(*machine->backend, machine->device);
    answer->map = operating_map(read, all, columns, options, *machine->backend, machine->beside, "columns");
    return answer;
  });
  std::vector<std::string> status;
  for (const Status s : found->map.status) status.emplace_back(to_string(s));
  nb::dict d;
  d["columns"] = found->map.columns;
  d["units"] = found->map.units;
  d["status"] = status;
  d["reason"] = found->map.reason;
  d["values"] = owned(std::move(found->map.values));
  d["residual"] = owned(std::move(found->map.residual));
  d["backend"] = found->backend;
  d["interrupted"] = found->by_keyboard;
  return d;
}

}  // namespace

void bind_circuits(nb::module_& m) {
  nb::class_<Circuit>(m, "Circuit", "A netlist: what its outputs are made of.")
      .def_prop_ro("outputs", &outputs)
      .def_prop_ro("elements",
                   [](const Circuit& c) {
                     std::vector<std::pair<std::string, std::string>> all;
                     for (const CircuitElement& e : c.elements) all.emplace_back(e.name, std::string(1, e.kind));
                     return all;
                   })
      .def_prop_ro("times", [](const Circuit& c) { return std::vector<double>(c.times.begin(), c.times.end()); })
      .def_prop_ro("steps",
                   [](const Circuit& c) {
                     std::vector<std::pair<std::string, std::vector<double>>> all;
                     for (const CircuitStep& s : c.steps) all.emplace_back(s.name, s.values);
                     return all;
                   })
      .def_ro("notes", &Circuit::notes)
      .def_ro("parameters", &Circuit::parameters)
      .def_prop_ro("reduction", &reduction)
      .def(
          "values", [](const Circuit& c, const Answer& answer) { return owned(output_values(c, answer.result)); },
          nb::arg("answer"), "rows x outputs")
      .def(
          "probe",
          [](const Circuit& c, const Answer& answer, const std::string& text) {
            return owned(Vector(Probe(c, text, "name")(answer.result.t, output_values(c, answer.result))));
          },
          nb::arg("answer"), nb::arg("text"))
      .def("measures", &measures_of, nb::arg("answer"))
      .def("balance", &balance_of, nb::arg("answer"), nb::arg("start"), nb::arg("end"))
      .def(
          "harmonics",
          [](const Circuit& c, const Answer& answer, const std::string& text, Index count, double from, double to) {
            const Probe probe(c, text, "name");
            return of_waveforms(c, answer, from, to,
                                [&](const CircuitWaveforms& w) { return w.harmonics(probe, count); });
          },
          nb::arg("answer"), nb::arg("text"), nb::arg("count"), nb::arg("start"), nb::arg("end"))
      .def(
          "distortion",
          [](const Circuit& c, const Answer& answer, const std::string& text, double from, double to) {
            const Probe probe(c, text, "name");
            return of_waveforms(c, answer, from, to,
                                [&](const CircuitWaveforms& w) { return numbers(probe, w).distortion; });
          },
          nb::arg("answer"), nb::arg("text"), nb::arg("start"), nb::arg("end"))
      .def_prop_ro("frequencies", [](const Circuit& c) { return c.netlist->frequencies; })
      .def(
          "responses",
          [](const Circuit& c, const Answer& answer, const std::vector<std::string>& words, const std::string& source,
             const std::vector<double>& frequencies) {
            return nb::cast(interruptible([&] {
              const std::lock_guard lock(answer.machine->busy);
              return responses(c, *answer.machine->backend, answer.result, words, source, frequencies, "name").values;
            }));
          },
          nb::arg("answer"), nb::arg("words"), nb::arg("source"), nb::arg("frequencies"), "frequencies x words")
      .def(
          "unit", [](const Circuit& c, const std::string& text) { return Probe(c, text, "name").unit(); },
          nb::arg("text"));
  nb::class_<NetlistSource>(m, "CircuitSource")
      .def(
          "__init__",
          [](NetlistSource* s, std::string text, std::string name, std::string folder, Settings settings,
             std::optional<double> period) {
            new (s) NetlistSource{std::move(text), std::move(name), std::move(folder), std::move(settings), period};
          },
          nb::arg("text"), nb::arg("name"), nb::arg("folder"), nb::arg("settings"), nb::arg("period").none());
  m.def(
      "stability_margins",
      [](const std::vector<double>& frequencies, const ComplexVector& gain) {
        const StabilityMargins found = stability_margins(frequencies, gain);
        return std::tuple(found.crossover, found.phase, found.phase_crossover, found.gain);
      },
      nb::arg("frequencies"), nb::arg("gain"));
  m.def("circuit_map", &map_of, nb::arg("source"), nb::arg("steps"), nb::arg("columns"), nb::arg("options"),
        nb::arg("machine"), nb::arg("progress").none(), nb::arg("stop").none());
  m.def("read_circuit", &read, nb::arg("file"), nb::arg("settings"), nb::arg("period").none());
  m.def("parse_circuit", &parse, nb::arg("text"), nb::arg("name"), nb::arg("folder"), nb::arg("settings"),
        nb::arg("period").none());
}

}  // namespace bromwich::python
