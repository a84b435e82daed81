#include "core/slabs/slab_convolution.hpp"

#include "core/base/error.hpp"
#include "core/slabs/slab_states.hpp"

#include <algorithm>
#include <type_traits>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

DenseRecurrence of_rank(const DenseRecurrence& r, bool first) {
  DenseRecurrence local = r;
  if (!first) local.start.setZero();
  return local;
}

template <class State, class Weights>
class SlabConvolution final : public Convolution {
 public:
  static constexpr bool modal = std::is_same_v<State, ModalState>;

  SlabConvolution(const RankedBackend& ranked, const Weights& weights, const Slabs& slabs)
      : ranked_(ranked), slabs_(slabs), state_(weights), added_to_(slabs.rows()) {
    Weights local = of_rank(weights, ranked.first());
    if constexpr (modal) local.initial.resize(0, 0);  // x0 comes as a state
    plan_ = ranked.local.convolution(WeightsRef(&local), slabs.rows());
    const int ranks = ranked.communicator.size();
    Index shortest = slabs.steps;
    for (int r = 1; r + 1 < ranks; ++r) shortest = std::min(shortest, slabs.count(r));
    if (ranks > 2) lasting_ = state_.lasting(shortest);
    if constexpr (modal) start_from = [this](const Array& D) { take_start(D); };
  }

  void apply(const Array& y, Array& v, Index first) override {
    const Index here = slabs_.here(first);  // rows before it are those of the call before
    const bool idle = here >= slabs_.rows();
    HostRows rows(ranked_.local, local_part(y));
    Vector z = exchange(y, rows, idle);
    if (idle) return;
    // z is that of the call before too. Where later rows have nothing of it, the plan goes on alone.
    if (plan_->begin_with && here > slabs_.own() && here > added_to_)
      return plan_->apply(local_part(y), local_part(v), here);
    hand_over(z);
    plan_->apply(local_part(y), local_part(v), 0);
    added_to_ = 0;
    if (z.isZero(0)) return;
    HostRows out(ranked_.local, local_part(v));
    added_to_ = state_.add(z, slabs_.rows() - 1, ranked_.local, out);
    out.put();
  }
  bool recorded() const override { return false; }  // the host steps the state

  std::size_t bytes() const override {
    return plan_->bytes() + sizeof(double) * std::size_t(4 * state_.size() + 2 * message_.size());
  }

 private:
  // The state before row 1 here. Afterwards the copied row of y has its values.
  Vector exchange(const Array& y, HostRows& rows, bool idle) {
    const Index n = modal ? y.cols() : 0, last = slabs_.rows() - 1;
    Vector received = Vector::Zero(state_.size() + n);
    Vector begun = Vector::Zero(state_.size());
    if (ranked_.first()) begun = state_.start(rows.row(0));
    if (!idle || message_.size() == 0) {
      message_.resize(state_.size() + n);
      Vector z = begun;
      if (!ranked_.last()) state_.advance(rows, last, ranked_.local, z);
      message_.head(state_.size()) = z;
      message_.tail(n) = Eigen::Map<const Vector>(rows.row(last), n);
    }
    ranked_.communicator.shift(message_, received);
    RowMatrix all;
    if (!lasting_.empty()) all = ranked_.communicator.gather(message_(lasting_));
    if (ranked_.first()) return own_x0();
    if (n > 0) ranked_.local.upload(RowMatrix(received.tail(n).transpose()), local_part(y));
    Vector z = received.head(state_.size());
    add_earlier(all, z);
    return z;
  }

  // What ranks before the last one have left, at the beginning of this slab.
  void add_earlier(const RowMatrix& all, Vector& z) const {
    const int rank = ranked_.communicator.rank();
    if (lasting_.empty() || rank < 2) return;
    Vector carried = Vector::Zero(all.cols());
    for (int r = 0; r + 1 < rank; ++r) {
      carried += all.row(r).transpose();
      state_.carry(lasting_, slabs_.count(r + 1), carried);
    }
    z(lasting_) += carried;
  }

