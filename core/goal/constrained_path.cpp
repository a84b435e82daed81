#include "core/goal/constrained_path.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/lcp/active_set.hpp"
#include "core/seam/backend.hpp"

#include <Eigen/SparseLU>

#include <limits>

namespace bromwich {
namespace {

const Scene& with_port(const Scene& scene) {
  if (!scene.port)
    throw Error("method", "goal needs a port-Hamiltonian scene and " + scene.name + " is none",
                "state it by E, J, R, Q, B and u, or use another method");
  if (!scene.free_rows.empty()) throw Error("method", "goal does not support free rows", "use method march");
  const LcpClass found = selection_class(scene.M, scene.lcp_class);
  if (!has_one_solution(found))
    throw Error("method", text("goal needs M of class P and found class %s", to_string(found)), "use method march");
  return scene;
}

/// The data shared by the steps of one size. With theta h the part of the step up to the point e,
/// e = S^{-1} (a + theta h f) + V y,  V = theta h S^{-1} B,  y in SOL(M + N V, N S^{-1} (a + theta h f) + g).
struct SizedStep {
  SizedStep(const ConstrainedSystem& system, double part) : part(part) {
    const SparseMatrix& A = system.port().A();
    SparseMatrix I(A.rows(), A.cols());
    I.setIdentity();
    SparseMatrix S = I - part * A;
    S.makeCompressed();
    lu.compute(S);
    if (lu.info() != Eigen::Success)
      throw Error("step", text("I - %g A is singular", part), "take another number of steps");
    V = part * lu.solve(Matrix(system.B()));
    const Matrix W = system.M() + system.N() * V;
    lcp = std::make_unique<ActiveSetLcp>(W, classify(W));
  }

