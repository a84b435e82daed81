#include "capi/settings.hpp"

#include "core/base/error.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/method_choice.hpp"
#include "cpu/cpu_backend.hpp"
#include "files/scene_file.hpp"
#include "files/words.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <sstream>
#include <utility>
#include <vector>

namespace bromwich::capi {

namespace {

constexpr Index recorded_states = 1000;  ///< the largest number that is recorded by default, as in Python

using Pairs = std::vector<std::pair<std::string, std::string>>;

Pairs pairs_of(const char* text, const char* argument) {
  Pairs pairs;
  std::istringstream words(text ? text : "");
  for (std::string word; words >> word;) {
    const std::size_t equals = word.find('=');
    if (equals == 0 || equals == std::string::npos || equals + 1 == word.size())
      throw Error(argument, fmt::format("found '{}'", word), "write key=value without blanks");
    const std::string key = word.substr(0, equals);
    for (const auto& [known, value] : pairs)
      if (known == key) throw Error(argument, fmt::format("{} is given twice", key), "set it once");
    pairs.emplace_back(key, word.substr(equals + 1));
  }
  return pairs;
}

/// One word of the options.
struct Word {
  const std::string &key, &text;

  [[noreturn]] void refuse(const std::string& remedy) const {
    throw Error("options: " + key, fmt::format("found '{}'", text), remedy);
  }
  Index whole(Index least) const {
    const auto value = parse_count(text);
    if (!value || *value < least) refuse(fmt::format("give an integer, {} or more", least));
    return Index(*value);
  }
  double positive() const {
    const auto value = parse_double(text);
    if (!value || !(*value > 0)) refuse("give a positive number");
    return *value;
  }
  bool yes() const {
    if (text != "0" && text != "1") refuse("give 0 or 1");
    return text == "1";
  }
};

using Take = std::function<void(Settings&, const Word&)>;

const std::vector<std::pair<std::string, Take>>& known_options() {
  static const std::vector<std::pair<std::string, Take>> known{
      {"method", [](Settings& s, const Word& w) { s.options.method = method_from_string(w.text); }},
      {"steps", [](Settings& s, const Word& w) { s.options.steps = w.whole(1); }},
      {"tol", [](Settings& s, const Word& w) { s.options.tolerance = w.positive(); }},
      {"tol-x", [](Settings& s, const Word& w) { s.options.tolerance_x = w.positive(); }},
      {"tol-y", [](Settings& s, const Word& w) { s.options.tolerance_y = w.positive(); }},
      {"atol", [](Settings& s, const Word& w) { s.options.absolute_tolerance = w.positive(); }},
      {"max-steps", [](Settings& s, const Word& w) { s.options.max_steps = w.whole(1); }},
      {"max-seconds", [](Settings& s, const Word& w) { s.options.max_seconds = w.positive(); }},
      {"iteration-tol", [](Settings& s, const Word& w) { s.options.iteration_tolerance = w.positive(); }},
      {"max-iterations", [](Settings& s, const Word& w) { s.options.max_iterations = w.whole(1); }},
      {"states", [](Settings& s, const Word& w) { s.states = w.text; }},
      {"backend", [](Settings& s, const Word& w) { s.backend = w.text; }},
      {"device", [](Settings& s, const Word& w) { s.device = int(w.whole(0)); }},
      {"threads", [](Settings& s, const Word& w) { s.threads = int(w.whole(0)); }},
      {"memory-limit", [](Settings& s, const Word& w) { s.options.memory_limit = w.positive(); }},
      {"event-location", [](Settings& s, const Word& w) { s.options.event_location = w.yes(); }},
      {"confirm", [](Settings& s, const Word& w) { s.options.confirm = w.yes(); }},
  };
  return known;
}

/// Names with '_' in place of '-' are taken too: keywords of Python.
void take_option(Settings& settings, std::string key, const std::string& text) {
  std::replace(key.begin(), key.end(), '_', '-');
  std::vector<std::string> names;
  for (const auto& [name, take] : known_options()) {
    if (name == key) return take(settings, {name, text});
    names.push_back(name);
  }
  throw Error("options", fmt::format("found '{}'", key) + suggestion(key, names), "use " + join(names));
}

/// As the command and the Python package do.
void take_defaults(Options& options, const Scene& scene, bool circuit, bool own_iteration_tolerance) {
  const bool stated = controls_error(options);
  options = with_defaults(options, scene);
  if (circuit && !stated) std::swap(options.tolerance, options.tolerance_x);
  double smallest = 0;
  for (const double one : {options.tolerance, options.tolerance_x, options.tolerance_y})
    if (one > 0 && (smallest == 0 || one < smallest)) smallest = one;
  // Iterations that end below a thousandth of the tolerance do not affect differences of grids.
  if (smallest > 0 && options.method != Method::goal && !own_iteration_tolerance)
    options.iteration_tolerance = std::max(1e-3 * smallest, options.iteration_tolerance);
}

}  // namespace

ParameterValues parameters_of(const char* settings) {
  ParameterValues values;
  for (const auto& [key, text] : pairs_of(settings, "settings")) {
    const auto number = parse_double(text);
    values.emplace(key, number ? *number : constant_expression(text, values, "settings: " + key));
  }
  return values;
}

Settings settings_of(const char* text, const Scene& scene, bool circuit) {
  Settings settings;
  const double untouched = settings.options.iteration_tolerance;
  for (const auto& [key, word] : pairs_of(text, "options")) take_option(settings, key, word);
  Options& options = settings.options;
  take_defaults(options, scene, circuit, options.iteration_tolerance != untouched);
  options.trace = options.method != Method::goal;
  if (settings.states == "auto") settings.states = scene.states() <= recorded_states ? "all" : "none";
  StateChoice choice = parse_state_choice("options: states", settings.states, scene);
  options.states = choice.selection;
  options.components = std::move(choice.components);
  return settings;
}

std::shared_ptr<Backend> backend_of(const Settings& s, const Scene& scene) {
  const Index steps = steps_of(scene, s.options);
  if (s.backend == "cpu" ||
      (s.backend == "auto" &&
       (!cuda_built() || !faster_on_device(cuda_traits(), cpu_traits(), scene, s.options.method, steps, false) ||
        cuda_devices().empty())))
    return make_cpu_backend(s.threads);
  if (s.backend != "auto" && s.backend != "cuda")
    throw Error("options: backend",
                fmt::format("found '{}'", s.backend) + suggestion(s.backend, {"auto", "cpu", "cuda"}),
                "use auto, cpu or cuda");
  if (!cuda_built()) throw Error("options: backend", "found 'cuda' but this build has no CUDA backend", "use cpu");
  if (cuda_devices().empty())
    throw Error("options: backend", "found 'cuda' but no CUDA device", "use cpu, or see what nvidia-smi says",
                ErrorKind::device);
  std::shared_ptr<Backend> cuda = make_cuda_backend(make_cpu_backend(s.threads), s.device.value_or(0));
  const Index components = Index(recorded_components(scene, s.options).size());
  const bool fits = s.backend == "cuda" || fits_on_device(scene, s.options.method, steps, components, cuda->device());
  return fits ? cuda : make_cpu_backend(s.threads);
}

bromwich_hooks hooks_of(const bromwich_hooks* given) {
  bromwich_hooks hooks{};
  if (!given) return hooks;
  if (given->size < offsetof(bromwich_hooks, interrupted))
    throw Error("hooks.size", fmt::format("found {}", given->size), "set it to sizeof(bromwich_hooks)");
  std::memcpy(&hooks, given, std::min(given->size, sizeof hooks));
  return hooks;
}

void listen(Options& options, const bromwich_hooks& h) {
  if (h.interrupted) options.interrupted = [h] { return h.interrupted(h.user) != 0; };
  if (h.progress) options.progress = [h](const Progress& p) { h.progress(p.iteration, p.total, p.change, h.user); };
  if (h.log) options.log = [h](const LogEntry& entry) { h.log(int(entry.level), entry.text.c_str(), h.user); };
}

}  // namespace bromwich::capi
