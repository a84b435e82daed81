// Contract of PointResponder: responses with a contour of its own for every time point, against sums in long double
// whose integrals are those of each interval, and against exact convolutions.

#include "core/seam/point_responses.hpp"

#include "core/numerics/literal_contour.hpp"
#include "tests/support/backends.hpp"

#include <cmath>
#include <complex>

namespace bromwich {
namespace {

using reference::Random;
using reference::Real;
using LongComplex = std::complex<Real>;

class PointResponsesTest : public BackendTest {
 protected:
  RowMatrix apply(PointResponses& plan, const RowMatrix& u, Index outputs) {
    const auto in = device(u), out = device(RowMatrix::Constant(u.rows(), outputs, NAN));
    plan.apply(*in, *out);
    return host(*out);
  }
};

INSTANTIATE_TEST_SUITE_P(Contract, PointResponsesTest, testing::ValuesIn(backend_cases()), backend_case_name);

// ∫_0^h e^{z (h - s)} (a + (b - a) s/h) ds = h (phi1(x) - phi2(x)) a + h phi2(x) b, x = h z.
struct Interval {
  LongComplex step, left, right;

  Interval(Complex z, double h) {
    const LongComplex x = LongComplex(z) * Real(h);
    LongComplex p1 = 0, p2 = 0, term = 1;
    if (std::abs(x) > 1) {
      p1 = (std::exp(x) - Real(1)) / x;
      p2 = (p1 - Real(1)) / x;
    } else {
      for (int k = 1; k < 30; ++k) {
        term /= Real(k);  // x^{k-1}/k!
        p1 += term;
        p2 += term / Real(k + 1);
        term *= x;
      }
    }
    step = std::exp(x);
    left = Real(h) * (p1 - p2);
    right = Real(h) * p2;
  }
};

struct Expected {
  RowMatrix v;
  RowMatrix rounding;  ///< sums of the absolute values of all terms, each with at most j + 16 roundings
};

// One interval after the other, I(t_{l+1}) = e^{hz} I(t_l) + the interval.
Expected direct(const PointResponseProblem& p, const PointContours& c, const ComplexMatrix& R, const RowMatrix& u) {
  Expected e{RowMatrix::Zero(u.rows(), p.outputs), RowMatrix::Zero(u.rows(), p.outputs)};
  for (Index i = 0; i < c.points(); ++i) {
    const Index j = c.first + i;
    for (Index q = c.begin[std::size_t(i)]; q < c.begin[std::size_t(i + 1)]; ++q) {
      const Interval part(c.nodes[q], p.h);
      for (Index k = 0; k < p.inputs; ++k) {
        LongComplex integral = 0;
        Real size = 0;
        for (Index l = 1; l <= j; ++l) {
          const Real a = u(l - 1, k), b = u(l, k);
          integral = part.step * integral + part.left * a + part.right * b;
          size = std::abs(part.step) * size + std::abs(part.left * a) + std::abs(part.right * b);
        }
        const auto add = [&](Index output, Index column) {
          const LongComplex factor = LongComplex(c.weights[q]) * LongComplex(R(q, column));
          e.v(j, output) += double((factor * integral).real());
          e.rounding(j, output) += epsilon * double(j + 16) * double(std::abs(factor) * size);
        };
        if (p.modal) add(k, k);
        for (Index o = 0; !p.modal && o < p.outputs; ++o) add(o, o * p.inputs + k);
      }
    }
  }
  return e;
}

// The printed contours of points first .. last, every third one with a few nodes less.
PointContours contours_of(Index first, Index last, double h, Index P) {
  PointContours c{first, {0}, {}, {}};
  std::vector<Complex> nodes, weights;
  for (Index j = first; j <= last; ++j) {
    const Contour one = literal_contour(P, double(j) * h);
    for (Index p = 0; p < one.nodes.size() - (j % 3 == 0 ? 2 : 0); ++p) {
      nodes.push_back(one.nodes[p]);
      weights.push_back(one.weights[p]);
    }
    c.begin.push_back(Index(nodes.size()));
  }
  c.nodes = Eigen::Map<const ComplexVector>(nodes.data(), Index(nodes.size()));
  c.weights = Eigen::Map<const ComplexVector>(weights.data(), Index(weights.size()));
  return c;
}

ComplexMatrix random_values(Random& random, Index rows, Index cols) {
  ComplexMatrix R(rows, cols);
  R.real() = random.matrix(rows, cols);
  R.imag() = random.matrix(rows, cols);
  return R;
}

TEST_P(PointResponsesTest, AgainstSumsOverIntervals) {
  struct Case {
    Index J, P, inputs, outputs;
    bool modal;
  };
  for (const Case& c : {Case{1, 4, 1, 1, true},
                        {2, 3, 5, 5, true},
                        {3, 25, 33, 33, true},
                        {140, 25, 39, 39, true},
                        {70, 300, 7, 7, true},
                        {1, 4, 1, 1, false},
                        {300, 25, 1, 2, false},
                        {200, 25, 3, 1, false},
                        {40, 100, 40, 5, false},
                        {9, 400, 3, 40, false}}) {
    Random random{std::uint32_t(c.J + c.inputs)};
    const PointResponseProblem problem{0.013, c.inputs, c.outputs, c.modal};
    const auto plan = make_point_responses(*backend, problem);
    const RowMatrix u = random.matrix(c.J + 1, c.inputs);
    RowMatrix expected = RowMatrix::Zero(c.J + 1, c.outputs), rounding = expected;
    // In two parts, as they are added where memory is short.
    for (const auto& [first, last] : {std::pair<Index, Index>{1, c.J / 2}, {c.J / 2 + 1, c.J}}) {
      if (last < first) continue;
      const PointContours contours = contours_of(first, last, problem.h, c.P);
      const ComplexMatrix R = random_values(random, contours.nodes.size(), c.modal ? c.inputs : c.inputs * c.outputs);
      const Expected e = direct(problem, contours, R, u);
      expected += e.v;
      rounding += e.rounding;
      plan->add(contours, R);
    }
    // Twice the roundings of all terms; the sums of the oracle are rounded to double as well. What is left out of the
    // sums is below 1e-18 of them.
    const RowMatrix found = apply(*plan, u, c.outputs), allowed = 4 * rounding;
    EXPECT_TRUE(found.allFinite()) << c.J << ' ' << c.inputs;
    EXPECT_EQ(found.row(0).cwiseAbs().maxCoeff(), 0) << "v_0";
    EXPECT_TRUE(((found - expected).array().abs() <= allowed.array()).all())
        << "J = " << c.J << ", P = " << c.P << ", " << c.inputs << " -> " << c.outputs << ": "
        << (found - expected).cwiseAbs().maxCoeff();
    EXPECT_GE(plan->bytes(), sizeof(Complex) * std::size_t(c.J * (c.P - 1) * c.inputs));
    EXPECT_EQ(apply(*plan, u, c.outputs), found) << "two calls differ";
  }
}

// With R_p = 1/(z_p - a) the contours give e^{at} * u to the printed rate (2.8).
TEST_P(PointResponsesTest, AgainstTheExactResponse) {
  const Index J = 50;
  const double h = 0.1;
  for (const Index P : {16, 64})
    for (const double a : {-0.2, -5.0, -300.0}) {
      const PointContours contours = [&] {
        PointContours all{1, {0}, ComplexVector((P + 1) * J), ComplexVector((P + 1) * J)};
        for (Index j = 1; j <= J; ++j) {
          const Contour one = literal_contour(P, double(j) * h);
          all.nodes.segment((j - 1) * (P + 1), P + 1) = one.nodes;
          all.weights.segment((j - 1) * (P + 1), P + 1) = one.weights;
          all.begin.push_back(j * (P + 1));
        }
        return all;
      }();
      const auto plan = make_point_responses(*backend, {h, 1, 1, false});
      plan->add(contours, (contours.nodes.array() - a).inverse().matrix());
      const RowMatrix u = Random(9).matrix(J + 1, 1), found = apply(*plan, u, 1);
      const Interval exact{Complex(a), h};
      LongComplex v = 0;
      double worst = 0;
      for (Index j = 1; j <= J; ++j) {
        v = exact.step * v + exact.left * Real(u(j - 1, 0)) + exact.right * Real(u(j, 0));
        worst = std::max(worst, std::abs(found(j, 0) - double(v.real())));
      }
      // |∫ e^{a(t-s)} u ds| <= T max |u| <= 5; the same factor of the rate as for the method (test_literal.cpp).
      const double rate = std::exp(-2.06 * std::sqrt(double(P))) / std::sqrt(double(P));
      EXPECT_LE(worst, 4 * 5 * rate) << P << ' ' << a;
    }
}

}  // namespace
}  // namespace bromwich
