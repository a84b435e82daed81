#pragma once
// A backend that queues like a device: batches and marches are submitted and collected, operations are recorded and
// replayed. The CPU does the work, at once.

#include "cpu/cpu_backend.hpp"
#include "tests/support/forwarding_backend.hpp"

#include <utility>

namespace bromwich {

/// Log of the calls, and which batches to leave unsolved.
struct QueueLog {
  long batches = 0, marches = 0, replays = 0, waited = 0;
  bool modes = false;  ///< batches support submit_in_modes
  long in_modes = 0;   ///< number of batches in modes
  long failing = -1;   ///< first batch to fail; its y is left unchanged
  long failures = 1;   ///< number of failing batches
};

class QueueingBackend final : public ForwardingBackend {
 public:
  explicit QueueingBackend(QueueLog& log) : ForwardingBackend("queueing", make_cpu_backend(1)), log_(log) {
    fused_ = inner().fused();
    fused_.record = [this](Index, const std::function<void()>& operations) -> std::function<void()> {
      return [this, operations] {
        ++log_.replays;
        operations();
      };
    };
  }

  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass c, double D, Index rows) override {
    return std::make_unique<Batch>(log_, inner(), inner().shifted_lcp(M, c, D, rows));
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index rows) override {
    return std::make_unique<QueuedMarch>(log_, inner().march(problem, rows));
  }

 private:
  struct Batch final : LcpBatch {
    Batch(QueueLog& log, Backend& host, std::unique_ptr<LcpBatch> plan)
        : LcpBatch(false), log(log), host(host), plan(std::move(plan)) {
      if (log.modes)
        submit_in_modes = [this](RowTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y,
                                 Array* y_modes, Index first) { in_modes(S, r, v, v_in_modes, y, y_modes, first); };
    }
    void submit(const Array& r, const Array& v, Array& y, Index first, double settle) override {
      if (settle >= 0) {
        ++log.waited;
        last = plan->solve(r, v, y, first, settle);
        return;
      }
      const long batch = log.batches++;
      if (log.failing >= 0 && batch >= log.failing && batch < log.failing + log.failures) {
        ++sum.count.unsolved;
        return;
      }
      sum.add(plan->solve(r, v, y, first));
    }
    LcpReport finish(const Array&, const Array&, Array&, Index, double) override { return last; }
    LcpReport collect() override { return std::exchange(sum, {}); }
    void in_modes(RowTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y, Array* y_modes,
                  Index first) {
      ++log.in_modes;
      const auto values = host.array(v.rows(), v.cols());
      if (v_in_modes) S.apply(v, nullptr, *values, 0);  // all rows: products of fewer rows may round differently
      submit(r, v_in_modes ? *values : v, y, first, -1);
      if (y_modes) S.apply(y, nullptr, *y_modes, 0);
    }
    double residual(const Array& r, const Array& v, const Array& y) override { return plan->residual(r, v, y); }
    std::size_t bytes() const override { return plan->bytes(); }

    QueueLog& log;
    Backend& host;
    std::unique_ptr<LcpBatch> plan;
    LcpReport last, sum;
  };

  struct QueuedMarch final : March {
    QueuedMarch(QueueLog& log, std::unique_ptr<March> plan) : March(false), log(log), plan(std::move(plan)) {}
    MarchReport run(Array& y, Array& v) override { return plan->run(y, v); }
    void submit(Array& y, Array& v) override {
      ++log.marches;
      const MarchReport report = plan->run(y, v);
      sum.count += report.count;
      if (report.stopped >= 0) sum.stopped = 0;
    }
    MarchReport collect() override { return std::exchange(sum, {}); }
    std::size_t bytes() const override { return plan->bytes(); }

    QueueLog& log;
    std::unique_ptr<March> plan;
    MarchReport sum;
  };

  QueueLog& log_;
};

}  // namespace bromwich
