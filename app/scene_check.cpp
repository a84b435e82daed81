#include "app/scene_check.hpp"

#include "app/circuit_check.hpp"
#include "app/mechanism_check.hpp"
#include "app/memory_output.hpp"
#include "app/nonlinear_solve.hpp"
#include "app/scene_facts.hpp"
#include "app/text.hpp"
#include "core/dynamics/spectrum.hpp"
#include "core/iteration/windows.hpp"
#include "core/kernel/ringing.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/scene/has_impacts.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/scene/separable.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/method_choice.hpp"
#include "core/solve/methods.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/shooting_control.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich::app {

namespace {

// Of one core, within a factor of ten: multiplications, and what a step costs however small it is.
constexpr double operations_per_second = 1e9;
constexpr double seconds_of_step = 5e-7, seconds_of_stages = 1.5e-5;  ///< stages: where M leaves y to the dynamics
constexpr Index smallest_sparse = 512;  ///< below, solves write sparse dynamics out (core/solve/reductions.cpp)
constexpr double large_growth = 1e6;    ///< of a free state over [0, T]

std::string counted(std::size_t count, const char* noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

std::string kind_text(const LinearSystem& dynamics) {
  if (dynamics.small_state()) return "dense matrices";
  if (const auto* d = dynamics.modes())
    return fmt::format("Kronecker sum, {} lines of {} points{}", d->lines(), d->across.points,
                       d->both_faces ? ", constraints at both ends" : "");
  if (const auto* d = dynamics.matrices()) return fmt::format("sparse matrices, {} nonzeros in A", d->A.nonZeros());
  return "supplied by callbacks";
}

std::string mass_text(const Dynamics& dynamics) {
  if (!dynamics->has_mass()) return "E = I";
  return dynamics->has_singular_mass() ? "E is singular" : "E is regular";
}

/// The scene on which the methods work: without E and free rows, small sparse matrices written out.
Scene reduced(const Scene& scene) {
  Scene result = scene;
  if (result.dynamics->has_mass())
    if (auto without = without_mass(result)) result = std::move(*without);
  if (!result.free_rows.empty() && !result.boundary && result.dynamics->has_matrices())
    if (auto eliminated = eliminate_free(result)) result = std::move(eliminated->scene);
  if (holds<SparseDynamics>(result.dynamics) && result.states() <= smallest_sparse)
    result = written_out(std::move(result));
  return result;
}

/// What w is at t = 0 without y.
std::string start_text(const Scene& scene) {
  if (scene.boundary) return "boundary values E0 x(0) + ET x(T) = b";
  if (scene.constraints() == 0) return "initial values";
  Vector q = observe(scene.dynamics, scene.x0);
  if (scene.g) {
    Vector g = Vector::Zero(q.size());
    scene.g(0, g);
    q += g;
  }
  const auto violated = (q.array() < 0).count();
  return violated == 0
             ? "initial values that need no y: N x0 + g(0) >= 0"
             : fmt::format("initial values; {} of {} constraints act at t = 0 (N x0 + g(0) < 0)", violated, q.size());
}

/// "f and g, 2 breakpoints"
void look_at_sources(const Scene& scene, Index J, SceneCheck& check) {
  if (!scene.f && !scene.g) {
    check.sources = scene.memories.empty() ? "none" : "those of modes";
    if (!scene.memories.empty())
      check.breakpoints = scene.breakpoints_are_all ? scene.breakpoints : find_breakpoints(scene);
    return;
  }
  check.sources = scene.f && scene.g ? "f(t) and g(t)" : scene.f ? "f(t)" : "g(t)";
  check.breakpoints = scene.breakpoints_are_all ? scene.breakpoints : find_breakpoints(scene);
  const Vector t = time_grid(scene.T, J);
  const SampledSource g = sample(scene.g, t, scene.constraints());
  const SampledSource f = scene.f ? sample(scene.f, t, scene.sources()) : SampledSource();
  if (const Index j = std::max(f.not_finite(), g.not_finite()); j >= 0)
    check.refusal = fmt::format("a source is not finite at t = {:.6g}", t[j]);
  else if (const SourceSteps steps = find_source_steps(scene, t, f, g, true);
           steps.unresolved > 0 && check.tolerance == 0)
    check.warnings.push_back(
        fmt::format("f or g changes too fast inside {} of {} steps (first seen around t = {:.6g}): use more steps",
                    steps.unresolved, J, steps.time));
}

/// Methods by the rules of core/solve/engines.cpp, with a refusal where none applies.
std::vector<Method> methods_of(const Scene& given, const Scene& scene, const BackendTraits& traits,
                               const Options& options, Index J, std::string& refusal) {
  if (!given.cones.empty()) {
    if (options.method != Method::automatic && options.method != Method::march)
      refusal = "friction on circles: method march takes it";
    return {Method::march};
  }
  if (const bool bounces = has_impacts(given); bounces || !given.memories.empty()) {
    const Method only = given.boundary ? Method::shooting : Method::events;
    const bool steps = bounces && !given.boundary && options.method == Method::march;
    if (options.method != Method::automatic && options.method != only && !steps)
      refusal = fmt::format("{}: method {} takes them", bounces ? "impacts with restitution" : "modes with memory",
                            to_string(only));
    return {steps ? Method::march : only};
  }
  const bool singular = !given.boundary && !given.free_rows.empty() && !can_eliminate_free(given);
  if (given.boundary || singular) {
    const std::string unsuited = unsuited_to_shooting(scene);
    if (options.method == Method::shooting && !unsuited.empty()) refusal = "method shooting: " + unsuited;
    if (options.method != Method::automatic && options.method != Method::galerkin && options.method != Method::shooting)
      refusal = given.boundary ? "the scene has boundary values, which only methods shooting and galerkin take"
                               : "the free rows and columns of M form a singular matrix: use method galerkin";
    if (options.method == Method::galerkin || !unsuited.empty()) return {Method::galerkin};
    return {Method::shooting};
  }
  if (options.method == Method::goal && !given.port) refusal = "method goal takes port-Hamiltonian scenes only";
  if (options.method != Method::automatic) return {options.method};
  const LcpClass lcp_class = known_class(scene.M, scene.lcp_class);
  return methods_by_time(traits, scene, lcp_class, J);
}

bool convolves(Method m) { return m == Method::contour || m == Method::multigrid || m == Method::contour_literal; }

/// What speaks against the functional iteration on this grid, and the bound on its sweeps (dense scenes).
struct IterationFacts {
  std::string against;
  std::string sweeps;
};

IterationFacts iteration_facts(const Scene& scene, Backend& backend, const Options& options, Index J) {
  if (!holds<DenseDynamics>(scene.dynamics)) {
    const LcpClass lcp_class = known_class(scene.M, scene.lcp_class);
    const BasisChoice basis = choose_basis(scene.M, lcp_class);
    return {basis.rings ? basis.reason + ": sweeps would ring" : "", ""};
  }
  Methods methods(scene, backend, J, {});
  if (methods.basis().rings) return {methods.basis().reason + ": sweeps would ring", ""};
  const auto forecast = iteration_forecast(methods.problem(), options.iteration_tolerance);
  if (!forecast || selects_least(methods.problem().lcp_class)) return {};
  if (forecast->longest_window(options.iteration_tolerance) == 0)
    return {fmt::format("its sweeps are not known to contract (kappa_0 = {:.2g})", forecast->kappa0), ""};
  if (std::isfinite(forecast->sweeps)) return {"", fmt::format("at most {:.0f} sweeps", std::ceil(forecast->sweeps))};
  return {};
}

Candidate candidate(const Scene& scene, Backend& backend, const Options& options, Index J, Method method) {
  const Index components = Index(recorded_components(scene, options).size());
  const Cost cost = predicted_cost(scene, method, J, components, backend.device().threads);
  const LcpClass lcp_class = known_class(scene.M, scene.lcp_class);
  const double fitted = predicted_seconds(backend.traits(), scene, lcp_class, method, J);
  const bool stages = method == Method::galerkin || !is_continuous(lcp_class);
  const double step = (convolves(method) ? 0 : 1) * (stages ? seconds_of_stages : seconds_of_step);
  const double seconds = cost.operations / operations_per_second + double(J) * step;
  Candidate c{method, cost.bytes, cost.operations, std::isfinite(fitted) ? fitted : seconds, "", ""};
  if (options.memory_limit > 0 && cost.bytes > options.memory_limit)
    c.against = fmt::format("it needs {}, most of it for {}", format_bytes(cost.bytes), cost.largest);
  else if (!fits_on_device(scene, method, J, components, backend.device()))
    c.against = "it does not fit into the memory of the device";
  return c;
}

void look_at_methods(const Scene& given, Backend& backend, const Options& options, SceneCheck& check) {
  const Scene scene = given.constraints() > 0 && !given.boundary ? reduced(given) : given;
  const std::vector<Method> methods = methods_of(given, scene, backend.traits(), options, check.steps, check.refusal);
  for (const Method method : methods) {
    check.candidates.push_back(candidate(scene, backend, options, check.steps, method));
    Candidate& c = check.candidates.back();
    if (!convolves(method) || !c.against.empty() || scene.boundary || scene.constraints() == 0) continue;
    const IterationFacts facts = iteration_facts(scene, backend, options, check.steps);
    c.against = facts.against;
    if (method == Method::contour) c.remark = facts.sweeps;
  }
  const bool none = std::all_of(check.candidates.begin(), check.candidates.end(),
                                [](const Candidate& c) { return !c.against.empty(); });
  if (none && check.refusal.empty())
    check.refusal = fmt::format("{}: {}", to_string(check.candidates.front().method), check.candidates.front().against);
}

void add_warnings(const SceneChoice& choice, const std::optional<Spectrum>& spectrum, SceneCheck& check) {
  const Scene& scene = choice.scene;
  if (!choice.warning.empty()) check.warnings.push_back(choice.warning);
  if (scene.constraints() > 0 && scene.free_rows.empty() && !is_stated(scene.lcp_class) && !choice.mechanism &&
      !selects_one(classify(scene.M)))
    check.warnings.emplace_back(
        "the class of M is not known: steps may have several solutions or none; state class if you know it");
  if (spectrum && !spectrum->bound && spectrum->abscissa * scene.T > std::log(large_growth))
    check.warnings.push_back(
        fmt::format("a free state grows by e^{:.3g} up to T: errors grow with it", spectrum->abscissa * scene.T));
  if (!check.breakpoints.empty() && scene.breakpoints.empty())
    check.warnings.push_back(
        fmt::format("{} found by looking at f and g; state them as breakpoints where you know them exactly",
                    counted(check.breakpoints.size(), "jump or kink")));
}

}  // namespace

SceneCheck check_scene(const SceneChoice& choice, Backend& backend, const Options& options) {
  const Scene& scene = choice.scene;
  scene.validate();
  SceneCheck check;
  check.constraints = scene.constraints();
  check.states = scene.states();
  check.steps = steps_of(scene, options);
  check.tolerance = with_defaults(options, scene).tolerance;
  check.free_rows = Index(scene.free_rows.size());
  check.T = scene.T;
  check.dynamics = kind_text(*scene.dynamics);
  check.mass = mass_text(scene.dynamics);
  check.matrix_class = matrix_class(scene);
  check.spectrum = spectrum_text(scene);
  check.start = start_text(scene);
  look_at_sources(scene, check.steps, check);
  if (choice.system)
    check.nonlinear = nonlinear_facts(*choice.system, check.steps);
  else if (scene.dynamics->has_singular_mass())
    check.refusal = describe_singular_mass(*scene.dynamics);
  else
    look_at_methods(scene, backend, options, check);
  if (choice.circuit)
    check.warnings.insert(check.warnings.end(), choice.circuit->notes.begin(), choice.circuit->notes.end());
  std::optional<Spectrum> known;
  if (check.spectrum != "not computed" && !scene.dynamics->has_singular_mass()) known = spectrum(scene.dynamics);
  add_warnings(choice, known, check);
  return check;
}

std::string check_text(const SceneChoice& choice, const SceneCheck& check) {
  std::string text;
  const auto line = [&text](const std::string& label, const std::string& value) {
    fmt::format_to(std::back_inserter(text), "{:<11} {}\n", label, value);
  };
  const std::string parameters = describe(choice.parameters);
  line("scene", parameters.empty() ? choice.scene.name : fmt::format("{} ({})", choice.scene.name, parameters));
  line("size",
       fmt::format("{}{}, {}, {}{} of {:.6g} up to T = {:.6g}{}", counted(std::size_t(check.constraints), "constraint"),
                   check.free_rows > 0 ? fmt::format(", {} of them free", check.free_rows) : "",
                   counted(std::size_t(check.states), "state"),
                   check.tolerance > 0 ? fmt::format("to {:g}, seen with ", check.tolerance) : "",
                   counted(std::size_t(check.steps), "step"), check.T / double(check.steps), check.T,
                   choice.scene.time_unit.empty() ? "" : " " + one_line(choice.scene.time_unit)));
  line("dynamics", check.dynamics + ", " + check.mass);
  line("class", check.matrix_class);
  line("spectrum", check.spectrum);
  line("start", check.start);
  std::string breaks;
  for (std::size_t i = 0; i < std::min<std::size_t>(check.breakpoints.size(), 8); ++i)
    breaks += fmt::format("{}{:.6g}", i ? ", " : "", check.breakpoints[i]);
  if (choice.circuit)
    for (const auto& [label, fact] : circuit_facts(*choice.circuit)) line(label, fact);
  if (choice.mechanism)
    for (const auto& [label, fact] : mechanism_facts(*choice.mechanism)) line(label, fact);
  const char* of_memory = "memory";
  for (const std::string& fact : memory_facts(choice.scene)) line(std::exchange(of_memory, ""), fact);
  line("sources", check.breakpoints.empty() ? check.sources
                                            : fmt::format("{}, {} at t = {}{}", check.sources,
                                                          counted(check.breakpoints.size(), "breakpoint"), breaks,
                                                          check.breakpoints.size() > 8 ? ", ..." : ""));
  const char* of_system = "nonlinear";
  for (const std::string& fact : check.nonlinear) line(std::exchange(of_system, ""), fact);
  const char* label = "methods";
  for (const Candidate& c : check.candidates) {
    line(label,
         fmt::format("{:<15} {}", to_string(c.method),
                     c.against.empty() ? fmt::format("about {} and {}{}", format_bytes(c.bytes),
                                                     format_seconds(c.seconds), c.remark.empty() ? "" : ", " + c.remark)
                                       : "not taken: " + c.against));
    label = "";
  }
  for (const std::string& warning : check.warnings) line("warning", one_line(warning));
  line("verdict",
       check.refusal.empty() ? "can be tried; times are orders of magnitude" : "not solved: " + check.refusal);
  return text;
}

Json check_json(const SceneChoice& choice, const SceneCheck& check) {
  Json json;
  json["schema"] = "bromwich-check/1";
  json["scene"] = choice.scene.name;
  json["parameters"] = to_json(choice.parameters);
  json["sizes"] = {{"constraints", check.constraints},
                   {"states", check.states},
                   {"free_rows", check.free_rows},
                   {"steps", check.steps},
                   {"tolerance", check.tolerance > 0 ? Json(check.tolerance) : Json(nullptr)},
                   {"T", check.T}};
  json["dynamics"] = check.dynamics;
  json["mass"] = check.mass;
  json["class"] = check.matrix_class;
  json["spectrum"] = check.spectrum;
  json["start"] = check.start;
  if (choice.circuit) {
    json["netlist"] = choice.circuit->reduction.summary;
    json["reduction"] = circuit_json(*choice.circuit);
  }
  if (choice.mechanism) json["mechanism"] = mechanism_json(*choice.mechanism);
  if (!choice.scene.memories.empty()) json["memories"] = memories_json(choice.scene);
  json["sources"] = check.sources;
  json["breakpoints"] = check.breakpoints;
  json["methods"] = Json::array();
  for (const Candidate& c : check.candidates)
    json["methods"].push_back({{"method", to_string(c.method)},
                               {"bytes", c.bytes},
                               {"operations", c.operations},
                               {"seconds", c.seconds},
                               {"remark", c.remark},
                               {"against", c.against.empty() ? Json(nullptr) : Json(c.against)}});
  if (!check.nonlinear.empty()) json["nonlinear"] = check.nonlinear;
  json["warnings"] = check.warnings;
  json["refusal"] = check.refusal.empty() ? Json(nullptr) : Json(check.refusal);
  return json;
}

}  // namespace bromwich::app
