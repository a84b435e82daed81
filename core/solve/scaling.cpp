#include "core/solve/scaling.hpp"

#include "core/dynamics/grid_system.hpp"
#include "core/kernel/step_defects.hpp"
#include "core/lcp/blocks.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/numerics/components.hpp"
#include "core/result/slack.hpp"
#include "core/scene/natural_sizes.hpp"
#include "core/scene/separable.hpp"
#include "core/solve/prepared.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

using Exponents = std::vector<int>;

// A power of ten stands for sizes of 0.47 to 4.7 times it. Those that are simple numbers and their means are not
// near these ends, so that rounding does not decide.
constexpr double round_up = 0.3317;

int exponent(double size) {
  return std::clamp(int(std::floor(std::log10(size) + round_up)), -largest_exponent, largest_exponent);
}

Exponents exponents(const Vector& sizes) {
  Exponents k;
  for (const double size : sizes) k.push_back(exponent(size));
  return k;
}

bool all_zero(const Exponents& k) {
  return std::all_of(k.begin(), k.end(), [](int e) { return e == 0; });
}

// log of S with S^{-1} |M| as symmetric as can be over the pairs of entries that are both there, and the parts of M
// that such pairs join.
struct Balance {
  Vector logarithms;
  std::vector<std::vector<Index>> parts;
};

// From S that is exact along a tree of pairs, Gauss-Seidel sweeps towards the least squares over all pairs: single
// pairs of an unsymmetric M may be far from symmetric in any units.
Balance balance(const Matrix& M) {
  constexpr int sweeps = 20;
  Balance b{Vector::Zero(M.rows()), {}};
  const Matrix logs = M.array().log();
  const auto pair = [&M](Index i, Index j) { return M(i, j) != 0 && M(j, i) != 0; };
  const auto step = [&](Index i, Index j) { return pair(i, j) ? logs(j, i) - logs(i, j) : 0; };
  b.parts = connected_components(
      M.rows(), [&](Index i, Index j) { return M(i, j) != 0 || M(j, i) != 0; },
      [&](Index i, Index j) { b.logarithms[j] = b.logarithms[i] + step(i, j); });
  for (int k = 0; k < sweeps; ++k)
    for (const std::vector<Index>& part : b.parts)
      for (const Index j : part) {
        double sum = 0;
        Index pairs = 0;
        for (const Index i : part)
          if (i != j && pair(i, j)) sum += b.logarithms[i] + step(i, j), ++pairs;
        if (pairs > 0) b.logarithms[j] = sum / double(pairs);
      }
  return b;
}

// W Y = c S in each part of M.
void keep_semidefinite(const NaturalSizes& s, const Matrix& abs_M, bool as_stated, NaturalUnits& units) {
  Balance b = balance(abs_M);
  if (as_stated) b.logarithms.setZero();
  const Vector& y = s.y;
  const Vector S = b.logarithms.array().exp();
  units.y = exponents(y);
  for (const std::vector<Index>& part : b.parts) {
    double sum = 0;
    for (const Index i : part) sum += std::log(s.w[i] * y[i] / S[i]);
    const int c = exponent(std::exp(sum / double(part.size())));
    for (const Index i : part)
      units.w[std::size_t(i)] = c + int(std::lround(std::log10(S[i]))) - units.y[std::size_t(i)];
  }
}

// Whether W Y has to be c S, and whether S = I.
struct Semidefinite {
  bool holds = false, as_stated = true;
};

Semidefinite semidefinite(const Scene& scene, const Matrix& M) {
  const LcpClass c = known_class(scene.M, scene.lcp_class);
  if (selects_least_norm(c)) return {true, true};
  if (selects_one(c) || is_stated(scene.lcp_class)) return {};
  Matrix balanced = M;
  const Vector logarithms = balance(M.cwiseAbs()).logarithms;
  for (Index i = 0; i < M.rows(); ++i) {
    const int k = int(std::lround(logarithms[i] / std::log(10.0)));
    for (double& entry : balanced.row(i)) entry = times_ten_to(-k, entry);
  }
  return {selects_least_norm(classify(balanced)), false};
}

// Nothing is gained by common factors of ten, and large results would have to be brought back.
bool near_one(double size) { return std::abs(exponent(size)) <= 1; }

// A number times 10^k is value * up / down: one of the two is 1, and 10^|k| the other, so that nothing is rounded
// twice.
struct Factors {
  Factors(const Exponents& k, int sign) : up(Vector::Ones(Index(k.size()))), down(up) {
    for (Index i = 0; i < up.size(); ++i) {
      const int e = sign * k[std::size_t(i)];
      (e > 0 ? up : down)[i] = times_ten_to(std::abs(e), 1);
    }
  }
  Vector up, down;
};

