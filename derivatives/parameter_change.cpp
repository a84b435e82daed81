#include "derivatives/parameter_change.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/scene/memory.hpp"
#include "core/scene/memory_rows.hpp"
#include "core/scene/separable.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double steps_to_try[] = {1e-3, 1e-4, 1e-5, 1e-6};  ///< of |p|
constexpr double step_with_moving_kinks = 1e-6;              ///< differences across a kink are those of no side
constexpr double bends_less = 1e-4;                          ///< two- and four-point formula, relative
constexpr double kink_less = 1e-5;  ///< second differences that do not shrink with d, of the first ones
constexpr double rounding_of_data = 64 * epsilon;
constexpr double same_breakpoint = 1e-11;   ///< of T
constexpr double beside_breakpoint = 1e-7;  ///< of T: where limits from both sides are taken
constexpr double same_vector = 1e-12;

// Tables of a scene; what it does not have is empty.
struct SceneData {
  RowMatrix x0, b, f, g;  ///< x0 and b: m x 1
  RowMatrix restitution;  ///< n x 1
  Matrix A, B, N, E, M, E0, ET;
};

template <class Use>
void each_member(const Use& use) {
  use("x0", &SceneData::x0);
  use("b", &SceneData::b);
  use("f", &SceneData::f);
  use("g", &SceneData::g);
  use("A", &SceneData::A);
  use("B", &SceneData::B);
  use("N", &SceneData::N);
  use("E", &SceneData::E);
  use("M", &SceneData::M);
  use("E0", &SceneData::E0);
  use("ET", &SceneData::ET);
  use("restitution", &SceneData::restitution);
}

RowMatrix source_table(const TimeFunction& function, const Vector& t, Index width) {
  return function && width > 0 ? RowMatrix(sample(function, t, width).table()) : RowMatrix::Zero(t.size(), width);
}

// `dynamics`: with A, B, N and E, as far as they are written out.
SceneData data_of(const Scene& scene, const Vector& t, bool written_out, bool dynamics) {
  SceneData d;
  d.x0 = scene.x0;
  d.restitution = scene.restitution;
  if (scene.boundary) d.b = scene.boundary->b, d.E0 = scene.boundary->E0, d.ET = scene.boundary->ET;
  d.M = to_dense(scene.M);
  d.g = source_table(scene.g, t, scene.constraints());
  d.f = source_table(scene.f, t, scene.sources());
  if (!written_out) return d;
  if (!dynamics && !(scene.f && scene.f_entry != SourceEntry::state)) return d;
  const DenseDynamics dense = to_dense(scene.dynamics);
  if (scene.f) d.f = d.f * source_matrix(scene, dense).transpose();
  if (!dynamics) return d;
  d.A = dense.A, d.B = dense.B, d.N = dense.N;
  d.E = dense.E;
  return d;
}

double largest_entry(const Eigen::Ref<const Matrix>& values) {
  return values.size() > 0 ? values.cwiseAbs().maxCoeff() : 0;
}

// Of one table at five values of the parameter.
struct DataDifferences {
  Matrix change, bend, kink;  ///< change: per unit; bend: the same by two points, less; kink: see kink_less
};

DataDifferences data_differences(const Matrix& a2, const Matrix& a, const Matrix& at, const Matrix& b, const Matrix& b2,
                                 double d) {
  const Matrix two = (b - a) / (2 * d), wide = (b2 - a2) / (4 * d);
  return {(4 * two - wide) / 3, (two - wide) / 3, (b2 - 2 * at + a2) / 4 - (b - 2 * at + a)};
}

bool shares_dynamics(const ParameterNeighbours& n, const Scene& scene) {
  return std::all_of(n.at.begin(), n.at.end(),
                     [&](const ParameterScene& p) { return &*p.scene.dynamics == &*scene.dynamics; });
}

[[noreturn]] void refuse_parameter(const std::string& name, const std::string& found, const std::string& remedy) {
  throw Error("derivative", "by " + name + ": " + found, remedy);
}

// The same modes, left in the same ways; what they add may differ.
bool same_memories(const Scene& a, const Scene& b) {
  const auto same = [](const auto& p, const auto& q, const auto& alike) {
    return std::equal(p.begin(), p.end(), q.begin(), q.end(), alike);
  };
  const auto same_jump = [](const Memory::Jump& p, const Memory::Jump& q) {
    return p.state == q.state && p.value == q.value;
  };
  const auto same_leave = [&](const Memory::Leave& p, const Memory::Leave& q) {
    return p.to == q.to && p.when.size() == q.when.size() && same(p.set, q.set, same_jump);
  };
  const auto same_mode = [&](const Memory::Mode& p, const Memory::Mode& q) {
    return p.name == q.name && same(p.leave, q.leave, same_leave);
  };
  return modes_at_start(a) == modes_at_start(b) && same(a.memories, b.memories, [&](const Memory& p, const Memory& q) {
           return same(p.modes, q.modes, same_mode);
         });
}

