#include "ranks/slab_backend.hpp"

#include "core/base/error.hpp"
#include "ranks/slab_array.hpp"
#include "ranks/slab_convolution.hpp"
#include "ranks/slab_plans.hpp"
#include "ranks/slab_stages.hpp"

#include <algorithm>
#include <string>
#include <utility>

namespace bromwich {

namespace {

class SlabBackend final : public Backend {
 public:
  SlabBackend(std::unique_ptr<Backend> local, Communicator& communicator, std::unique_ptr<Communicator> kept = nullptr)
      : Backend(local->name(), local->traits(), communicator.size()),
        local_(std::move(local)),
        kept_(std::move(kept)),
        ranked_{*local_, communicator} {
    const FusedOperations& own = local_->fused();
    fused_.upload_product = [this](const RowMatrix& amplitudes, const Matrix& shapes, Array& to) {
      upload_product_here(amplitudes, shapes, to);
    };
    fused_.restrict_problem = [this](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                     Array& coarse_r, Array& coarse_y,
                                     Array& old) { restrict_here(r, v, y, coarse_v, coarse_r, coarse_y, old); };
    fused_.face_transform = [this](const FaceBasis& basis, Index rows, Way way) {
      const Slabs slabs = slabs_for(rows);
      return make_slab_transform(local_->face_transform(basis, slabs.rows(), way), slabs);
    };
    fused_.projected_sweeps = [this](const ProjectedSweeps& sweeps, Index rows) -> std::unique_ptr<LcpBatch> {
      const Slabs slabs = slabs_for(rows);
      if (!local_->fused().projected_sweeps) return nullptr;
      auto batch = local_->fused().projected_sweeps(sweeps, slabs.rows());
      return batch ? make_slab_lcp(ranked_, std::move(batch), slabs) : nullptr;
    };
    if (own.record && communicator.moves_rows())
      fused_.record = [this](Index values, const std::function<void()>& operations) {
        return local_->record(values / ranks(), operations);
      };
    if (own.upload_projection)
      fused_.upload_projection = [this](const Vector& values, const Array& P, Array& to) {
        upload_projection_here(values, P, to);
      };
    fused_.alternates = [this](const Array& y, Index run, double part) { return alternates_somewhere(y, run, part); };
    fused_.step_chain = own.step_chain;
    fused_.affine_chain = own.affine_chain;
    fused_.resolvent = [this](const Dynamics& dynamics, const ComplexVector& nodes) {
      return resolvent_by_nodes(dynamics, nodes);
    };
    staged_ = slab_stages(ranked_, staged_);
  }

  DeviceInfo device() const override {
    DeviceInfo info = local_->device();
    info.memory *= ranks();  // arrays are divided
    info.detail += (info.detail.empty() ? "" : ", ") + std::to_string(ranks()) + " ranks";
    return info;
  }
  int threads() const override { return local_->threads(); }
  void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const override {
    local_->each_range(count, length, body);
  }
  void wait() override { local_->wait(); }

  std::unique_ptr<Array> array(Index rows, Index cols) override {
    Slabs slabs = slabs_for(rows);
    auto local = local_->array(slabs.rows(), cols);
    return std::make_unique<SlabArray>(std::move(slabs), cols, std::move(local));
  }
  void upload(const RowMatrix& from, Array& to) override { ranked_.upload(from, to); }
  void download(const Array& from, RowMatrix& to) override { ranked_.download(from, to); }

  void inject(const Array& fine, Array& coarse) override {
    const Slabs &from = slab(fine).slabs, &to = slab(coarse).slabs;
    if ((from.whole() && to.whole()) || aligned(from, to)) return local_->inject(local_part(fine), local_part(coarse));
    const Index ratio = from.steps / to.steps;
    to.whole() ? ranked_.collect(fine, ratio, coarse) : ranked_.upload(ranked_.every(fine, ratio), coarse);
  }

  void interpolate(const Array& coarse, const Array* old, Array& fine) override {
    const Slabs &from = slab(coarse).slabs, &to = slab(fine).slabs;
    if (from.whole() && to.whole())
      return local_->interpolate(local_part(coarse), old ? &local_part(*old) : nullptr, local_part(fine));
    if (!aligned(to, from)) {
      const SlabOperations& rows = local_->fused().slabs;
      if (!rows || !from.whole()) return interpolate_rows(coarse, old, fine);
      return rows.interpolate_rows(local_part(coarse), old ? &local_part(*old) : nullptr, to.steps / from.steps,
                                   to.first(), local_part(fine));
    }
    old ? ranked_.copy_row_before({&coarse, old}) : ranked_.copy_row_before({&coarse});
    local_->interpolate(local_part(coarse), old ? &local_part(*old) : nullptr, local_part(fine));
  }

  void add(const Array& b, double s, const Array& c, Array& a) override {
    local_->add(local_part(b), s, local_part(c), local_part(a));
  }
  std::unique_ptr<Differences> differences(std::size_t slots) override { return make_slab_differences(ranked_, slots); }

