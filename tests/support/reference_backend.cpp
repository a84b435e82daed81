#include "tests/support/reference_backend.hpp"
#include "core/base/error.hpp"
#include "core/lcp/active_set.hpp"
#include "core/seam/shared_memory.hpp"
#include "tests/support/face_oracle.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

namespace bromwich {

namespace naive {
namespace {

class NaiveArray final : public Array {
 public:
  NaiveArray(Index rows, Index cols) : Array(rows, cols), values(RowMatrix::Zero(rows, cols)) {}
  RowMatrix values;
};

RowMatrix& values(Array& array) { return static_cast<NaiveArray&>(array).values; }
const RowMatrix& values(const Array& array) { return static_cast<const NaiveArray&>(array).values; }

template <class Derived>
std::size_t bytes_of(const Eigen::MatrixBase<Derived>& a) {
  return sizeof(double) * std::size_t(a.size());
}

class NaiveTransform final : public RowTransform {
 public:
  NaiveTransform(const FaceBasis& basis, Way way) : transform_(basis, way) {}
  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    for (Index j = first; j < in.rows(); ++j) {
      Vector v = transform_(values(in).row(j).transpose());
      if (add) v += values(*add).row(j).transpose();
      values(out).row(j) = v.transpose();
    }
  }
  std::size_t bytes() const override { return 0; }

 private:
  FaceOracle transform_;
};

// Steps the state z of a recurrence: `known` is v_j without W_0 u_j, `take` advances with u_j.
class Recursion {
 public:
  virtual ~Recursion() = default;
  virtual void start(const Vector& u0) = 0;
  virtual Vector known(Index j) const = 0;
  virtual Vector implicit(const Vector& u) const = 0;  ///< W_0 u
  virtual void take(Index j, const Vector& u) = 0;
};

class ModalRecursion final : public Recursion {
 public:
  explicit ModalRecursion(const ModalRecurrence& r) : r_(r) {}
  void start(const Vector& u0) override {
    z_ = r_.start;
    for (Index k = 0; k < z_.rows(); ++k) z_.row(k) = z_.row(k).cwiseProduct(u0.transpose());
    if (r_.initial.size() > 0) z_ += r_.initial;
    last_ = r_.s1.cwiseProduct(u0);
  }
  Vector known(Index) const override { return last_ + r_.output.cwiseProduct(z_).colwise().sum().transpose(); }
  Vector implicit(const Vector& u) const override { return r_.w0.cwiseProduct(u); }
  void take(Index, const Vector& u) override {
    for (Index k = 0; k < z_.rows(); ++k) z_.row(k) = r_.decay.row(k).cwiseProduct(z_.row(k)) + u.transpose();
    last_ = r_.w1.cwiseProduct(u);
  }

 private:
  const ModalRecurrence& r_;
  RowMatrix z_;
  Vector last_;
};

class DenseRecursion final : public Recursion {
 public:
  DenseRecursion(const DenseRecurrence& r, const MarchProblem* march) : r_(r), march_(march) {}
  void start(const Vector& u0) override {
    z_ = r_.start * u0;
    if (march_ && march_->start) z_ += *march_->start;
  }
  Vector known(Index) const override { return r_.output * z_; }
  Vector implicit(const Vector& u) const override { return r_.w0 * u; }
  void take(Index j, const Vector& u) override {
    z_ = r_.decay * z_ + r_.input * u;
    if (march_ && march_->forcing) z_ += values(*march_->forcing).row(j).transpose();
  }

 private:
  const DenseRecurrence& r_;
  const MarchProblem* march_;
  Vector z_;
};

class LagRecursion final : public Recursion {
 public:
  explicit LagRecursion(const LagTable& table) : table_(table) {}
  void start(const Vector& u0) override { past_ = {u0}; }
  Vector known(Index j) const override {
    Vector v = product(table_.S, j, past_[0]);
    for (Index d = 1; d < j; ++d) v += product(table_.W, d, past_[std::size_t(j - d)]);
    return v;
  }
  Vector implicit(const Vector& u) const override { return product(table_.W, 0, u); }
  void take(Index, const Vector& u) override { past_.push_back(u); }

