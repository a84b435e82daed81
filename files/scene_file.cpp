#include "files/scene_file.hpp"

#include "core/base/error.hpp"
#include "core/result/result.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/scene/relay.hpp"
#include "files/sections.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich {

namespace {

constexpr Index largest_dense = 4096;       ///< states; a dense A then takes 128 MiB
constexpr Index smallest_sparse = 257;      ///< states from which a sparse A is kept sparse
constexpr double largest_density = 0.1;     ///< of a sparse A
constexpr Index smallest_tridiagonal = 17;  ///< constraints from which a tridiagonal M is stored as diagonals

SparseMatrix to_sparse(const MatrixValue& value) {
  if (const auto* sparse = std::get_if<SparseMatrix>(&value)) return *sparse;
  return std::get<Matrix>(value).sparseView();
}

Matrix to_dense(const MatrixValue& value, const std::string& where) {
  if (const auto* dense = std::get_if<Matrix>(&value)) return *dense;
  if (rows(value) > largest_dense * largest_dense / columns(value))
    throw Error(where, fmt::format("is {} x {} and would be kept densely", rows(value), columns(value)),
                "use a sparse A (coordinate .mtx) with few constraints, or fewer states");
  return Matrix(std::get<SparseMatrix>(value));
}

bool stays_sparse(const MatrixValue& A) {
  const auto* sparse = std::get_if<SparseMatrix>(&A);
  return sparse && sparse->rows() >= smallest_sparse &&
         double(sparse->nonZeros()) < largest_density * double(sparse->rows()) * double(sparse->cols());
}

bool is_tridiagonal(const SparseMatrix& M) {
  for (Index j = 0; j < M.outerSize(); ++j)
    for (SparseMatrix::InnerIterator entry(M, j); entry; ++entry)
      if (entry.value() != 0 && std::abs(entry.row() - j) > 1) return false;
  return true;
}

LcpMatrix lcp_matrix(const MatrixValue& value, const std::string& where) {
  const SparseMatrix M = to_sparse(value);
  const Index n = M.rows();
  if (n < smallest_tridiagonal || M.cols() != n || !is_tridiagonal(M)) return to_dense(value, where);
  Tridiagonal t{Vector::Zero(n), Vector::Zero(n), Vector::Zero(n)};
  for (Index i = 0; i < n; ++i) {
    if (i > 0) t.lower[i] = M.coeff(i, i - 1);
    t.diagonal[i] = M.coeff(i, i);
    if (i + 1 < n) t.upper[i] = M.coeff(i, i + 1);
  }
  return t;
}

Dynamics dynamics(const Sections& s) {
  const MatrixValue A = s.dynamics.matrix("A"), B = s.dynamics.matrix("B"), N = s.complementarity.matrix("N");
  const bool mass = s.dynamics.has("E");
  const MatrixValue E = mass ? s.dynamics.matrix("E") : MatrixValue(Matrix());
  if (stays_sparse(A))
    return SparseDynamics{to_sparse(A), to_sparse(B), to_sparse(N), mass ? to_sparse(E) : SparseMatrix()};
  return DenseDynamics{to_dense(A, s.dynamics.where("A")), to_dense(B, s.dynamics.where("B")),
                       to_dense(N, s.complementarity.where("N")), mass ? to_dense(E, s.dynamics.where("E")) : Matrix()};
}

LcpClass lcp_class(const Section& complementarity) {
  const std::string word = complementarity.word("class", {"auto", "P", "Z", "PSD"});
  if (word == "P") return LcpClass::P;
  if (word == "Z") return LcpClass::Z;
  return word == "PSD" ? LcpClass::PSD : LcpClass::automatic;
}

void require_entries(const FunctionValue& value, Index expected, const std::string& where, const char* meaning) {
  if (value.function && value.entries != expected)
    throw Error(where, fmt::format("has {} entries", value.entries), fmt::format("give {}, {}", expected, meaning));
}

/// f = F phi as a function with one entry per state.
TimeFunction spread(const SparseMatrix& F, const TimeFunction& phi) {
  return [F, phi](double t, Eigen::Ref<Vector> f) {
    Vector sources(F.cols());
    phi(t, sources);
    f = F * sources;
  };
}

Scene complementarity_scene(const Sections& s) {
  Scene scene;
  scene.dynamics = dynamics(s);
  scene.M = lcp_matrix(s.complementarity.matrix("M"), s.complementarity.where("M"));
  scene.lcp_class = lcp_class(s.complementarity);
  if (!s.boundary.given()) scene.x0 = s.dynamics.vector("x0");
  return scene;
}

/// A scene under construction, and the switch times of its sources.
struct Draft {
  Scene scene;
  SwitchTimes switches;

