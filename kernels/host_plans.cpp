#include "kernels/host_plans.hpp"

namespace bromwich::cuda {

void upload(const Device& device, const RowMatrix& from, Array& to) {
  const std::size_t width = sizeof(double) * std::size_t(from.cols());
  if (from.size() == 0) return;
  check(cudaMemcpy2DAsync(values(to), sizeof(double) * std::size_t(stride(from.cols())), from.data(), width, width,
                          std::size_t(from.rows()), cudaMemcpyHostToDevice, device.stream()),
        "copying to the device");
  device.wait();
}

void download(const Device& device, const Array& from, RowMatrix& to, const std::function<void()>& meanwhile) {
  to.resize(from.rows(), from.cols());
  if (to.size() == 0) return meanwhile ? meanwhile() : void();
  device.fetcher().fetch(values(from), std::size_t(stride(from.cols())), to.data(), std::size_t(from.cols()),
                         std::size_t(from.rows()), device.stream(), meanwhile);
}

namespace {

/// An array of the host backend that mirrors a device array.
class Twin {
 public:
  Twin(const Device& device, Backend& host, Index rows, Index cols)
      : device_(device), host_(host), array(host.array(rows, cols)) {}
  Twin(const Device& device, Backend& host, const Array& from) : Twin(device, host, from.rows(), from.cols()) {
    fetch(from);
  }

  void fetch(const Array& from) {
    download(device_, from, values_);
    host_.upload(values_, *array);
  }
  void send(Array& to) {
    host_.download(*array, values_);
    upload(device_, values_, to);
  }

 private:
  const Device& device_;
  Backend& host_;
  RowMatrix values_;

 public:
  std::unique_ptr<Array> array;
};

std::unique_ptr<Twin> twin(const Device& device, Backend& host, const Array* from) {
  return from ? std::make_unique<Twin>(device, host, *from) : nullptr;
}

class HostLcp final : public ImmediateLcpBatch {
 public:
  HostLcp(const Device& device, Backend& host, const LcpMatrix& M, LcpClass lcp_class, double shift, Index rows)
      : r_(device, host, rows, size(M)),
        v_(device, host, rows, size(M)),
        y_(device, host, rows, size(M)),
        plan_(host.shifted_lcp(M, lcp_class, shift, rows)) {}

  LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    fetch(r, v, y);
    const LcpReport report = plan_->solve(*r_.array, *v_.array, *y_.array, first, settle_tolerance);
    y_.send(y);
    return report;
  }
  double residual(const Array& r, const Array& v, const Array& y) override {
    fetch(r, v, y);
    return plan_->residual(*r_.array, *v_.array, *y_.array);
  }
  std::size_t bytes() const override { return 3 * y_.array->bytes() + plan_->bytes(); }

 private:
  void fetch(const Array& r, const Array& v, const Array& y) {
    r_.fetch(r);
    v_.fetch(v);
    y_.fetch(y);
  }

  Twin r_, v_, y_;
  std::unique_ptr<LcpBatch> plan_;
};

class HostMarch final : public ImmediateMarch {
 public:
  HostMarch(const Device& device, Backend& host, MarchProblem problem, Index rows)
      : given_r_(*problem.r),
        given_drive_(problem.drive),
        given_forcing_(problem.forcing),
        r_(device, host, *problem.r),
        drive_(twin(device, host, problem.drive)),
        forcing_(twin(device, host, problem.forcing)),
        y_(device, host, rows, problem.r->cols()),
        v_(device, host, rows, problem.r->cols()) {
    problem.r = r_.array.get();
    problem.drive = drive_ ? drive_->array.get() : nullptr;
    problem.forcing = forcing_ ? forcing_->array.get() : nullptr;
    plan_ = host.march(problem, rows);
  }

  MarchReport run(Array& y, Array& v) override {
    r_.fetch(given_r_);  // inputs may have changed since the last run
    if (drive_) drive_->fetch(*given_drive_);
    if (forcing_) forcing_->fetch(*given_forcing_);
    y_.fetch(y);
    const MarchReport report = plan_->run(*y_.array, *v_.array);
    y_.send(y);
    v_.send(v);
    return report;
  }
  std::size_t bytes() const override { return 3 * y_.array->bytes() + plan_->bytes(); }

 private:
  const Array& given_r_;
  const Array *given_drive_, *given_forcing_;
  Twin r_;
  std::unique_ptr<Twin> drive_, forcing_;
  Twin y_, v_;
  std::unique_ptr<March> plan_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_host_lcp(const Device& device, Backend& host, const LcpMatrix& M, LcpClass lcp_class,
                                        double shift, Index rows) {
  return std::make_unique<HostLcp>(device, host, M, lcp_class, shift, rows);
}

std::unique_ptr<March> make_host_march(const Device& device, Backend& host, const MarchProblem& problem, Index rows) {
  return std::make_unique<HostMarch>(device, host, problem, rows);
}

}  // namespace bromwich::cuda
