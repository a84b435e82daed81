// Step-by-step solution with the state of a dense scene, in blocks of b steps. With Z = z at the last step s of the
// previous block, inputs u = (y, phi) and their input matrix G,
//
//     v_{s+i} = C E^{i-1} Z + Σ_{d=1}^{i-1} C E^{d-1} G u_{s+i-d} + W_0 y_{s+i},   1 <= i <= b,
//     z_{s+b} = E^b Z + Σ_{i=1}^{b} E^{b-i} G u_{s+i}.
//
// A step costs m^2/b + 2 m (n + k) + n (n + k) b/2 multiplications instead of m^2 + m (2 n + k). x0 and f enter Z and u
// as y does, so no growing parts are computed separately and cancelled later. If E^b grows within a block, C E^{i-1} Z
// and the sum would cancel; therefore b is limited by ||E^i||.

#include "cpu/march_step.hpp"
#include "cpu/parts.hpp"

#include <cmath>
#include <vector>

namespace bromwich::cpu {

using host::invalidate;
using host::Poll;

namespace {

constexpr Index smallest_blocked = 48;  ///< m; below it a step costs less than the LCP
constexpr Index most_block_steps = 32;
constexpr double most_growth = 8;  ///< of a state within a block: at most one digit is lost
constexpr double product_advantage =
    6;  ///< multiplications per time of one memory-bound multiplication, in a matrix product

double growth_of(const Matrix& E) { return E.cwiseAbs().rowwise().sum().maxCoeff(); }

// E^b for the power of two b with the smallest cost over all rows.
struct BlockPower {
  Index b = 1;
  Matrix power;

  BlockPower() = default;
  BlockPower(const DenseRecurrence& r, Index inputs, Index rows) : power(r.decay) {
    const double m = double(r.decay.rows()), n = double(r.output.rows()), u = double(inputs), J = double(rows);
    if (m < double(smallest_blocked)) return;
    const auto cost = [&](double steps) {
      return J * (m * m / steps + n * u * steps / 2) +
             (std::log2(steps) * m * m * m + steps * (n + u) * m * m) / product_advantage;
    };
    double limit = growth_of(power);
    while (b < most_block_steps && limit <= most_growth && cost(2.0 * double(b)) < cost(double(b))) {
      Matrix squared = power * power;
      const double growth = growth_of(squared);
      if (!(growth <= most_growth)) return;
      power.swap(squared);
      limit = growth;
      b *= 2;
    }
  }
};

class DenseMarch final : public ImmediateMarch {
 public:
  DenseMarch(const MarchProblem& problem, const DenseRecurrence& r, Index rows, const LinearStep& linear)
      : r_(r),
        asked_to_stop_(problem),
        n_(r.output.rows()),
        response_(host(*problem.r)),
        start_(problem.start),
        forcing_(problem.forcing ? &host(*problem.forcing) : nullptr),
        M_(to_dense(*problem.M)),
        step_(problem, linear, M_, [&] { return Matrix(M_ + r.w0); }),
        z_(r.decay.rows()),
        next_(z_),
        q_(n_),
        y_(n_) {
    // Sources with few shapes are inputs like y; others add a vector to the state at each step.
    const bool few = problem.sources && 4 * problem.source_input->cols() <= z_.size();
    if (few) sources_ = problem.sources;
    inputs_ = n_ + (few ? problem.source_input->cols() : 0);
    if (forcing_ && !few)
      power_.power = r.decay;
    else
      power_ = BlockPower(r, inputs_, rows);
    Matrix G(z_.size(), inputs_);
    G.leftCols(n_) = r.input;
    if (few) G.rightCols(inputs_ - n_) = *problem.source_input;
    make_block(G);
  }

  MarchReport run(Array& y_array, Array& v_array) override {
    const FlushDenormals flush;
    RowMatrix &Y = host(y_array), &V = host(v_array);
    MarchReport report;
    report.well_posed = step_.well_posed();
    V.row(0).setZero();
    y_ = Y.row(0).transpose();
    step_.start_from(y_);
    z_.noalias() = r_.start * y_;
    if (start_) z_ += *start_;
    for (Index j = 1; j < Y.rows(); ++j) {
      if (asked_to_stop_(j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      const Index i = (j - 1) % power_.b;
      if (i == 0) begin_block(j);
      q_ = far_.segment(i * n_, n_);
      // near_ holds .., W_2, W_1 side by side: its last i blocks multiply the first i inputs of the block.
      if (i > 0) q_.noalias() += near_.rightCols(i * inputs_) * u_.head(i * inputs_);
      V.row(j) = q_.transpose();
      q_ += response_.row(j).transpose();
      if (!step_.solve(q_, y_, j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      Y.row(j) = y_.transpose();
      V.row(j).transpose().noalias() += r_.w0 * y_;
      u_.segment(i * inputs_, n_) = y_;
      if (sources_) u_.segment(i * inputs_ + n_, inputs_ - n_) = sources_->row(j).transpose();
    }
    return report;
  }

  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(power_.power.size() + seen_.size() + driven_.size() + near_.size()) +
           step_.bytes();
  }

 private:
  // C E^{i-1}, E^{b-i} G and C E^{d-1} G for the steps of a block.
  void make_block(const Matrix& G) {
    const Index b = power_.b, m = z_.size();
    seen_.resize(b * n_, m);
    driven_.resize(m, b * inputs_);
    near_.resize(n_, (b - 1) * inputs_);
    seen_.topRows(n_) = r_.output;
    driven_.rightCols(inputs_) = G;
    for (Index i = 1; i < b; ++i) {
      near_.middleCols((b - 1 - i) * inputs_, inputs_).noalias() = seen_.middleRows((i - 1) * n_, n_) * G;
      seen_.middleRows(i * n_, n_).noalias() = seen_.middleRows((i - 1) * n_, n_) * r_.decay;
      driven_.middleCols((b - 1 - i) * inputs_, inputs_).noalias() =
          r_.decay * driven_.middleCols((b - i) * inputs_, inputs_);
    }
    far_.resize(b * n_);
    u_ = Vector::Zero(b * inputs_);
  }

  // z at row j - 1, and its contribution to the rows of the block that begins at row j.
  void begin_block(Index j) {
    if (j > 1) {
      next_.noalias() = power_.power * z_;
      next_.noalias() += driven_ * u_;
      if (forcing_ && !sources_) next_ += forcing_->row(j - 1).transpose();
      z_.swap(next_);
    }
    far_.noalias() = seen_ * z_;
  }

  const DenseRecurrence& r_;
  Poll asked_to_stop_;
  Index n_, inputs_ = 0;
  const RowMatrix& response_;
  const Vector* start_;
  const RowMatrix* forcing_;
  const RowMatrix* sources_ = nullptr;
  Matrix M_;
  MarchStep step_;
  BlockPower power_;
  RowMatrix seen_;  ///< b n x m: C E^{i-1}, stacked
  Matrix driven_;   ///< m x b (n + k): E^{b-i} G, side by side
  Matrix near_;     ///< n x (b - 1)(n + k): C E^{d-1} G, largest lag first
  Vector z_, next_, q_, y_, far_, u_;
};

}  // namespace

std::unique_ptr<March> make_dense_march(const MarchProblem& problem, const DenseRecurrence& r, Index rows,
                                        const LinearStep& linear) {
  return std::make_unique<DenseMarch>(problem, r, rows, linear);
}

}  // namespace bromwich::cpu