  std::unique_ptr<RowTransform> sine_transform(Index n, Index rows) override {
    const Slabs slabs = slabs_for(rows);
    return make_slab_transform(local_->sine_transform(n, slabs.rows()), slabs);
  }
  std::unique_ptr<Convolution> convolution(WeightsRef weights, Index rows) override {
    const Slabs slabs = slabs_for(rows);
    if (slabs.whole()) return make_whole_convolution(ranked_, local_->convolution(weights, rows), slabs, 0);
    return make_slab_convolution(ranked_, weights, slabs);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass lcp_class, double shift, Index rows) override {
    const Slabs slabs = slabs_for(rows);
    return make_slab_lcp(ranked_, local_->shifted_lcp(M, lcp_class, shift, slabs.rows()), slabs);
  }
  std::unique_ptr<March> march(const MarchProblem& problem, Index rows) override {
    return make_slab_march(ranked_, problem, slabs_for(rows));
  }

 private:
  Slabs slabs_for(Index rows) const { return slabs_of(rows, ranked_.communicator); }

  void upload_product_here(const RowMatrix& amplitudes, const Matrix& shapes, Array& to) {
    const Slabs& slabs = slab(to).slabs;
    const Index count = std::min(amplitudes.rows() - slabs.first(), slabs.rows());
    if (count <= 0) return;
    if (slabs.whole()) return local_->upload_product(amplitudes, shapes, local_part(to));
    local_->upload_product(amplitudes.middleRows(slabs.first(), count), shapes, local_part(to));
  }

  // Of arrays that every rank holds as a whole.
  void upload_projection_here(const Vector& values, const Array& P, Array& to) {
    if (slab(P).slabs.whole() && slab(to).slabs.whole())
      return local_->upload_projection(values, local_part(P), local_part(to));
    const Index k = P.rows(), m = P.cols();
    RowMatrix weights(k, m);
    ranked_.download(P, weights);
    ranked_.upload(weights * Eigen::Map<const RowMatrix>(values.data(), to.cols(), m).transpose(), to);
  }

  // Within one slab; what rings does so for longer than a few rows at its ends.
  bool alternates_somewhere(const Array& y, Index run, double part) {
    Vector found = Vector::Constant(1, local_->alternates(local_part(y), run, part) ? 1 : 0);
    if (!slab(y).slabs.whole()) ranked_.communicator.maximum(found);
    return found[0] > 0;
  }

  void restrict_here(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                     Array& coarse_y, Array& old) {
    const Slabs &fine = slab(y).slabs, &coarse = slab(coarse_y).slabs;
    if ((fine.whole() && coarse.whole()) || aligned(fine, coarse))
      return local_->restrict_problem(local_part(r), local_part(v), local_part(y), local_part(coarse_v),
                                      local_part(coarse_r), local_part(coarse_y), local_part(old));
    inject(r, coarse_r);
    inject(v, old);
    add(coarse_r, 1, old, coarse_r);
    add(coarse_r, -1, coarse_v, coarse_r);
    inject(y, coarse_y);
    inject(coarse_y, old);
  }

  // From a grid whose points do not include the ends of slabs, or that every rank holds.
  void interpolate_rows(const Array& coarse, const Array* old, Array& fine) {
    RowMatrix change, before;
    ranked_.download(coarse, change);
    if (old) {
      ranked_.download(*old, before);
      change -= before;
    }
    const Slabs& slabs = slab(fine).slabs;
    const Index ratio = slabs.steps / (coarse.rows() - 1);
    HostRows rows(*local_, local_part(fine));
    for (Index i = slabs.own(); i < slabs.rows(); ++i) {
      const Index j = slabs.first() + i, left = j / ratio;
      const double right = double(j % ratio) / double(ratio);
      Eigen::Map<Eigen::RowVectorXd> row(rows.row(i), fine.cols());
      row += (1 - right) * change.row(left);
      if (right > 0) row += right * change.row(left + 1);
    }
    rows.put();
  }

  // Each rank solves for its share of the nodes.
  ComplexMatrix resolvent_by_nodes(const Dynamics& dynamics, const ComplexVector& nodes) {
    const Index count = nodes.size(), ranks = ranked_.communicator.size();
    if (count < ranks) return local_->resolvent(dynamics, nodes);
    const auto begin = [&](Index r) { return r * count / ranks; };
    const Index rank = ranked_.communicator.rank(), mine = begin(rank + 1) - begin(rank);
    ComplexMatrix own;
    Vector failed = Vector::Zero(1);
    try {
      own = local_->resolvent(dynamics, nodes.segment(begin(rank), mine));
    } catch (const Error&) {
      failed[0] = 1;
    }
    ranked_.communicator.maximum(failed);
    if (failed[0] > 0) return local_->resolvent(dynamics, nodes);  // throws on all ranks
    ComplexMatrix by_columns(own.cols(), count);                   // a node's values side by side
    by_columns.middleCols(begin(rank), mine) = own.transpose();
    for (Index r = 0; r < ranks; ++r)
      ranked_.communicator.broadcast(reinterpret_cast<double*>(by_columns.col(begin(r)).data()),
                                     2 * own.cols() * (begin(r + 1) - begin(r)), int(r));
    return by_columns.transpose();
  }

  std::unique_ptr<Backend> local_;
  std::unique_ptr<Communicator> kept_;
  RankedBackend ranked_;
};

}  // namespace

std::unique_ptr<Backend> make_slab_backend(std::unique_ptr<Backend> local, Communicator& communicator) {
  return std::make_unique<SlabBackend>(std::move(local), communicator);
}
std::unique_ptr<Backend> make_slab_backend(std::unique_ptr<Backend> local, std::unique_ptr<Communicator> communicator) {
  Communicator& ranks = *communicator;
  return std::make_unique<SlabBackend>(std::move(local), ranks, std::move(communicator));
}

}  // namespace bromwich
