#include "core/seam/stage_convolution.hpp"

#include "core/base/error.hpp"

namespace bromwich {

namespace {

class SplitStages final : public Convolution {
 public:
  SplitStages(Backend& backend, StageWeights parts, Index n, Index rows) : backend_(backend) {
    const Index points = (rows - 1) / 2 + 1;
    for (int a = 0; a < 2; ++a) {
      y_[a] = backend.array(points, n);
      v_[a] = backend.array(points, n);
      for (int b = 0; b < 2; ++b) parts_[a][b] = convolution_of(backend, *parts[a][b], points);
    }
    part_ = backend.array(points, n);
  }

  void apply(const Array& y, Array& v, Index) override {
    backend_.take_stages(y, *y_[0], *y_[1]);
    for (int a = 0; a < 2; ++a) {
      parts_[a][0]->apply(*y_[0], *v_[a], 0);
      parts_[a][1]->apply(*y_[1], *part_, 0);
      backend_.add(*v_[a], 1, *part_, *v_[a]);
    }
    backend_.put_stages(*v_[0], *v_[1], v);
  }

  std::size_t bytes() const override {
    std::size_t sum = part_->bytes();
    for (int a = 0; a < 2; ++a) {
      sum += y_[a]->bytes() + v_[a]->bytes();
      for (int b = 0; b < 2; ++b) sum += parts_[a][b]->bytes();
    }
    return sum;
  }

 private:
  static std::unique_ptr<Convolution> convolution_of(Backend& backend, const Weights& weights, Index rows) {
    if (const auto* table = std::get_if<LagTable>(&weights)) return backend.convolution(*table, rows);
    return backend.convolution(std::get<Recurrence>(weights), rows);
  }

  Backend& backend_;
  std::unique_ptr<Convolution> parts_[2][2];
  std::unique_ptr<Array> y_[2], v_[2], part_;
};

}  // namespace

std::unique_ptr<Convolution> make_stage_convolution(Backend& backend, StageWeights parts, Index n, Index rows) {
  return std::make_unique<SplitStages>(backend, parts, n, rows);
}

ModalRecurrence part_of(const StageRecurrence& r, int a, int b) {
  const Index n = r.modes();
  ModalRecurrence part;
  part.decay = r.decay;
  part.output = r.output[a].cwiseProduct(r.input[b]);
  part.start = RowMatrix::Zero(r.exponentials(), n);
  part.w0 = r.w0[a][b];
  part.w1 = b == 1 ? r.w1[a] : Vector(Vector::Zero(n));
  part.s1 = Vector::Zero(n);
  return part;
}

std::unique_ptr<Convolution> make_stage_convolution(Backend& backend, const StageRecurrence& r, Index rows) {
  Weights weights[2][2];
  for (int a = 0; a < 2; ++a)
    for (int b = 0; b < 2; ++b) weights[a][b] = Recurrence(part_of(r, a, b));
  const Weights* const parts[2][2] = {{&weights[0][0], &weights[0][1]}, {&weights[1][0], &weights[1][1]}};
  return make_stage_convolution(backend, parts, r.modes(), rows);
}

}  // namespace bromwich