void check_same_form(const std::string& name, const Scene& scene, const Scene& other) {
  const auto refuse = [&](const char* what) {
    refuse_parameter(name, text("%s depends on it", what), "differentiate by parameters of the data");
  };
  if (scene.T != other.T) refuse("T");
  if (scene.states() != other.states() || scene.constraints() != other.constraints() ||
      scene.sources() != other.sources())
    refuse("the size of the scene");
  if (scene.free_rows != other.free_rows || scene.f_entry != other.f_entry ||
      scene.boundary.has_value() != other.boundary.has_value() ||
      scene.dynamics->has_mass() != other.dynamics->has_mass())
    refuse("the form of the scene");
  if (!same_memories(scene, other)) refuse("what a memory sets, or its first mode,");
}

std::vector<double> breakpoints_of(const Scene& scene) {
  return scene.breakpoints_are_all || (!scene.f && !scene.g) ? scene.breakpoints : find_breakpoints(scene);
}

// Whether f, g or what memories have of them has different limits from both sides.
bool jumps_at(const Scene& scene, double t) {
  const double by = beside_breakpoint * scene.T;
  if (t <= by || t >= scene.T - by) return false;
  bool found = false;
  for_each_source(scene, [&](const TimeFunction& function, Index width) {
    if (!function || width == 0) return;
    double size = 0;
    const auto apart = [&](double beside) {
      Vector before = Vector::Zero(width), after = before;
      function(std::max(t - beside, 0.0), before);
      function(std::min(t + beside, scene.T), after);
      size = std::max(before.cwiseAbs().maxCoeff(), after.cwiseAbs().maxCoeff());
      return (after - before).cwiseAbs().maxCoeff();
    };
    const double wide = apart(by), close = apart(by / 8);
    found = found || (close > 0.5 * wide && close > 1e-10 * size);
  });
  return found;
}

// The breakpoints that move with the parameter.
void find_moving(ParameterNeighbours& n, const Scene& scene) {
  n.moving.clear();
  n.moved = 0;
  const std::vector<double> here = breakpoints_of(scene);
  std::array<std::vector<double>, 4> there;
  bool paired = true;
  for (std::size_t k = 0; k < 4; ++k) {
    there[k] = breakpoints_of(n.at[k].scene);
    paired = paired && there[k].size() == here.size();
  }
  const auto refuse_unpaired = [&](const Scene& of, const std::vector<double>& times) {
    for (const double t : times)
      if (jumps_at(of, t))
        refuse_parameter(n.name, text("jumps of f and g appear or vanish with it (one is at t = %.6g)", t),
                         "choose another value");
  };
  if (!paired) {
    refuse_unpaired(scene, here);
    for (std::size_t k = 0; k < 4; ++k) refuse_unpaired(n.at[k].scene, there[k]);
    return;
  }
  for (std::size_t i = 0; i < here.size(); ++i) {
    double moved = 0;
    for (const std::vector<double>& times : there) moved = std::max(moved, std::abs(times[i] - here[i]));
    if (moved <= same_breakpoint * scene.T) continue;
    n.moving.push_back(here[i]);
    n.moved = std::max(n.moved, moved);
    if (jumps_at(scene, here[i]))
      n.jumps.push_back({here[i], (8 * (there[2][i] - there[1][i]) - (there[3][i] - there[0][i])) / (12 * n.step)});
  }
}

// The same times, but those that a jump moves over: just beside it, on their side. A jump itself counts as after it.
Vector beside_jumps(const ParameterNeighbours& n, const Vector& t, double T) {
  Vector times = t;
  const double beside = 2 * n.moved + 1e-9 * T;
  for (const MovingJump& jump : n.jumps)
    for (double& at : times)
      if (std::abs(at - jump.t) < beside) at = std::clamp(at < jump.t ? jump.t - beside : jump.t + beside, 0.0, T);
  return times;
}

// Rows of tables that a kink moves over.
std::vector<bool> rows_with_kinks(const ParameterNeighbours& n, const Vector& t, double T) {
  std::vector<bool> rows(std::size_t(t.size()), false);
  for (const double kink : n.moving)
    for (Index j = 0; j < t.size(); ++j)
      if (std::abs(t[j] - kink) <= n.moved + 1e-9 * T) rows[std::size_t(j)] = true;
  return rows;
}

