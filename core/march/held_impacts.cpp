#include "core/march/held_impacts.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_states = 64;           ///< dense products with more cost as much as the series of a sparse A
constexpr double well_known = 1e-12;        ///< reciprocal condition of W_SS, at least
constexpr double rounding_of_step = 1e-12;  ///< residual of the problem, at most
constexpr double no_speed = 1e-11;          ///< of the largest terms of a speed: less is none

using Kind = ImpactRows::Kind;

}  // namespace

bool HeldImpacts::serves(const ImpactRows& rows) { return rows.states() <= most_states && rows.cones.empty(); }

HeldImpacts::HeldImpacts(const ImpactRows& rows, const ImpactFlow& flow, double h)
    : rows_(rows),
      h_(h),
      m_(rows.states()),
      n_(rows.constraints()),
      decay_(Matrix::Identity(m_, m_)),
      drive_(Matrix::Zero(m_, 3 * m_)),
      forced_(Matrix::Zero(m_, n_)),
      N_(rows.N),
      NA_(rows.NA),
      NB_(rows.NB.sparseView(0, 0)) {
  flow.advance(h, {}, decay_);
  flow.advance(h, {Matrix(rows.B), {}, {}}, forced_);
  for (Index k = 0; k < 3; ++k) {
    QuadraticColumns input;
    for (Matrix& c : input) c = Matrix::Zero(m_, m_);
    input[std::size_t(k)].setIdentity();
    Matrix driven = Matrix::Zero(m_, m_);
    flow.advance(h, input, driven);
    drive_.middleCols(k * m_, m_) = driven;
  }
  size_of_N_ = rows.N.cwiseAbs() * Vector::Ones(m_);
  for (const ImpactRows::Friction& f : rows.friction) {
    Slip& s = slips_.emplace_back(Slip{f.room, {}, {}, f.normals.empty(), false});
    for (const Index i : f.forces)
      if (const double by = rows.M(i, f.room); by > 0) s.speeds.push_back(i), s.by.push_back(by);
  }
  y_.resize(n_);
}

void HeldImpacts::hold(const std::vector<char>& closed, const std::vector<Index>& rows, const Matrix& W,
                       const Vector& y, const std::vector<Index>& held, const Matrix& back) {
  closed_ = closed, in_problem_ = rows, W_ = W, held_ = held, back_ = back;
  size_of_W_ = W.cwiseAbs().rowwise().sum().array() + 1;
  active_.clear(), gaps_.clear();
  is_active_.assign(rows.size(), 0);
  holds_ = true;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    is_active_[k] = y[rows[k]] > 0;
    if (is_active_[k]) active_.push_back(Index(k));
    if (rows_.is(rows[k], Kind::gap)) holds_ = holds_ && is_active_[k];  // others may open
  }
  for (Index i = 0; i < n_; ++i)
    if (rows_.is(i, Kind::gap) && !closed[std::size_t(i)]) gaps_.push_back(i);
  for (Slip& s : slips_) s.acts = std::binary_search(rows.begin(), rows.end(), s.room);
  if (!active_.empty()) {
    const Eigen::PartialPivLU<Matrix> lu(W(active_, active_));
    holds_ = holds_ && lu.rcond() > well_known;
    inverse_ = lu.inverse();
  }
  q_.resize(Index(rows.size())), w_ = z_ = q_;
  of_active_.resize(Index(active_.size()));
}

bool HeldImpacts::is_held(const std::vector<char>& closed, const Vector& y) const {
  if (!holds_ || closed != closed_) return false;
  for (std::size_t k = 0; k < in_problem_.size(); ++k)
    if ((y[in_problem_[k]] > 0) != (is_active_[k] != 0)) return false;
  return true;
}

// x_ at the end by f, and the parts of w and w' by f and g.
void HeldImpacts::set_sources(const SmoothSources& now) {
  for (Index k = 0; k < 3; ++k)
    for (Index i = 0; i < m_; ++i)
      if (const double c = now.f(i, k); c != 0) x_.noalias() += c * drive_.col(k * m_ + i);
  g_end_ = now.g.col(0) + h_ * (now.g.col(1) + h_ * now.g.col(2));
  rate_end_ = now.g.col(1) + 2 * h_ * now.g.col(2);
  f_ = now.f.col(0) + h_ * (now.f.col(1) + h_ * now.f.col(2));
  rate_end_.noalias() += N_ * f_;
  slope_at_begin_ = now.g.col(1);
  f_ = now.f.col(0);
  slope_at_begin_.noalias() += N_ * f_;
}

