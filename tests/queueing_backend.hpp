#pragma once
// A backend that queues as a device does: batches and marches are begun and looked at later, and operations are
// recorded and replayed. The CPU does the work, at once.

#include "core/seam/affine_chain.hpp"
#include "core/seam/backend.hpp"
#include "core/seam/step_chain.hpp"
#include "cpu/cpu_backend.hpp"

#include <utility>

namespace bromwich {

/// What happened, and the number of the batch that is to be left unsolved.
struct QueueLog {
  long batches = 0, marches = 0, replays = 0, waited = 0;
  bool modes = false;  ///< batches take modes
  long in_modes = 0;   ///< such batches
  long failing = -1;   ///< the number of a batch; its y stays as it is
  long failures = 1;   ///< how many from there
};

class QueueingBackend final : public Backend {
 public:
  explicit QueueingBackend(QueueLog& log) : log_(log), host_(make_cpu_backend(1)) {}

  std::string name() const override { return "queueing"; }
  DeviceInfo device() const override { return host_->device(); }
  std::unique_ptr<Program> record(Index, const std::function<void()>& operations) override {
    return std::make_unique<Replay>(log_, operations);
  }
  std::unique_ptr<Array> array(Index rows, Index cols) override { return host_->array(rows, cols); }
  void upload(const RowMatrix& from, Array& to) override { host_->upload(from, to); }
  void download(const Array& from, RowMatrix& to) override { host_->download(from, to); }
  void inject(const Array& fine, Array& coarse) override { host_->inject(fine, coarse); }
  void interpolate(const Array& coarse, const Array* old, Array& fine) override {
    host_->interpolate(coarse, old, fine);
  }
  void restrict_problem(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                        Array& coarse_y, Array& old) override {
    host_->restrict_problem(r, v, y, coarse_v, coarse_r, coarse_y, old);
  }
  void add(const Array& b, double s, const Array& c, Array& a) override { host_->add(b, s, c, a); }
  double difference(const Array& a, const Array& b) override { return host_->difference(a, b); }
  bool alternates(const Array& y, Index run, double part) override { return host_->alternates(y, run, part); }
  std::unique_ptr<SineTransform> sine_transform(Index n, Index rows) override { return host_->sine_transform(n, rows); }
  std::unique_ptr<Convolution> convolution(const Recurrence& r, Index rows) override {
    return host_->convolution(r, rows);
  }
  std::unique_ptr<Convolution> convolution(const LagTable& t, Index rows) override {
    return host_->convolution(t, rows);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass c, double D, Index rows) override {
    return std::make_unique<Batch>(log_, *host_, host_->shifted_lcp(M, c, D, rows));
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index rows) override {
    return std::make_unique<QueuedMarch>(log_, host_->march(problem, rows));
  }
  std::unique_ptr<StageMarch> stage_march(const StageProblem& problem, Index rows) override {
    return host_->stage_march(problem, rows);
  }
  std::unique_ptr<StepChain> step_chain(const StepChainProblem& problem) override { return host_->step_chain(problem); }
  std::unique_ptr<AffineChain> affine_chain(const AffineChainSizes& sizes) override {
    return host_->affine_chain(sizes);
  }
  ComplexMatrix resolvent(const Dynamics& dynamics, const ComplexVector& nodes) override {
    return host_->resolvent(dynamics, nodes);
  }

 private:
  struct Replay final : Program {
    Replay(QueueLog& log, std::function<void()> operations) : log(log), operations(std::move(operations)) {}
    void run() override {
      ++log.replays;
      operations();
    }
    QueueLog& log;
    std::function<void()> operations;
  };

  struct Batch final : LcpBatch {
    Batch(QueueLog& log, Backend& host, std::unique_ptr<LcpBatch> plan) : log(log), host(host), plan(std::move(plan)) {}
    LcpReport solve(const Array& r, const Array& v, Array& y, Index first, double settle) override {
      ++log.waited;
      return plan->solve(r, v, y, first, settle);
    }
    bool queues() const override { return true; }
    void start(const Array& r, const Array& v, Array& y, Index first, double settle) override {
      const long batch = log.batches++;
      if (log.failing >= 0 && batch >= log.failing && batch < log.failing + log.failures) {
        ++sum.count.unsolved;
        return;
      }
      const LcpReport report = plan->solve(r, v, y, first, settle);
      sum.count.solved += report.count.solved;
      sum.count.newton += report.count.newton;
      sum.count.unsolved += report.count.unsolved;
    }
    LcpReport collect() override { return std::exchange(sum, {}); }
    bool takes_modes() const override { return log.modes; }
    void start_in_modes(SineTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y, Array* y_modes,
                        Index first) override {
      ++log.in_modes;
      const auto values = host.array(v.rows(), v.cols());
      if (v_in_modes) S.apply(v, nullptr, *values, 0);  // all rows: products of others round otherwise
      start(r, v_in_modes ? *values : v, y, first, -1);
      if (y_modes) S.apply(y, nullptr, *y_modes, 0);
    }
    double residual(const Array& r, const Array& v, const Array& y) override { return plan->residual(r, v, y); }
    std::size_t bytes() const override { return plan->bytes(); }

    QueueLog& log;
    Backend& host;
    std::unique_ptr<LcpBatch> plan;
    LcpReport sum;
  };

  struct QueuedMarch final : March {
    QueuedMarch(QueueLog& log, std::unique_ptr<March> plan) : log(log), plan(std::move(plan)) {}
    MarchReport run(Array& y, Array& v) override { return plan->run(y, v); }
    bool queues() const override { return true; }
    void start(Array& y, Array& v) override {
      ++log.marches;
      const MarchReport report = plan->run(y, v);
      sum.count.solved += report.count.solved;
      sum.count.newton += report.count.newton;
      if (report.stopped >= 0) sum.stopped = 0;
    }
    MarchReport collect() override { return std::exchange(sum, {}); }
    std::size_t bytes() const override { return plan->bytes(); }

    QueueLog& log;
    std::unique_ptr<March> plan;
    MarchReport sum;
  };

  QueueLog& log_;
  std::unique_ptr<Backend> host_;
};

}  // namespace bromwich
