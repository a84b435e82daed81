// symbol              variable           shape
// ζ_j                 Scan::z            rows of the state x time points of a block
// P^T y_j             Scan::p            n x (time points of a block + 1), the last one of the block before first
// U, D, P             PoleModel          see core/host/pole_model.hpp

#include "core/kernel/pole_plans.hpp"

#include "core/base/denormals.hpp"
#include "core/host/step_lcp.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace pole_plans {

namespace {

constexpr Index block = 128;     ///< time points of a block
constexpr Index together = 256;  ///< rows of the state that a thread takes at once
constexpr Index outputs_together = 32;

// The driven rows of the state, for blocks of consecutive time points.
class Scan {
 public:
  Scan(const PoleRecurrence& recurrence, Index first_output, Index outputs)
      : model_(recurrence.model),
        factors_(pole_factors(*model_, recurrence.h)),
        first_(first_output),
        outputs_(outputs),
        z_(Vector::Zero(model_->driven)) {}

  // v(j) = U ζ_j + D y_j for j = first .. first + count - 1; y(first - 1) is the last row of the block before.
  void run(const HostThreads& threads, const RowMatrix& y, Index first, Index count, RowMatrix& v) {
    const PoleModel& m = *model_;
    p_.resize(m.n, count + 1);
    states_.resize(m.driven, count);
    p_.noalias() = m.basis.transpose() * y.middleRows(first - 1, count + 1).transpose();
    share(threads, m.driven, together, [&](Index a, Index b) { advance(a, b, count); });
    share(threads, outputs_, outputs_together, [&](Index a, Index b) {
      v.block(first, a, count, b - a).noalias() =
          states_.transpose() * m.output.block(first_ + a, 0, b - a, m.driven).transpose() +
          y.middleRows(first, count) * m.direct.block(first_ + a, 0, b - a, m.n).transpose();
    });
    z_ = states_.rightCols(1);
  }

  std::size_t bytes() const { return sizeof(double) * std::size_t((block + 4) * model_->driven + block * model_->n); }

 private:
  void advance(Index a, Index b, Index count) {
    const PoleModel& m = *model_;
    for (Index t = 0; t < count; ++t) {
      const double* z = t > 0 ? &states_(0, t - 1) : z_.data();
      const double *before = &p_(0, t), *now = &p_(0, t + 1);
      double* next = &states_(0, t);
      for (Index i = a; i < b; ++i) {
        const Index d = m.direction[std::size_t(i)];
        next[i] = factors_.decay[i] * z[i] + factors_.before[i] * before[d] + factors_.behind[i] * now[d];
      }
    }
  }

  std::shared_ptr<const PoleModel> model_;
  PoleFactors factors_;
  Index first_, outputs_;
  Matrix p_, states_;
  Vector z_;
};

RowMatrix convolved(const HostThreads& threads, const PoleRecurrence& recurrence, const RowMatrix& y, Index first,
                    Index outputs) {
  Scan scan(recurrence, first, outputs);
  RowMatrix v = RowMatrix::Zero(y.rows(), outputs);
  for (Index j = 1; j < y.rows(); j += block) scan.run(threads, y, j, std::min(block, y.rows() - j), v);
  return v;
}

class PoleConvolution final : public Convolution {
 public:
  PoleConvolution(Backend& backend, PoleRecurrence recurrence)
      : backend_(backend), recurrence_(std::move(recurrence)) {}

  // Rows before `first` are computed again: the state at `first` is not kept.
  void apply(const Array& y, Array& v, Index) override {
    backend_.download(y, y_);
    backend_.upload(convolved(backend_, recurrence_, y_, 0, recurrence_.model->n), v);
  }
  bool recorded() const override { return false; }
  std::size_t bytes() const override {
    return recurrence_.model->bytes() + sizeof(double) * std::size_t(2 * y_.size() + block * recurrence_.model->driven);
  }