  void note(const FunctionValue& source) {
    switches.times.insert(switches.times.end(), source.switches.times.begin(), source.switches.times.end());
    switches.complete = switches.complete && source.switches.complete;
  }
};

PortHamiltonian read_port(const Section& section, double T, Draft& draft) {
  const auto matrix = [&](const char* key) {
    return section.has(key) ? to_sparse(section.matrix(key)) : SparseMatrix();
  };
  PortHamiltonian port{
      matrix("E"), to_sparse(section.matrix("J")), to_sparse(section.matrix("R")), matrix("Q"), matrix("B"), {}, {}};
  if (section.has("u") && !section.has("B"))
    throw Error(section.where("B"), "is missing beside u", "give m rows and one column per entry of u");
  const FunctionValue u = section.function("u", T);
  require_entries(u, port.ports(), section.where("u"), "one per column of B");
  port.u = u.function;
  draft.note(u);
  if (section.has("jumps")) {
    const Vector jumps = section.vector("jumps");
    port.jumps.assign(jumps.begin(), jumps.end());
    draft.note({{}, 0, {port.jumps, true}});
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
  const double T = s.time.number("T");
  const PortHamiltonian port = read_port(s.port, T, draft);
  std::map<std::string, std::string> in_port = places(s);
  for (const char* key : {"E", "J", "R", "Q", "B", "x0"}) in_port[key] = s.port.where(key);
  in_port["Q^T E"] = s.port.where("Q");
  Scene scene;
  in_the_file(in_port, [&] {
    scene = make_scene(port, s.port.vector("x0"), T);
    scene.validate();
  });
  if (!s.complementarity.given()) {
    if (s.dynamics.given())
      throw Error(s.dynamics.where("B"), "is given without [complementarity]", "add N and M there, or leave it out");
    return scene;
  }
  const MatrixValue B = s.dynamics.matrix("B"), N = s.complementarity.matrix("N");
  if (auto* sparse = get_if<SparseDynamics>(&scene.dynamics)) {
    sparse->B = to_sparse(B);
    sparse->N = to_sparse(N);
  } else {
    auto& dense = get<DenseDynamics>(scene.dynamics);
    dense.B = to_dense(B, s.dynamics.where("B"));
    dense.N = to_dense(N, s.complementarity.where("N"));
  }
  scene.M = lcp_matrix(s.complementarity.matrix("M"), s.complementarity.where("M"));
  scene.lcp_class = lcp_class(s.complementarity);
  return scene;
}

Scene relay_scene(const Sections& s) {
  if (s.complementarity.given())
    throw Error(s.relay.where("C"), "found [relay] and [complementarity]", "give one of the two");
  if (s.dynamics.has("E"))
    throw Error(s.dynamics.where("E"), "is given with [relay]", "multiply A, B and f by its inverse");
  const Index m = rows(s.dynamics.matrix("A"));
  const auto dense = [](const Section& section, const char* key) {
    return to_dense(section.matrix(key), section.where(key));
  };
  const Matrix A = dense(s.dynamics, "A"), B = dense(s.dynamics, "B"), C = dense(s.relay, "C");
  const Vector x0 = s.boundary.given() ? Vector(Vector::Zero(m)) : s.dynamics.vector("x0");
  Scene scene;
  // The sources follow when their lengths have been checked.
  in_the_file(places(s), [&] { scene = bromwich::relay_scene(A, B, C, {}, x0); });
  if (s.boundary.given()) scene.x0 = {};
  return scene;
}

/// Adds f of the file to the f of a relay.
void add_f(const Sections& s, Draft& draft) {
  Scene& scene = draft.scene;
  const FunctionValue f = s.dynamics.function("f", scene.T);
  draft.note(f);
  const TimeFunction brought = std::exchange(scene.f, {});  // it has one entry per state, f may have fewer
  if (s.dynamics.has("F")) {
    if (!f.function) throw Error(s.dynamics.where("F"), "is given without f", "add f with one entry per column of F");
    scene.F = to_sparse(s.dynamics.matrix("F"));
    scene.f_entry = SourceEntry::through_F;
    require_entries(f, scene.F.cols(), s.dynamics.where("f"), "one per column of F");
    in_the_file(places(s), [&] { scene.validate(); });
  } else {
    require_entries(f, scene.states(), s.dynamics.where("f"), "one per state");
  }
  if (!f.function || !s.relay.given()) {
    scene.f = f.function ? f.function : brought;
    return;
  }
  const TimeFunction entering = s.dynamics.has("F") ? spread(scene.F, f.function) : f.function;
  scene.f_entry = SourceEntry::state;
  scene.F = {};
  scene.f = [entering, brought, m = scene.states()](double t, Eigen::Ref<Vector> value) {
    Vector own(m);
    entering(t, own);
    brought(t, value);
    value += own;
  };
}

void add_g(const Sections& s, Draft& draft) {
  Scene& scene = draft.scene;
  const FunctionValue g = s.complementarity.function("g", scene.T);
  require_entries(g, scene.constraints(), s.complementarity.where("g"), "one per constraint");
  if (g.function) scene.g = g.function;
  draft.note(g);
}

void add_exact(const Section& section, Scene& scene) {
  if (!section.given()) return;
  const FunctionValue x = section.expressions("x"), y = section.expressions("y");
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
    return section.has(key) ? to_dense(section.matrix(key), section.where(key)) : Matrix(Matrix::Zero(m, m));
  };
  scene.boundary = BoundaryCondition{end("E0"), end("ET"), section.vector("b")};
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

/// The switch times of the sources and those that the file declares, each once.
void add_breakpoints(const Sections& s, Draft& draft) {
  Scene& scene = draft.scene;
  if (s.time.has("jumps")) {
    const Vector declared = s.time.vector("jumps");
    for (const double t : declared)
      if (!(t >= 0 && t <= scene.T))
        throw Error(s.time.where("jumps"), fmt::format("found {}", t),
                    fmt::format("give times from 0 to T = {}", scene.T));
    draft.note({{}, 0, {{declared.begin(), declared.end()}, true}});
  }
  std::vector<double>& times = draft.switches.times;
  std::erase_if(times, [&](double t) { return !(t >= 0 && t <= scene.T); });
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());
  scene.breakpoints = times;
  scene.breakpoints_are_all = draft.switches.complete;
}

Draft build(const Sections& s) {
  Draft draft;
  Scene& scene = draft.scene;
  scene = s.port.given() ? port_scene(s, draft) : s.relay.given() ? relay_scene(s) : complementarity_scene(s);
  add_boundary(s, scene);
  add_free_rows(s.free, scene);
  scene.T = s.time.number("T");
  scene.default_steps = s.time.positive_integer("steps", scene.default_steps);
  in_the_file(places(s), [&] { scene.validate(); });
  if (!s.port.given()) add_f(s, draft);
  add_g(s, draft);
  add_breakpoints(s, draft);
  in_the_file(places(s), [&] { scene.validate(); });
  add_exact(s.exact, scene);
  return draft;
}

std::vector<std::string> status_words() {
  std::vector<std::string> words;
  for (const Status status : {Status::solved, Status::tolerance_not_met, Status::infeasible, Status::unsupported,
                              Status::nonfinite, Status::interrupted})
    words.emplace_back(to_string(status));
  return words;
}

std::optional<Reference> read_reference(const Section& section, const Scene& scene) {
  if (!section.given()) return std::nullopt;
  Reference reference;
  reference.t = section.optional_number("t");
  reference.x = section.partly_known("x");
  reference.y = section.partly_known("y");
  reference.tolerance = section.optional_number("tolerance");
  reference.status = section.word("status", status_words());
  reference.infeasible_at = section.optional_number("infeasible_at");
  reference.source = section.text("source", "");
  for (const auto& [key, values, expected] :
       {std::tuple("x", &reference.x, scene.states()), std::tuple("y", &reference.y, scene.constraints())})
    if (!values->empty() && Index(values->size()) != expected)
      throw Error(section.where(key), fmt::format("has {} entries", values->size()), fmt::format("give {}", expected));
  if (reference.t && (*reference.t < 0 || *reference.t > scene.T))
    throw Error(section.where("t"), fmt::format("found {}", *reference.t), fmt::format("give 0 to T = {}", scene.T));
  if (!reference.t && !(reference.x.empty() && reference.y.empty()))
    throw Error(section.where("t"), "is missing", "add the time t of x and y");
  if (reference.tolerance && !(*reference.tolerance > 0))
    throw Error(section.where("tolerance"), fmt::format("found {}", *reference.tolerance), "give a positive number");
  return reference;
}

std::shared_ptr<const QuantityOfInterest> read_quantity(const Section& section, const Scene& scene) {
  if (!section.given()) return nullptr;
  if (!scene.port)
    throw Error(section.where("W"), "is given without a section [port]", "leave it out: it is for method goal");
  QuadraticQuantity q;
  q.name = section.text("name", q.name);
  if (section.has("W")) q.W = to_sparse(section.matrix("W"));
  if (section.has("end_W")) q.end_W = to_sparse(section.matrix("end_W"));
  if (section.has("end_c")) q.end_c = section.vector("end_c");
  const FunctionValue c = section.function("c", scene.T);
  require_entries(c, scene.states(), section.where("c"), "one per state");
  q.c = c.function;
  q.exact = section.optional_number("exact");
  std::shared_ptr<const QuantityOfInterest> quantity;
  std::map<std::string, std::string> in_quantity;
  for (const char* key : {"W", "end_W", "end_c"}) in_quantity[key] = section.where(key);
  in_quantity["quantity"] = section.where("W");
  in_the_file(in_quantity, [&] { quantity = quadratic_quantity(q, scene.states()); });
  return quantity;
}

toml::table parse_toml(std::string_view text, const std::string& name) {
  try {
    return toml::parse(text, name);
  } catch (const toml::parse_error& error) {
    throw Error(fmt::format("{}:{}", name, error.source().begin.line), one_line(error.description()),
                "correct the TOML of this line");
  }
}

}  // namespace

