#include "core/adapted/radau_steps.hpp"

#include "core/host/stage_coefficients.hpp"
#include "core/host/step_lcp.hpp"
#include "core/scene/has_impacts.hpp"
#include "core/scene/source_steps.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <type_traits>

namespace bromwich {

namespace {

constexpr double no_sign = 1e-9;             ///< of the largest y of a step: smaller values count as 0
constexpr double not_acting = 1e-9;          ///< of the terms of N B
constexpr double resolution = 64 * epsilon;  ///< of T: times of breakpoints

// Lengths that differ by rounding share their matrices: of T, and of the length itself.
constexpr double rounding_of_times = 4 * epsilon, same_length = 1e-11;
constexpr double most_kept = 5e7;  ///< numbers in the matrices of all lengths, about
constexpr Index most_constraints = 512;
/// Of a shortest part: the step in which the state may jump. M hides N B of shorter ones.
constexpr double of_jump = 0x1p-4;

SparseMatrix entry_of_f(const Scene& scene) {
  if (scene.f_entry == SourceEntry::through_F) return scene.F;
  if (scene.f_entry == SourceEntry::through_B) return scene.dynamics->inputs();
  SparseMatrix identity(scene.states(), scene.states());
  identity.setIdentity();
  return identity;
}

template <class Scalar>
Vector weights(Index n) {
  if constexpr (std::is_same_v<Scalar, double>) return Vector::Ones(n);
  Vector d(2 * n);
  d << Vector::Constant(n, 0.75), Vector::Constant(n, 0.25);
  return d;
}

}  // namespace

// f, as it enters the state, and g at the stages of a part.
struct RadauSteps::Sources {
  explicit Sources(const Scene& s)
      : F(entry_of_f(s)),
        f(s.f, s.f ? s.sources() : 0, resolution * s.T),
        g(s.g, s.g ? s.constraints() : 0, resolution * s.T) {}

  static Vector at(const OneSided& source, double from, double to, double node) {
    if (node == 1) return source.whole(source.before(to, to - from));
    Vector value;
    source.value(from + node * (to - from), value);
    return source.whole(value);
  }

  SparseMatrix F;
  OneSided f, g;
};

// The steps of one length.
template <class Scalar>
struct StepsOfLength {
  using Columns = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  static constexpr Index s = host::Coefficients<Scalar>::stages;

  StepsOfLength(const LinearSystem& system, const SparseMatrix& B, const SparseMatrix& N, const Matrix& M, LcpClass c,
                double h) {
    const host::Coefficients<Scalar> k;
    shifted = system.at_shift(k.mu / h);
    if (!shifted) return;
    const Index m = B.rows(), n = B.cols();
    const Columns RB = shifted->solve(Columns(Matrix(B).cast<Scalar>()));
    drive.resize(m, s * n);
    implicit.resize(s * n, s * n);
    Matrix blocks = Matrix::Zero(s * n, s * n);
    for (Index i = 0; i < s; ++i) {
      blocks.block(i * n, i * n, n, n) = M;
      for (Index j = 0; j < s; ++j) {
        const Matrix QB = k.real(k.v[i] * k.w[j] * RB);
        implicit.block(i * n, j * n, n, n) = N * QB;
        if (i == s - 1) drive.middleCols(j * n, n) = QB;
      }
    }
    const Vector d = weights<Scalar>(n);
    lcp = std::make_unique<host::StepLcp>(d.asDiagonal() * (blocks + implicit), M, s == 1 ? c : LcpClass::unknown,
                                          d.asDiagonal() * blocks);
  }