 private:
  Vector product(const RowMatrix& rows, Index d, const Vector& u) const {
    if (table_.modal) return rows.row(d).transpose().cwiseProduct(u);
    return Eigen::Map<const RowMatrix>(rows.row(d).data(), table_.outputs, table_.inputs) * u;
  }
  const LagTable& table_;
  std::vector<Vector> past_;
};

std::unique_ptr<Recursion> recursion(WeightsRef weights, const MarchProblem* march = nullptr) {
  if (const auto* modal = std::get_if<const ModalRecurrence*>(&weights))
    return std::make_unique<ModalRecursion>(**modal);
  if (const auto* dense = std::get_if<const DenseRecurrence*>(&weights))
    return std::make_unique<DenseRecursion>(**dense, march);
  return std::make_unique<LagRecursion>(*std::get<const LagTable*>(weights));
}

Weights copy_of(WeightsRef weights) {
  if (const auto* modal = std::get_if<const ModalRecurrence*>(&weights)) return Recurrence(**modal);
  if (const auto* dense = std::get_if<const DenseRecurrence*>(&weights)) return Recurrence(**dense);
  return *std::get<const LagTable*>(weights);
}

std::size_t bytes_of(WeightsRef weights) {
  if (const auto* modal = std::get_if<const ModalRecurrence*>(&weights))
    return 3 * bytes_of((*modal)->decay) + 3 * bytes_of((*modal)->w0);
  if (const auto* dense = std::get_if<const DenseRecurrence*>(&weights))
    return bytes_of((*dense)->decay) + 3 * bytes_of((*dense)->input) + bytes_of((*dense)->w0);
  return 2 * bytes_of(std::get<const LagTable*>(weights)->W);
}

WeightsRef reference_to(const Weights& weights) {
  const auto* recurrence = std::get_if<Recurrence>(&weights);
  return recurrence ? weights_ref(*recurrence) : weights_ref(std::get<LagTable>(weights));
}

class NaiveConvolution final : public Convolution {
 public:
  explicit NaiveConvolution(WeightsRef weights)
      : weights_(copy_of(weights)), recursion_(recursion(reference_to(weights_))) {}
  void apply(const Array& y, Array& v, Index) override {
    const RowMatrix& Y = values(y);
    values(v).row(0).setZero();
    recursion_->start(Y.row(0).transpose());
    for (Index j = 1; j < Y.rows(); ++j) {
      const Vector u = Y.row(j).transpose();
      values(v).row(j) = (recursion_->known(j) + recursion_->implicit(u)).transpose();
      recursion_->take(j, u);
    }
  }
  std::size_t bytes() const override { return bytes_of(reference_to(weights_)); }

 private:
  Weights weights_;
  std::unique_ptr<Recursion> recursion_;
};

class NaiveLcp final : public ImmediateLcpBatch {
 public:
  NaiveLcp(const LcpMatrix& M, LcpClass lcp_class, double shift)
      : M_(to_dense(M)),
        shift_(shift),
        solver_(M_ + shift * Matrix::Identity(M_.rows(), M_.rows()),
                selection_class(M_ + shift * Matrix::Identity(M_.rows(), M_.rows()), lcp_class)) {}

  double residual(const Array& r, const Array& v, const Array& y) override {
    double worst = 0;
    for (Index j = 0; j < y.rows(); ++j) {
      const Vector q = (values(r).row(j) + values(v).row(j)).transpose(), Y = values(y).row(j).transpose();
      const Vector w = M_ * Y + q;
      if (!w.allFinite() || !Y.allFinite()) return NAN;
      if (q.size() > 0)
        worst = std::max(worst, Y.cwiseMin(w).cwiseAbs().maxCoeff() / std::max(1.0, q.cwiseAbs().maxCoeff()));
    }
    return worst;
  }
  std::size_t bytes() const override { return bytes_of(M_); }

