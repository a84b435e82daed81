#include "core/kernel/states.hpp"

#include "core/base/error.hpp"
#include "core/kernel/closed_loop.hpp"
#include "core/kernel/kernel.hpp"
#include "core/kernel/rough_response.hpp"
#include "core/kernel/sparse_kernel.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

namespace bromwich {

namespace {

// Σ_d c_p F_d(z_p) u_{j-d} over the lags of one window, back to u_0 at most; u_0 has the weights S.
ComplexMatrix past_inputs(const LagWindow& window, const RowMatrix& u, Index j) {
  ComplexMatrix sums = ComplexMatrix::Zero(window.contour.nodes.size(), u.cols());
  const Index last = std::min(window.last, j - 1);
  for (Index d = window.first; d <= last; ++d)
    sums.noalias() += window.F.row(d - window.first).transpose() * u.row(j - d).cast<Complex>();
  if (window.first <= j && j <= window.last)
    sums.noalias() += window.S.row(j - window.first).transpose() * u.row(0).cast<Complex>();
  return sums;
}

// The state at one time point of a Kronecker sum, in modes of the `along` direction: row l is the grid line of mode l.
RowMatrix lines_at(const DiscreteProblem& p, const std::vector<LagWindow>& windows, const RowMatrix& u, Index j) {
  const KroneckerDynamics& d = *p.modes();
  const Vector mu = d.face_eigenvalues();
  RowMatrix lines = RowMatrix::Zero(mu.size(), d.across.points);
  std::vector<Vector> inputs;
  for (Index f = 0; f < d.families(); ++f) inputs.push_back(d.input(f));
  for (const LagWindow& window : windows) {
    if (window.first > j) break;
    const ComplexMatrix sums = past_inputs(window, u, j);
    for (Index l = 0; l < mu.size(); ++l)
      for (Index q = 0; q < sums.rows(); ++q)
        // zI - across is symmetric: the solution on a grid line with right-hand side b is its Green's row.
        lines.row(l) +=
            (sums(q, l) * green_row(d.across, inputs[std::size_t(d.family(l))], window.contour.nodes[q] - mu[l]))
                .real()
                .transpose();
  }
  return lines;
}

// The response to f on rough steps (core/kernel/rough_response.hpp) at chosen time points, in modes of both directions.
std::map<Index, RowMatrix> rough_states(const DiscreteProblem& p, const std::vector<Index>& rows) {
  std::map<Index, RowMatrix> at;
  if (!p.rough_response || rows.empty()) return at;
  const std::set<Index> wanted(rows.begin(), rows.end());
  each_rough_state(p, std::min(p.J, *wanted.rbegin()), [&](Index j, const RowMatrix& x) {
    if (wanted.count(j) > 0) at[j] = x.transpose();
  });
  return at;
}

Matrix kronecker_states_at(const DiscreteProblem& p, const RowMatrix& y, const std::vector<Index>& rows) {
  const KroneckerDynamics& d = *p.modes();
  const RowMatrix u =
      transformed(p.backend, p.face(), p.drive() ? RowMatrix(y + p.drive()->table()) : y, Way::to_modes);
  const RowMatrix x0 = x0_in_modes(p.backend, d, p.scene.x0, true);
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  const std::vector<LagWindow> windows = lag_windows(*contour_parameters(0), p.h, p.J);
  const std::map<Index, RowMatrix> rough = rough_states(p, rows);
  Matrix x(p.scene.states(), Index(rows.size()));
  for (std::size_t c = 0; c < rows.size(); ++c) {
    const Index j = rows[c];
    if (j == 0) {
      x.col(Index(c)) = p.scene.x0;
      continue;
    }
    // e^{A t} x0 is diagonal in both directions.
    RowMatrix free = x0;
    for (Index l = 0; l < mu.size(); ++l) free.row(l).array() *= (p.t[j] * (nu.transpose().array() + mu[l])).exp();
    if (const auto more = rough.find(j); more != rough.end()) free += more->second;
    const RowMatrix lines = from_line_modes(p.backend, d.across, free) + lines_at(p, windows, u, j);
    const RowMatrix grid = transformed(p.backend, p.face(), lines.transpose(), Way::to_points).transpose();
    x.col(Index(c)) = Eigen::Map<const Vector>(grid.data(), x.rows());  // of two faces: the view from the first one
  }
  return x;
}

// What enters the state at both ends of step j, with y and f linear on the step.
class Inputs {
 public:
  explicit Inputs(const DiscreteProblem& p) : p_(p), B_(p.scene.dynamics->inputs()) {}

