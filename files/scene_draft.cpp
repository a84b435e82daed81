#include "files/scene_draft.hpp"

#include "core/base/error.hpp"
#include "core/result/result.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/scene/relay.hpp"
#include "files/include.hpp"
#include "files/memory_section.hpp"
#include "files/names.hpp"
#include "files/nonlinear_file.hpp"
#include "files/nonlinear_section.hpp"
#include "files/reference_section.hpp"
#include "files/scene_matrices.hpp"
#include "files/sections.hpp"
#include "files/structure_section.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <set>
#include <tuple>

namespace bromwich {

namespace {

LcpClass lcp_class(const Section& complementarity) {
  return *lcp_class_named(complementarity.word("class", lcp_class_names()));
}

/// f = F phi as a function with one entry per state.
TimeFunction spread(const SparseMatrix& F, const TimeFunction& phi) {
  return [F, phi](double t, Eigen::Ref<Vector> f) {
    Vector sources(F.cols());
    phi(t, sources);
    f = F * sources;
  };
}

const LcpMatrix& matrix_M(const Sections& s, Index n) {
  return s.complementarity.kept("M as it is stored", {double(n)}, [&] {
    return lcp_matrix(s.complementarity.matrix("M", n, n), s.complementarity.where("M"));
  });
}

/// M of the sides of a rectangle. A stencil on the side of a box is one as a sparse matrix.
const LcpMatrix& matrix_M(const Sections& s, const Rectangle& r, Index n) {
  return s.complementarity.kept("M of all sides", {double(n)}, [&]() -> LcpMatrix {
    const std::string where = s.complementarity.where("M");
    const MatrixValue of_all = of_each_side(s.complementarity.matrix("M", n, n), read_rectangle(s), where);
    if (r.beside.empty()) return lcp_matrix(of_all, where, 1);
    return SparseLcpMatrix(sparse_value(of_all));
  });
}

Scene complementarity_scene(const Sections& s) {
  Scene scene;
  scene.dynamics = read_dynamics(s);
  if (!s.kronecker.given()) {
    scene.M = without_pairs(s) ? LcpMatrix(Matrix()) : matrix_M(s, scene.constraints());
    if (!s.boundary.given()) scene.x0 = s.dynamics.vector("x0", scene.states());
  } else {
    const Rectangle& r = read_rectangle(s);
    if (!r.written_out) scene.f_entry = SourceEntry::through_B;
    scene.M = matrix_M(s, r, scene.constraints());
    if (!s.boundary.given()) scene.x0 = s.dynamics.vector("x0", scene.states(), r.across.points);
  }
  scene.lcp_class = lcp_class(s.complementarity);
  return scene;
}

PortHamiltonian read_port(const Section& section, double T, Draft& draft) {
  const auto matrix = [&](const char* key) {
    return section.has(key) ? sparse_value(section.matrix(key)) : SparseMatrix();
  };
  PortHamiltonian port{
      matrix("E"), sparse_value(section.matrix("J")), sparse_value(section.matrix("R")), matrix("Q"), matrix("B"), {},
      {}};
  if (section.has("u") && !section.has("B"))
    throw Error(section.where("B"), "is missing beside u", "give m rows and one column per entry of u");
  const FunctionValue u = section.function("u", T, port.ports());
  require_entries(u, port.ports(), section.where("u"), "one per column of B");
  port.u = u.function;
  draft.note(u.switches);
  if (section.has("jumps")) {
    const Vector jumps = section.vector("jumps");
    port.jumps.assign(jumps.begin(), jumps.end());
    draft.note({port.jumps, true});
  }
  return port;
}

/// E x' = (J - R) Q x + B u, with or without complementarity: y enters by dynamics.B.
Scene port_scene(const Sections& s, Draft& draft) {
  for (const char* key : {"A", "E", "f", "F", "x0"})
    if (s.dynamics.has(key))
      throw Error(s.dynamics.where(key), "is given with a section [port]",
                  "leave it out: E, J, R, Q, B, u and x0 of [port] say it");
  for (const Section* other : {&s.relay, &s.boundary})
    if (other->given())
      throw Error(other->where(other == &s.relay ? "C" : "b"), "is given with [port]", "leave it out");
  const PortHamiltonian port = read_port(s.port, draft.scene.T, draft);
  const auto in_port = [&] {
    Places where = places(s);
    for (const char* key : {"E", "J", "R", "Q", "B", "x0"}) where[key] = s.port.where(key);
    where["Q^T E"] = s.port.where("Q");
    return where;
  };
  Scene scene;
  in_the_file(in_port, [&] {
    scene = make_scene(port, s.port.vector("x0"), draft.scene.T);
    scene.validate();
  });
  if (!s.complementarity.given()) {
    if (s.dynamics.given())
      throw Error(s.dynamics.where("B"), "is given without [complementarity]", "add N and M there, or leave it out");
    return scene;
  }
  const MatrixValue &B = s.dynamics.matrix("B"), &N = s.complementarity.matrix("N", columns(B), scene.states());
  if (auto* sparse = get_if<SparseDynamics>(&scene.dynamics)) {
    sparse->B = sparse_value(B);
    sparse->N = sparse_value(N);
  } else {
    auto& dense = get<DenseDynamics>(scene.dynamics);
    dense.B = dense_value(B, s.dynamics.where("B"));
    dense.N = dense_value(N, s.complementarity.where("N"));
  }
  scene.M = matrix_M(s, scene.constraints());
  scene.lcp_class = lcp_class(s.complementarity);
  return scene;
}

/// g of [complementarity], with n entries.
FunctionValue g_of_pairs(const Sections& s, double T, Index n) {
  FunctionValue g = s.complementarity.function("g", T, n);
  require_entries(g, n, s.complementarity.where("g"), "one per constraint");
  return g;
}

/// All of a relay and of the pairs beside it but x0 and f of the file.
const Scene& relay_alone(const Sections& s, double T) {
  return s.relay.kept("the scene without x0 and f", {T}, [&] {
    const auto dense = [](const Section& section, const char* key, Index rows = 0, Index columns = 0) {
      return dense_value(section.matrix(key, rows, columns), section.where(key));
    };
    const Matrix A = dense(s.dynamics, "A"), B = dense(s.dynamics, "B");
    const Index m = A.rows();
    const Matrix C = dense(s.relay, "C", m, m);
    const Index k = C.rows(), n = s.complementarity.given() ? B.cols() - k : 0;
    if (n < 0)
      throw Error(s.dynamics.where("B"), fmt::format("has {} columns for {} relays", B.cols(), k),
                  "give one for each relay, and then those of y");
    const FunctionValue e = s.relay.function("e", T, k), bound = s.relay.function("bound", T, k);
    require_entries(e, k, s.relay.where("e"), "one per row of C");
    require_entries(bound, k, s.relay.where("bound"), "one per row of C");
    Scene scene;
    in_the_file([&] { return places(s); },
                [&] {
                  scene = bromwich::relay_scene(A, B.leftCols(B.cols() - n), C, {}, {}, e.function, bound.function);
                  if (s.complementarity.given())
                    scene = with_pairs(std::move(scene), B.rightCols(n), dense(s.complementarity, "N", n, m),
                                       dense(s.complementarity, "M", n, n), g_of_pairs(s, T, n).function);
                });
    if (s.dynamics.has("E")) {
      DenseDynamics with_mass = *scene.dynamics->small_state();
      with_mass.E = dense(s.dynamics, "E", m, m);
      scene.dynamics = std::move(with_mass);
    }
    return scene;
  });
}

Scene relay_scene(const Sections& s, Draft& draft) {
  if (s.kronecker.given()) throw Error(s.relay.where("C"), "found [relay] and [kronecker]", "give one of the two");
  Scene scene = relay_alone(s, draft.scene.T);
  for (const char* key : {"e", "bound"}) draft.note(s.relay.function(key, draft.scene.T, scene.relays).switches);
  if (!s.boundary.given()) scene.x0 = s.dynamics.vector("x0", scene.states());
  return scene;
}

/// f of the file beside what a relay brings. Precondition: both are given, with their lengths.
const TimeFunction& f_beside_relay(const Sections& s, double T, Index size) {
  return s.relay.kept("f with that of the file", {T, double(size)}, [&]() -> TimeFunction {
    const TimeFunction f = s.dynamics.function("f", T, size).function;
    const Scene& relay = relay_alone(s, T);
    const bool spread_out = s.dynamics.has("F");
    const TimeFunction entering = spread_out ? spread(sparse_value(s.dynamics.matrix("F")), f) : f;
    return [entering, brought = relay.f, m = relay.states()](double t, Eigen::Ref<Vector> value) {
      Vector own(m);
      entering(t, own);
      brought(t, value);
      value += own;
    };
  });
}

/// Adds f of the file to the f of a relay.
void add_f(const Sections& s, Draft& draft) {
  Scene& scene = draft.scene;
  const SparseMatrix F = s.dynamics.has("F") ? sparse_value(s.dynamics.matrix("F")) : SparseMatrix();
  const FunctionValue f = s.dynamics.function("f", scene.T, s.dynamics.has("F") ? F.cols() : scene.sources());
  draft.note(f.switches);
  const TimeFunction brought = std::exchange(scene.f, {});  // it has one entry per state, f may have fewer
  if (s.dynamics.has("F")) {
    if (!f.function) throw Error(s.dynamics.where("F"), "is given without f", "add f with one entry per column of F");
    scene.F = F;
    scene.f_entry = SourceEntry::through_F;
    require_entries(f, scene.F.cols(), s.dynamics.where("f"), "one per column of F");
    in_the_file([&] { return places(s); }, [&] { scene.validate(); });
  } else {
    const bool by_line = scene.f_entry == SourceEntry::through_B;
    require_entries(f, scene.sources(), s.dynamics.where("f"), by_line ? "one per line: B f(t)" : "one per state");
  }
  if (!f.function || !s.relay.given()) {
    scene.f = f.function ? f.function : brought;
    return;
  }
  scene.f = f_beside_relay(s, scene.T, scene.sources());
  scene.f_entry = SourceEntry::state;
  scene.F = {};
}

void add_g(const Sections& s, Draft& draft) {
  Scene& scene = draft.scene;
  const FunctionValue g = g_of_pairs(s, scene.T, scene.constraints() - 2 * scene.relays);
  if (g.function && scene.relays == 0) scene.g = g.function;  // otherwise it is beside that of the relays
  draft.note(g.switches);
}

void add_exact(const Section& section, Scene& scene) {
  if (!section.given()) return;
  const FunctionValue x = section.expressions("x", scene.states()), y = section.expressions("y", scene.constraints());
  if (!x.function && !y.function) throw Error(section.where("x"), "found neither x nor y", "give one of them or both");
  require_entries(x, scene.states(), section.where("x"), "one per state");
  require_entries(y, scene.constraints(), section.where("y"), "one per constraint");
  scene.exact = [x, y](double t, Eigen::Ref<Vector> x_value, Eigen::Ref<Vector> y_value) {
    x_value.setConstant(std::numeric_limits<double>::quiet_NaN());
    y_value.setConstant(std::numeric_limits<double>::quiet_NaN());
    if (x.function) x.function(t, x_value);
    if (y.function) y.function(t, y_value);
  };
}

Scene structure_scene(const Sections& s, Draft& draft) {
  draft.mechanism = read_mechanism(s, draft);
  return draft.mechanism->scene;
}

/// E0 x(0) + ET x(T) = b instead of x0; an omitted matrix is zero.
void add_boundary(const Sections& s, Scene& scene) {
  const Section& section = s.boundary;
  if (!section.given()) return;
  if (s.dynamics.has("x0"))
    throw Error(s.dynamics.where("x0"), "is given with a section [boundary]", "give one of the two");
  if (!section.has("E0") && !section.has("ET"))
    throw Error(section.where("E0"), "found neither E0 nor ET", "give one of them or both");
  const Index m = scene.states();
  if (m > largest_dense)
    throw Error(section.where("E0"), fmt::format("the scene has {} states", m),
                fmt::format("boundary values are for {} states at most", largest_dense));
  const auto end = [&](const char* key) {
    return section.has(key) ? dense_value(section.matrix(key, m, m), section.where(key)) : Matrix(Matrix::Zero(m, m));
  };
  scene.boundary = BoundaryCondition{end("E0"), end("ET"), section.vector("b", m)};
}

void add_free_rows(const Section& section, Scene& scene) {
  if (!section.given()) return;
  const Vector rows = section.vector("rows");
  for (const double row : rows) {
    if (row != std::floor(row) || std::abs(row) > 1e9)
      throw Error(section.where("rows"), fmt::format("found {}", row), "give whole numbers; rows are counted from 0");
    scene.free_rows.push_back(Index(row));
  }
}

/// Of [complementarity], behind the rows of relays.
void add_restitution(const Section& section, Scene& scene) {
  if (!section.has("restitution")) return;
  const Index relays = 2 * scene.relays;
  scene.restitution = Vector::Zero(scene.constraints());
  scene.restitution.tail(scene.constraints() - relays) =
      section.one_or_each("restitution", scene.constraints() - relays);
}

/// The switch times of the sources and those that the file declares, each once.
void add_breakpoints(const Sections& s, Draft& draft) {
  Scene& scene = draft.scene;
  if (s.time.has("jumps")) {
    const Vector declared = s.time.vector("jumps");
    for (const double t : declared)
      if (!(t >= 0 && t <= scene.T))
        throw Error(s.time.where("jumps"), fmt::format("found {}", t),
                    fmt::format("give times from 0 to T = {}", scene.T));
    draft.note({{declared.begin(), declared.end()}, true});
  }
  std::vector<double>& times = draft.switches.times;
  std::erase_if(times, [&](double t) { return !(t >= 0 && t <= scene.T); });
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());
  scene.breakpoints = times;
  scene.breakpoints_are_all = draft.switches.complete;
}

void add_sources(const Sections& s, Draft& draft) {
  if (!s.port.given()) add_f(s, draft);
  add_g(s, draft);
  add_breakpoints(s, draft);
}

Index next_number() {
  static std::atomic<Index> given{0};
  return ++given;
}

/// The draft with its sources, of which those of a scene before are taken where nothing that enters them has changed.
void add_kept_sources(const Sections& s, Draft& draft) {
  const Scene& scene = draft.scene;
  const Draft& with = s.top.kept(
      "the sources", {scene.T, double(scene.states()), double(scene.constraints()), double(scene.f_entry)}, [&] {
        if (s.relay.given()) relay_alone(s, scene.T);  // whose sources the draft has
        Draft made = draft;
        add_sources(s, made);
        made.sources = next_number();
        return made;
      });
  draft.scene.f = with.scene.f, draft.scene.f_entry = with.scene.f_entry, draft.scene.F = with.scene.F;
  draft.scene.g = with.scene.g;
  draft.scene.breakpoints = with.scene.breakpoints;
  draft.scene.breakpoints_are_all = with.scene.breakpoints_are_all;
  draft.switches = with.switches, draft.sources = with.sources;
}

/// Names are headers of columns, beside x0, x1, ... where the components of a kind have none.
void check_names(const Section& section, const Scene& scene) {
  const Labels& names = scene.names;
  std::set<std::string> seen{"t", "all", "none"};
  for (const auto& [letter, list, count] : {std::tuple('x', &names.x, scene.states()),
                                            {'y', &names.y, scene.constraints()},
                                            {'w', &names.w, scene.constraints()}})
    for (Index i = 0; list->empty() && i < count; ++i) seen.insert(letter + std::to_string(i));
  for (const auto& [key, list] : {std::pair("x", &names.x), std::pair("y", &names.y), std::pair("w", &names.w)})
    for (std::size_t i = 0; i < list->size(); ++i) {
      const std::string& name = (*list)[i];
      if (name.empty() || name.find_first_of(",\"'#=") != std::string::npos)
        throw Error(section.where(key), fmt::format("found '{}'", name),
                    "give names without commas, quotes, # and =: they are headers of columns");
      if (!seen.insert(name).second)
        throw Error(section.where(key), fmt::format("'{}' is taken", name), "give every component a name of its own");
    }
}

void add_labels(const Sections& s, Scene& scene) {
  const auto labels = [&](const Section& section) {
    return Labels{section.texts("x", scene.states()), section.texts("y", scene.constraints()),
                  section.texts("w", scene.constraints())};
  };
  if (s.names.given() || scene.names.x.empty()) scene.names = labels(s.names);
  scene.units = labels(s.units);
  scene.time_unit = s.units.text("t", "");
  if (s.names.given()) check_names(s.names, scene);
}

Index whole_steps(const std::string& where, double value) {
  constexpr double largest = 1 << 24;
  if (value != std::floor(value) || value < 1 || value > largest)
    throw Error(where, fmt::format("steps is {}", value), fmt::format("give a whole number from 1 to {}", largest));
  return Index(value);
}

}  // namespace

