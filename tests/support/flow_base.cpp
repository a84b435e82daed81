#include "tests/support/flow_base.hpp"

#include "tests/support/lemke.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace bromwich::oracle {

const double radau_nodes[3] = {(4 - std::sqrt(6.0)) / 10, (4 + std::sqrt(6.0)) / 10, 1};

ScaledLu::ScaledLu(Matrix K) : rows_(Vector::Ones(K.rows())), columns_(rows_) {
  for (int sweep = 0; sweep < 8; ++sweep) {
    for (Index i = 0; i < K.rows(); ++i) {
      const double size = K.row(i).cwiseAbs().maxCoeff(), r = size > 0 ? 1 / std::sqrt(size) : 1;
      K.row(i) *= r, rows_[i] *= r;
    }
    for (Index i = 0; i < K.rows(); ++i) {
      const double size = K.col(i).cwiseAbs().maxCoeff(), c = size > 0 ? 1 / std::sqrt(size) : 1;
      K.col(i) *= c, columns_[i] *= c;
    }
  }
  lu_.compute(K);
}

Vector ScaledLu::solve(const Vector& b) const {
  const Vector scaled = rows_.asDiagonal() * b, z = lu_.solve(scaled);
  return columns_.asDiagonal() * z;
}

FlowBase::FlowBase(const EngineeringScene& s, const Vector& x0, double T, double resistance)
    : s_(s), m_(s.states()), n_(s.constraints()), x_(x0) {
  flow_.T = T;
  unit_ = T;
  for (const TimeSignal& signal : s.signals) {
    if (signal.kind == TimeSignal::Kind::sine && signal.a != 0)
      unit_ = std::min(unit_, 2 * std::numbers::pi / std::abs(signal.a));
    if (signal.kind == TimeSignal::Kind::pulse) unit_ = std::min(unit_, signal.b);
  }
  flow_.unit = unit_;
  flow_.largest = x0.cwiseAbs();
  for (Index i = 0; i < m_; ++i) {
    const double reach = s.weight[i] * s.F.row(i).cwiseAbs().sum() * std::min(unit_, 1 / std::abs(s.A(i, i)));
    flow_.driven = std::max(flow_.driven, reach);
  }
  for (Index j = 0; j < n_; ++j) {  // g moves N x
    const double seen = s.N.row(j).transpose().cwiseQuotient(s.weight).cwiseAbs().maxCoeff();
    if (seen > 0) flow_.driven = std::max(flow_.driven, s.G.row(j).cwiseAbs().sum() / seen);
  }
  M_ = s.M;
  const Vector moved = unit_ * s.N.cwiseAbs().cwiseProduct(s.B.cwiseAbs().transpose()).rowwise().sum();
  M_.diagonal() += resistance * moved.cwiseMax(s.M.diagonal().cwiseMax(0));
  make_edges();
}

Flow FlowBase::run() {
  flow_.decided = true;
  for (std::size_t k = 0; k + 1 < edges_.size() && flow_.decided; ++k) {
    middle_ = 0.5 * (edges_[k] + edges_[k + 1]);
    piece(edges_[k], edges_[k + 1]);
  }
  return std::move(flow_);
}

void FlowBase::make_edges() {
  std::vector<double> all{0, flow_.T};
  for (const TimeSignal& signal : s_.signals) {
    if (signal.kind == TimeSignal::Kind::step) all.push_back(signal.a);
    if (signal.kind != TimeSignal::Kind::pulse) continue;
    for (double k = std::floor(-signal.a / signal.b) - 1; signal.a + k * signal.b < flow_.T; ++k)
      for (const double t : {signal.a + k * signal.b, signal.a + k * signal.b + signal.c}) all.push_back(t);
  }
  std::sort(all.begin(), all.end());
  for (const double t : all) {  // edges that differ by rounding are one
    if (t < 0 || t > flow_.T) continue;
    if (edges_.empty() || t - edges_.back() > 1e-10 * unit_) edges_.push_back(t);
  }
  if (flow_.T - edges_.back() < 1e-10 * unit_) edges_.back() = flow_.T;
}

Vector FlowBase::signals(double t) const {
  Vector v(Index(s_.signals.size()));
  for (Index i = 0; i < v.size(); ++i) {
    const TimeSignal& signal = s_.signals[std::size_t(i)];
    v[i] = signal.value(signal.kind == TimeSignal::Kind::sine ? t : middle_);
  }
  return v;
}

void FlowBase::undecided(const std::string& reason, double t) {
  flow_.decided = false;
  flow_.reason = reason + " at t = " + std::to_string(t);
}

double FlowBase::size_of(const Vector& change) const {
  const Vector large = s_.weight.cwiseProduct(flow_.largest);
  const double least = 1e-3 * std::max(large.maxCoeff(), flow_.driven);
  double size = 0;
  for (Index i = 0; i < m_; ++i) {
    const double scale = std::max(large[i], least);
    if (scale > 0) size = std::max(size, std::abs(change[i]) * s_.weight[i] / scale);
  }
  return size;
}

const FlowBase::Gains& FlowBase::gains(double h) {
  if (gains_.size() > 200) gains_.clear();
  auto& found = gains_[h];
  if (found) return *found;
  found = std::make_unique<Gains>(Gains{ScaledLu(Matrix::Identity(m_, m_) - h * s_.A), Matrix(m_, n_), {}});
  for (Index j = 0; j < n_; ++j) found->gain.col(j) = found->lu.solve(Vector(h * s_.B.col(j)));
  found->M = M_ + s_.N * found->gain;
  return *found;
}

std::optional<FlowBase::Stage> FlowBase::stage(const Wide& from, double t, double h) {
  const Gains& g = gains(h);
  const Vector u = signals(t), rate = h * (s_.A * from.cast<double>() + s_.F * u), free = g.lu.solve(rate);
  const Wide w = s_.N.cast<long double>() * from + s_.G.cast<long double>() * u.cast<long double>();
  const Vector q = w.cast<double>() + s_.N * free;
  const auto basis = complementary_basis(g.M, q, basis_);
  if (!basis) return std::nullopt;
  basis_ = *basis;
  Vector y = basic_solution(g.M, q, basis_).cwiseMax(0);
  const Vector change = free + g.gain * y;
  return Stage{from + change.cast<long double>(), std::move(y)};
}

}  // namespace bromwich::oracle
