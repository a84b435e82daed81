#include "bench/studies/derivative_check.hpp"

#include "core/base/error.hpp"
#include "core/derivatives/modal_derivative.hpp"
#include "core/derivatives/space_time_derivative.hpp"
#include "core/derivatives/switched_derivative.hpp"
#include "core/scene/separable.hpp"
#include "core/solve/solve.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <vector>

namespace bromwich::app {

namespace {

constexpr Index largest_dense = 400;    ///< states that are written out
constexpr double largest_step = 1e-5;   ///< of a difference, relative: its error is 1e-10
constexpr double within_reach = 0.3;    ///< of the change that leaves the active sets, to first order
constexpr double located_steps[] = {1e-4, 1e-5, 1e-6, 1e-7};
constexpr Index located_points = 64;

class Drawing {
 public:
  Matrix matrix(Index rows, Index columns) {
    return Matrix::NullaryExpr(rows, columns, [this](Index, Index) { return uniform_(generator_); });
  }

 private:
  std::mt19937_64 generator_{7};
  std::uniform_real_distribution<double> uniform_{-1, 1};
};

double size_of(const Eigen::Ref<const Matrix>& values) {
  const double largest = values.size() > 0 ? values.cwiseAbs().maxCoeff() : 0;
  return largest > 0 ? largest : 1;
}

// The change of a source over [0, T] and the same at time points.
struct Ramp {
  Vector start, slope;
  double T;

