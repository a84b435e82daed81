#pragma once
// Planar structures with contacts by located events: the second opinion on their motion. It shares no code with the
// solver: every contact is open, closed and sliding one way or the other, or closed and sticking. With these states
// held, forces follow from accelerations, and q and v from classical Runge-Kutta steps. A step ends where a gap closes,
// a normal force vanishes, sliding ends, or friction reaches its bound, found by bisection. There velocities jump by
// Newton's law, and the next states are those of the forces whose accelerations fit (projected Gauss-Seidel).

#include "mechanics/mechanism.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace bromwich::oracle {

/// q and v (d values each) at multiples of T / count.
struct ContactFlow {
  bool decided = true;
  std::string reason;  ///< why it is not
  Index impacts = 0, events = 0;
  std::vector<Vector> q, v;
};

/// Constant gaps and velocities, f without jumps.
class ContactFlowMaker {
 public:
  ContactFlowMaker(const Mechanism& m, double step) : m_(m), s_(m.structure), d_(m.coordinates()), step_(step) {
    n_ = Index(m.contacts.size());
    mass_.compute(Matrix(s_.M));
    C_ = s_.C.size() > 0 ? Matrix(s_.C) : Matrix(Matrix::Zero(d_, d_));
    K_ = s_.K.size() > 0 ? Matrix(s_.K) : Matrix(Matrix::Zero(d_, d_));
    H_ = Matrix::Zero(2 * n_, d_);
    gap_ = belt_ = mu_ = kn_ = e_ = Vector::Zero(n_);
    for (Index i = 0; i < n_; ++i) {
      const Contact& c = m.contacts[std::size_t(i)];
      H_.row(2 * i) = c.normal.transpose();
      if (c.mu > 0) H_.row(2 * i + 1) = c.tangent.row(0), belt_[i] = at(c.velocity, 0);
      gap_[i] = at(c.gap, 0);
      mu_[i] = c.mu, kn_[i] = c.kn, e_[i] = c.restitution;
    }
    moved_ = mass_.solve(Matrix(H_.transpose()));
    W_ = H_ * moved_;
    q_ = s_.q0.size() > 0 ? s_.q0 : Vector(Vector::Zero(d_));
    v_ = s_.v0.size() > 0 ? s_.v0 : Vector(Vector::Zero(d_));
    state_.assign(std::size_t(n_), State::open);
    slide_ = Vector::Zero(n_);
  }

  ContactFlow run(Index count) {
    meet(0, {});
    for (Index k = 1; k <= count && flow_.decided; ++k) {
      pass(s_.T * double(k - 1) / double(count), s_.T * double(k) / double(count));
      flow_.q.push_back(q_), flow_.v.push_back(v_);
    }
    return flow_;
  }

 private:
  enum class State : char { open, slip, stick };
  struct Rates {
    Vector a, l;  ///< accelerations, and forces ln, lt of all contacts
  };
  static constexpr double zero_gap = 1e-10, zero_speed = 1e-8, below = 1e-11, rebound = 1e-7;

  static double at(const TimeFunction& function, double t) {
    Vector value = Vector::Zero(1);
    if (function) function(t, value);
    return value[0];
  }
  bool rigid(Index i) const { return kn_[i] == 0; }
  State state(Index i) const { return state_[std::size_t(i)]; }
  double gap(Index i, const Vector& q) const { return gap_[i] + H_.row(2 * i).dot(q); }
  double opens(Index i, const Vector& v) const { return H_.row(2 * i).dot(v); }
  double slides(Index i, const Vector& v) const { return H_.row(2 * i + 1).dot(v) - belt_[i]; }
  void undecided(const std::string& why) { flow_.decided = false, flow_.reason = why; }

  Vector free(double t, const Vector& q, const Vector& v) const {
    Vector f = Vector::Zero(d_);
    if (s_.f) s_.f(t, f);
    return mass_.solve(Vector(f - C_ * v - K_ * q));
  }

  // The forces with these states.
  Rates rates(double t, const Vector& q, const Vector& v) {
    Rates r{free(t, q, v), Vector::Zero(2 * n_)};
    const Vector a = H_ * r.a;
    std::vector<Index> rows;
    Matrix known = Matrix::Zero(2 * n_, 1), by = Matrix::Zero(2 * n_, 2 * n_);  // forces = known + by z
    for (Index i = 0; i < n_; ++i) {
      if (state(i) == State::open) continue;
      if (rigid(i)) {
        rows.push_back(2 * i);
        by(2 * i, 2 * i) = 1;
        if (state(i) == State::slip) by(2 * i + 1, 2 * i) = -mu_[i] * slide_[i];
      } else {
        known(2 * i) = -kn_[i] * gap(i, q);
        if (state(i) == State::slip) known(2 * i + 1) = -mu_[i] * slide_[i] * known(2 * i);
      }
      if (state(i) == State::stick) rows.push_back(2 * i + 1), by(2 * i + 1, 2 * i + 1) = 1;
    }
    r.l = known.col(0);
    if (!rows.empty()) {
      const Matrix L = (W_ * by)(rows, rows);
      const Vector b = -(a + W_ * known.col(0))(rows);
      Vector z = Vector::Zero(2 * n_);
      const Vector found = L.completeOrthogonalDecomposition().solve(b);
      z(rows) = found;
      r.l += by * z;
    }
    r.a += moved_ * r.l;
    return r;
  }

