#include "tests/support/switched_flow.hpp"

#include "tests/support/flow_base.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

namespace bromwich::oracle {
namespace {

const double root6 = std::sqrt(6.0);
const double radau_weights[3][3] = {{(88 - 7 * root6) / 360, (296 - 169 * root6) / 1800, (-2 + 3 * root6) / 225},
                                    {(296 + 169 * root6) / 1800, (88 + 7 * root6) / 360, (-2 - 3 * root6) / 225},
                                    {(16 - root6) / 36, (16 + root6) / 36, 1.0 / 9}};

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

class FlowMaker : public FlowBase {
 public:
  FlowMaker(const EngineeringScene& s, const FlowSteps& steps, const Vector& x0, double T)
      : FlowBase(s, x0, T, 0), steps_(steps), sizes_w_(Vector::Zero(n_)), sizes_y_(sizes_w_) {}

 private:
  void piece(double begin, double end) override {
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

  void keep(double t, double h, const Step& step) {
    flow_.pieces.push_back({t, h, with_start(x_, step.x)});
    x_ = step.x.col(2);
    flow_.largest = flow_.largest.cwiseMax(x_.cwiseAbs());
    for (Index k = 0; k < 3; ++k) sizes_y_ = sizes_y_.cwiseMax(step.y.col(k).cwiseAbs());
  }

  bool euler(double t, double h) {
    basis_.clear();  // the last one is what failed
    const auto made = stage(x_.cast<long double>(), t + h, h);
    if (!made) return false;
    const Vector after = made->x.cast<double>();
    set_.clear();
    for (Index i = 0; i < n_; ++i)
      if (basis_[std::size_t(i)] != 0) set_.push_back(i);
    Matrix all(m_, 4);
    for (Index k = 0; k < 4; ++k) all.col(k) = k == 0 ? x_ : Vector(x_ + radau_nodes[k - 1] * (after - x_));
    flow_.pieces.push_back({t, h, std::move(all)});
    x_ = after;
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

  FlowSteps steps_;
  Vector sizes_w_, sizes_y_;
  int kept_ = 0;  ///< steps of this length
  std::vector<Index> set_;
  std::map<std::pair<std::vector<char>, double>, std::unique_ptr<ScaledLu>> cache_;
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