 protected:
  LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    LcpReport report;
    report.settled = first;
    bool settled = true;
    for (Index j = first; j < y.rows(); ++j) {
      const Vector old = values(y).row(j).transpose();
      const Vector q = (values(r).row(j) + values(v).row(j)).transpose() - shift_ * old;
      Vector now = old;
      LcpOutcome outcome;
      double change = NAN, size = 0;
      if (q.allFinite()) {
        solver_.start_from(old.allFinite() ? old : Vector(Vector::Zero(old.size())));
        outcome = solver_.solve(q, now);
        size = now.size() > 0 ? now.cwiseAbs().maxCoeff() : 0;
        change = now.size() > 0 ? (now - old).cwiseAbs().maxCoeff() / std::max(1.0, size) : 0;
        values(y).row(j) = now.transpose();
      }
      report.count.newton += outcome.newton;
      report.count.fallbacks += outcome.fallback;
      ++(outcome.solved ? report.count.solved : report.count.unsolved);
      if (outcome.infeasible && report.infeasible < 0) report.infeasible = j;
      report.finite = report.finite && std::isfinite(change);
      report.change = std::max(report.change, change);
      report.magnitude = std::max(report.magnitude, size);
      settled = settled && outcome.solved && change <= settle_tolerance;
      if (settled) report.settled = j + 1;
    }
    return report;
  }

 private:
  Matrix M_;
  double shift_;
  ActiveSetLcp solver_;
};

class NaiveMarch final : public ImmediateMarch {
 public:
  explicit NaiveMarch(const MarchProblem& problem)
      : problem_(problem),
        weights_(problem.lags ? weights_ref(*problem.lags) : weights_ref(*problem.recurrence)),
        modal_(std::holds_alternative<const ModalRecurrence*>(weights_)) {}

  MarchReport run(Array& y, Array& v) override {
    RowMatrix &Y = values(y), &V = values(v);
    const Index n = Y.cols();
    const Matrix M = to_dense(*problem_.M);
    const Matrix Q = modal_ ? FaceOracle(std::get<const ModalRecurrence*>(weights_)->basis(), Way::to_points).matrix()
                            : Matrix(Matrix::Identity(n, n));
    Matrix W(n, n);
    const auto z = recursion(weights_, &problem_);
    for (Index i = 0; i < n; ++i) W.col(i) = Q * z->implicit(Q.row(i).transpose());
    const LcpClass step_class = classify(LcpMatrix(Matrix(M + W)));
    const bool least = problem_.lcp_class == LcpClass::Z;
    ActiveSetLcp solver(M + W, step_class, least ? &M : nullptr);
    const auto drive = [&](Index j) {
      return problem_.drive ? Vector(Q.transpose() * values(*problem_.drive).row(j).transpose())
                            : Vector(Vector::Zero(n));
    };
    MarchReport report;
    report.well_posed = least || step_class == LcpClass::P || step_class == LcpClass::PSD;
    V.row(0).setZero();
    z->start(Q.transpose() * Y.row(0).transpose() + drive(0));
    for (Index j = 1; j < Y.rows(); ++j) {
      const Vector known = Q * (z->known(j) + z->implicit(drive(j)));
      const Vector q = values(*problem_.r).row(j).transpose() + known;
      Vector now;
      const bool stop = j % 64 == 0 && problem_.interrupted && problem_.interrupted();
      if (j % 64 == 0 && problem_.progress) problem_.progress(j);
      if (stop || !solved(solver, q, now, j, report)) {
        report.interrupted = stop;
        report.stopped = j;
        Y.bottomRows(Y.rows() - j).setConstant(NAN);
        V.bottomRows(V.rows() - j).setConstant(NAN);
        return report;
      }
      Y.row(j) = now.transpose();
      V.row(j) = (known + W * now).transpose();
      z->take(j, Q.transpose() * now + drive(j));
    }
    return report;
  }
  std::size_t bytes() const override { return bytes_of(weights_); }

 private:
  bool solved(ActiveSetLcp& solver, const Vector& q, Vector& y, Index j, MarchReport& report) const {
    report.finite = report.finite && q.allFinite();
    const LcpOutcome outcome = solver.solve(q, y);
    report.count.newton += outcome.newton;
    report.count.fallbacks += outcome.fallback;
    ++(outcome.solved ? report.count.solved : report.count.unsolved);
    if (outcome.infeasible && problem_.lcp_class != LcpClass::P) report.infeasible = j;
    return outcome.solved;
  }

