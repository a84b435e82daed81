#include "bromwich/laplace_inversion.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/numerics/inversion_rule.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// Two rules that disagree beyond this multiple of their rounding have a singularity between them, or near them.
constexpr double beyond_rounding = 100;
// The difference of two rules estimates the error of the worse one, some times too small.
constexpr double of_difference = 4;
// s times this is a neighbour of s: the difference of F there says how F is rounded.
const double neighbour = 1 + std::ldexp(1.0, -50);
// A disagreement of less than this part of the terms is that of a contour which does not suit F, such as exp(-sqrt(s))
// at small t; it counts so many times for all larger t.
constexpr double little = 1e-6, of_little = 10;

// f of one window at its times, then at its ends t0 and t1.
struct Part {
  ComplexMatrix value;
  Matrix rounding, difference, size;  ///< difference: of two rules; size: sum of the absolute terms
};

ComplexMatrix kept(ComplexMatrix value, bool real) {
  if (real) value.imag().setZero();
  return value;
}

Part in_window(const InversionWindow& window, const ComplexMatrix& F, bool real) {
  const Index n = window.rule.size();
  const ComplexMatrix here = F.topRows(n), beside = F.middleRows(n, n);
  const Matrix terms = window.weights.value.cwiseAbs();
  Part part;
  part.value = kept(window.weights.value * here, real);
  part.rounding = window.weights.error * here.cwiseAbs() + of_difference * terms * (here - beside).cwiseAbs();
  part.size = terms * here.cwiseAbs();
  const ComplexMatrix second = kept(window.second_weights.value * F.bottomRows(window.second.size()), real);
  part.difference = (part.value - second).cwiseAbs();
  return part;
}

// How much neighbours differ at the time that they share, t0 of one and t1 of the other; 0: both agree to rounding.
double disagreement(const Part& left, const Part& right, Index j) {
  const Index i = left.value.rows() - 2, k = right.value.rows() - 1;
  const double across = std::abs(left.value(i, j) - right.value(k, j));
  const double l = left.difference(i, j), r = right.difference(k, j);
  const bool agree = across <= beyond_rounding * (left.rounding(i, j) + right.rounding(k, j)) &&
                     l <= beyond_rounding * left.rounding(i, j) && r <= beyond_rounding * right.rounding(k, j);
  return agree ? 0 : across + l + r;
}

void append(const ComplexVector& more, ComplexVector& s) {
  s.conservativeResize(s.size() + more.size());
  s.tail(more.size()) = more;
}

std::vector<Part> parts_of(const std::vector<InversionWindow>& windows, const ComplexMatrix& F, bool real) {
  std::vector<Part> parts;
  Index at = 0;
  for (const InversionWindow& window : windows) {
    const Index count = 2 * window.rule.size() + window.second.size();
    parts.push_back(in_window(window, F.middleRows(at, count), real));
    at += count;
  }
  return parts;
}

// From small t to large ones: what neighbours disagree about is an error of all larger t.
void collect(const std::vector<InversionWindow>& windows, const std::vector<Part>& parts, LaplaceInverse& result) {
  Eigen::RowVectorXd beyond = Eigen::RowVectorXd::Zero(result.f.cols());
  std::size_t asked = 0;
  for (std::size_t k = 0; k < windows.size(); ++k)
    if (!windows[k].rows.empty()) asked = k;
  for (std::size_t k = parts.size(); k-- > 0;) {
    const Part& part = parts[k];
    for (Index j = 0; k + 1 < parts.size() && j < beyond.size(); ++j) {
      const double apart = disagreement(part, parts[k + 1], j);
      double size = 0;
      for (std::size_t l = std::max<std::size_t>(std::min(k, asked), 2) - 2; l <= k + 1; ++l)
        size = std::max(size, parts[l].size(parts[l].size.rows() - 2, j));
      beyond[j] += apart <= little * size ? of_little * apart : INFINITY;
    }
    for (std::size_t i = 0; i < windows[k].rows.size(); ++i) {
      const Index row = windows[k].rows[i];
      result.f.row(row) = part.value.row(Index(i));
      result.error.row(row) = of_difference * part.difference.row(Index(i)) + part.rounding.row(Index(i)) + beyond;
    }
  }
}

void take_talbot(const std::vector<InversionRule>& rules, const Vector& t, const ComplexMatrix& F,
                 const InversionOptions& options, LaplaceInverse& result) {
  Index at = 0;
  for (Index i = 0; i < t.size(); ++i) {
    const InversionRule& rule = rules[std::size_t(i)];
    const InversionWeights weights = inversion_weights(rule, t.segment(i, 1), options.accuracy);
    const ComplexMatrix here = F.middleRows(at, rule.size());
    const ComplexMatrix f = kept(weights.value * here, options.real);
    result.error.row(i) += (f.row(0) - result.f.row(i)).cwiseAbs() + (weights.error * here.cwiseAbs()).row(0);
    result.f.row(i) = f.row(0);
    at += rule.size();
  }
}

}  // namespace

LaplaceInverse invert_laplace(const LaplaceTransform& F, const Vector& t, const InversionOptions& options) {
  if (!F) throw Error("F", "is empty", "give a function of an array of complex s");
  const std::vector<InversionWindow> windows = inversion_windows(t, options);
  std::vector<InversionRule> of_each;
  if (options.contour == InversionContour::talbot) of_each = talbot_rules(t, options);
  ComplexVector s;
  for (const InversionWindow& window : windows) {
    const ComplexVector points = window.rule.points();
    append(points, s), append(neighbour * points, s), append(window.second.points(), s);
  }
  const Index of_windows = s.size();
  for (const InversionRule& rule : of_each) append(rule.points(), s);
  const ComplexMatrix values = F(s);
  if (values.rows() != s.size())
    throw Error("F", text("returned %td rows for %td points", values.rows(), s.size()), "return a row for each point");
  LaplaceInverse result{ComplexMatrix::Zero(t.size(), values.cols()), Matrix::Zero(t.size(), values.cols()), s.size()};
  collect(windows, parts_of(windows, values, options.real), result);
  if (!of_each.empty()) take_talbot(of_each, t, values.bottomRows(s.size() - of_windows), options, result);
  for (Index j = 0; j < result.error.cols(); ++j)
    for (Index i = 0; i < t.size(); ++i)
      if (!std::isfinite(result.error(i, j))) result.error(i, j) = INFINITY, result.f(i, j) = NAN;
  return result;
}

}  // namespace bromwich
