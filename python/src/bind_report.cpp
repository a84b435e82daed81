// The page of a result, and the object that describes it: those of the command.

#include "answer.hpp"
#include "app/mechanism_output.hpp"
#include "app/output_json.hpp"
#include "core/build_info.hpp"
#include "report/page.hpp"

#include <nanobind/stl/map.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace bromwich::python {
namespace {

using Texts = std::map<std::string, std::vector<std::string>>;

/// The scene as the command has it, with the names and units that Python knows.
app::SceneChoice choice_of(const Answer& answer, const std::map<std::string, double>& parameters, Texts names,
                           Texts units) {
  app::SceneChoice choice;
  choice.scene = answer.model->scene;
  choice.parameters = parameters;
  choice.scene.names = {names["x"], names["y"], names["w"]};
  choice.scene.units = {units["x"], units["y"], units["w"]};
  choice.scene.time_unit = units["t"].empty() ? "" : units["t"].front();
  return choice;
}

/// `mechanism`: null for a scene that is no structure.
app::Json object_of(const Answer& answer, const app::SceneChoice& choice, const Mechanism* mechanism) {
  const std::vector<std::string> decisions;
  const int threads = answer.machine->backend->device().threads;
  app::Json object = app::to_json(choice, answer.result, threads, {}, {answer.options, decisions});
  if (mechanism) {
    Mechanism of_answer = *mechanism;
    of_answer.scene = answer.model->scene;
    app::report_on_contacts(of_answer, answer.result, object);
  }
  return object;
}

std::string summary(const Answer& answer, const std::map<std::string, double>& parameters, const Texts& names,
                    const Texts& units, const Mechanism* mechanism) {
  const nb::gil_scoped_release released;
  return app::dump(object_of(answer, choice_of(answer, parameters, names, units), mechanism));
}

std::string page(const Answer& answer, const std::map<std::string, double>& parameters, const Texts& names,
                 const Texts& units, const Mechanism* mechanism) {
  const nb::gil_scoped_release released;
  const app::SceneChoice choice = choice_of(answer, parameters, names, units);
  return report::page({object_of(answer, choice, mechanism), report::as_table(choice.scene, answer.result),
                       "bromwich.solve, Python", build_info::version});
}

std::string page_of_file(const std::string& name) {
  const nb::gil_scoped_release released;
  report::ResultTable table = report::read_result("path", name);
  report::Json object = report::Json::parse(table.summary.empty() ? "null" : table.summary, nullptr, false);
  return report::page(
      {std::move(object), std::move(table), std::filesystem::path(name).filename().string(), build_info::version});
}

}  // namespace

void bind_report(nb::module_& m) {
  for (const auto& [name, function, words] : {std::tuple("summary", &summary, "The object of solve --json, as text."),
                                              {"page", &page, "The page of solve --report, as HTML."}})
    m.def(name, function, nb::arg("answer"), nb::arg("parameters"), nb::arg("names"), nb::arg("units"),
          nb::arg("mechanism").none(), words);
  m.def("page_of_file", &page_of_file, nb::arg("name"), "The page of a file of results, as HTML.");
  m.attr("commit") = build_info::commit;
}

}  // namespace bromwich::python