  RowMatrix rows(const Vector& t) const {
    return RowMatrix(Vector::Ones(t.size()) * start.transpose() + t / T * slope.transpose());
  }
  TimeFunction added_to(const TimeFunction& given, double by, const Matrix& entry) const {
    return [ramp = *this, given, by, entry](double t, Eigen::Ref<Vector> v) {
      if (given && entry.size() > 0) {
        Vector phi(entry.cols());
        given(t, phi);
        v = entry * phi;
      } else if (given) {
        given(t, v);
      } else {
        v.setZero();
      }
      v += by * (ramp.start + t / ramp.T * ramp.slope);
    };
  }
};

struct Change {
  std::string name;
  DataChange data;
  std::function<Scene(double)> scene;  ///< with the change times a number
};

Ramp drawn_ramp(const TimeFunction& given, Index width, const Vector& t, Drawing& draw) {
  const double size = given && width > 0 ? size_of(Matrix(sample(given, t, width).table())) : 1;
  return {size * draw.matrix(width, 1), size * draw.matrix(width, 1), t[t.size() - 1]};
}

// Changes of x0, f, g and M. `by_B`: f as phi of f = B phi.
std::vector<Change> changes_of_any(const Scene& scene, const Vector& t, bool by_B, Drawing& draw) {
  const Index n = scene.constraints();
  std::vector<Change> all(4);
  all[0].name = "x0";
  all[0].data.x0 = size_of(scene.x0) * draw.matrix(scene.states(), 1);
  all[0].scene = [&scene, x0 = all[0].data.x0](double by) {
    Scene s = scene;
    s.x0 += by * x0;
    return s;
  };
  all[1].name = "f";
  const Matrix entry = by_B || !scene.f || scene.f_entry == SourceEntry::state
                           ? Matrix()
                           : source_matrix(scene, *scene.dynamics->small_state());
  const Ramp of_f = drawn_ramp(entry.size() > 0 ? TimeFunction() : scene.f, by_B ? n : scene.states(), t, draw);
  all[1].data.f = of_f.rows(t);
  all[1].scene = [&scene, of_f, entry, by_B](double by) {
    Scene s = scene;
    s.f = of_f.added_to(scene.f, by, entry);
    s.f_entry = by_B ? SourceEntry::through_B : SourceEntry::state;
    s.F = {};
    return s;
  };
  all[2].name = "g";
  const Ramp of_g = drawn_ramp(scene.g, n, t, draw);
  all[2].data.g = of_g.rows(t);
  all[2].scene = [&scene, of_g](double by) {
    Scene s = scene;
    s.g = of_g.added_to(scene.g, by, Matrix());
    return s;
  };
  all[3].name = "M";
  const Matrix M = to_dense(scene.M);
  all[3].data.M = size_of(M) * draw.matrix(n, n);
  all[3].scene = [&scene, M, more = all[3].data.M](double by) {
    Scene s = scene;
    s.M = Matrix(M + by * more);
    return s;
  };
  if (n == 0) all.resize(2);
  return all;
}

// And of the matrices of dense dynamics.
void add_matrices(const Scene& scene, Drawing& draw, std::vector<Change>& all) {
  struct Member {
    const char* name;
    Matrix DenseDynamics::*of;
    Matrix DataChange::*change;
  };
  for (const Member& m : {Member{"A", &DenseDynamics::A, &DataChange::A}, {"B", &DenseDynamics::B, &DataChange::B},
                          {"N", &DenseDynamics::N, &DataChange::N}, {"E", &DenseDynamics::E, &DataChange::E}}) {
    const Matrix& given = scene.dynamics->small_state()->*m.of;
    if (given.size() == 0) continue;
    Change c;
    c.name = m.name;
    c.data.*m.change = size_of(given) * draw.matrix(given.rows(), given.cols());
    c.scene = [&scene, of = m.of, more = c.data.*m.change](double by) {
      Scene s = scene;
      DenseDynamics d = *scene.dynamics->small_state();
      d.*of += by * more;
      s.dynamics = std::move(d);
      return s;
    };
    all.push_back(std::move(c));
  }
}

double dot(const RowMatrix& a, const RowMatrix& b) {
  return a.size() > 0 && b.size() > 0 ? a.cwiseProduct(b).sum() : 0;
}

// <J^T u, v> of a gradient and a change.
double product(const DataChange& a, const DataChange& b) {
  double sum = a.x0.size() > 0 && b.x0.size() > 0 ? a.x0.dot(b.x0) : 0;
  sum += dot(a.f, b.f) + dot(a.g, b.g);
  for (const auto member : {&DataChange::A, &DataChange::B, &DataChange::N, &DataChange::M, &DataChange::E})
    if ((a.*member).size() > 0 && (b.*member).size() > 0) sum += (a.*member).cwiseProduct(b.*member).sum();
  return sum;
}

using Jvp = std::function<SolutionChange(const DataChange&)>;
using Vjp = std::function<DataChange(const SolutionChange&)>;

// Largest |found - difference| over the largest of all, of columns of the same kind.
double largest_deviation(const RowMatrix& found, const RowMatrix& difference) {
  if (found.size() == 0 || difference.size() == 0) return 0;
  const double size = std::max(found.cwiseAbs().maxCoeff(), difference.cwiseAbs().maxCoeff());
  return size > 0 ? (found - difference).cwiseAbs().maxCoeff() / size : 0;
}

double largest(const RowMatrix& values) { return values.size() > 0 ? values.cwiseAbs().maxCoeff() : 0; }

// The largest |change| over the largest value.
double relative_change(const RowMatrix& change, const RowMatrix& values) {
  return largest(values) > 0 ? largest(change) / largest(values) : 0;
}

// The largest multiple of the change of y and w to first order that leaves the active sets. Entries with w = 0 that does
// not change are left out.
double reach(const RowMatrix& y, const RowMatrix& w, const SolutionChange& by) {
  double least = INFINITY;
  const double none = 1e-12 * (largest(w) + 1e-290);
  for (Index k = 0; k < y.size(); ++k) {
    const bool active = y.data()[k] > 0;
    const double value = active ? y.data()[k] : w.data()[k], change = std::abs((active ? by.y : by.w).data()[k]);
    if (change > 0 && (value > none || change > 1e-12 * largest(by.w))) least = std::min(least, std::max(value, 0.0) / change);
  }
  return least;
}

void check_identity(const SolutionChange& out, const Change& c, const Vjp& vjp, const std::vector<Index>& left_out,
                    Drawing& draw, DerivativeCheck& check) {
  SolutionChange of;
  const auto weigh = [&](const RowMatrix& values, RowMatrix& weights) {
    if (values.size() == 0) return;
    weights = draw.matrix(values.rows(), values.cols());
    for (const Index j : left_out) weights.row(j).setZero();
  };
  weigh(out.y, of.y);
  weigh(out.x, of.x);
  weigh(out.w, of.w);
  try {
    const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.w, out.w);
    double size = 0;
    for (const auto member : {&SolutionChange::y, &SolutionChange::x, &SolutionChange::w})
      size += (of.*member).norm() * (out.*member).norm();
    const double off = std::abs(forward - product(vjp(of), c.data)) / std::max(size, 1e-290);
    check.identity = std::fmax(check.identity, off);
  } catch (const Error& refusal) {
    check.refused["vjp"] = refusal.what();
  }
}

Options options_of(Method method, Index steps) {
  Options options;
  options.method = method;
  options.steps = steps;
  options.states = StateSelection::all;
  options.trace = true;
  return options;
}

// w of the solution where it is known, to choose a step that keeps the sets.
struct Discrete {
  Result result;
  Jvp jvp;
  Vjp vjp;
  double margin = 0;
};

Discrete discrete_of(const Scene& scene, Backend& backend, Index steps, std::string& kind) {
  Discrete d;
  d.result = solve(scene, backend, options_of(Method::march, steps));
  if (scene.dynamics->small_state()) {
    const auto of = std::make_shared<SolutionDerivative>(scene, d.result);
    d.jvp = [of](const DataChange& c) { return of->jvp(c); };
    d.vjp = [of](const SolutionChange& c) { return of->vjp(c); };
    d.margin = of->margin().margin;
    kind = "discrete";
  } else if (scene.dynamics->modes()) {
    const auto of = std::make_shared<ModalDerivative>(scene, d.result);
    d.jvp = [of](const DataChange& c) { return of->jvp(c, true); };
    d.vjp = [of](const SolutionChange& c) { return of->vjp(c); };
    d.margin = of->margin().margin;
    kind = "in modes";
  } else {
    const auto of = std::make_shared<SpaceTimeDerivative>(scene, d.result, backend);
    d.jvp = [of](const DataChange& c) { return of->jvp(c); };
    d.vjp = [of](const SolutionChange& c) { return of->vjp(c); };
    d.margin = of->margin().margin;
    kind = "over all times";
  }
  return d;
}

void compare_discrete(const Scene& scene, Backend& backend, const Discrete& d, Drawing& draw, DerivativeCheck& check) {
  const Vector& t = d.result.t;
  const Index J = d.result.steps;
  std::vector<Change> changes = changes_of_any(scene, t, !scene.dynamics->small_state(), draw);
  if (scene.dynamics->small_state()) add_matrices(scene, draw, changes);
  RowMatrix w = d.result.trace + d.result.y * to_dense(scene.M).transpose();
  if (scene.g && scene.constraints() > 0) w += sample(scene.g, t, scene.constraints()).table();
  for (const Change& c : changes) try {
      const SolutionChange out = d.jvp(c.data);
      const double relative = std::max({relative_change(out.y, d.result.y), relative_change(out.x, d.result.x),
                                        relative_change(out.w, w), 1.0});
      const double step = std::min(within_reach * reach(d.result.y, w, out), largest_step / relative);
      if (!(step > 0)) throw Error("derivative", "y = w = 0 at a time point", "another grid");
      const Options options = options_of(d.result.method, J);
      const Result up = solve(c.scene(step), backend, options), down = solve(c.scene(-step), backend, options);
      if (up.status != Status::solved || down.status != Status::solved)
        throw Error("derivative", "a scene with changed data is not solved", "another change");
      check.error[c.name] = std::max(largest_deviation(out.y, (up.y - down.y) / (2 * step)),
                                     largest_deviation(out.x, (up.x - down.x) / (2 * step)));
      check_identity(out, c, d.vjp, {}, draw, check);
    } catch (const Error& refusal) {
      check.refused[c.name] = refusal.what();
    }
}

// Whether t is at a switch of one of the three, or between those of different ones.
bool moves_over(double t, const std::vector<double>& a, const std::vector<double>& b, const std::vector<double>& c) {
  for (std::size_t i = 0; i < a.size(); ++i)
    if (t >= std::min({a[i], b[i], c[i]}) - 1e-9 && t <= std::max({a[i], b[i], c[i]}) + 1e-9) return true;
  return false;
}

double located_error(const SwitchedDerivative& d, const SolutionChange& out, const Change& c, double step) {
  const SwitchedDerivative up(c.scene(step), d.times()), down(c.scene(-step), d.times());
  if (up.switches().size() != d.switches().size() || down.switches().size() != d.switches().size()) return INFINITY;
  double worst = 0;
  for (const auto member : {&SolutionChange::y, &SolutionChange::x, &SolutionChange::integral}) {
    RowMatrix found = out.*member, difference = (up.values().*member - down.values().*member) / (2 * step);
    for (Index j = 0; j < d.times().size(); ++j)
      if (moves_over(d.times()[j], d.switches(), up.switches(), down.switches()))
        found.row(j) = difference.row(j) = RowMatrix::Zero(1, found.cols());
    worst = std::max(worst, largest_deviation(found, difference));
  }
  return worst;
}

void check_located(const Scene& scene, Drawing& draw, DerivativeCheck& check) {
  const Vector t = time_grid(scene.T, located_points);
  const SwitchedDerivative d(scene, t);
  check.kind = "located";
  check.steps = Index(d.switches().size());
  check.margin = std::min(d.margin().margin, d.margin().transversality);
  std::vector<Change> changes = changes_of_any(scene, t, false, draw);
  add_matrices(scene, draw, changes);
  const Vjp vjp = [&d](const SolutionChange& of) { return d.vjp(of); };
  for (const Change& c : changes) {
    try {
      const SolutionChange out = d.jvp(c.data);
      double best = INFINITY;
      for (const double step : located_steps) try {
          best = std::min(best, located_error(d, out, c, step));
        } catch (const Error&) {
        }  // the changed scene has no derivative: a smaller step
      check.error[c.name] = best;
      check_identity(out, c, vjp, d.one_sided(), draw, check);
    } catch (const Error& refusal) {
      check.refused[c.name] = refusal.what();
    }
  }
}

}  // namespace