// Empty, or the member that is not smooth on this distance.
std::string not_smooth(const ParameterNeighbours& n, const Scene& scene, const Vector& at, bool written_out) {
  const Vector t = beside_jumps(n, at, scene.T);
  const bool dynamics = !shares_dynamics(n, scene);
  const SceneData here = data_of(scene, t, written_out, dynamics);
  std::array<SceneData, 4> there;
  for (std::size_t i = 0; i < 4; ++i) there[i] = data_of(n.at[i].scene, t, written_out, dynamics);
  const std::vector<bool> left_out = rows_with_kinks(n, t, scene.T);
  std::string found;
  each_member([&](const char* name, auto member) {
    if ((here.*member).size() == 0 || !found.empty()) return;
    DataDifferences d =
        data_differences(there[0].*member, there[1].*member, here.*member, there[2].*member, there[3].*member, n.step);
    const double size = largest_entry(d.change), terms = rounding_of_data * largest_entry(here.*member);
    if (const std::string word = name; word == "f" || word == "g")
      for (Index j = 0; j < t.size(); ++j)
        if (left_out[std::size_t(j)]) d.bend.row(j).setZero(), d.kink.row(j).setZero();
    if (!(largest_entry(d.bend) <= bends_less * size + terms / n.step) ||
        !(largest_entry(d.kink) <= kink_less * n.step * size + terms))
      found = name;
  });
  return found;
}

// The neighbours in these modes, with the rows of their memories.
ParameterNeighbours neighbours_in(const ParameterNeighbours& n, const std::vector<Index>& modes) {
  ParameterNeighbours made = n;
  for (ParameterScene& p : made.at) p.scene = in_modes(with_memory_rows(p.scene), modes);
  return made;
}

// In all modes: the member that is not smooth, or empty.
std::string not_smooth_in_modes(const ParameterNeighbours& n, const Scene& scene, const Vector& t, bool written_out) {
  if (scene.memories.empty()) return not_smooth(n, scene, t, written_out);
  std::string found;
  for (const std::vector<Index>& modes : each_mode(scene))
    if (found.empty()) found = not_smooth(neighbours_in(n, modes), in_modes(with_memory_rows(scene), modes), t, true);
  return found;
}

ParameterNeighbours at_distance(const VariedParameter& p, const Scene& scene, double relative) {
  ParameterNeighbours n{p.name, relative * (p.value != 0 ? std::abs(p.value) : 1), {}, {}, 0, {}};
  const double by[] = {-2, -1, 1, 2};
  for (std::size_t i = 0; i < 4; ++i) {
    try {
      n.at[i] = p.scene_of(p.value + by[i] * n.step);
    } catch (const Error& e) {
      refuse_parameter(
          p.name, text("there is no scene with %s = %.17g (%s)", p.name.c_str(), p.value + by[i] * n.step, e.what()),
          "differentiate by parameters that may be larger and smaller");
    }
    check_same_form(p.name, scene, n.at[i].scene);
  }
  find_moving(n, scene);
  return n;
}

// [8 (v_2 - v_1) - (v_3 - v_0)]/(12 d).
template <class Value>
double slope_of(const ParameterNeighbours& n, const Value& value) {
  return (8 * (value(n.at[2].scene) - value(n.at[1].scene)) - (value(n.at[3].scene) - value(n.at[0].scene))) /
         (12 * n.step);
}

// c with v = c u; none if there is no such number.
std::optional<double> factor_of(const Vector& v, const Vector& u) {
  const double square = u.squaredNorm();
  if (!(square > 0) || v.size() != u.size()) return std::nullopt;
  const double c = v.dot(u) / square;
  return (v - c * u).norm() <= same_vector * v.norm() ? std::optional(c) : std::nullopt;
}

bool same_shape(const SecondDifference& a, const SecondDifference& b) {
  return a.points == b.points && a.spacing == b.spacing && a.first == b.first && a.last == b.last &&
         (a.diffusivity > 0) == (b.diffusivity > 0);
}

// Of two sums that differ by what KroneckerChange has.
bool same_sum(const KroneckerDynamics& a, const KroneckerDynamics& b) {
  bool same = same_shape(a.along, b.along) && same_shape(a.across, b.across) && a.beside.size() == b.beside.size();
  for (std::size_t i = 0; same && i < a.beside.size(); ++i)
    same = same_shape(a.beside[i], b.beside[i]) && std::abs(a.beside[i].diffusivity / b.beside[i].diffusivity -
                                                            a.along.diffusivity / b.along.diffusivity) <= same_vector;
  return same && factor_of(a.b, b.b) && factor_of(a.n, b.n);
}

double decay_of(const KroneckerDynamics& d) {
  double sum = d.along.decay + d.across.decay;
  for (const SecondDifference& line : d.beside) sum += line.decay;
  return sum;
}