  double part;
  Eigen::SparseLU<SparseMatrix> lu;
  Matrix V;
  std::unique_ptr<ActiveSetLcp> lcp;
};

}  // namespace

ConstrainedSystem::ConstrainedSystem(const Scene& scene)
    : scene_(with_port(scene)),
      port_(*scene.port, scene.T, PortSystem::Form::state_space),
      B_(scene.dynamics->inputs()),
      N_(scene.dynamics->outputs()),
      M_(to_dense(scene.M)),
      port_matrix_(port_.energy_matrix() * Matrix(B_)) {}

Vector ConstrainedSystem::g(double t) const {
  Vector value = Vector::Zero(constraints());
  if (scene_.g) scene_.g(t, value);
  return value;
}

Index ConstrainedSystem::mode_of(const Eigen::Ref<const Vector>& y) {
  const Index n = constraints();
  const std::vector<Index> S = support_of(y);
  const auto known = numbers_.find(S);
  if (known != numbers_.end()) return known->second;
  Matrix K = Matrix::Zero(n, n);
  if (!S.empty()) K(S, S) = Matrix(M_(S, S).inverse());
  const SparseMatrix sparse_K = K.sparseView(), KN = sparse_K * N_, feedback = B_ * KN;
  StepMatrix A = port_.step_matrix(StepScheme::euler);
  if (auto* dense = std::get_if<Matrix>(&A))
    *dense -= Matrix(feedback);
  else
    A = SparseMatrix(std::get<SparseMatrix>(A) - feedback);
  modes_.push_back({A, K, -K * Matrix(N_)});
  return numbers_[S] = modes() - 1;
}

double constraint_point(StepScheme scheme) {
  if (scheme == StepScheme::exponential)
    throw Error("scheme", "exponential steps have no complementarity within them", "use euler or midpoint");
  return scheme == StepScheme::euler ? 1 : 0.5;
}

ConstrainedSolution solve_constrained(ConstrainedSystem& system, StepScheme scheme, const Vector& t, const Vector& x0) {
  const double theta = constraint_point(scheme);
  const Index M = t.size() - 1, n = system.constraints();
  const StepSizes sizes = group_steps(t);
  std::vector<std::unique_ptr<SizedStep>> steps;
  for (const double h : sizes.sizes) steps.push_back(std::make_unique<SizedStep>(system, theta * h));
  const RowMatrix sources = step_sources(system.port(), scheme, t, x0);  // h f
  ConstrainedSolution s{sources, {RowMatrix::Zero(M, n), std::vector<Index>(std::size_t(M))}, -1, false};
  Vector y = Vector::Zero(n), e, a = x0;
  for (Index i = 0; i < M; ++i) {
    SizedStep& step = *steps[std::size_t(sizes.of[std::size_t(i)])];
    const double t_e = theta == 1 ? t[i + 1] : t[i] + theta * (t[i + 1] - t[i]);
    e = step.lu.solve(Vector(a + theta * sources.row(i + 1).transpose()));
    step.lcp->start_from(y);
    const Vector q = system.N() * e + system.g(t_e);
    s.nonfinite = !q.allFinite();
    const LcpOutcome outcome = s.nonfinite ? LcpOutcome{} : step.lcp->solve(q, y);
    if (!outcome.solved) {
      s.unsolved = i + 1;
      s.infeasible = outcome.infeasible;
      s.x.bottomRows(M - i).setConstant(std::numeric_limits<double>::quiet_NaN());
      s.steps.y.bottomRows(M - i).setConstant(std::numeric_limits<double>::quiet_NaN());
      return s;
    }
    e += step.V * y;
    a = a + (e - a) / theta;
    s.x.row(i + 1) = a.transpose();
    s.steps.y.row(i) = y.transpose();
    s.steps.modes[std::size_t(i)] = system.mode_of(y);
  }
  return s;
}

ConstraintValues constraints_at(ConstrainedSystem& system, Backend& backend, const Vector& times, const RowMatrix& e) {
  const Index rows = e.rows(), n = system.constraints();
  RowMatrix q = e * system.N().transpose();
  for (Index i = 0; i < rows; ++i) q.row(i) += system.g(times[i]).transpose();
  const auto r = backend.array(rows, n), zero = backend.array(rows, n), y = backend.array(rows, n);
  backend.upload(q, *r);
  const LcpReport report = backend.lcp(system.scene().M, LcpClass::P, rows)->solve(*r, *zero, *y, 0, 0);
  if (report.count.unsolved > 0)
    throw Error("complementarity", text("%ld problems stayed unsolved", report.count.unsolved), "use method march");
  ConstraintValues found{RowMatrix(rows, n), std::vector<Index>(std::size_t(rows))};
  backend.download(*y, found.y);
  for (Index i = 0; i < rows; ++i) found.modes[std::size_t(i)] = system.mode_of(found.y.row(i).transpose());
  return found;
}

ConstraintValues constraints_within(ConstrainedSystem& system, Backend& backend, const Trajectory& path, double s) {
  const Index M = path.steps();
  const Vector left = path.t.head(M), right = path.t.tail(M);
  const Vector times = s == 1 ? right : Vector(left + s * (right - left));
  return constraints_at(system, backend, times, states_within(path, s));
}

ConstraintPath constraints_along(ConstrainedSystem& system, Backend& backend, const Trajectory& path) {
  ConstraintPath constraints{&system, {}};
  for (const double s : quadrature(path.scheme).nodes)
    constraints.nodes.push_back(constraints_within(system, backend, path, s));
  return constraints;
}

ConstrainedChain constrained_chain(const ConstrainedSystem& system, StepScheme scheme, const Vector& t,
                                   const Vector& x0, const ConstraintValues& steps) {
  const double theta = constraint_point(scheme);
  const StepSizes sizes = group_steps(t);
  ConstrainedChain chain{{}, step_sources(system.port(), scheme, t, x0)};
  if (system.port().memory_limit > 0) chain.problem.memory_limit = system.port().memory_limit;
  std::map<std::pair<Index, Index>, Index> kinds;
  for (std::size_t i = 0; i < steps.modes.size(); ++i) {
    const auto [at, fresh] = kinds.insert({{sizes.of[i], steps.modes[i]}, Index(chain.problem.maps.size())});
    const ActiveMode& mode = system.mode(steps.modes[i]);
    if (fresh) chain.problem.maps.push_back(step_map(scheme, mode.A, sizes.sizes[sizes.of[i]]));
    chain.problem.map_of.push_back(at->second);
    const Index row = Index(i);
    const double h = t[row + 1] - t[row], t_e = theta == 1 ? t[row + 1] : t[row] + theta * h;
    chain.d.row(row + 1) -= h * (system.B() * (mode.K * system.g(t_e))).transpose();
  }
  return chain;
}

Vector constraint_supply(const Trajectory& path) {
  const ConstraintPath& c = *path.constraints;
  const Index M = path.steps();
  const Vector h = path.lengths();
  const auto& [nodes, weights] = quadrature(path.scheme);
  Vector supply = Vector::Zero(M);
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    const RowMatrix outputs = states_within(path, nodes[q]) * c.system->port_matrix();
    supply += weights[q] * h.cwiseProduct(outputs.cwiseProduct(c.nodes[q].y).rowwise().sum());
  }
  return supply;
}

void add_constraint_supply(const Trajectory& path, const Vector& w, RowMatrix& gradient) {
  const ConstraintPath& c = *path.constraints;
  const auto& [nodes, weights] = quadrature(path.scheme);
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    const RowMatrix outputs = states_within(path, nodes[q]) * c.system->port_matrix();
    RowMatrix g = c.nodes[q].y * c.system->port_matrix().transpose();
    for (Index i = 0; i < path.steps(); ++i) {
      g.row(i) += outputs.row(i) * c.system->mode(c.nodes[q].modes[std::size_t(i)]).slope;
      g.row(i) *= weights[q] * w[i] * path.h(i);
    }
    add_within(path, nodes[q], g, gradient);
  }
}

}  // namespace bromwich