Vector powers_of_ten(const Exponents& k) {
  const Factors factors(k, 1);
  return factors.up.cwiseQuotient(factors.down);
}

TimeFunction divided(const TimeFunction& function, const Exponents& k) {
  if (!function || all_zero(k)) return function;
  if (const auto* separable = function.separable()) {
    SeparableSource scaled = *separable;
    for (Index i = 0; i < scaled.shapes.rows(); ++i)
      for (Index j = 0; j < scaled.shapes.cols(); ++j)
        scaled.shapes(i, j) = times_ten_to(-k[std::size_t(i)], scaled.shapes(i, j));
    return scaled;
  }
  return [function, by = Factors(k, -1)](double t, Eigen::Ref<Vector> value) {
    function(t, value);
    value.array() *= by.up.array();
    value.array() /= by.down.array();
  };
}

Matrix changed(Matrix matrix, const Exponents& rows, const Exponents& columns) {
  for (Index j = 0; j < matrix.cols(); ++j)
    for (Index i = 0; i < matrix.rows(); ++i)
      matrix(i, j) = times_ten_to(columns[std::size_t(j)] - rows[std::size_t(i)], matrix(i, j));
  return matrix;
}

SparseMatrix changed(SparseMatrix matrix, const Exponents& rows, const Exponents& columns) {
  for (Index j = 0; j < matrix.outerSize(); ++j)
    for (SparseMatrix::InnerIterator a(matrix, j); a; ++a)
      a.valueRef() = times_ten_to(columns[std::size_t(j)] - rows[std::size_t(a.row())], a.value());
  return matrix;
}

// E is scaled as A is; any scaling of the equations would do.
template <typename Matrices>
requires requires(Matrices d) { d.E; }
Matrices matrices_in_units(const Matrices& d, const NaturalUnits& u) {
  return {changed(d.A, u.x, u.x), changed(d.B, u.x, u.y), changed(d.N, u.w, u.x), changed(d.E, u.x, u.x)};
}

template <typename Matrices>
requires requires(Matrices d) { d.E; }
Dynamics changed(const Matrices& d, const NaturalUnits& u) { return matrices_in_units(d, u); }

Dynamics changed(const KroneckerDynamics& d, const NaturalUnits& u) {
  KroneckerDynamics scaled = d;
  for (double& b : scaled.b) b = times_ten_to(u.y[0] - u.x[0], b);
  for (double& n : scaled.n) n = times_ten_to(u.x[0] - u.w[0], n);
  return scaled;
}

// Supplied dynamics keep the units of the scene.
Dynamics changed(const Dynamics& given, const NaturalUnits& u) {
  if (const auto* d = given->small_state()) return changed(*d, u);
  if (const auto* d = given->modes()) return changed(*d, u);
  if (const auto* grid = dynamic_cast<const GridSystem*>(&*given))
    return Dynamics(grid->in_units(matrices_in_units(grid->d, u), powers_of_ten(u.x)));
  if (const auto* d = given->matrices()) return changed(*d, u);
  return given;
}

LcpMatrix changed(const LcpMatrix& M, const NaturalUnits& u) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return changed(*dense, u.w, u.y);
  if (const auto* sparse = sparse_of(M)) return SparseLcpMatrix(changed(*sparse, u.w, u.y));
  Tridiagonal t = std::get<Tridiagonal>(M);
  each_entry(t, [&u](Index i, Index j, double& entry) {
    entry = times_ten_to(u.y[std::size_t(j)] - u.w[std::size_t(i)], entry);
  });
  return t;
}

Exponents boundary_rows(const BoundaryCondition& c, const Exponents& x) {
  Exponents rows;
  for (Index i = 0; i < c.E0.rows(); ++i) {
    double largest = 0;
    for (Index j = 0; j < c.E0.cols(); ++j)
      largest =
          std::max(largest, times_ten_to(x[std::size_t(j)], std::max(std::abs(c.E0(i, j)), std::abs(c.ET(i, j)))));
    rows.push_back(largest > 0 ? exponent(largest) : 0);
  }
  return rows;
}

template <typename Table>
void change_columns(Table& table, const Exponents& k, int sign) {
  if (table.size() == 0) return;
  if (all_zero(k)) return;
  const Factors by(k, sign);
  for (Index j = 0; j < table.rows(); ++j) {  // tables over time lie row by row
    table.row(j).array() *= by.up.transpose().array();
    table.row(j).array() /= by.down.transpose().array();
  }
}

