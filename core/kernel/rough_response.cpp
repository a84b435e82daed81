#include "core/kernel/rough_response.hpp"

#include "core/numerics/phi.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

RowMatrix kronecker_response(const DiscreteProblem& p) {
  const KroneckerDynamics& d = *p.modes();
  const Vector seen = d.across.in_modes(d.n);
  RowMatrix modes = RowMatrix::Zero(p.J + 1, d.face_points());
  each_rough_state(p, p.J, [&](Index j, const RowMatrix& x) { modes.row(j).noalias() = seen.transpose() * x; });
  return transformed(p.backend, p.face(), modes, Way::to_points);
}

}  // namespace

std::vector<Matrix> beyond_linear(const DiscreteProblem& p, const RoughStep& rough) {
  const Index j = rough.step;
  const Vector before = p.f.values().row(j - 1).transpose(), slope = p.f.values().row(j).transpose() - before;
  std::vector<Matrix> pieces;
  for (const SourcePiece& piece : rough.pieces) {
    Matrix& e = pieces.emplace_back(piece.phi);
    e.col(0) -= before + (piece.start - p.t[j - 1]) / p.h * slope;
    e.col(1) -= piece.length / p.h * slope;
  }
  return pieces;
}

void each_rough_state(const DiscreteProblem& p, Index last,
                      const std::function<void(Index j, const RowMatrix& x)>& visit) {
  const KroneckerDynamics& d = *p.modes();
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  RowMatrix x = RowMatrix::Zero(nu.size(), mu.size()), decay = x;
  for (Index k = 0; k < nu.size(); ++k) decay.row(k) = (p.h * (mu.array() + nu[k])).exp().transpose();
  for (Index j = p.sources->rough.front().step; j <= last; ++j) {
    x.array() *= decay.array();
    if (const RoughStep* rough = p.sources->at(j)) x += modal_defect(p, *rough);
    visit(j, x);
  }
}

RowMatrix modal_defect(const DiscreteProblem& p, const RoughStep& rough) {
  const KroneckerDynamics& d = *p.modes();
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  const Matrix b = d.inputs_in_modes();
  RowMatrix e = RowMatrix::Zero(nu.size(), mu.size());
  const std::vector<Matrix> pieces = beyond_linear(p, rough);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const Matrix in_lines = p.f.shapes().size() > 0 ? Matrix(p.f.shapes() * pieces[i]) : pieces[i];
    // The coefficients of e: 3 x n.
    const RowMatrix c = transformed(p.backend, p.face(), in_lines.transpose(), Way::to_modes);
    const double length = rough.pieces[i].length;
    for (Index k = 0; k < nu.size(); ++k)
      for (Index l = 0; l < mu.size(); ++l) {
        const double z = length * (nu[k] + mu[l]);
        e(k, l) = std::exp(z) * e(k, l) +
                  b(k, d.family(l)) * length * (phi(1, z) * c(0, l) + phi(2, z) * c(1, l) + 2 * phi(3, z) * c(2, l));
      }
  }
  return e;
}

Matrix linear_by_moments(const RoughStep& rough, double a, double d) {
  Matrix linear;
  Vector mean, moment;
  for (const SourcePiece& piece : rough.pieces) {
    const double begin = std::max(piece.start, a), end = std::min(piece.start + piece.length, a + d);
    if (!(end > begin)) continue;
    // The polynomial in tau, begin + tau (end - begin): k0 + k1 tau + k2 tau^2.
    const Matrix& c = piece.phi;
    const double s = (begin - piece.start) / piece.length, r = (end - begin) / piece.length;
    const Vector k0 = c.col(0) + s * (c.col(1) + s * c.col(2)), k1 = r * (c.col(1) + 2 * s * c.col(2)),
                 k2 = r * r * c.col(2);
    const double from = (begin - a) / d, part = (end - begin) / d;
    const Vector m0 = part * (k0 + k1 / 2 + k2 / 3), m1 = from * m0 + part * part * (k0 / 2 + k1 / 3 + k2 / 4);
    if (mean.size() == 0) mean = moment = Vector::Zero(m0.size());
    mean += m0;
    moment += m1;
  }
  linear.resize(mean.size(), 2);
  linear.col(1) = 12 * (moment - mean / 2);
  linear.col(0) = mean - linear.col(1) / 2;
  return linear;
}

Matrix ends_by_moments(const DiscreteProblem& p, const RoughStep& rough) {
  Matrix linear = linear_by_moments(rough, p.t[rough.step - 1], p.h);
  if (linear.rows() == 0) return {};
  linear.col(1) += linear.col(0);
  return p.f.shapes().size() > 0 ? Matrix(p.f.shapes() * linear) : linear;
}

RowMatrix rough_response(const DiscreteProblem& p, const LagTable& response) {
  const Index rows = p.J + 1, k = p.f.cols();
  RowMatrix ends = RowMatrix::Zero(rows, k), steps = RowMatrix::Zero(rows, k);
  for (const RoughStep& rough : p.sources->rough) {
    const Index j = rough.step;
    const Matrix linear = ends_by_moments(p, rough);
    if (linear.size() == 0) continue;
    const Vector start = linear.col(0) - p.f.row(j - 1), end = linear.col(1) - p.f.row(j);
    ends.row(j) += end.transpose();
    steps.row(j) -= end.transpose();
    steps.row(j - 1) += start.transpose();
  }
  LagTable from_here = response;
  from_here.W = response.S;
  const auto in = p.backend.array(rows, k), out = p.backend.array(rows, response.outputs);
  RowMatrix sum, part;
  p.backend.upload(ends, *in);
  p.backend.convolution(response, rows)->apply(*in, *out, 0);
  p.backend.download(*out, sum);
  p.backend.upload(steps, *in);
  p.backend.convolution(from_here, rows)->apply(*in, *out, 0);
  p.backend.download(*out, part);
  return sum + part;
}

std::shared_ptr<const RowMatrix> rough_response(const DiscreteProblem& p) {
  if (!p.modes()) return nullptr;
  return std::make_shared<RowMatrix>(kronecker_response(p));
}

}  // namespace bromwich
