// Scenes: new ones, from files and from text.

#include "capi/failures.hpp"
#include "capi/handles.hpp"
#include "capi/settings.hpp"
#include "files/scene_file.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>

namespace bromwich::capi {

namespace {

std::unique_ptr<bromwich_scene> of_scene(Scene scene, std::shared_ptr<const Circuit> circuit = {}) {
  auto made = std::make_unique<bromwich_scene>();
  made->kinks = scene.breakpoints;
  made->kinks_are_all = scene.breakpoints_are_all;
  made->scene = std::move(scene);
  made->circuit = std::move(circuit);
  return made;
}

/// The accuracy of a netlist is that of the command.
std::unique_ptr<bromwich_scene> of_circuit(Circuit read) {
  auto circuit = std::make_shared<const Circuit>(std::move(read));
  Scene scene = circuit->scene;
  scene.default_tolerance = 1e-4;
  return of_scene(std::move(scene), std::move(circuit));
}

std::unique_ptr<bromwich_scene> read(const std::string& name, const ParameterValues& settings) {
  if (is_netlist(name)) return of_circuit(read_circuit(name, settings));
  const bool file = std::filesystem::path(name).extension() == ".toml" || name.find('/') != std::string::npos;
  return of_scene(file ? read_scene_file(name, settings).scene : make_scene(name, settings));
}

std::unique_ptr<bromwich_scene> parse(const std::string& text, const std::string& language,
                                      const ParameterValues& settings) {
  if (language == "netlist") return of_circuit(parse_circuit(text, "netlist", {}, settings));
  if (language != "toml") throw Error("language", fmt::format("found '{}'", language), "use toml or netlist");
  return of_scene(parse_scene(text, "text", {}, settings).scene);
}

std::unique_ptr<bromwich_scene> zero_scene(Index m, Index n, double T) {
  if (m < 0 || n < 0)
    throw Error(m < 0 ? "states" : "constraints", fmt::format("found {}", m < 0 ? m : n), "give 0 or more");
  if (!(T > 0) || !std::isfinite(T)) throw Error("T", fmt::format("found {}", T), "give a positive number");
  auto made = std::make_unique<bromwich_scene>();
  made->own = true;
  made->A.dense = Matrix::Zero(m, m);
  made->B.dense = Matrix::Zero(m, n);
  made->N.dense = Matrix::Zero(n, m);
  made->scene.dynamics = DenseDynamics{made->A.dense, made->B.dense, made->N.dense};
  made->scene.M = Matrix(Matrix::Zero(n, n));
  made->scene.x0 = Vector::Zero(m);
  made->scene.T = T;
  made->scene.name = "arrays";
  made->scene.breakpoints_are_all = true;
  return made;
}

}  // namespace

}  // namespace bromwich::capi

using namespace bromwich;
using namespace bromwich::capi;

int bromwich_scene_new(int64_t states, int64_t constraints, double T, bromwich_scene** scene) {
  return guarded([&] { given(scene, "scene") = zero_scene(states, constraints, T).release(); });
}

int bromwich_scene_read(const char* name, const char* settings, bromwich_scene** scene) {
  return guarded([&] { given(scene, "scene") = read(&given(name, "name"), parameters_of(settings)).release(); });
}

int bromwich_scene_parse(const char* text, const char* language, const char* settings, bromwich_scene** scene) {
  return guarded([&] {
    given(scene, "scene") =
        parse(&given(text, "text"), &given(language, "language"), parameters_of(settings)).release();
  });
}

int bromwich_scene_copy(const bromwich_scene* scene, bromwich_scene** copy) {
  return guarded([&] {
    given(scene, "scene").complete();
    given(copy, "copy") = new bromwich_scene(*scene);
  });
}

void bromwich_scene_free(bromwich_scene* scene) { delete scene; }

int bromwich_scene_sizes(const bromwich_scene* scene, int64_t* states, int64_t* constraints) {
  return guarded([&] {
    const Scene& found = given(scene, "scene").scene;
    if (states) *states = found.states();
    if (constraints) *constraints = found.constraints();
  });
}
