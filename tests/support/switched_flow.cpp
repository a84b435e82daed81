#include "tests/support/switched_flow.hpp"

#include "tests/support/lemke.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <utility>

namespace bromwich::oracle {
namespace {

const double root6 = std::sqrt(6.0);
const double radau_nodes[3] = {(4 - root6) / 10, (4 + root6) / 10, 1};
const double radau_weights[3][3] = {{(88 - 7 * root6) / 360, (296 - 169 * root6) / 1800, (-2 + 3 * root6) / 225},
                                    {(296 + 169 * root6) / 1800, (88 + 7 * root6) / 360, (-2 - 3 * root6) / 225},
                                    {(16 - root6) / 36, (16 + root6) / 36, 1.0 / 9}};

/// LU of a matrix whose rows and columns have sizes of many decades.
class ScaledLu {
 public:
  explicit ScaledLu(Matrix K) : rows_(Vector::Ones(K.rows())), columns_(rows_) {
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
  Vector solve(const Vector& b) const {
    const Vector scaled = rows_.asDiagonal() * b, z = lu_.solve(scaled);
    return columns_.asDiagonal() * z;
  }

 private:
  Vector rows_, columns_;
  Eigen::PartialPivLU<Matrix> lu_;
};

struct Step {
  Matrix x, y;  ///< m x 3, n x 3 at the stages
  bool signs = false;
};

Vector inside(const Flow::Piece& p, double t) {
  const double s = std::clamp((t - p.t) / p.h, 0.0, 1.0), at[4] = {0, radau_nodes[0], radau_nodes[1], 1};
  Vector x = Vector::Zero(p.nodes.rows());
  for (Index i = 0; i < 4; ++i) {
    double factor = 1;
    for (Index j = 0; j < 4; ++j)
      if (j != i) factor *= (s - at[j]) / (at[i] - at[j]);
    x += factor * p.nodes.col(i);
  }
  return x;
}

Matrix with_start(const Vector& x, const Matrix& stages) {
  Matrix all(x.size(), 4);
  all << x, stages;
  return all;
}

class FlowMaker {
 public:
  FlowMaker(const EngineeringScene& s, const FlowSteps& steps, const Vector& x0, double T)
      : s_(s), steps_(steps), m_(s.states()), n_(s.constraints()), x_(x0) {
    flow_.T = T;
    unit_ = T;
    for (const TimeSignal& signal : s.signals) {
      if (signal.kind == TimeSignal::Kind::sine && signal.a != 0)
        unit_ = std::min(unit_, 2 * std::numbers::pi / std::abs(signal.a));
      if (signal.kind == TimeSignal::Kind::pulse) unit_ = std::min(unit_, signal.b);
    }
    flow_.largest = x0.cwiseAbs();
    sizes_w_ = Vector::Zero(n_), sizes_y_ = Vector::Zero(n_);
    for (Index i = 0; i < m_; ++i) {
      const double reach = s.weight[i] * s.F.row(i).cwiseAbs().sum() * std::min(unit_, 1 / std::abs(s.A(i, i)));
      flow_.driven = std::max(flow_.driven, reach);
    }
    for (Index j = 0; j < n_; ++j) {  // g moves N x
      const double seen = s.N.row(j).transpose().cwiseQuotient(s.weight).cwiseAbs().maxCoeff();
      if (seen > 0) flow_.driven = std::max(flow_.driven, s.G.row(j).cwiseAbs().sum() / seen);
    }
    // Diodes side by side share their current in any way: a resistance a billion times smaller than what else limits
    // y lets them share it in one way.
    M_ = s.M;
    const Vector moved = unit_ * s.N.cwiseAbs().cwiseProduct(s.B.cwiseAbs().transpose()).rowwise().sum();
    M_.diagonal() += steps.resistance * moved.cwiseMax(s.M.diagonal().cwiseMax(0));
    make_edges();
  }

  Flow run() {
    flow_.decided = true;
    for (std::size_t k = 0; k + 1 < edges_.size() && flow_.decided; ++k) piece(edges_[k], edges_[k + 1]);
    return std::move(flow_);
  }

