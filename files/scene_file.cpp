#include "files/scene_file.hpp"

#include "core/base/error.hpp"
#include "files/include.hpp"
#include "files/names.hpp"
#include "files/nonlinear_section.hpp"
#include "files/reference_section.hpp"
#include "files/scene_draft.hpp"
#include "files/scene_matrices.hpp"
#include "files/scene_reader.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <utility>

namespace bromwich {

/// Sections have pointers to the document and the table.
struct SceneReader::File {
  Document document;
  toml::table root;
  Sections sections;
  std::vector<std::filesystem::path> path;  ///< of the file, or none
  Index sources = 0;                        ///< of the last scene

  File(std::string_view toml, const std::string& name, const std::filesystem::path& folder)
      : document{name},
        root(read_with_includes(document, toml, folder / std::filesystem::path(name).filename())),
        sections(read_sections(document, root)) {}
};

namespace {

constexpr const char* incomplete_switches =
    "not all times at which a source jumps or has a kink were found: its expressions switch too often; declare them as "
    "jumps in [time]";

/// tol, or tolerance; 0 without them.
double read_tolerance(const Section& time) {
  const std::optional<double> tol = time.optional_number("tol"), tolerance = time.optional_number("tolerance");
  if (tol && tolerance) throw Error(time.where("tolerance"), "is given beside tol", "give one of them");
  const std::optional<double> stated = tol ? tol : tolerance;
  if (stated && !(*stated > 0 && *stated < 1))
    throw Error(time.where(tol ? "tol" : "tolerance"), fmt::format("found {}", *stated),
                "give a number between 0 and 1, such as 1e-4");
  return stated.value_or(0);
}

/// What the file says beside the scene. `settings`: parameters with other values than in the file.
void add_facts(SceneFile& file, const Document& document, const Sections& sections, const ParameterValues& settings) {
  file.scene.name = sections.top.text("name", std::filesystem::path(document.name).stem().string());
  file.description = sections.top.text("description", "");
  file.parameters = document.expressions.parameters();
  file.states = sections.output.text("states", "none");
  parse_state_choice(sections.output.where("states"), file.states, file.scene);
  file.scene.default_tolerance = read_tolerance(sections.time);
  try {
    file.reference = read_reference(sections.reference, file.scene);
  } catch (const Error&) {  // it is valid for the parameters of the file, and others may change sizes and T
    if (settings.empty()) throw;
  }
  file.quantity = read_quantity(sections.quantity, file.scene);
}

}  // namespace

SceneReader::SceneReader(const std::filesystem::path& file) {
  const std::string name = one_line(file.string());
  file_ = std::make_unique<File>(read_text({name, file}, name), name, file.parent_path());
  file_->path = {file};
}
SceneReader::SceneReader(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder)
    : file_(std::make_unique<File>(toml, file_name, folder)) {}
SceneReader::~SceneReader() = default;
SceneReader::SceneReader(SceneReader&&) noexcept = default;
SceneReader& SceneReader::operator=(SceneReader&&) noexcept = default;

NonlinearFile SceneReader::nonlinear(const ParameterValues& settings) {
  auto& [document, root, sections, path, number_of_sources] = *file_;
  ParameterValues others;
  document.expressions.begin_scene();
  read_parameters(document, sections.parameters, settings, others);
  read_definitions(document, sections.definitions);
  NonlinearFile read;
  SceneFile& file = read.file;
  Draft draft = draft_scene(sections, others);
  file.scene = std::move(draft.scene);
  number_of_sources = draft.sources;
  file.mechanism = std::move(draft.mechanism);
  if (sections.kronecker.given()) file.rectangle = read_rectangle(sections);
  if (!draft.switches.complete) file.warning = incomplete_switches;
  add_facts(file, document, sections, settings);
  file.inputs = document.read;
  file.inputs.insert(file.inputs.end(), path.begin(), path.end());
  read.system = read_nonlinear(sections, file.scene);
  return read;
}

Index SceneReader::sources() const { return file_->sources; }

SceneFile SceneReader::linear(const ParameterValues& settings) {
  NonlinearFile read = nonlinear(settings);
  if (read.system)
    throw Error(fmt::format("{}: nonlinear", file_->document.name), "the file states a nonlinear system",
                "use bromwich solve, solve_nonlinear or read_nonlinear_file, or take [nonlinear] out");
  return std::move(read.file);
}

bool scene_files_available() { return true; }

NonlinearFile parse_nonlinear(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder,
                              const ParameterValues& settings) {
  return SceneReader(toml, file_name, folder).nonlinear(settings);
}

NonlinearFile read_nonlinear_file(const std::filesystem::path& file, const ParameterValues& settings) {
  return SceneReader(file).nonlinear(settings);
}

SceneFile parse_scene(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder,
                      const ParameterValues& settings) {
  return SceneReader(toml, file_name, folder).linear(settings);
}

SceneFile read_scene_file(const std::filesystem::path& file, const ParameterValues& settings) {
  return SceneReader(file).linear(settings);
}

ParameterValues file_parameters(const std::filesystem::path& file, const ParameterValues& settings) {
  const std::string name = one_line(file.string());
  Document document{name};
  const toml::table root = read_with_includes(document, read_text({name, file}, name), file);
  const Sections sections = read_sections(document, root);
  ParameterValues others;
  read_parameters(document, sections.parameters, settings, others);
  return document.expressions.parameters();
}

double constant_expression(const std::string& text, const ParameterValues& names, const std::string& where) {
  Expressions expressions;
  for (const Name& name : names_in(text))
    if (const auto known = names.find(name.text); known != names.end() && !expressions.has(name.text))
      expressions.define(name.text, known->second, where);
  return expressions.number(text, where);
}

}  // namespace bromwich