  // What stays above 0 as long as the states hold; the contact of each.
  std::vector<std::pair<double, Index>> margins(double t, const Vector& q, const Vector& v) {
    const Rates r = rates(t, q, v);
    std::vector<std::pair<double, Index>> all;
    for (Index i = 0; i < n_; ++i) {
      const double ln = r.l[2 * i], lt = r.l[2 * i + 1];
      if (state(i) == State::open) all.emplace_back(gap(i, q), i);
      if (state(i) == State::open) continue;
      all.emplace_back(rigid(i) ? ln : -gap(i, q), i);
      if (state(i) == State::slip && mu_[i] > 0) all.emplace_back(slide_[i] * slides(i, v), i);
      if (state(i) == State::stick) all.emplace_back(mu_[i] * ln - std::abs(lt), i);
    }
    return all;
  }

  void advance(double t, double h, Vector& q, Vector& v) {
    const Vector a1 = rates(t, q, v).a, v2 = v + h / 2 * a1, q2 = q + h / 2 * v;
    const Vector a2 = rates(t + h / 2, q2, v2).a, v3 = v + h / 2 * a2, q3 = q + h / 2 * v2;
    const Vector a3 = rates(t + h / 2, q3, v3).a, v4 = v + h * a3, q4 = q + h * v3;
    const Vector a4 = rates(t + h, q4, v4).a;
    q += h / 6 * (v + 2 * v2 + 2 * v3 + v4);
    v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  }

  bool holds(double t, const Vector& q, const Vector& v) {
    for (const auto& [margin, i] : margins(t, q, v))
      if (margin < -below) return false;
    return true;
  }

  void pass(double t, double end) {
    while (flow_.decided && end - t > 1e-13) {
      const double h = std::min(step_, end - t);
      Vector q = q_, v = v_;
      advance(t, h, q, v);
      if (holds(t + h, q, v)) {
        q_ = q, v_ = v, t += h;
        continue;
      }
      double low = 0, high = h;
      for (int halved = 0; halved < 45; ++halved) {
        const double middle = (low + high) / 2;
        q = q_, v = v_;
        advance(t, middle, q, v);
        (holds(t + middle, q, v) ? low : high) = middle;
      }
      advance(t, high, q_, v_);
      t += high;
      if (high < 1e-9) {
        if (++crowded_ > 200) return undecided("events accumulate at " + std::to_string(t));
      } else {
        crowded_ = 0;
      }
      std::vector<Index> left;  // forces that have vanished, friction that has reached its bound
      for (const auto& [margin, i] : margins(t, q_, v_))
        if (margin < 0) left.push_back(i);
      ++flow_.events;
      meet(t, left);
    }
  }

  // Impulses, then the states that go on. `ends`: contacts whose state ends here.
  void meet(double t, const std::vector<Index>& ends) {
    const Rates before = rates(t, q_, v_);
    std::vector<char> touches(std::size_t(n_), 0);
    bool strikes = false;
    for (Index i = 0; i < n_; ++i) {
      touches[std::size_t(i)] = rigid(i) && (gap(i, q_) <= zero_gap || state(i) != State::open);
      strikes = strikes || (touches[std::size_t(i)] && opens(i, v_) < -zero_speed);
    }
    const std::vector<State> old = state_;
    if (strikes && !strike(touches)) return;
    // 0 may be crossed by the event itself: a sticking contact at its bound slips, a closed one without force opens.
    std::vector<char> slips(std::size_t(n_), 0), parts(std::size_t(n_), 0);
    if (!strikes)
      for (const Index i : ends) {
        const double ln = before.l[2 * i], lt = before.l[2 * i + 1];
        if (old[std::size_t(i)] == State::open) continue;
        if (rigid(i) && ln <= 0)
          parts[std::size_t(i)] = 1;
        else if (old[std::size_t(i)] == State::stick && mu_[i] * ln - std::abs(lt) < 0)
          slips[std::size_t(i)] = lt > 0 ? -1 : 1;
      }
    choose(t, touches, slips, parts);
    put_back();
  }

  bool strike(const std::vector<char>& touches) {
    ++flow_.impacts;
    Vector p = Vector::Zero(2 * n_);
    const Vector u = H_ * v_;
    for (int sweep = 0;; ++sweep) {
      if (sweep == 100000) return undecided("impulses not found"), false;
      const Vector last = p;
      for (Index i = 0; i < n_; ++i) {
        if (!touches[std::size_t(i)]) continue;
        const Index a = 2 * i, b = a + 1;
        const double speed = u[a], back = speed < 0 && -e_[i] * speed > rebound ? e_[i] * speed : 0;
        p[a] = std::max(0.0, -(speed + back + W_.row(a).dot(p) - W_(a, a) * p[a]) / W_(a, a));
        if (mu_[i] > 0)
          p[b] = std::clamp(-(u[b] - belt_[i] + W_.row(b).dot(p) - W_(b, b) * p[b]) / W_(b, b), -mu_[i] * p[a],
                            mu_[i] * p[a]);
      }
      if ((p - last).cwiseAbs().maxCoeff() <= 1e-15 * (1 + p.cwiseAbs().maxCoeff())) break;
    }
    v_ += moved_ * p;
    return true;
  }