  // What the plan takes of z needs no addition to v.
  void hand_over(Vector& z) {
    if (!plan_->begin_with) return;
    const std::vector<bool>& taken = plan_->begin_with(z);
    const Index n = Index(taken.size());
    for (Index i = 0; i < z.size(); ++i)
      if (taken[std::size_t(i % n)]) z[i] = 0;
  }

  // The plan of rank 0 takes y_0 in, and not x0.
  Vector own_x0() const {
    if constexpr (modal)
      return state_.initial();
    else
      return Vector::Zero(state_.size());
  }

  void take_start(const Array& D) {
    if constexpr (modal) {
      RowMatrix values;
      ranked_.download(D, values);
      if (ranked_.first()) state_.start_from(values);
    }
  }

  RankedBackend ranked_;
  Slabs slabs_;
  State state_;
  Index added_to_;  ///< the last row that step 5 has changed
  std::unique_ptr<Convolution> plan_;
  std::vector<Index> lasting_;  ///< values of the state that go to all ranks
  Vector message_;              ///< the state at the end of the slab, and the last row of y
};

// The same where arrays lie on a device: states and rows stay there, and the plan begins with z in all modes.
class CarriedSlabs final : public Convolution {
 public:
  CarriedSlabs(const RankedBackend& ranked, const ModalRecurrence& weights, const Slabs& slabs)
      : ranked_(ranked),
        slabs_(slabs),
        plan_(ranked.local.fused().slabs.carried_convolution(weights, slabs.ends, slabs.rank)),
        left_(ranked.local.array(1, plan_->state)),
        received_(ranked.local.array(1, plan_->state)) {
    if (plan_->lasting > 0) {
      outliving_ = ranked.local.array(1, plan_->lasting);
      of_all_ = ranked.local.array(ranked.communicator.size(), plan_->lasting);
    }
    start_from = [this](const Array& D) {
      if (ranked_.first()) plan_->start_from(local_part(D));
    };
  }

  void apply(const Array& y, Array& v, Index first) override {
    const Index here = slabs_.here(first), last = slabs_.rows() - 1;
    const bool idle = here > last;  // what an idle rank leaves is that of the call before
    Array& rows = local_part(y);
    if (!idle || !has_left_) plan_->leave(rows, *left_, outliving_.get());
    has_left_ = true;
    ranked_.shift({{left_.get(), 0, received_.get(), 0, 1}, {&rows, last, &rows, 0, 1}});
    if (outliving_) ranked_.gather(*outliving_, *of_all_);
    if (idle) return;
    if (!ranked_.first()) plan_->begin(*received_, of_all_.get());
    plan_->apply(rows, local_part(v), here > slabs_.own() ? here : 0);
  }
  bool recorded() const override { return ranked_.communicator.moves_rows(); }

  std::size_t bytes() const override {
    return plan_->bytes() + left_->bytes() + received_->bytes() +
           (outliving_ ? outliving_->bytes() + of_all_->bytes() : 0);
  }

 private:
  RankedBackend ranked_;
  Slabs slabs_;
  std::unique_ptr<CarriedConvolution> plan_;
  std::unique_ptr<Array> left_, received_, outliving_, of_all_;
  bool has_left_ = false;
};

}  // namespace

std::unique_ptr<Convolution> make_slab_convolution(const RankedBackend& ranked, WeightsRef weights,
                                                   const Slabs& slabs) {
  if (const auto* modal = std::get_if<const ModalRecurrence*>(&weights)) {
    if (ranked.local.fused().slabs) return std::make_unique<CarriedSlabs>(ranked, **modal, slabs);
    return std::make_unique<SlabConvolution<ModalState, ModalRecurrence>>(ranked, **modal, slabs);
  }
  if (const auto* dense = std::get_if<const DenseRecurrence*>(&weights))
    return std::make_unique<SlabConvolution<DenseState, DenseRecurrence>>(ranked, **dense, slabs);
  throw Error("ranks",
              "found " + std::to_string(ranked.communicator.size()) +
                  " for a convolution over lag weights, which does not split over time",
              "run it on one rank");
}

}  // namespace bromwich
