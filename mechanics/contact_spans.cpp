#include "mechanics/contact_spans.hpp"

#include "core/base/error.hpp"
#include "core/result/located_solution.hpp"

#include <array>
#include <cmath>
#include <limits>

namespace bromwich {

namespace {

// Gauss-Legendre on [-1, 1], eight points (Abramowitz and Stegun, table 25.4): exact for products of two polynomials
// of degree 7.
constexpr std::array<double, 4> points{0.1834346424956498049394761, 0.5255324099163289858177390,
                                       0.7966664774136267395915539, 0.9602898564975362316835609};
constexpr std::array<double, 4> point_weights{0.3626837833783619829651504, 0.3137066458778872873379622,
                                              0.2223810344533744705443560, 0.1012285362903762591525314};

class LocatedSpans {
 public:
  LocatedSpans(const Scene& scene, const Vector& start, const LocatedSolution& solution)
      : solution_(solution), B_(scene.dynamics->inputs()), x_(start), integral_(Vector::Zero(scene.constraints())) {}

  ContactSpans all() {
    ContactSpans found;
    found.located = true;
    found.first = x_;
    for (const EventPiece& piece : solution_.pieces) found.spans.push_back(span(piece));
    found.last = x_;
    return found;
  }

 private:
  static constexpr double rounding = 16 * std::numeric_limits<double>::epsilon();

  ContactSpan span(const EventPiece& piece) {
    ContactSpan s;
    s.begin = piece.begin, s.end = piece.end;
    Vector unseen = piece.integral - integral_;
    for (const EventImpulse& impulse : piece.impulses) unseen -= impulse.p;
    if (unseen.norm() > rounding * piece.integral.norm()) jump(unseen, false, s);
    for (const EventImpulse& impulse : piece.impulses) jump(impulse.p, true, s);
    const double half = (piece.end - piece.begin) / 2;
    const auto at = [&](double t) { return legendre((t - piece.begin) / piece.length); };
    for (std::size_t i = 0; i < points.size(); ++i)
      for (const int sign : {-1, 1}) {
        const double t = piece.begin + half * (1 + sign * points[i]);
        s.samples.push_back({t, half * point_weights[i], piece.x.transpose() * at(t), piece.y.transpose() * at(t)});
      }
    s.active.assign(std::size_t(B_.cols()), 0);
    for (const Index i : piece.active) s.active[std::size_t(i)] = 1;
    if (piece.passed)
      for (Index i = 0; i < B_.cols(); ++i) s.active[std::size_t(i)] = piece.y(0, i) > 0;
    x_ = piece.x.transpose() * at(piece.end);
    integral_ = piece.integral +
                piece.length * piece.y.transpose() * legendre_integrals((piece.end - piece.begin) / piece.length);
    return s;
  }

  void jump(const Vector& p, bool impact, ContactSpan& s) {
    const Vector after = x_ + B_ * p;
    s.jumps.push_back({x_, after, p, impact});
    x_ = after;
  }

  const LocatedSolution& solution_;
  const SparseMatrix B_;
  Vector x_, integral_;  ///< so far: the state, and the integral of y
};

/// On a circle: whether friction is at its bound.
void see_circles(const Mechanism& m, const Eigen::Ref<const Vector>& y, std::vector<char>& active) {
  constexpr double rounding = 1e-9;
  for (const FrictionCone& cone : m.scene.cones) {
    const double bound = cone.mu * y[cone.first];
    const bool slips = y.segment(cone.first + 1, 2).norm() >= (1 - rounding) * bound;
    active[std::size_t(cone.first)] = bound > 0 && (cone.given ? slips : true);
    active[std::size_t(cone.first + 1)] = slips;
  }
}

ContactSpans spans_of_rows(const Mechanism& m, const Result& r) {
  constexpr double negligible = 1e-12;  // of the largest value of a row
  const RowMatrix integral = integral_of_y(r);
  const Vector least = negligible * r.y.cwiseAbs().colwise().maxCoeff().transpose();
  ContactSpans found;
  found.first = r.x.row(0).transpose();
  for (Index j = 0; j + 1 < r.t.size() && r.x.row(j + 1).allFinite(); ++j) {
    ContactSpan s;
    s.begin = r.t[j], s.end = r.t[j + 1];
    const double h = s.end - s.begin;
    s.samples.push_back({s.begin + h / 2, h, (r.x.row(j) + r.x.row(j + 1)).transpose() / 2,
                         (integral.row(j + 1) - integral.row(j)).transpose() / h});
    for (Index i = 0; i < r.y.cols(); ++i) s.active.push_back(r.y(j + 1, i) > least[i]);
    see_circles(m, r.y.row(j + 1).transpose(), s.active);
    found.last = r.x.row(j + 1).transpose();
    found.spans.push_back(std::move(s));
  }
  return found;
}

}  // namespace

ContactSpans contact_spans(const Mechanism& m, const Result& r) {
  if (r.located) return LocatedSpans(m.scene, r.start.size() > 0 ? r.start : m.scene.x0, *r.located).all();
  if (r.x.cols() != m.scene.states() || r.t.size() < 2)
    throw Error("states", "were not all recorded", "solve with all states");
  if (r.t.size() != r.steps + 1) throw Error("rows", "are not those of the steps", "take the result that was solved");
  return spans_of_rows(m, r);
}

}  // namespace bromwich