 private:
  Backend& backend_;
  PoleRecurrence recurrence_;
  RowMatrix y_;
};

// Step by step. The part of ζ_j that y_j does not enter comes first.
class PoleMarch final : public ImmediateMarch {
 public:
  PoleMarch(Backend& backend, const MarchProblem& problem, const PoleRecurrence& recurrence)
      : backend_(backend),
        model_(recurrence.model),
        factors_(pole_factors(*model_, recurrence.h)),
        asked_to_stop_(problem),
        r_(*problem.r),
        U_(model_->output.topLeftCorner(model_->n, model_->driven)),
        W0_(implicit_part(recurrence)),
        lcp_(to_dense(*problem.M) + W0_, to_dense(*problem.M), problem.lcp_class) {}

  MarchReport run(Array& y_array, Array& v_array) override {
    const FlushDenormals flush;
    const PoleModel& m = *model_;
    RowMatrix Y, V, r;
    backend_.download(y_array, Y);
    backend_.download(r_, r);
    V = RowMatrix::Zero(Y.rows(), m.n);
    MarchReport report;
    report.well_posed = lcp_.well_posed();
    Vector y = Y.row(0).transpose(), q(m.n), z = Vector::Zero(m.driven), p = m.basis.transpose() * y, free(m.n);
    lcp_.start_from(y);
    for (Index j = 1; j < Y.rows(); ++j) {
      bool stopped = asked_to_stop_(j, report);
      if (!stopped) {
        for (Index i = 0; i < m.driven; ++i)
          z[i] = factors_.decay[i] * z[i] + factors_.before[i] * p[m.direction[std::size_t(i)]];
        see(z, free);
        q = r.row(j).transpose() + free;
        stopped = !lcp_.solve(q, y, j, report);
      }
      if (stopped) {
        host::invalidate(Y, V, j);
        break;
      }
      Y.row(j) = y.transpose();
      V.row(j).transpose() = free + W0_ * y;
      p.noalias() = m.basis.transpose() * y;
      for (Index i = 0; i < m.driven; ++i) z[i] += factors_.behind[i] * p[m.direction[std::size_t(i)]];
    }
    backend_.upload(Y, y_array);
    backend_.upload(V, v_array);
    return report;
  }

  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(2 * U_.size() + W0_.size() + 4 * model_->driven) + lcp_.bytes();
  }

 private:
  // U z. A matrix of a few MB and more is read by all threads.
  void see(const Vector& z, Vector& free) const {
    if (U_.size() < parallel_size) {
      free.noalias() = U_ * z;
      return;
    }
    share(backend_, U_.rows(), (U_.rows() + backend_.threads() - 1) / backend_.threads(),
          [&](Index a, Index b) { free.segment(a, b - a).noalias() = U_.middleRows(a, b - a) * z; });
  }
  static constexpr Index parallel_size = 1 << 19;

  Backend& backend_;
  std::shared_ptr<const PoleModel> model_;
  PoleFactors factors_;
  host::Poll asked_to_stop_;
  const Array& r_;
  RowMatrix U_;
  Matrix W0_;
  host::StepLcp lcp_;
};

}  // namespace

}  // namespace pole_plans

PoleFactors pole_factors(const PoleModel& model, double h) {
  const ArrayPhi phi = array_phi(h * model.poles.array());
  return {phi.exponential, h * (phi.phi1 - phi.phi2), h * phi.phi2};
}

Matrix implicit_part(const PoleRecurrence& recurrence) {
  const PoleModel& m = *recurrence.model;
  const PoleFactors f = pole_factors(m, recurrence.h);
  Matrix in_P = Matrix::Zero(m.n, m.n);
  for (Index i = 0; i < m.driven; ++i) in_P.col(m.direction[std::size_t(i)]) += f.behind[i] * m.output.col(i).head(m.n);
  return m.direct.topLeftCorner(m.n, m.n) + in_P * m.basis.transpose();
}

Matrix at_minus_one(const PoleRecurrence& recurrence) {
  const PoleModel& m = *recurrence.model;
  const ArrayPhi phi = array_phi(recurrence.h * m.poles.array());
  const Eigen::ArrayXd sum = recurrence.h * (phi.phi2 - phi.phi1.square() / (1 + phi.exponential));
  Matrix in_P = Matrix::Zero(m.n, m.n);
  for (Index i = 0; i < m.driven; ++i) in_P.col(m.direction[std::size_t(i)]) += sum[i] * m.output.col(i).head(m.n);
  return m.direct.topLeftCorner(m.n, m.n) + in_P * m.basis.transpose();
}

