#include "core/kernel/rough_response.hpp"

#include "core/numerics/phi.hpp"

#include <cmath>

namespace bromwich {

namespace {

// The pieces of e, each with three coefficients in the sine modes of the lines: 3 x n.
std::vector<RowMatrix> pieces_in_modes(const DiscreteProblem& p, const RoughStep& rough) {
  const Index j = rough.step;
  const Vector before = p.f.values().row(j - 1).transpose(), slope = p.f.values().row(j).transpose() - before;
  std::vector<RowMatrix> modes;
  for (const SourcePiece& piece : rough.pieces) {
    Matrix apart = piece.phi;
    apart.col(0) -= before + (piece.start - p.t[j - 1]) / p.h * slope;
    apart.col(1) -= piece.length / p.h * slope;
    if (p.f.shapes().size() > 0) apart = (p.f.shapes() * apart).eval();
    modes.push_back(row_modes(p.backend, apart.transpose()));
  }
  return modes;
}

RowMatrix kronecker_response(const DiscreteProblem& p) {
  const KroneckerDynamics& d = *p.kronecker();
  const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues(), seen = in_sine_basis(d.n);
  RowMatrix decay(nu.size(), mu.size()), x = RowMatrix::Zero(nu.size(), mu.size()),
                                         modes = RowMatrix::Zero(p.J + 1, mu.size());
  for (Index k = 0; k < nu.size(); ++k) decay.row(k) = (p.h * (mu.array() + nu[k])).exp().transpose();
  for (Index j = p.sources->rough.front().step; j <= p.J; ++j) {
    x.array() *= decay.array();
    if (const RoughStep* rough = p.sources->at(j)) x += modal_defect(p, *rough);
    modes.row(j).noalias() = seen.transpose() * x;
  }
  return row_modes(p.backend, modes);
}

}  // namespace

RowMatrix modal_defect(const DiscreteProblem& p, const RoughStep& rough) {
  const KroneckerDynamics& d = *p.kronecker();
  const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues(), b = in_sine_basis(d.b);
  RowMatrix e = RowMatrix::Zero(nu.size(), mu.size());
  const std::vector<RowMatrix> modes = pieces_in_modes(p, rough);
  for (std::size_t i = 0; i < modes.size(); ++i) {
    const double length = rough.pieces[i].length;
    for (Index k = 0; k < nu.size(); ++k)
      for (Index l = 0; l < mu.size(); ++l) {
        const double z = length * (nu[k] + mu[l]);
        e(k, l) =
            std::exp(z) * e(k, l) +
            b[k] * length * (phi(1, z) * modes[i](0, l) + phi(2, z) * modes[i](1, l) + 2 * phi(3, z) * modes[i](2, l));
      }
  }
  return e;
}

Matrix linear_by_moments(const RoughStep& rough, double a, double d) {
  Matrix linear;
  Vector mean, moment;
  for (const SourcePiece& piece : rough.pieces) {
    if (piece.start < a - 0.5 * piece.length || piece.start >= a + d - 0.5 * piece.length) continue;
    const Matrix& c = piece.phi;
    const double from = (piece.start - a) / d, part = piece.length / d;
    const Vector m0 = part * (c.col(0) + c.col(1) / 2 + c.col(2) / 3),
                 m1 = from * m0 + part * part * (c.col(0) / 2 + c.col(1) / 3 + c.col(2) / 4);
    if (mean.size() == 0) mean = moment = Vector::Zero(m0.size());
    mean += m0;
    moment += m1;
  }
  linear.resize(mean.size(), 2);
  linear.col(1) = 12 * (moment - mean / 2);
  linear.col(0) = mean - linear.col(1) / 2;
  return linear;
}

RowMatrix rough_response(const DiscreteProblem& p, const LagTable& response) {
  const Index rows = p.J + 1, k = p.f.cols();
  RowMatrix ends = RowMatrix::Zero(rows, k), steps = RowMatrix::Zero(rows, k);
  for (const RoughStep& rough : p.sources->rough) {
    const Index j = rough.step;
    Matrix linear = linear_by_moments(rough, p.t[j - 1], p.h);
    if (linear.rows() == 0) continue;
    if (p.f.shapes().size() > 0) linear = (p.f.shapes() * linear).eval();
    const Vector start = linear.col(0) - p.f.row(j - 1), end = linear.col(0) + linear.col(1) - p.f.row(j);
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
  if (!p.kronecker()) return nullptr;
  return std::make_shared<RowMatrix>(kronecker_response(p));
}

}  // namespace bromwich