Result changed(Result result, const NaturalUnits& units, int sign) {
  if (units.trivial()) return result;
  change_columns(result.y, units.y, sign);
  change_columns(result.y_left, units.y, sign);
  change_columns(result.y_integral, units.y, sign);
  change_columns(result.trace, units.w, sign);
  Exponents x;
  for (const Index c : result.x_components) x.push_back(units.x[std::size_t(c)]);
  change_columns(result.x, x, sign);
  for (Index i = 0; i < result.start.size(); ++i)
    result.start[i] = times_ten_to(sign * units.x[std::size_t(i)], result.start[i]);
  if (result.defects) {
    auto defects = std::make_shared<StepDefects>(*result.defects);
    change_columns(defects->values, units.x, sign);
    result.defects = std::move(defects);
  }
  if (result.impacts) {
    auto impacts = std::make_shared<std::vector<Impact>>(*result.impacts);
    const auto change = [sign](Vector& v, const Exponents& k) {
      for (Index i = 0; i < v.size(); ++i) v[i] = times_ten_to(sign * k[std::size_t(i)], v[i]);
    };
    for (Impact& impact : *impacts) change(impact.p, units.y), change(impact.jump, units.x);
    result.impacts = std::move(impacts);
  }
  return result;
}

// Forces of a circle have one unit, and so have its two speeds. That of a given bound keeps w = y - R.
void keep_circle(const FrictionCone& cone, NaturalUnits& units) {
  const auto y = units.y.begin() + cone.first, w = units.w.begin() + cone.first;
  std::fill_n(y, 3, *std::max_element(y, y + 3));
  std::fill_n(w + 1, 2, std::max(w[1], w[2]));
  if (cone.given) *w = *y;
}

double boundary_residual_of(const BoundaryCondition& c, const RowMatrix& x) {
  const Vector apart = c.E0 * x.row(0).transpose() + c.ET * x.row(x.rows() - 1).transpose() - c.b;
  return apart.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() / std::max(1.0, c.b.cwiseAbs().maxCoeff());
}

// Keeps the requested components of all that were recorded.
void select_components(const std::vector<Index>& requested, Result& result) {
  if (result.x_components == requested) return;
  result.x = result.x(Eigen::all, requested).eval();
  result.x_components = requested;
}

}  // namespace

double stated_residual(const Scene& scene, const Result& result) {
  double worst = NAN;
  const RowMatrix slacks = slack(scene, result);
  // An impulse is no solution of the problem at t = 0.
  const Index first = result.starts_with_impulse ? 1 : 0;
  for (Index j = first; j < std::min(result.y.rows(), slacks.rows()); ++j) {
    Vector y = result.y.row(j).transpose();
    const Vector w = slacks.row(j).transpose(), q = w - multiply(scene.M, y);
    if (!y.allFinite() || !w.allFinite()) continue;
    const Vector given = y;
    y = y.cwiseMin(w);
    for (const Index i : scene.free_rows) y[i] = w[i];
    for (const auto& [row, mu, known] : scene.cones) {
      const Vector unscaled = Vector::Ones(3);
      y.segment(row, 3) =
          FrictionBlock(row, mu, known).law(given.segment(row, 3), w.segment(row, 3), unscaled, nullptr, nullptr);
    }
    const double missed = y.cwiseAbs().maxCoeff() / std::max(1.0, q.cwiseAbs().maxCoeff());
    worst = std::isnan(worst) ? missed : std::max(worst, missed);
  }
  return worst;
}

void take_stated_residual(const Scene& scene, Result& result) {
  if (result.y_left.size() > 0 || std::isnan(result.residual)) return;
  if (const double residual = stated_residual(scene, result); !std::isnan(residual)) result.residual = residual;
}

NaturalUnits natural_units(const Scene& scene) {
  if (!scene.dynamics->has_matrices() || scene.constraints() == 0) return {};
  const auto* common = scene.dynamics->modes();
  if (common)
    if (const CommonSizes s = common_sizes(*common, scene); near_one(s.x) && near_one(s.y) && near_one(s.w)) return {};
  const NaturalSizes sizes = natural_sizes(scene);
  NaturalUnits units{exponents(sizes.x), exponents(sizes.y), exponents(sizes.w), {}};
  const Matrix M = common ? Matrix() : to_dense(scene.M);
  if (!common && !(all_zero(units.y) && all_zero(units.w)))
    if (const Semidefinite s = semidefinite(scene, M); s.holds)
      keep_semidefinite(sizes, M.cwiseAbs(), s.as_stated, units);
  for (const FrictionCone& cone : scene.cones) keep_circle(cone, units);
  for (const Memory& memory : scene.memories)
    if (memory.state >= 0) units.x[std::size_t(memory.state)] = 0;  // the number of a mode
  if (scene.boundary) units.boundary = boundary_rows(*scene.boundary, units.x);
  if (all_zero(units.x) && all_zero(units.y) && all_zero(units.w) && all_zero(units.boundary)) return {};
  return units;
}

