// Active sets of a SwitchedTape with singular M_SS, and what changes of the data have to keep there.

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "derivatives/switched_tape.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <iterator>

namespace bromwich {

namespace {

// Vectors v (n x k, zero outside S) with first v_S = 0 and second v_S = 0.
Matrix common_kernel(const Matrix& first, const Matrix& second, const std::vector<Index>& S, Index n) {
  constexpr double zero = 1e-12;
  const auto scaled = [](const Matrix& a) -> Matrix {
    const double size = a.size() > 0 ? a.cwiseAbs().maxCoeff() : 0;
    return size > 0 ? Matrix(a / size) : a;
  };
  Matrix both(first.rows() + second.rows(), first.cols());
  both << scaled(first), scaled(second);
  Eigen::FullPivLU<Matrix> lu(both);
  lu.setThreshold(zero);
  Matrix all = Matrix::Zero(n, lu.dimensionOfKernel());
  if (all.cols() > 0) all(S, Eigen::all) = lu.kernel();
  return all;
}

}  // namespace

// v with M_SS v = 0 and B_S v = 0, u with u^T M_SS = 0 and u^T N_S = 0.
void SwitchedTape::find_ambiguity(const Rows& of) {
  const auto& [regime, together] = of;
  if (together.empty() || ambiguities_.contains(of)) return;
  const SystemMatrices& s = regime->system;
  const Matrix M = s.M(together, together);
  ambiguities_[of] = {common_kernel(M, s.B(Eigen::all, together), together, n_),
                      common_kernel(M.transpose(), s.N(together, Eigen::all).transpose(), together, n_)};
}

// The left kernel of M_SS. A change of M that does not keep it turns constraints on the state, or a jump of y, into
// fast motions, which are stable on one side only. One that does keeps the rank of M_SS.
void SwitchedTape::find_singular(const Rows& of) {
  const std::vector<Index>& S = of.second;
  if (S.empty() || singular_.contains(of)) return;
  const Matrix M = of.first->system.M(S, S), none(0, Index(S.size()));
  singular_[of] = common_kernel(M.transpose(), none, S, n_);
}

// The sets that a jump of y may pass through.
void SwitchedTape::find_singular_between(const Rows& before, const std::vector<Index>& to, Index component) {
  const auto& [regime, from] = before;
  constexpr std::size_t most_looked_at = 8;
  std::vector<Index> both, either, changing;
  std::set_intersection(from.begin(), from.end(), to.begin(), to.end(), std::back_inserter(both));
  std::set_union(from.begin(), from.end(), to.begin(), to.end(), std::back_inserter(either));
  if (const auto at = std::lower_bound(either.begin(), either.end(), component); at == either.end() || *at != component)
    either.insert(at, component);
  std::erase(both, component);
  std::set_difference(either.begin(), either.end(), both.begin(), both.end(), std::back_inserter(changing));
  if (changing.size() > most_looked_at) {  // no change at all
    singular_[{regime, either}] = Matrix::Identity(n_, n_)(Eigen::all, either);
    return;
  }
  for (std::size_t chosen = 0; chosen < std::size_t(1) << changing.size(); ++chosen) {
    std::vector<Index> S = both;
    for (std::size_t i = 0; i < changing.size(); ++i)
      if (chosen >> i & 1) S.push_back(changing[i]);
    std::sort(S.begin(), S.end());
    find_singular({regime, S});
  }
}

void SwitchedTape::judge_M() {
  for (const auto& [active, mode] : modes_) {
    find_ambiguity(active);
    if (mode.rows.constraints.x.rows() == 0) continue;
    find_singular(active);
    if (without_M_.empty())
      without_M_ = "M_SS is singular on an active set, and a change of M can act from one side only";
  }
  for (std::size_t k = 1; k < parts_.size(); ++k) {
    if (parts_[k].change < 0) continue;
    const Switch& s = switches_[std::size_t(parts_[k].change)];
    if (!s.moves || n_ == 0) continue;
    if (((s.y_after - s.y_before).cwiseAbs() - 1e-6 * pieces_.back().most_y).maxCoeff() <= 0) continue;
    const Mode &before = *piece_of(parts_[k - 1]).mode, &after = *piece_of(parts_[k]).mode;
    if (before.regime != after.regime) continue;  // M of each regime says what y is
    find_singular_between({before.regime, before.rows.active}, after.rows.active, s.component);
    if (without_M_.empty())
      without_M_ = text("y jumps at the switch at t = %.6g, and a change of M removes the jump", s.t);
  }
}

// Where y is not unique, the change of x must not depend on the one that is taken. Where M_SS is singular, a change of
// M has to leave its left kernel.
void SwitchedTape::check_ambiguities(const ChangeInModes& change_in) const {
  const auto moves = [](const Matrix& change, const Matrix& by) {
    if (change.size() == 0 || by.cols() == 0) return false;
    return ((change * by).cwiseAbs() - 1e-9 * change.cwiseAbs() * by.cwiseAbs()).maxCoeff() > 0;
  };
  const auto within = [this](const DataChange& c, const std::vector<Index>& S) {  // y is zero elsewhere
    Matrix change = c.M.size() > 0 ? Matrix(Matrix::Zero(n_, n_)) : Matrix();
    if (c.M.size() > 0) change(S, S) = c.M(S, S);
    return change;
  };
  for (const auto& [together, a] : ambiguities_) {
    const DataChange& c = change_in(together.first->modes);
    const Matrix M = within(c, together.second);
    if (moves(c.B, a.right) || moves(M, a.right) || moves(M.transpose(), a.left) || moves(c.N.transpose(), a.left))
      throw Error("derivative",
                  "not differentiable here: y is not unique, and the change makes x depend on which y it is",
                  "change equal constraints alike, or leave out one of them");
  }
  for (const auto& [rows, kernel] : singular_) {
    const auto& [regime, S] = rows;
    if (moves(within(change_in(regime->modes), S).transpose(), kernel))
      throw Error("M", without_M_, "ask for derivatives with respect to other data");
  }
}

// Bounces that are too low to be seen do not depend on e. Where e = 0, bounces begin with it: it acts from one side.
Matrix SwitchedTape::by_restitution(const Mode& mode, const EventImpulse& p, const JetValues& before) {
  const Vector &e = mode.system().restitution, velocity = evaluate(rates_of_w(mode.system()), before);
  Matrix by = mode.rows.velocities * velocity.asDiagonal();
  for (Index i = 0; i < n_; ++i) {
    if (p.e.size() > 0 && p.e[i] > 0) continue;
    const bool strikes = p.p[i] > 0 && !by.col(i).isZero(0);
    if (strikes && (e.size() == 0 || e[i] == 0)) inelastic_.push_back(i);
    by.col(i).setZero();
  }
  return by;
}

// Bounces that begin with e do so on one side only.
void SwitchedTape::check_restitution(const ChangeInModes& change_in) const {
  for (const auto& [modes, regime] : regimes_)
    for (const Index i : inelastic_)
      if (const Vector& by = change_in(modes).restitution; by.size() > 0 && by[i] != 0)
        throw Error("derivative",
                    text("not differentiable here: constraint %ld strikes without rebound, and bounces with any change",
                         long(i)),
                    "differentiate by the restitution of scenes that have it");
}

// Constraints on the state that are derivatives of w (a rigid contact) need N B = 0 there; changes have to keep it.
void SwitchedTape::check_structure(const ChangeInModes& change_in) const {
  check_ambiguities(change_in);
  check_restitution(change_in);
  for (const auto& [of, mode] : modes_) {
    const DataChange& c = change_in(mode.regime->modes);
    const std::vector<Index>& active = mode.rows.active;
    const Jet& rows = mode.rows.constraints;
    if (rows.x.rows() == 0 || !(rows.f.array() != 0).any()) continue;
    Matrix change = Matrix::Zero(rows.x.rows(), Index(active.size())), terms = change;
    if (c.B.size() > 0) {
      const Matrix dB = c.B(Eigen::all, active);
      change += rows.f * dB;
      terms += rows.f.cwiseAbs() * dB.cwiseAbs();
    }
    if (c.N.size() > 0) {
      const Matrix dg = rows.dg * c.N, B = mode.system().B(Eigen::all, active);
      change += dg * B;
      terms += rows.dg.cwiseAbs() * c.N.cwiseAbs() * B.cwiseAbs();
    }
    if (((change.cwiseAbs() - 1e-9 * terms).array() > 0).any())
      throw Error("derivative", "not differentiable here: the change makes N B nonzero, where y is a contact force",
                  "change B and N together so that N B stays 0");
  }
}

}  // namespace bromwich
