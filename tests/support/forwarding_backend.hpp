#pragma once
// A backend that hands the required operations to another one. A test overrides the operations that it watches.

#include "core/seam/backend.hpp"

#include <memory>
#include <string>
#include <utility>

namespace bromwich {

class ForwardingBackend : public Backend {
 public:
  ForwardingBackend(std::string name, std::unique_ptr<Backend> inner)
      : Backend(std::move(name)), inner_(std::move(inner)) {}

  DeviceInfo device() const override { return inner_->device(); }
  int threads() const override { return inner_->threads(); }
  void each_range(Index count, Index length, const std::function<void(Index, Index)>& body) const override {
    inner_->each_range(count, length, body);
  }
  std::unique_ptr<Array> array(Index rows, Index cols) override { return inner_->array(rows, cols); }
  void upload(const RowMatrix& from, Array& to) override { inner_->upload(from, to); }
  void download(const Array& from, RowMatrix& to) override { inner_->download(from, to); }
  void inject(const Array& fine, Array& coarse) override { inner_->inject(fine, coarse); }
  void interpolate(const Array& coarse, const Array* old, Array& fine) override {
    inner_->interpolate(coarse, old, fine);
  }
  void add(const Array& b, double s, const Array& c, Array& a) override { inner_->add(b, s, c, a); }
  std::unique_ptr<Differences> differences(std::size_t slots) override { return inner_->differences(slots); }
  std::unique_ptr<RowTransform> sine_transform(Index n, Index rows) override { return inner_->sine_transform(n, rows); }
  std::unique_ptr<Convolution> convolution(WeightsRef weights, Index rows) override {
    return inner_->convolution(weights, rows);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass c, double D, Index rows) override {
    return inner_->shifted_lcp(M, c, D, rows);
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index rows) override {
    return inner_->march(problem, rows);
  }

 protected:
  Backend& inner() const { return *inner_; }

 private:
  std::unique_ptr<Backend> inner_;
};

}  // namespace bromwich