// z, with w without forces. False: other rows have forces.
bool HeldImpacts::solve(const SmoothSources& now, double& residual) {
  double unit = 1e-290;
  for (Index k = 0; k < q_.size(); ++k) {
    const Index i = in_problem_[std::size_t(k)];
    switch (rows_.kind[std::size_t(i)]) {
      case Kind::gap:
        q_[k] = slope_[i];
        break;
      case Kind::speed:
        q_[k] = end_[i];
        break;
      case Kind::room:
        q_[k] = h_ * (now.g(i, 0) + h_ * (now.g(i, 1) / 2 + h_ * now.g(i, 2) / 3));
        break;
      case Kind::spring:
        q_[k] = (begin_[i] + end_[i]) / 2;
    }
    unit = std::max(unit, std::abs(q_[k]));
  }
  const Index active = of_active_.size();
  z_.setZero();
  w_ = q_;
  if (active > 0) {
    for (Index a = 0; a < active; ++a) of_active_[a] = -q_[active_[std::size_t(a)]];
    q_.head(active).noalias() = inverse_ * of_active_;  // not needed any more
    for (Index a = 0; a < active; ++a) {
      const double z = q_[a];
      if (!(z > 0)) return false;
      z_[active_[std::size_t(a)]] = z;
      unit = std::max(unit, z);
    }
    w_.noalias() += W_ * z_;
  }
  double largest = 0;
  for (Index k = 0; k < w_.size(); ++k) {
    if (is_active_[std::size_t(k)])
      largest = std::max(largest, std::abs(w_[k]) / size_of_W_[k]);
    else if (!(w_[k] >= 0))
      return false;
  }
  if (!(largest <= rounding_of_step * unit)) return false;
  residual = std::max(residual, largest / unit);
  return true;
}

// Gaps whose cubics have all coefficients of Bernstein's form above 0 stay open.
bool HeldImpacts::stays(double largest_x, const SmoothSources& now) const {
  for (const Index i : gaps_) {
    const double from = std::max(begin_[i], 0.0);
    if (!(from + h_ / 3 * slope_at_begin_[i] >= 0 && end_[i] - h_ / 3 * slope_[i] >= 0 && end_[i] >= 0)) return false;
  }
  for (const Index i : in_problem_) {
    if (!rows_.is(i, Kind::speed)) continue;
    const double rest = no_speed * (size_of_N_[i] * largest_x + std::abs(now.g(i, 0)));
    if (std::abs(begin_[i]) > rest && !(std::copysign(1.0, begin_[i]) * end_[i] > rest)) return false;
  }
  return true;
}

double HeldImpacts::slip_of(const Slip& s, const Vector& w) const {
  double slip = 0;
  for (std::size_t k = 0; k < s.speeds.size(); ++k) slip = std::max(slip, -w[s.speeds[k]] / s.by[k]);
  return slip;
}

bool HeldImpacts::step(const SmoothSources& now, Vector& x, Vector& y, Vector& integral, double& residual) {
  for (const Slip& s : slips_)
    if (s.given && s.acts != (now.g.row(s.room).cwiseAbs().sum() != 0)) return false;
  x_.noalias() = decay_ * x;
  set_sources(now);
  begin_ = now.g.col(0);
  begin_.noalias() += N_ * x;
  slope_at_begin_.noalias() += NA_ * x;
  const auto look_at_end = [&] {
    end_ = g_end_, slope_ = rate_end_;
    end_.noalias() += N_ * x_;
    slope_.noalias() += NA_ * x_;
  };
  look_at_end();
  double of_step = residual;
  if (!solve(now, of_step)) return false;
  y_.setZero();
  for (std::size_t k = 0; k < in_problem_.size(); ++k) {
    const Index i = in_problem_[k];
    y_[i] = rows_.is_force[std::size_t(i)] ? z_[Index(k)] / h_ : 0;
  }
  if (!active_.empty()) {
    x_.noalias() += forced_ * y_;
    look_at_end();
    slope_.noalias() += NB_ * y_;
    slope_at_begin_.noalias() += NB_ * y_;
  }
  if (!stays(x.cwiseAbs().maxCoeff(), now)) return false;
  for (std::size_t k = 0; k < in_problem_.size(); ++k)
    if (const Index i = in_problem_[k]; !rows_.is_force[std::size_t(i)]) y_[i] = z_[Index(k)];
  for (const Slip& s : slips_)
    if (!s.acts) y_[s.room] = slip_of(s, end_);
  residual = of_step;
  for (Index i = 0; i < n_; ++i)
    if (rows_.is_force[std::size_t(i)]) integral[i] += h_ * y_[i];
  for (const Slip& s : slips_) integral[s.room] += h_ / 2 * (slip_of(s, begin_) + y_[s.room]);
  x = x_;
  if (!held_.empty()) {
    off_.resize(Index(held_.size()));
    for (Index k = 0; k < off_.size(); ++k) off_[k] = end_[held_[std::size_t(k)]];
    x.noalias() -= back_ * off_;
  }
  y = y_;
  return true;
}

}  // namespace bromwich