double DerivativeCheck::largest_error() const {
  double largest = 0;
  for (const auto& [name, e] : error) largest = std::fmax(largest, std::isnan(e) ? INFINITY : e);
  return largest;
}

DerivativeCheck check_derivatives(const Scene& given, Backend& backend, Index steps, Index grids) {
  DerivativeCheck check;
  check.states = given.states();
  check.constraints = given.constraints();
  Drawing draw;
  try {
    Scene scene = given;
    if (scene.states() <= largest_dense && scene.dynamics->dense_form()) scene = written_out(scene);
    const Result first = solve(scene, backend, options_of(Method::march, steps));
    if (first.status == Status::solved && y_may_jump(first)) {
      check_located(scene, draw, check);
      return check;
    }
    std::optional<Discrete> best;
    for (Index more = 0; more < grids; ++more) try {
        Discrete d = discrete_of(scene, backend, steps + more, check.kind);
        if (!best || d.margin > best->margin) best = std::move(d);
      } catch (const Error& refusal) {
        check.reason = refusal.what();
      }
    if (!best) return check;
    check.reason.clear();
    check.steps = best->result.steps;
    check.margin = best->margin;
    compare_discrete(scene, backend, *best, draw, check);
  } catch (const Error& refusal) {
    check.kind.clear();
    check.reason = refusal.what();
  }
  return check;
}

}  // namespace bromwich::app
