#include "core/host/face_lcp.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::host {

namespace {

constexpr double slow = 0.5;    ///< contraction above which the problem is left to other solvers
constexpr int relaxations = 3;  ///< for each product with W_0
constexpr int most_products = 100;
constexpr double settled = 16 * epsilon;

}  // namespace

std::unique_ptr<FaceLcp> FaceLcp::make(const LcpMatrix& M, const std::vector<Index>& extents, const Vector& w0,
                                       Transform transform) {
  const std::optional<Stencil> stencil = stencil_of(M, extents);
  if (!stencil) return nullptr;
  const Vector of_M = stencil->eigenvalues();
  if (!(of_M.minCoeff() > 0) || !((of_M + w0).minCoeff() > 0)) return nullptr;
  const InstantShift shift = instant_shift(of_M, w0);
  if (!(shift.contraction < slow) || !(stencil->shifted(shift.shift).jacobi_radius() < 1)) return nullptr;
  return std::unique_ptr<FaceLcp>(new FaceLcp(*stencil, w0, shift, std::move(transform)));
}

FaceLcp::FaceLcp(const Stencil& stencil, const Vector& w0, const InstantShift& shift, Transform transform)
    : n_(w0.size()),
      length_(stencil.extents.back()),
      w0_(w0),
      shift_(shift.shift),
      centre_(stencil.centre + shift.shift),
      omega_(best_relaxation(stencil.shifted(shift.shift))),
      beside_(stencil.beside),
      strides_(stencil.extents.size()),
      transform_(std::move(transform)) {
  Index padded = 1;
  for (std::size_t d = stencil.extents.size(); d-- > 0; padded *= stencil.extents[d] + 2) strides_[d] = padded;
  y_ = q_ = Vector::Zero(padded);
  last_ = before_ = now_ = right_ = modes_ = Vector::Zero(n_);
  for (Index first = 0; first < n_; first += length_) {
    Line line{1, first, 0};
    Index rest = first / length_;
    for (std::size_t d = stencil.extents.size() - 1; d-- > 0; rest /= stencil.extents[d]) {
      const Index at = rest % stencil.extents[d];
      line.padded += (at + 1) * strides_[d];
      line.colour += int(at % 2);
    }
    line.colour %= 2;
    lines_.push_back(line);
  }
}

void FaceLcp::start_from(const Vector& y) { last_ = before_ = y; }

void FaceLcp::to_padded(const Vector& values, Vector& padded) const {
  for (const Line& line : lines_) padded.segment(line.padded, length_) = values.segment(line.first, length_);
}

void FaceLcp::relax(int colour) {
  const double keep = 1 - omega_, scale = omega_ / centre_;
  const std::size_t directions = strides_.size();
  for (const Line& line : lines_) {
    double* y = y_.data() + line.padded;
    const double* q = q_.data() + line.padded;
    const Index begin = (colour + line.colour) % 2;
    if (directions == 2) {
      const double *above = y - strides_[0], *below = y + strides_[0], b = beside_[0], c = beside_[1];
      for (Index i = begin; i < length_; i += 2)
        y[i] = std::max(0.0, keep * y[i] - scale * (q[i] + b * (above[i] + below[i]) + c * (y[i - 1] + y[i + 1])));
      continue;
    }
    for (Index i = begin; i < length_; i += 2) {
      double sum = q[i];
      for (std::size_t d = 0; d < directions; ++d) sum += beside_[d] * (y[i - strides_[d]] + y[i + strides_[d]]);
      y[i] = std::max(0.0, keep * y[i] - scale * sum);
    }
  }
}

LcpOutcome FaceLcp::solve(const Vector& q, Vector& y) {
  LcpOutcome outcome;
  if (!q.allFinite()) return outcome;
  now_ = (2 * last_ - before_).cwiseMax(0);
  to_padded(now_, y_);
  while (!outcome.solved && outcome.newton < most_products) {
    transform_(now_.data(), modes_.data());
    modes_.array() *= w0_.array() - shift_;
    transform_(modes_.data(), right_.data());
    right_ += q;
    to_padded(right_, q_);
    for (int k = 0; k < relaxations; ++k)
      for (const int colour : {0, 1}) relax(colour);
    double moved = 0, largest = 1;
    for (const Line& line : lines_) {
      const auto next = y_.segment(line.padded, length_);
      auto kept = now_.segment(line.first, length_);
      moved = std::max(moved, (next - kept).cwiseAbs().maxCoeff());
      largest = std::max(largest, next.maxCoeff());
      kept = next;
    }
    ++outcome.newton;
    outcome.solved = moved <= settled * largest;
  }
  if (!outcome.solved) return outcome;
  y = now_;
  before_.swap(last_);
  last_ = y;
  return outcome;
}

std::size_t FaceLcp::bytes() const { return sizeof(double) * std::size_t(2 * y_.size() + 6 * n_); }

}  // namespace bromwich::host
