#include "tests/support/row_ranks.hpp"

#include "core/base/error.hpp"
#include "ranks/slab_array.hpp"
#include "ranks/slab_backend.hpp"
#include "ranks/slab_states.hpp"
#include "tests/support/forwarding_backend.hpp"
#include "tests/support/reference_backend.hpp"

#include <utility>

namespace bromwich {

namespace {

class NaiveCarried final : public CarriedConvolution {
 public:
  NaiveCarried(Backend& backend, const ModalRecurrence& r, const Outliving& outliving, bool first)
      : CarriedConvolution(r.decay.size(), Index(outliving.values.size())),
        backend_(backend),
        r_(of_rank(r, first)),
        outliving_(outliving),
        z_(r_.initial.size() > 0 ? r_.initial : RowMatrix(RowMatrix::Zero(r.decay.rows(), r.decay.cols()))),
        first_(first) {
    if (first)
      start_from = [this](const Array& D) {
        backend_.download(D, z_);
        z_ = (r_.decay.array() == 0).select(0, z_.array() * r_.decay.array() / r_.output.array());
      };
  }

  void leave(const Array& y, Array& to, Array* outliving) override {
    RowMatrix rows;
    backend_.download(y, rows);
    RowMatrix z = first_ ? started(rows) : RowMatrix(RowMatrix::Zero(r_.decay.rows(), r_.decay.cols()));
    for (Index j = 1; j < rows.rows(); ++j) advance(z, rows.row(j));
    const Eigen::Map<const RowMatrix> values(z.data(), 1, z.size());
    backend_.upload(values, to);
    if (!outliving) return;
    RowMatrix few(1, lasting);
    for (Index i = 0; i < lasting; ++i) few(0, i) = values(0, outliving_.values[std::size_t(i)]);
    backend_.upload(few, *outliving);
  }

  void begin(const Array& left, const Array* of_all) override {
    RowMatrix values, all;
    backend_.download(left, values);
    if (of_all) {
      backend_.download(*of_all, all);
      for (Index i = 0; i < lasting; ++i)
        values(0, outliving_.values[std::size_t(i)]) += outliving_.powers.col(i).dot(all.col(i));
    }
    z_ = Eigen::Map<const RowMatrix>(values.data(), z_.rows(), z_.cols());
  }

  void apply(const Array& y, Array& v, Index) override {
    RowMatrix rows;
    backend_.download(y, rows);
    RowMatrix out = RowMatrix::Zero(rows.rows(), rows.cols()), z = started(rows);
    for (Index j = 1; j < rows.rows(); ++j) {
      const Vector& w1 = j == 1 ? r_.s1 : r_.w1;
      out.row(j) = r_.output.cwiseProduct(z).colwise().sum() + rows.row(j).cwiseProduct(r_.w0.transpose()) +
                   rows.row(j - 1).cwiseProduct(w1.transpose());
      advance(z, rows.row(j));
    }
    backend_.upload(out, v);
  }

  std::size_t bytes() const override { return sizeof(double) * std::size_t(z_.size()); }

 private:
  RowMatrix started(const RowMatrix& rows) const {
    return z_ + (r_.start.array().rowwise() * rows.row(0).array()).matrix();
  }
  void advance(RowMatrix& z, const Eigen::RowVectorXd& y) const {
    z = (z.array() * r_.decay.array()).matrix().rowwise() + y;
  }

  Backend& backend_;
  ModalRecurrence r_;
  Outliving outliving_;
  RowMatrix z_;
  bool first_;
};

/// A batch that reports late and can be recorded, by one that does neither.
class LateLcp final : public LcpBatch {
 public:
  explicit LateLcp(std::unique_ptr<LcpBatch> inner) : LcpBatch(false), inner_(std::move(inner)) {}
  void submit(const Array& r, const Array& v, Array& y, Index first, double tolerance) override {
    inner_->submit(r, v, y, first, tolerance);
  }
  LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double tolerance) override {
    return inner_->finish(r, v, y, first, tolerance);
  }
  LcpReport collect() override { return inner_->collect(); }
  double residual(const Array& r, const Array& v, const Array& y) override { return inner_->residual(r, v, y); }
  std::size_t bytes() const override { return inner_->bytes(); }