  MarchProblem problem_;
  WeightsRef weights_;
  bool modal_;
};

class NaiveDifferences final : public Differences {
 public:
  explicit NaiveDifferences(std::size_t slots) : found_(slots, 0) {}
  void submit(std::size_t slot, const Array& a, const Array& b) override {
    double worst = 0;
    for (Index j = 0; j < a.rows(); ++j)
      for (Index i = 0; i < a.cols(); ++i) {
        const double size = std::max(1.0, values(a).row(j).cwiseAbs().maxCoeff());
        const double apart = std::abs(values(a)(j, i) - values(b)(j, i)) / size;
        worst = std::isfinite(apart) && std::isfinite(worst) ? std::max(worst, apart) : NAN;
      }
    found_[slot] = worst;
  }
  const std::vector<double>& collect() override { return found_; }
  std::size_t bytes() const override { return 0; }

 private:
  std::vector<double> found_;
};

class ReferenceBackend final : public Backend, public SharedMemory {
 public:
  explicit ReferenceBackend(const BackendTraits& traits) : Backend("reference", traits) {
    fused_.face_transform = [](const FaceBasis& basis, Index, Way way) {
      return std::make_unique<NaiveTransform>(basis, way);
    };
  }
  DeviceInfo device() const override { return {"naive loops", 1, ""}; }
  std::unique_ptr<Array> array(Index rows, Index cols) override { return std::make_unique<NaiveArray>(rows, cols); }
  void upload(const RowMatrix& from, Array& to) override { values(to).topRows(from.rows()) = from; }
  void download(const Array& from, RowMatrix& to) override { to = values(from); }
  void inject(const Array& fine, Array& coarse) override {
    const Index ratio = (fine.rows() - 1) / (coarse.rows() - 1);
    for (Index i = 0; i < coarse.rows(); ++i) values(coarse).row(i) = values(fine).row(ratio * i);
  }
  void interpolate(const Array& coarse, const Array* old, Array& fine) override {
    const Index ratio = (fine.rows() - 1) / (coarse.rows() - 1);
    const RowMatrix added = old ? RowMatrix(values(coarse) - values(*old)) : values(coarse);
    for (Index j = 0; j < fine.rows(); ++j) {
      const Index i = j / ratio;
      const double right = double(j % ratio) / double(ratio);
      values(fine).row(j) += (1 - right) * added.row(i);
      if (right > 0) values(fine).row(j) += right * added.row(i + 1);
    }
  }
  void add(const Array& b, double s, const Array& c, Array& a) override { values(a) = values(b) + s * values(c); }
  std::unique_ptr<Differences> differences(std::size_t slots) override {
    return std::make_unique<NaiveDifferences>(slots);
  }
  Place place() const override { return {}; }
  std::shared_ptr<double> numbers(Index count) override {
    return {new double[std::size_t(count)], std::default_delete<double[]>()};
  }
  void read(const double* from, Array& to) override {
    values(to) = Eigen::Map<const RowMatrix>(from, to.rows(), to.cols());
  }
  void write(const Array& from, double* to) override {
    Eigen::Map<RowMatrix>(to, from.rows(), from.cols()) = values(from);
  }
  void to_host(const void* from, std::size_t bytes, void* to) override { std::memcpy(to, from, bytes); }
  void add_product(const LcpMatrix& M, const Array& y, Array& q) override {
    values(q) += values(y) * to_dense(M).transpose();
  }
  std::unique_ptr<RowTransform> sine_transform(Index n, Index) override {
    return std::make_unique<NaiveTransform>(FaceBasis{n}, Way::to_modes);
  }
  std::unique_ptr<Convolution> convolution(WeightsRef weights, Index) override {
    return std::make_unique<NaiveConvolution>(weights);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass lcp_class, double D, Index) override {
    if (D != 0 && std::holds_alternative<Matrix>(M))
      throw Error("shift", "found a matrix that is not tridiagonal", "shift tridiagonal ones");
    return std::make_unique<NaiveLcp>(M, lcp_class, D);
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index) override {
    return std::make_unique<NaiveMarch>(problem);
  }
};

}  // namespace
}  // namespace naive

std::unique_ptr<Backend> make_reference_backend(const BackendTraits& traits) {
  return std::make_unique<naive::ReferenceBackend>(traits);
}

}  // namespace bromwich
