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

namespace {

bool is_symmetric(const SparseMatrix& M) {
  const SparseMatrix transposed = M.transpose();
  return (M - transposed).norm() == 0;
}

// min_i m_ii - Σ_{j != i} |m_ij|: no eigenvalue of a symmetric M is smaller.
double lowest_by_gershgorin(const SparseMatrix& M) {
  const Vector sums = M.cwiseAbs() * Vector::Ones(M.cols()), diagonal = M.diagonal();
  return (diagonal - sums + diagonal.cwiseAbs()).minCoeff();
}

}  // namespace

std::unique_ptr<FaceLcp> FaceLcp::make(const LcpMatrix& M, const FaceBasis& basis, const Vector& w0,
                                       Transform transform) {
  if (const auto stencil = stencil_in(basis, M)) return make(*stencil, w0, std::move(transform));
  const SparseMatrix* sparse = sparse_of(M);
  return sparse ? make(*sparse, w0, std::move(transform)) : nullptr;
}

std::unique_ptr<FaceLcp> FaceLcp::make(const Stencil& stencil, const Vector& w0, Transform transform) {
  const Vector of_M = stencil.eigenvalues();
  if (!(of_M.minCoeff() > 0) || !((of_M + w0).minCoeff() > 0)) return nullptr;
  const InstantShift shift = instant_shift(of_M, w0);
  const Stencil shifted = stencil.shifted(shift.shift);
  if (!(shift.contraction < slow) || !(shifted.jacobi_radius() < 1)) return nullptr;
  std::unique_ptr<FaceLcp> made(new FaceLcp(w0, shift, best_relaxation(shifted), std::move(transform)));
  made->take(stencil);
  return made;
}

std::unique_ptr<FaceLcp> FaceLcp::make(const SparseMatrix& M, const Vector& w0, Transform transform) {
  const double lowest = M.rows() > 0 && is_symmetric(M) ? lowest_by_gershgorin(M) : 0;
  if (!(lowest > 0) || !(lowest + w0.minCoeff() > 0)) return nullptr;
  const InstantShift shift = instant_shift(Vector::Constant(w0.size(), lowest), w0);
  if (!(shift.contraction < slow)) return nullptr;
  const Vector diagonal = M.diagonal().array() + shift.shift;
  const Vector beside = M.cwiseAbs() * Vector::Ones(M.cols()) - M.diagonal().cwiseAbs();
  const double radius = (beside.array() / diagonal.array()).maxCoeff();  // below 1: lowest + D is positive
  const double omega = 2 / (1 + std::sqrt(std::max(0.0, 1 - radius * radius)));
  std::unique_ptr<FaceLcp> made(new FaceLcp(w0, shift, omega, std::move(transform)));
  made->take(M);
  return made;
}

FaceLcp::FaceLcp(const Vector& w0, const InstantShift& shift, double omega, Transform transform)
    : n_(w0.size()), w0_(w0), shift_(shift.shift), omega_(omega), transform_(std::move(transform)) {
  last_ = before_ = now_ = right_ = modes_ = Vector::Zero(n_);
}

void FaceLcp::take(const Stencil& stencil) {
  length_ = stencil.extents.back();
  centre_ = stencil.centre + shift_;
  beside_ = stencil.beside;
  strides_.resize(stencil.extents.size());
  Index padded = 1;
  for (std::size_t d = stencil.extents.size(); d-- > 0; padded *= stencil.extents[d] + 2) strides_[d] = padded;
  y_ = q_ = Vector::Zero(padded);
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

// One line without padding.
void FaceLcp::take(const SparseMatrix& M) {
  SparseMatrix identity(n_, n_);
  identity.setIdentity();
  rows_ = M + shift_ * identity;
  step_ = omega_ * Vector(rows_.diagonal()).cwiseInverse();
  length_ = n_;
  lines_ = {{0, 0, 0}};
  y_ = q_ = Vector::Zero(n_);
}

void FaceLcp::start_from(const Vector& y) { last_ = before_ = y; }

void FaceLcp::to_padded(const Vector& values, Vector& padded) const {
  for (const Line& line : lines_) padded.segment(line.padded, length_) = values.segment(line.first, length_);
}

void FaceLcp::relax() {
  if (step_.size() > 0) return relax_rows();
  for (const int colour : {0, 1}) relax_colour(colour);
}

void FaceLcp::relax_rows() {
  for (Index i = 0; i < n_; ++i) {
    double w = q_[i];
    for (Eigen::SparseMatrix<double, Eigen::RowMajor>::InnerIterator a(rows_, i); a; ++a) w += a.value() * y_[a.col()];
    y_[i] = std::max(0.0, y_[i] - step_[i] * w);
  }
}

void FaceLcp::relax_colour(int colour) {
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
    transform_(Way::to_modes, now_.data(), modes_.data());
    modes_.array() *= w0_.array() - shift_;
    transform_(Way::to_points, modes_.data(), right_.data());
    right_ += q;
    to_padded(right_, q_);
    for (int k = 0; k < relaxations; ++k) relax();
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

std::size_t FaceLcp::bytes() const {
  return sizeof(double) * std::size_t(2 * y_.size() + 6 * n_) + 16 * std::size_t(rows_.nonZeros());
}

}  // namespace bromwich::host