bool scene_files_available() { return true; }

SceneFile parse_scene(std::string_view toml, const std::string& file_name, const std::filesystem::path& folder,
                      const ParameterValues& settings) {
  const toml::table root = parse_toml(toml, file_name);
  Document document{file_name, folder, {}, {}};
  const Sections sections = read_sections(document, root);
  read_parameters(document, root, sections.parameters, settings);
  SceneFile file;
  Draft draft = build(sections);
  file.scene = std::move(draft.scene);
  if (!draft.switches.complete)
    file.warning =
        "not all times at which a source jumps or has a kink were found: its expressions switch too often; declare "
        "them "
        "as jumps in [time]";
  file.scene.name = sections.top.text("name", std::filesystem::path(file_name).stem().string());
  file.description = sections.top.text("description", "");
  file.parameters = document.expressions.parameters();
  file.states = sections.output.text("states", "none");
  parse_state_choice(sections.output.where("states"), file.states, file.scene.states());
  file.reference = read_reference(sections.reference, file.scene);
  file.quantity = read_quantity(sections.quantity, file.scene);
  file.inputs = std::move(document.read);
  return file;
}

SceneFile read_scene_file(const std::filesystem::path& file, const ParameterValues& settings) {
  const std::string name = one_line(file.string());
  SceneFile found = parse_scene(read_text({name, file}, name), name, file.parent_path(), settings);
  found.inputs.push_back(file);
  return found;
}

}  // namespace bromwich