KroneckerChange change_of_sum(const ParameterNeighbours& n, const Scene& scene) {
  const KroneckerDynamics& here = *scene.dynamics->modes();
  for (const ParameterScene& p : n.at)
    if (!p.scene.dynamics->modes() || !same_sum(*p.scene.dynamics->modes(), here))
      refuse_parameter(n.name, "it changes the dynamics, and not by factors of their parts",
                       "differentiate scenes with at most 1000 states");
  const auto sum = [](const Scene& s) -> const KroneckerDynamics& { return *s.dynamics->modes(); };
  KroneckerChange c;
  c.face = slope_of(n, [&](const Scene& s) { return sum(s).along.diffusivity / here.along.diffusivity; });
  c.across = slope_of(n, [&](const Scene& s) { return sum(s).across.diffusivity / here.across.diffusivity; });
  c.decay = slope_of(n, [&](const Scene& s) { return decay_of(sum(s)); });
  c.input = slope_of(n, [&](const Scene& s) { return *factor_of(sum(s).b, here.b); });
  c.output = slope_of(n, [&](const Scene& s) { return *factor_of(sum(s).n, here.n); });
  return c;
}

bool equal(const SparseMatrix& a, const SparseMatrix& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() && (a.size() == 0 || SparseMatrix(a - b).norm() == 0);
}

// Of dynamics that are not written out.
void check_sparse(const ParameterNeighbours& n, const Scene& scene) {
  const SparseDynamics* here = scene.dynamics->matrices();
  for (const ParameterScene& p : n.at) {
    const SparseDynamics* there = p.scene.dynamics->matrices();
    const bool same = here && there && equal(here->A, there->A) && equal(here->B, there->B) &&
                      equal(here->N, there->N) && equal(here->E, there->E);
    if (!same)
      refuse_parameter(n.name, "it changes the dynamics of a scene with more than 1000 states",
                       "differentiate by parameters of x0, f, g and M, or a smaller scene");
  }
}

}  // namespace

ParameterNeighbours neighbours_of(const VariedParameter& p, const Scene& scene, const Vector& t, bool written_out) {
  std::string member;
  for (double relative : steps_to_try) {
    ParameterNeighbours n = at_distance(p, scene, relative);
    if (!n.moving.empty() && relative > step_with_moving_kinks)
      n = at_distance(p, scene, relative = step_with_moving_kinks);
    member = not_smooth_in_modes(n, scene, t, written_out);
    if (member.empty()) return n;
    if (relative == step_with_moving_kinks) break;
  }
  refuse_parameter(p.name, text("%s is not differentiable at %s = %.6g", member.c_str(), p.name.c_str(), p.value),
                   "choose another value");
}

std::vector<std::vector<Index>> each_mode(const Scene& scene) {
  std::vector<std::vector<Index>> all;
  for (std::size_t k = 0; k < scene.memories.size(); ++k)
    for (Index i = 0; i < Index(scene.memories[k].modes.size()); ++i) {
      all.emplace_back(scene.memories.size(), 0);
      all.back()[k] = i;
    }
  return all;
}

ParameterChange parameter_change(const ParameterNeighbours& n, const Scene& scene, const Vector& at, bool written_out,
                                 const std::vector<std::vector<Index>>& modes) {
  if (!modes.empty()) {
    ParameterChange found = parameter_change(n, scene, at, written_out);
    for (const std::vector<Index>& now : modes)
      found.in_modes[now] =
          parameter_change(neighbours_in(n, now), in_modes(with_memory_rows(scene), now), at, true).data;
    return found;
  }
  const Vector t = beside_jumps(n, at, scene.T);
  const bool dynamics = !shares_dynamics(n, scene);
  std::array<SceneData, 4> there;
  for (std::size_t i = 0; i < 4; ++i) there[i] = data_of(n.at[i].scene, t, written_out, dynamics);
  SceneData change;
  each_member([&](const char*, auto member) {
    const auto of = [&](std::size_t i) -> const auto& { return there[i].*member; };
    if (of(0).size() == 0) return;
    change.*member = (8 * (of(2) - of(1)) - (of(3) - of(0))) / (12 * n.step);
    if ((change.*member).isZero(0)) (change.*member).resize(0, 0);
  });
  ParameterChange found;
  found.jumps = n.jumps;
  found.data = {change.x0.reshaped(), change.f, change.g, change.A, change.B, change.N, change.M, change.E,
                change.b.reshaped()};
  found.data.E0 = change.E0, found.data.ET = change.ET;
  found.data.restitution = change.restitution.reshaped();
  if (written_out || !dynamics) return found;
  if (!scene.dynamics->modes()) {
    check_sparse(n, scene);
    return found;
  }
  found.sum = change_of_sum(n, scene);
  found.of_sum = true;
  return found;
}

}  // namespace bromwich