Draft draft_scene(const Sections& s, const ParameterValues& settings) {
  Draft draft;
  Scene& scene = draft.scene;
  const auto final_time = [&] { return settings.contains("T") ? settings.at("T") : s.time.number("T"); };
  const bool structure = s.structure.given() || !s.contacts.empty();
  // Sources that are read with matrices.
  if (structure || s.port.given() || s.relay.given()) scene.T = final_time();
  scene = structure         ? structure_scene(s, draft)
          : s.port.given()  ? port_scene(s, draft)
          : s.relay.given() ? relay_scene(s, draft)
                            : complementarity_scene(s);
  add_boundary(s, scene);
  add_free_rows(s.free, scene);
  add_restitution(s.complementarity, scene);
  scene.T = final_time();
  scene.default_steps = s.time.positive_integer("steps", scene.default_steps);
  if (settings.contains("steps")) scene.default_steps = whole_steps("--set", settings.at("steps"));
  const auto where = [&] {
    Places of_file = places(s);
    if (settings.contains("T")) of_file["T"] = "--set";
    return of_file;
  };
  in_the_file(where, [&] { scene.validate(); });
  if (structure) {
    add_breakpoints(s, draft);
    draft.sources = next_number();
  } else if (s.port.given()) {  // with sources of its own, which depend on the dynamics
    add_sources(s, draft);
    draft.sources = next_number();
  } else {
    add_kept_sources(s, draft);
  }
  in_the_file(where, [&] { scene.validate(); });
  add_exact(s.exact, scene);
  add_labels(s, scene);
  if (s.memories.empty()) return draft;
  add_memories(s, draft);
  add_breakpoints(s, draft);
  draft.sources = next_number();
  return draft;
}

}  // namespace bromwich