  std::unique_ptr<ShiftedSystem<Scalar>> shifted;
  Matrix drive, implicit;  ///< m x s n, s n x s n
  std::unique_ptr<host::StepLcp> lcp;
};

template <class Scalar>
struct RadauSteps::Family {
  explicit Family(const Scene& scene)
      : B(scene.dynamics->inputs()), N(scene.dynamics->outputs()), rounding(rounding_of_times * scene.T) {}
  StepsOfLength<Scalar>& of(const LinearSystem& system, const Matrix& M, LcpClass c, double h) {
    const double size = double(B.rows() + 2 * B.cols());
    const double same = std::min(rounding, same_length * h);
    const auto near = by_length.lower_bound(h - same);
    if (near != by_length.end() && near->first <= h + same) return *near->second;
    if (double(by_length.size()) * size * size > most_kept) by_length.clear();
    auto& kept = by_length[h];
    kept = std::make_unique<StepsOfLength<Scalar>>(system, B, N, M, c, h);
    return *kept;
  }
  SparseMatrix B, N;
  double rounding;  ///< of times
  std::map<double, std::unique_ptr<StepsOfLength<Scalar>>> by_length;
};

RadauSteps::RadauSteps(const Scene& scene, LcpClass c)
    : scene_(scene),
      M_(to_dense(scene.M)),
      class_(c),
      sources_(std::make_unique<Sources>(scene)),
      radau_(std::make_unique<Family<Complex>>(scene)),
      euler_(std::make_unique<Family<double>>(scene)) {}

RadauSteps::~RadauSteps() = default;

template <class Scalar>
bool RadauSteps::advance(Family<Scalar>& family, const Part& p, const TreeRow& from, TreeRow& to) {
  using Column = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
  constexpr Index s = host::Coefficients<Scalar>::stages;
  const host::Coefficients<Scalar> c;
  const LinearSystem& system = *scene_.dynamics;
  StepsOfLength<Scalar>& step = family.of(system, M_, class_, p.length);
  if (!step.shifted) return false;
  const Index n = M_.rows();
  Column rhs = (c.start / p.length) * system.times_mass(from.x).template cast<Scalar>();
  const auto node = [](Index i) { return s == 1 ? 1.0 : part_nodes[std::size_t(i)]; };
  for (Index k = 0; k < s && scene_.f; ++k)
    rhs += c.w[k] * (sources_->F * Sources::at(sources_->f, p.from, p.to, node(k))).template cast<Scalar>();
  const Column xi = step.shifted->solve(rhs);
  Vector q(s * n);
  for (Index i = 0; i < s; ++i) {
    to.x = c.real(c.v[i] * xi);
    q.segment(i * n, n) = family.N * to.x;
    if (scene_.g) q.segment(i * n, n) += Sources::at(sources_->g, p.from, p.to, node(i));
  }
  if (!q.allFinite()) return false;
  Vector Y = Vector::Zero(s * n);
  ++problems_;
  if ((q.array() < 0).any()) {
    q.array() *= weights<Scalar>(n).array();
    if (!step.lcp->well_posed()) step.lcp->start_from(from.y.replicate(s, 1));
    MarchReport report;
    if (!step.lcp->solve(q, Y, 0, report)) return false;
    newton_ += report.count.newton;
    to.x.noalias() += step.drive * Y;
  }
  if (p.length <= shortest_) {
    shortest_ = p.length;
    well_posed_ = step.lcp->well_posed();
  }
  to.y = Y.tail(n);
  to.integral = from.integral + p.length * (s == 1 ? Y : Vector(0.75 * Y.head(n) + 0.25 * Y.tail(n)));
  // Where constraints are released or met y may be an impulse, of which Radau IIA makes 9/5.
  to.apart.resize(0), to.missed.resize(0);
  if constexpr (s == 2) {
    const double zero = no_sign * std::max(Y.maxCoeff(), from.y.maxCoeff());
    const auto acts = [zero](const auto& y) { return y.array() > zero; };
    const bool early = (acts(from.y) != acts(Y.head(n))).any(), inside = (acts(Y.head(n)) != acts(Y.tail(n))).any();
    if (early || inside) {
      TreeRow one;
      if (!advance(*euler_, p, from, one)) return false;
      // A switch may be anywhere between two stages, and half the step need not see it.
      Vector late = Vector::Zero(n);
      if (early) late += part_nodes[0] * (from.y - Y.head(n)).cwiseAbs();
      if (inside) late += (0.75 - part_nodes[0]) * (Y.head(n) - Y.tail(n)).cwiseAbs();
      to.missed = p.length * late;
      to.apart = (to.x - one.x).cwiseAbs() + 4.0 / 3 * step.drive.leftCols(n).cwiseAbs() * late;
    }
  }
  return true;
}

// Behind a breakpoint the state may jump: by a step so short that nothing else moves.
bool RadauSteps::take(const Part& p, const TreeRow& from, TreeRow& to) {
  if (!is_shortest(p)) return advance(*radau_, p, from, to);
  Part jump = p, rest = p;
  jump.length *= of_jump;
  rest.length -= jump.length;
  jump.to = rest.from = p.from + of_jump * (p.to - p.from);
  TreeRow behind;
  return advance(*euler_, jump, from, behind) && advance(*radau_, rest, behind, to);
}

std::string unsuited_to_radau_steps(const Scene& scene) {
  if (scene.boundary) return "the scene has boundary values";
  if (!scene.free_rows.empty()) return "the scene has free rows";
  if (has_impacts(scene) || !scene.cones.empty()) return "impacts and circles of friction have steps of their own";
  if (scene.constraints() > most_constraints) return "each length of a step has its own matrix of all constraints";
  if (scene.dynamics->modes()) return "a Kronecker sum is marched by weights";
  const SparseMatrix B = scene.dynamics->rates_of_inputs(scene.T / double(scene.steps())),
                     N = scene.dynamics->outputs();
  const Eigen::SparseMatrix<double, Eigen::RowMajor> rows = N;
  const Vector M = diagonal(scene.M);
  for (Index i = 0; i < M.size(); ++i)
    if (M[i] == 0 &&
        std::abs(rows.row(i).dot(B.col(i))) <= not_acting * rows.row(i).cwiseAbs().dot(B.col(i).cwiseAbs()))
      return "y acts on a higher derivative of w";
  return "";
}

}  // namespace bromwich