  std::pair<Vector, Vector> at(Index j, const RowMatrix& y) const {
    Vector before = B_ * y.row(j - 1).transpose(), now = B_ * y.row(j).transpose();
    if (p_.f.size() == 0) return {std::move(before), std::move(now)};
    Matrix f(p_.f.cols(), 2);
    f << p_.f.row(j - 1), p_.f.row(j);
    const RoughStep* rough = p_.sources ? p_.sources->at(j) : nullptr;
    if (rough)
      if (const Matrix ends = ends_by_moments(p_, *rough); ends.size() > 0) f = ends;
    return {before + entering(f.col(0)), now + entering(f.col(1))};
  }

 private:
  Vector entering(const Vector& f) const {
    if (p_.scene.f_entry == SourceEntry::through_B) return B_ * f;
    return p_.scene.f_entry == SourceEntry::through_F ? Vector(p_.scene.F * f) : f;
  }

  const DiscreteProblem& p_;
  SparseMatrix B_;
};

Matrix stepped_states_at(const SteppedStates& steps, const DiscreteProblem& p, const RowMatrix& y,
                         const std::vector<Index>& rows) {
  Matrix x(p.scene.states(), Index(rows.size()));
  const Index last = rows.empty() ? 0 : *std::max_element(rows.begin(), rows.end());
  steps.each(y, last, [&](Index j, const Vector& at) {
    for (std::size_t c = 0; c < rows.size(); ++c)
      if (rows[c] == j) x.col(Index(c)) = at;
  });
  return x;
}

}  // namespace

Matrix states_at_rows(const DiscreteProblem& p, const RowMatrix& y, const std::vector<Index>& rows,
                      const StepDefects* defects) {
  if (p.modes()) return kronecker_states_at(p, y, rows);
  if (p.small_state()) return states_of(p, Rule::exponential, y, defects).x(rows, Eigen::all).transpose();
  if (const auto steps = SteppedStates::make(p)) return stepped_states_at(*steps, p, y, rows);
  throw Error("dynamics", "whole states of supplied dynamics are not computed afterwards",
              "ask for components with Options::states when solving");
}

StepFactors step_factors(const LagWindow& window, double h) {
  return {exponential_factors(window.contour, h, 1, 1).row(0).transpose(), window.S.row(1).transpose(),
          window.F.row(0).transpose()};
}

// e^x = 2 Re Σ_p alpha_p / (x - theta_p) to 2.5e-14 for x <= 0: M. Pusa, Nucl. Sci. Eng. 172 (2012), degree 14, without
// its value at infinity, 1.8e-14. (e^x - 1)/x has the residues alpha_p / theta_p, and so on.
StepFactors rational_step_factors(double h, ComplexVector& nodes) {
  ComplexVector theta(7), alpha(7);
  theta << Complex(-8.8977731864688888199, 16.630982619902085304),
      Complex(-3.7032750494234480603, 13.656371871483268171), Complex(-0.2087586382501301251, 10.991260561901260913),
      Complex(3.9933697105785685194, 6.0048316422350373178), Complex(5.0893450605806245066, 3.5888240290270065102),
      Complex(5.6231425727459771248, 1.1940690463439669766), Complex(2.2697838292311127097, 8.4617379730402214019);
  alpha << Complex(-7.1542880635890672853e-5, 1.4361043349541300111e-4),
      Complex(9.4390253107361688779e-3, -1.7184791958483017511e-2),
      Complex(-3.7636003878226968717e-1, 3.3518347029450104214e-1),
      Complex(-23.498232091082701191, -5.8083591297142074004), Complex(46.933274488831293047, 45.643649768827760791),
      Complex(-27.875161940145646468, -102.14733999056451434), Complex(4.8071120988325088907, -1.3209793837428723881);
  nodes = theta / h;
  const ComplexVector decay = -2 / h * alpha;
  const ComplexVector right = decay.cwiseQuotient(h * nodes.cwiseProduct(nodes));
  return {decay, decay.cwiseQuotient(nodes) - right, right};
}

std::unique_ptr<const SteppedStates> SteppedStates::make(const DiscreteProblem& p) {
  const SparseDynamics* matrices = p.scene.dynamics->matrices();
  if (!matrices) return nullptr;
  std::unique_ptr<SteppedStates> steps(new SteppedStates(p, *matrices));
  if (steps->try_poles(*matrices)) return steps;
  const ContourChoices choices = contours_to_try(p.shared->spectrum(), p.scene.T);
  for (const double half_angle : choices.half_angles)
    if (steps->try_contour(*contour_parameters(half_angle), choices.shift)) return steps;
  return nullptr;
}

bool SteppedStates::try_poles(const SparseDynamics& d) {
  const auto symmetric = [](const SparseMatrix& matrix) {
    return matrix.size() == 0 || SparseMatrix(matrix - SparseMatrix(matrix.transpose())).norm() == 0;
  };
  const Spectrum& spectrum = p_.shared->spectrum();
  if (!spectrum.real_negative() || spectrum.bound || !symmetric(d.A) || !symmetric(d.E)) return false;
  ComplexVector nodes;
  factors_ = rational_step_factors(p_.h, nodes);
  solves_ = shifts_.factorize(nodes, p_.backend);
  return solves_ != nullptr;
}

// Takes this contour if another one gives the same e^{hA} v.
bool SteppedStates::try_contour(const ContourParameters& parameters, double shift) {
  const LagWindow window = lag_windows(parameters, p_.h, 1, shift).front();
  Contour other = window_contour(parameters, 0.8 * p_.h);
  other.nodes.array() += shift;
  const SparseMatrix B = p_.scene.dynamics->inputs(), N = p_.scene.dynamics->outputs();
  const Vector driven = B * Vector::Ones(B.cols()) + N.transpose() * Vector::Ones(N.rows());
  const auto decayed = [&](const SparseShifts::Factors& solves, const Contour& contour) {
    const ComplexVector factors = contour.weights.array() * (p_.h * contour.nodes.array()).exp();
    const ComplexMatrix columns = driven.cast<Complex>() * factors.transpose();
    return Vector(solves.solve(columns, false, p_.backend).real().rowwise().sum());
  };
  solves_ = shifts_.factorize(window.contour.nodes, p_.backend);
  const auto others = solves_ ? shifts_.factorize(other.nodes, p_.backend) : nullptr;
  if (!others) return false;
  const Vector value = decayed(*solves_, window.contour);
  const double apart = (value - decayed(*others, other)).norm();
  if (!(apart <= accepted_contour_error * (driven.norm() + value.norm()))) return false;
  factors_ = step_factors(window, p_.h);
  return true;
}

Vector SteppedStates::advance(const Vector& x, const Vector& before, const Vector& now) const {
  const Vector decayed = p_.scene.dynamics->times_mass(x);
  ComplexMatrix given(x.size(), factors_.decay.size());
  for (Index p = 0; p < given.cols(); ++p)
    given.col(p) = factors_.decay[p] * decayed + factors_.left[p] * before + factors_.right[p] * now;
  return solves_->solve(given, false, p_.backend).real().rowwise().sum();
}

void SteppedStates::each(const RowMatrix& y, Index last,
                         const std::function<void(Index j, const Vector& x)>& visit) const {
  const Inputs inputs(p_);
  Vector x = p_.scene.x0;
  visit(0, x);
  for (Index j = 1; j <= last; ++j) {
    const auto [before, now] = inputs.at(j, y);
    x = advance(x, before, now);
    visit(j, x);
  }
}

const std::vector<Index>& RecordedStates::in_kernel() {
  static const std::vector<Index> none;
  if (!steps_) steps_ = Index(p_.components.size()) > most_in_kernel ? SteppedStates::make(p_) : nullptr;
  return *steps_ ? none : p_.components;
}

std::optional<RowMatrix> RecordedStates::stepped(const RowMatrix& y) {
  if (in_kernel().size() == p_.components.size()) return std::nullopt;
  RowMatrix rows(p_.J + 1, Index(p_.components.size()));
  (*steps_)->each(y, p_.J, [&](Index j, const Vector& x) { rows.row(j) = x(p_.components).transpose(); });
  return rows;
}

}  // namespace bromwich