  // The acceleration-level problem of contacts that touch and stay, by projected Gauss-Seidel.
  void choose(double t, const std::vector<char>& touches, const std::vector<char>& slips,
              const std::vector<char>& parts) {
    const Vector a = H_ * free(t, q_, v_);
    Vector l = Vector::Zero(2 * n_), sign = Vector::Zero(n_);
    std::vector<char> closed(std::size_t(n_), 0);
    for (Index i = 0; i < n_; ++i) {
      closed[std::size_t(i)] = rigid(i)
                                   ? touches[std::size_t(i)] && opens(i, v_) <= zero_speed && !parts[std::size_t(i)]
                                   : gap(i, q_) < 0 || (gap(i, q_) < zero_gap && opens(i, v_) < 0);
      if (!closed[std::size_t(i)]) continue;
      if (!rigid(i)) l[2 * i] = std::max(0.0, -kn_[i] * gap(i, q_));
      if (mu_[i] == 0) continue;
      const double vt = slides(i, v_);
      sign[i] = slips[std::size_t(i)]       ? double(slips[std::size_t(i)])
                : std::abs(vt) > zero_speed ? std::copysign(1.0, vt)
                                            : 0;
    }
    for (int sweep = 0;; ++sweep) {
      if (sweep == 100000) return undecided("accelerations not found at " + std::to_string(t));
      const Vector last = l;
      for (Index i = 0; i < n_; ++i) {
        if (!closed[std::size_t(i)]) continue;
        const Index n = 2 * i, b = n + 1;
        if (rigid(i)) {
          const double along = -mu_[i] * sign[i], diagonal = W_(n, n) + along * W_(n, b);
          if (!(diagonal > 0)) return undecided("a contact jams");
          const double rest = a[n] + W_.row(n).dot(l) - W_(n, n) * l[n] - along * l[n] * W_(n, b);
          l[n] = std::max(0.0, -rest / diagonal);
        }
        if (mu_[i] == 0) continue;
        l[b] = sign[i] != 0
                   ? -mu_[i] * sign[i] * l[n]
                   : std::clamp(-(a[b] + W_.row(b).dot(l) - W_(b, b) * l[b]) / W_(b, b), -mu_[i] * l[n], mu_[i] * l[n]);
      }
      if ((l - last).cwiseAbs().maxCoeff() <= 1e-14 * (1 + l.cwiseAbs().maxCoeff())) break;
    }
    for (Index i = 0; i < n_; ++i) {
      State& now = state_[std::size_t(i)];
      const double ln = l[2 * i], lt = l[2 * i + 1];
      now = State::open;
      if (!closed[std::size_t(i)] || (rigid(i) && ln <= 1e-12)) continue;
      now = State::slip, slide_[i] = sign[i];
      if (mu_[i] == 0 || sign[i] != 0) continue;
      if (std::abs(lt) < mu_[i] * ln * (1 - 1e-12))
        now = State::stick;
      else
        slide_[i] = lt > 0 ? -1 : 1;
      if (!rigid(i) && ln == 0) {  // has just closed: it slides the way it goes
        const double vt = slides(i, v_);
        slide_[i] = vt < 0 ? -1 : 1;
      }
    }
  }

  void put_back() {
    std::vector<Index> held, moving;
    for (Index i = 0; i < n_; ++i) {
      if (state(i) == State::open) continue;
      if (rigid(i)) held.push_back(2 * i), moving.push_back(2 * i);
      if (state(i) == State::stick) moving.push_back(2 * i + 1);
    }
    const auto onto = [&](const std::vector<Index>& rows, const Vector& off) {
      if (rows.empty()) return Vector(Vector::Zero(d_));
      return Vector(moved_(Eigen::all, rows) *
                    W_(rows, rows).completeOrthogonalDecomposition().solve(Vector(off(rows))));
    };
    Vector of_q = H_ * q_, of_v = H_ * v_;
    for (Index i = 0; i < n_; ++i) of_q[2 * i] += gap_[i], of_v[2 * i + 1] -= belt_[i];
    q_ -= onto(held, of_q);
    v_ -= onto(moving, of_v);
  }

  const Mechanism& m_;
  const Structure& s_;
  Index d_, n_;
  double step_;
  Eigen::LLT<Matrix> mass_;
  Matrix C_, K_, H_, moved_, W_;
  Vector gap_, belt_, mu_, kn_, e_, q_, v_, slide_;
  std::vector<State> state_;
  int crowded_ = 0;
  ContactFlow flow_;
};

inline ContactFlow contact_flow(const Mechanism& m, Index count, double step = 1e-3) {
  return ContactFlowMaker(m, step).run(count);
}

}  // namespace bromwich::oracle
