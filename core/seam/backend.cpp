#include "core/seam/backend.hpp"

#include "core/numerics/alternation.hpp"

#include <algorithm>
#include <utility>

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

  bool recorded() const override {
    return parts_[0][0]->recorded() && parts_[0][1]->recorded() && parts_[1][0]->recorded() && parts_[1][1]->recorded();
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

// By products on the host.
class HostFaceTransform final : public RowTransform {
 public:
  HostFaceTransform(Backend& backend, FaceBasis basis, Way way)
      : backend_(backend), basis_(std::move(basis)), way_(way) {}

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    RowMatrix values, sum;
    backend_.download(in, values);
    backend_.download(out, sum);
    for (Index j = first; j < values.rows(); ++j) basis_.apply(way_, values.row(j).data());
    const Index rows = values.rows() - first;
    sum.bottomRows(rows) = values.bottomRows(rows);
    if (add) {
      backend_.download(*add, values);
      sum.bottomRows(rows) += values.bottomRows(rows);
    }
    backend_.upload(sum, out);
  }
  std::size_t bytes() const override { return 0; }

 private:
  Backend& backend_;
  FaceBasis basis_;
  Way way_;
};

}  // namespace

std::unique_ptr<RowTransform> Backend::face_transform(const FaceBasis& basis, Index rows, Way way) {
  if (basis.size() == 1 && basis.is_sine()) return sine_transform(basis.points(), rows);
  if (fused_.face_transform)
    if (auto transform = fused_.face_transform(basis, rows, way)) return transform;
  return std::make_unique<HostFaceTransform>(*this, basis, way);
}

FaceTransforms Backend::face_transforms(const FaceBasis& basis, Index rows) {
  FaceTransforms both;
  both.to_modes = face_transform(basis, rows, Way::to_modes);
  both.to_points = basis.is_sine() ? both.to_modes : face_transform(basis, rows, Way::to_points);
  return both;
}

std::unique_ptr<LcpBatch> Backend::projected_sweeps(const ProjectedSweeps& sweeps, LcpClass lcp_class, Index rows) {
  if (fused_.projected_sweeps)
    if (auto batch = fused_.projected_sweeps(sweeps, rows)) return batch;
  return shifted_lcp(SparseLcpMatrix(*sweeps.M), lcp_class, sweeps.shift, rows);
}

void Backend::upload_product(const RowMatrix& amplitudes, const Matrix& shapes, Array& to) {
  if (fused_.upload_product) return fused_.upload_product(amplitudes, shapes, to);
  upload(amplitudes * shapes.transpose(), to);
}

void Backend::upload_projection(const Vector& values, const Array& P, Array& to) {
  if (fused_.upload_projection) return fused_.upload_projection(values, P, to);
  constexpr Index together = 64;  // rows of X, by one thread
  const Eigen::Map<const RowMatrix> X(values.data(), to.cols(), P.cols());
  RowMatrix weights, product(to.rows(), to.cols());
  download(P, weights);
  each_range(X.rows(), together, [&](Index first, Index last) {
    product.middleCols(first, last - first).noalias() = weights * X.middleRows(first, last - first).transpose();
  });
  upload(product, to);
}

void Backend::download_during(const Array& from, RowMatrix& to, const std::function<void()>& operations) {
  if (fused_.download_during) return fused_.download_during(from, to, operations);
  download(from, to);
  operations();
}

void Backend::restrict_problem(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                               Array& coarse_y, Array& old) {
  if (fused_.restrict_problem) return fused_.restrict_problem(r, v, y, coarse_v, coarse_r, coarse_y, old);
  inject(r, coarse_r);
  inject(v, old);
  add(coarse_r, 1, old, coarse_r);
  add(coarse_r, -1, coarse_v, coarse_r);
  inject(y, coarse_y);
  inject(y, old);
}

std::unique_ptr<Convolution> Backend::stage_convolution(StageWeights parts, Index n, Index rows) {
  if (staged_.stage_tables)
    if (auto plan = staged_.stage_tables(parts, n, rows)) return plan;
  return std::make_unique<SplitStages>(*this, parts, n, rows);
}

std::unique_ptr<Convolution> Backend::stage_convolution(const StageRecurrence& r, Index rows) {
  if (staged_.stage_convolution)
    if (auto plan = staged_.stage_convolution(r, rows)) return plan;
  Weights weights[2][2];
  for (int a = 0; a < 2; ++a)
    for (int b = 0; b < 2; ++b) weights[a][b] = Recurrence(part_of(r, a, b));
  const Weights* const parts[2][2] = {{&weights[0][0], &weights[0][1]}, {&weights[1][0], &weights[1][1]}};
  return stage_convolution(parts, r.modes(), rows);
}

double Backend::difference(const Array& a, const Array& b) {
  const auto one = differences(1);
  one->submit(0, a, b);
  return one->collect()[0];
}

bool Backend::alternates(const Array& y, Index run, double part) {
  if (fused_.alternates) return fused_.alternates(y, run, part);
  RowMatrix values;
  download(y, values);
  Vector largest = Vector::Zero(values.cols());
  largest_of_columns(values, 0, values.rows(), largest);
  return bromwich::alternates(values, 0, values.rows(), part * largest, run);
}

std::function<void()> Backend::record(Index values, const std::function<void()>& operations) {
  return fused_.record ? fused_.record(values, operations) : std::function<void()>();
}

std::unique_ptr<StepChain> Backend::step_chain(const StepChainProblem& problem) {
  return fused_.step_chain ? fused_.step_chain(problem) : make_step_chain(problem, *this);
}

std::unique_ptr<AffineChain> Backend::affine_chain(const AffineChainSizes& sizes) {
  return fused_.affine_chain ? fused_.affine_chain(sizes) : make_affine_chain(sizes, *this);
}

ComplexMatrix Backend::resolvent(const Dynamics& dynamics, const ComplexVector& nodes) {
  return fused_.resolvent ? fused_.resolvent(dynamics, nodes) : dynamics->shifted_solves(nodes, *this);
}

}  // namespace bromwich

void std::default_delete<bromwich::Backend>::operator()(bromwich::Backend* backend) const { delete backend; }