 private:
  std::unique_ptr<LcpBatch> inner_;
};

class RowBackend final : public ForwardingBackend {
 public:
  RowBackend() : ForwardingBackend("rows", make_reference_backend()) {
    // As a device: what is recorded runs when it is replayed, and the host has no part in it.
    fused_.record = [this](Index, const std::function<void()>& operations) {
      recording_ = true;
      operations();
      recording_ = false;
      return operations;
    };
    fused_.face_transform = [this](const FaceBasis& basis, Index rows, Way way) {
      return inner().face_transform(basis, rows, way);
    };
    staged_.take_stages = [this](const Array& stages, Array& first, Array& second) {
      inner().take_stages(stages, first, second);
    };
    staged_.put_stages = [this](const Array& first, const Array& second, Array& stages) {
      inner().put_stages(first, second, stages);
    };
    staged_.sweep_stages = [this](const StageDivisors& d, const Array& r, const Array& v, Array& y) {
      inner().sweep_stages(d, r, v, y);
    };
    staged_.restrict_stages = [this](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                     Array& coarse_r, Array& coarse_y, Array& old) {
      inner().restrict_stages(r, v, y, coarse_v, coarse_r, coarse_y, old);
    };
    fused_.slabs.move_rows = [this](const Array* from, Index first, Index ratio, Array& to, Index begin, Index count) {
      RowMatrix source, target;
      inner().download(to, target);
      if (from) inner().download(*from, source);
      for (Index i = 0; i < count; ++i)
        from ? target.row(begin + i) = source.row(first + i * ratio) : target.row(begin + i).setZero();
      inner().upload(target, to);
    };
    fused_.slabs.download_rows = [this](const Array& from, Index first, Index count, double* to) {
      check_host();
      RowMatrix source;
      inner().download(from, source);
      Eigen::Map<RowMatrix>(to, count, from.cols()) = source.middleRows(first, count);
    };
    fused_.slabs.upload_rows = [this](const double* from, Array& to, Index first, Index count) {
      check_host();
      RowMatrix target;
      inner().download(to, target);
      target.middleRows(first, count) = Eigen::Map<const RowMatrix>(from, count, to.cols());
      inner().upload(target, to);
    };
    fused_.slabs.interpolate_rows = [this](const Array& coarse, const Array* old, Index ratio, Index first,
                                           Array& fine) {
      RowMatrix change, before, target;
      inner().download(coarse, change);
      if (old) {
        inner().download(*old, before);
        change -= before;
      }
      inner().download(fine, target);
      for (Index i = 0; i < target.rows(); ++i) {
        const Index left = (first + i) / ratio;
        const double share = double((first + i) % ratio) / double(ratio);
        target.row(i) += (1 - share) * change.row(left);
        if (share > 0) target.row(i) += share * change.row(left + 1);
      }
      inner().upload(target, fine);
    };
    fused_.slabs.carried_convolution = [this](const ModalRecurrence& r, const std::vector<Index>& ends, int rank) {
      return std::make_unique<NaiveCarried>(inner(), r, outliving(r.decay, ends, rank), rank == 0);
    };
  }

  void upload(const RowMatrix& from, Array& to) override {
    check_host();
    ForwardingBackend::upload(from, to);
  }
  void download(const Array& from, RowMatrix& to) override {
    check_host();
    ForwardingBackend::download(from, to);
  }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix& M, LcpClass c, double D, Index rows) override {
    return std::make_unique<LateLcp>(inner().shifted_lcp(M, c, D, rows));
  }

 private:
  void check_host() const {
    if (recording_) throw Error("rows", "the host takes part in recorded operations", "", ErrorKind::internal);
  }

  bool recording_ = false;
};

class RowRank final : public Communicator {
 public:
  explicit RowRank(Communicator& host)
      : Communicator(host.rank(), host.size()), carrier_(make_reference_backend()), by_host_{*carrier_, host} {}
  bool moves_rows() const override { return true; }

 private:
  Communicator& host() const { return by_host_.communicator; }
  void do_shift(const Vector& right, Vector& left) override { host().shift(right, left); }
  void do_gather(const Vector& values, RowMatrix& all) override { all = host().gather(values); }
  void do_maximum(Vector& values) override { host().maximum(values); }
  void do_broadcast(double* values, Index count, int root) override { host().broadcast(values, count, root); }
  void do_shift_rows(const std::vector<RowShift>& rows) override { by_host_.shift(rows); }
  void do_gather_rows(const Array& values, Array& all) override { by_host_.gather(values, all); }
  void do_gather_rows(Array& rows, const std::vector<Index>& ends) override {
    RowMatrix values = by_host_.rows_here(rows, 0, ends.back());
    for (int r = 0; r < size(); ++r) {
      const Index begin = ends[std::size_t(r)];
      host().broadcast(values.data() + begin * values.cols(), (ends[std::size_t(r) + 1] - begin) * values.cols(), r);
    }
    by_host_.put_rows_here(values, rows, 0);
  }

  std::unique_ptr<Backend> carrier_;  ///< has the same arrays
  RankedBackend by_host_;
};

}  // namespace

std::unique_ptr<Backend> make_row_backend() { return std::make_unique<RowBackend>(); }

std::unique_ptr<Communicator> make_row_rank(Communicator& host) { return std::make_unique<RowRank>(host); }

std::unique_ptr<Backend> make_backend_over_rows(Communicator& ranks) {
  auto local = make_row_backend();
  auto rows = make_row_rank(ranks);
  return make_slab_backend(std::move(local), std::move(rows));
}

}  // namespace bromwich