 private:
  void make_edges() {
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

  Vector signals(double t) const {
    Vector v(Index(s_.signals.size()));
    for (Index i = 0; i < v.size(); ++i) {
      const TimeSignal& signal = s_.signals[std::size_t(i)];
      v[i] = signal.value(signal.kind == TimeSignal::Kind::sine ? t : middle_);
    }
    return v;
  }

  void undecided(const std::string& reason, double t) {
    flow_.decided = false;
    flow_.reason = reason + " at t = " + std::to_string(t);
  }

  void piece(double begin, double end) {
    middle_ = 0.5 * (begin + end);
    const double shortest = std::min(steps_.crossing * unit_, 0.02 * (end - begin));
    double t = begin, h = shortest;
    bool cross = true;
    long crossings = 0;
    while (flow_.decided && t < end) {
      if (++flow_.steps > steps_.most) return undecided("too many steps", t);
      if (cross) {
        ++flow_.events;
        // Events that follow each other at once are passed by longer and longer steps.
        h = std::min({shortest * double(1L << std::min(crossings / 50, 10L)), 0.3 * (end - t)});
        if (end - t < 4 * shortest) h = 0.5 * (end - t);
        if (++crossings > 4000) return undecided("events accumulate", t);
        if (!euler(t, h) || !euler(t + h, h)) return undecided("the problem of a short step has no solution", t);
        t = end - t - 2 * h < 1e-6 * shortest ? end : t + 2 * h;
        cross = false;
        continue;
      }
      h = std::min({h, end - t, steps_.longest * unit_});
      advance(t, h, end, shortest, cross);
    }
  }

  void advance(double& t, double& h, double end, double shortest, bool& cross) {
    const Step whole = step(t, h, x_);
    const Step first = whole.signs ? step(t, h / 2, x_) : whole;
    const Step second = first.signs ? step(t + h / 2, h / 2, first.x.col(2)) : first;
    if (!whole.signs || !first.signs || !second.signs) {
      if (h > shortest / 64)
        h /= 2;
      else
        cross = true;
      return;
    }
    // What lies between the stages is a polynomial of degree 3, which is less accurate than the end.
    const Vector middle = inside({t, h, with_start(x_, whole.x)}, t + h / 2);
    const double error = std::max(size_of(whole.x.col(2) - second.x.col(2)), 1e-4 * size_of(middle - first.x.col(2)));
    if (error > steps_.error && h > shortest / 64) {
      h /= 2, kept_ = 0;
      return;
    }
    keep(t, h / 2, first), keep(t + h / 2, h / 2, second);
    t = end - t - h < 1e-9 * h ? end : t + h;
    // Rounding is no smaller with shorter steps, so longer ones are tried after a while.
    if (error < steps_.error / 100 || ++kept_ >= 8) h *= 2, kept_ = 0;
  }

  double size_of(const Vector& change) const {
    const Vector large = s_.weight.cwiseProduct(flow_.largest);
    const double least = 1e-3 * std::max(large.maxCoeff(), flow_.driven);
    double size = 0;
    for (Index i = 0; i < m_; ++i) {
      const double scale = std::max(large[i], least);
      if (scale > 0) size = std::max(size, std::abs(change[i]) * s_.weight[i] / scale);
    }
    return size;
  }

  void keep(double t, double h, const Step& step) {
    flow_.pieces.push_back({t, h, with_start(x_, step.x)});
    x_ = step.x.col(2);
    flow_.largest = flow_.largest.cwiseMax(x_.cwiseAbs());
    for (Index k = 0; k < 3; ++k) sizes_y_ = sizes_y_.cwiseMax(step.y.col(k).cwiseAbs());
  }

  bool euler(double t, double h) {
    Matrix I = Matrix::Identity(m_, m_) - h * s_.A;
    const ScaledLu lu(I);
    const Vector u = signals(t + h), moved = x_ + h * (s_.F * u), free = lu.solve(moved);
    Matrix gain(m_, n_);
    for (Index j = 0; j < n_; ++j) gain.col(j) = lu.solve(Vector(h * s_.B.col(j)));
    const Matrix M = M_ + s_.N * gain;
    const Vector q = s_.N * free + s_.G * u;
    const auto basis = complementary_basis(M, q);
    if (!basis) return false;
    basis_ = *basis;
    set_.clear();
    for (Index i = 0; i < n_; ++i)
      if (basis_[std::size_t(i)] != 0) set_.push_back(i);
    const Vector y = basic_solution(M, q, basis_).cwiseMax(0);
    Matrix all(m_, 4);
    const Vector x1 = free + gain * y;
    for (Index k = 0; k < 4; ++k) all.col(k) = k == 0 ? x_ : Vector(x_ + radau_nodes[k - 1] * (x1 - x_));
    flow_.pieces.push_back({t, h, std::move(all)});
    x_ = x1;
    flow_.largest = flow_.largest.cwiseMax(x_.cwiseAbs());
    return x_.allFinite();
  }

  const ScaledLu& factors(double h) {
    auto& found = cache_[{basis_, h}];
    if (found) return *found;
    const Index k = Index(set_.size()), size = m_ + k;
    const Matrix BS = s_.B(Eigen::all, set_), NS = s_.N(set_, Eigen::all), MS = M_(set_, set_);
    Matrix K = Matrix::Zero(3 * size, 3 * size);
    for (Index a = 0; a < 3; ++a) {
      K.block(a * size, a * size, m_, m_).setIdentity();
      K.block(a * size + m_, a * size, k, m_) = NS;
      K.block(a * size + m_, a * size + m_, k, k) = MS;
      for (Index b = 0; b < 3; ++b) {
        K.block(a * size, b * size, m_, m_) -= h * radau_weights[a][b] * s_.A;
        K.block(a * size, b * size + m_, m_, k) -= h * radau_weights[a][b] * BS;
      }
    }
    if (cache_.size() > 3000) {
      cache_.clear();
      return *(cache_[{basis_, h}] = std::make_unique<ScaledLu>(std::move(K)));
    }
    return *(found = std::make_unique<ScaledLu>(std::move(K)));
  }

  /// A step with the basis held. Signs: y and w stay above what rounding explains.
  Step step(double t, double h, const Vector& x) {
    const Index k = Index(set_.size()), size = m_ + k;
    const Matrix NS = s_.N(set_, Eigen::all), GS = s_.G(set_, Eigen::all);
    Matrix u(Index(s_.signals.size()), 3);
    for (Index a = 0; a < 3; ++a) u.col(a) = signals(t + h * radau_nodes[a]);
    const Vector rate = s_.A * x, distance = NS * x;
    const Matrix force = s_.F * u;
    Vector b(3 * size);
    for (Index a = 0; a < 3; ++a) {
      b.segment(a * size, m_).setZero();
      for (Index c = 0; c < 3; ++c) b.segment(a * size, m_) += h * radau_weights[a][c] * (rate + force.col(c));
      b.segment(a * size + m_, k) = -distance - GS * u.col(a);
    }
    const Vector z = factors(h).solve(b);
    Step made{Matrix(m_, 3), Matrix::Zero(n_, 3), z.allFinite()};
    for (Index a = 0; a < 3 && made.signs; ++a) {
      made.x.col(a) = x + z.segment(a * size, m_);
      for (Index i = 0; i < k; ++i) made.y(set_[std::size_t(i)], a) = z[a * size + m_ + i];
      const Vector g = s_.G * u.col(a), Nx = s_.N * made.x.col(a), y = made.y.col(a), w = Nx + M_ * y + g;
      sizes_w_ = sizes_w_.cwiseMax(s_.N.cwiseAbs() * flow_.largest + s_.M.cwiseAbs() * sizes_y_ + g.cwiseAbs());
      // y of a held distance is found from second differences: rounding over (h / unit)^2, at most.
      const double of_y = std::clamp(1e-15 * std::pow(unit_ / h, 2), 1e-10, 1e-4);
      for (Index i = 0; i < n_; ++i) {
        const double least = basis_[std::size_t(i)] != 0 ? y[i] + of_y * sizes_y_[i] : w[i] + 1e-12 * sizes_w_[i];
        if (!(least >= 0)) made.signs = false;
      }
    }
    return made;
  }

  const EngineeringScene& s_;
  FlowSteps steps_;
  Index m_, n_;
  Matrix M_;
  Vector x_, sizes_w_, sizes_y_;
  double unit_ = 0, middle_ = 0;
  int kept_ = 0;  ///< steps of this length
  std::vector<double> edges_;
  std::vector<char> basis_;
  std::vector<Index> set_;
  std::map<std::pair<std::vector<char>, double>, std::unique_ptr<ScaledLu>> cache_;
  Flow flow_;
};

}  // namespace

Vector Flow::left(double t) const {
  const auto after = std::partition_point(pieces.begin(), pieces.end(), [&](const Piece& p) { return p.t < t; });
  return inside(after == pieces.begin() ? *after : *(after - 1), t);
}

Vector Flow::right(double t) const {
  const auto after = std::partition_point(pieces.begin(), pieces.end(), [&](const Piece& p) { return p.t <= t; });
  return inside(after == pieces.begin() ? *after : *(after - 1), t);
}

Flow switched_flow(const EngineeringScene& s, const Vector& x0, double T, const FlowSteps& steps) {
  return FlowMaker(s, steps, x0, T).run();
}

Flow switched_flow(const EngineeringScene& s, const FlowSteps& steps) { return switched_flow(s, s.x0, s.T, steps); }

Vector error_scale(const EngineeringScene& s, const Flow& flow) {
  const Vector large = s.weight.cwiseProduct(flow.largest);
  // What a millionth of the sources would do is nothing: a circuit that stays at rest has the state 0 up to rounding.
  return large.cwiseMax(std::max(1e-3 * large.maxCoeff(), 1e-6 * flow.driven)).cwiseMax(1e-300).cwiseQuotient(s.weight);
}

double distance(const EngineeringScene& s, const Flow& a, const Flow& b, Index count) {
  const Vector scale = error_scale(s, a);
  double largest = 0;
  for (Index k = 1; k <= count; ++k) {
    const double t = a.T * double(k) / double(count);
    const double apart = std::min((a.left(t) - b.left(t)).cwiseQuotient(scale).cwiseAbs().maxCoeff(),
                                  (a.right(t) - b.right(t)).cwiseQuotient(scale).cwiseAbs().maxCoeff());
    largest = std::max(largest, apart);
  }
  return largest;
}

}  // namespace bromwich::oracle