RowMatrix seen_components(const HostThreads& threads, const PoleRecurrence& recurrence, const RowMatrix& y) {
  return pole_plans::convolved(threads, recurrence, y, recurrence.model->n, recurrence.model->components);
}

RowMatrix transposed_convolution(const HostThreads& threads, const PoleRecurrence& recurrence, const RowMatrix& u) {
  using pole_plans::block;
  const PoleModel& m = *recurrence.model;
  const PoleFactors f = pole_factors(m, recurrence.h);
  const auto U = m.output.topLeftCorner(m.n, m.driven), D = m.direct.topLeftCorner(m.n, m.n);
  RowMatrix result = RowMatrix::Zero(u.rows(), m.n);
  Matrix a, in_P;  // driven x (count + 1) with the first row of the block behind last, n x count
  Vector behind = Vector::Zero(m.driven);
  for (Index end = u.rows(); end > 0;) {
    const Index first = std::max<Index>(0, end - block), count = end - first;
    a.resize(m.driven, count + 1);
    a.leftCols(count).noalias() = U.transpose() * u.middleRows(first, count).transpose();
    if (first == 0) a.col(0).setZero();  // v_0 = 0
    a.col(count) = behind;
    share(threads, m.driven, pole_plans::together, [&](Index from, Index to) {
      for (Index t = count - 1; t >= 0; --t)
        for (Index i = from; i < to; ++i) a(i, t) += f.decay[i] * a(i, t + 1);
    });
    in_P = Matrix::Zero(m.n, count);
    for (Index t = 0; t < count; ++t) {
      const bool start = first + t == 0;
      for (Index i = 0; i < m.driven; ++i)
        in_P(m.direction[std::size_t(i)], t) += (start ? 0 : f.behind[i] * a(i, t)) + f.before[i] * a(i, t + 1);
    }
    result.middleRows(first, count).noalias() = (m.basis * in_P).transpose() + u.middleRows(first, count) * D;
    if (first == 0) result.row(0) = (m.basis * in_P.col(0)).transpose();
    behind = a.col(0);
    end = first;
  }
  return result;
}

RowMatrix free_response(const HostThreads& threads, const PoleRecurrence& recurrence, const RowMatrix& phi,
                        Index rows) {
  const PoleModel& m = *recurrence.model;
  const Index outputs = m.n + m.components, others = m.rows() - m.driven;
  RowMatrix free = RowMatrix::Zero(rows, outputs);
  if (phi.size() > 0 && m.sources == 0) free = pole_plans::convolved(threads, recurrence, phi, 0, outputs);
  if (others == 0) return free;
  const PoleFactors f = pole_factors(m, recurrence.h);
  RowMatrix states = RowMatrix::Zero(rows, others);
  for (Index i = 0; i < others; ++i) {
    const Index row = m.driven + i;
    const bool forced = i < m.forced;
    const Index d = forced ? m.direction[std::size_t(row)] : 0;
    double z = forced ? 0 : 1;
    for (Index j = 1; j < rows; ++j) {
      z *= f.decay[row];
      if (forced) z += f.before[row] * phi(j - 1, d) + f.behind[row] * phi(j, d);
      states(j, i) = z;
    }
  }
  free.noalias() += states * m.output.rightCols(others).transpose();
  if (m.sources > 0 && phi.size() > 0)
    free.bottomRows(rows - 1).noalias() += phi.bottomRows(rows - 1) * m.direct.rightCols(m.sources).transpose();
  return free;
}

std::unique_ptr<Convolution> make_pole_convolution(Backend& backend, const PoleRecurrence& recurrence, Index) {
  return std::make_unique<pole_plans::PoleConvolution>(backend, recurrence);
}

std::unique_ptr<March> make_march(Backend& backend, const MarchProblem& problem, const Weights& weights, Index rows) {
  if (const auto* poles = std::get_if<PoleRecurrence>(&weights))
    return std::make_unique<pole_plans::PoleMarch>(backend, problem, *poles);
  MarchProblem with = problem;
  with.recurrence = std::get_if<Recurrence>(&weights);
  with.lags = std::get_if<LagTable>(&weights);
  return backend.march(with, rows);
}

}  // namespace bromwich