namespace {

void change_modes(std::vector<Memory>& memories, const NaturalUnits& u) {
  for (Memory& memory : memories)
    for (Memory::Mode& mode : memory.modes) {
      mode.f = divided(mode.f, u.x);
      mode.g = divided(mode.g, u.w);
      mode.A = changed(std::move(mode.A), u.x, u.x);
      mode.B = changed(std::move(mode.B), u.x, u.y);
      mode.N = changed(std::move(mode.N), u.w, u.x);
      mode.M = changed(std::move(mode.M), u.w, u.y);
      for (Memory::Leave& leave : mode.leave)
        for (Memory::Jump& jump : leave.set) jump.value = times_ten_to(-u.x[std::size_t(jump.state)], jump.value);
    }
}

}  // namespace

Scene in_natural_units(const Scene& scene, const NaturalUnits& u) {
  Scene natural = scene;
  if (u.trivial()) return natural;
  natural.port = {};
  natural.exact = {};
  natural.dynamics = changed(scene.dynamics, u);
  natural.M = changed(scene.M, u);
  if (scene.f_entry == SourceEntry::through_F)
    natural.F = changed(scene.F, u.x, Exponents(std::size_t(scene.F.cols()), 0));
  else
    natural.f = divided(scene.f, scene.f_entry == SourceEntry::through_B ? u.y : u.x);
  natural.g = divided(scene.g, u.w);
  change_modes(natural.memories, u);
  if (scene.boundary) {
    BoundaryCondition& c = *natural.boundary;
    c.E0 = changed(std::move(c.E0), u.boundary, u.x);
    c.ET = changed(std::move(c.ET), u.boundary, u.x);
    for (Index i = 0; i < c.b.size(); ++i) c.b[i] = times_ten_to(-u.boundary[std::size_t(i)], c.b[i]);
  } else {
    for (Index i = 0; i < natural.x0.size(); ++i) natural.x0[i] = times_ten_to(-u.x[std::size_t(i)], natural.x0[i]);
  }
  return natural;
}

Result to_units_of_scene(Result result, const NaturalUnits& units) {
  result = changed(std::move(result), units, 1);
  if (!units.trivial() && result.rounding_of_y != 0)
    result.rounding_of_y = times_ten_to(*std::max_element(units.y.begin(), units.y.end()), result.rounding_of_y);
  return result;
}

std::optional<Reduction> natural_units_of(const Scene& scene, const InnerOptions& options) {
  if (options.method == Method::goal) return std::nullopt;
  const auto of_scene = [&] { return natural_units(scene); };
  const auto units =
      std::make_shared<const NaturalUnits>(options.prepared ? options.prepared->units_of_solve(of_scene) : of_scene());
  if (units->trivial()) return std::nullopt;
  note(options.log, LogLevel::debug, "solved in natural units: powers of ten that bring x, y and w near 1");
  Reduction made{in_natural_units(scene, *units), options};
  InnerOptions& inner = made.options;
  inner.units = units;
  if (options.prepared)
    made.scene.dynamics = options.prepared->reduced(ReducedDynamics::units, scene.dynamics, made.scene.dynamics);
  if (options.tuning.first_iterate && options.tuning.first_iterate->cols() == scene.constraints()) {
    made.first_iterate = std::make_shared<RowMatrix>(*options.tuning.first_iterate);
    change_columns(*made.first_iterate, units->y, -1);
    inner.tuning.first_iterate = made.first_iterate.get();
  }
  inner.trace = true;
  if (scene.boundary) inner.states = StateSelection::all;
  made.there = [units](Result& result) { result = changed(std::move(result), *units, -1); };
  made.back = [units](Result& result) { result = to_units_of_scene(std::move(result), *units); };
  made.finish = [&scene, &options](Result& result) {
    take_stated_residual(scene, result);
    if (result.boundary_residual && result.x.rows() > 0 && result.x.cols() == scene.states())
      result.boundary_residual = boundary_residual_of(*scene.boundary, result.x);
    if (scene.boundary && result.x_components.size() == std::size_t(scene.states()))
      select_components(recorded_components(scene, options), result);
    if (!options.trace) result.trace.resize(0, 0);
  };
  return made;
}

}  // namespace bromwich
