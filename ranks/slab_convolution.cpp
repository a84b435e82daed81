#include "ranks/slab_convolution.hpp"

#include "core/base/error.hpp"
#include "ranks/combined_states.hpp"

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

// Without lags beyond a slab; y_0 has no part in them.
LagTable of_rank(const LagTable& table, Index rows) {
  LagTable local{table.outputs, table.inputs, table.modal, table.W.topRows(rows), table.S.topRows(rows)};
  return local;
}

// The convolution of a rank for its own rows alone.
template <class Weights>
std::unique_ptr<Convolution> plan_of_rank(const RankedBackend& ranked, const Weights& weights, Index rows) {
  if constexpr (std::is_same_v<Weights, StageRecurrence>) {
    return ranked.local.stage_convolution(weights, rows);
  } else if constexpr (std::is_same_v<Weights, LagTable>) {
    return ranked.local.convolution(of_rank(weights, rows), rows);
  } else {
    Weights local = of_rank(weights, ranked.first());
    if constexpr (std::is_same_v<Weights, ModalRecurrence>) local.initial.resize(0, 0);  // x0 comes as a state
    return ranked.local.convolution(WeightsRef(&local), rows);
  }
}

template <class State, class Weights>
class SlabConvolution final : public Convolution {
 public:
  static constexpr bool modal = std::is_same_v<State, ModalState>;

  SlabConvolution(const RankedBackend& ranked, const Weights& weights, const Slabs& slabs)
      : ranked_(ranked),
        slabs_(slabs),
        state_(weights),
        added_to_(slabs.rows()),
        plan_(plan_of_rank(ranked, weights, slabs.rows())) {
    const int ranks = ranked.communicator.size();
    Index shortest = slabs.steps;
    for (int r = 1; r + 1 < ranks; ++r) shortest = std::min(shortest, slabs.count(r));
    if (ranks > 2) lasting_ = state_.lasting(shortest);
    for (int r = 0; r + 1 < slabs.rank && !lasting_.empty(); ++r)
      powers_.push_back(state_.power(lasting_, slabs.count(r + 1)));
    if constexpr (modal) at_rest_ = weights.initial.size() == 0 || weights.initial.isZero(0);
    if constexpr (modal) start_from = [this](const Array& D) { take_start(D); };
  }

  void apply(const Array& y, Array& v, Index first) override {
    const Index here = slabs_.here(first);  // rows before it are those of the call before
    const bool idle = here >= slabs_.rows();
    HostRows rows(ranked_.local, local_part(y));
    exchange(y, rows, idle);
    if (idle) return;
    // z is that of the call before too. Where later rows have nothing of it, the plan goes on alone.
    const bool goes_on = plan_->begin_with && here > slabs_.own() && here > added_to_;
    if (goes_on || (ranked_.first() && at_rest_)) return plan_->apply(local_part(y), local_part(v), here);
    if constexpr (modal)
      if (ranked_.first()) z_.head(state_.size()) = state_.initial();
    const bool something_left = hand_over();
    plan_->apply(local_part(y), local_part(v), 0);
    added_to_ = 0;
    if (!something_left) return;
    HostRows out(ranked_.local, local_part(v));
    added_to_ = state_.add(z_.head(state_.size()), slabs_.rows() - 1, ranked_.local, out);
    out.put();
  }
  bool recorded() const override { return false; }  // the host steps the state

  std::size_t bytes() const override {
    return plan_->bytes() + sizeof(double) * std::size_t(4 * state_.size() + 3 * message_.size());
  }

 private:
  // z_ <- the state before row 1 here. Afterwards the copied row of y has its values.
  void exchange(const Array& y, HostRows& rows, bool idle) {
    const Index m = state_.size(), n = modal ? y.cols() : 0, last = slabs_.rows() - 1;
    if (!idle || message_.size() == 0) {
      message_.setZero(m + n);
      if (ranked_.first()) state_.start(rows.row(0), message_.head(m));
      if (!ranked_.last()) state_.advance(rows, last, ranked_.local, message_.head(m));
      message_.tail(n) = Eigen::Map<const Vector>(rows.row(last), n);
    }
    z_.resize(m + n);
    ranked_.communicator.shift(message_, z_);
    RowMatrix all;
    if (!lasting_.empty()) all = ranked_.communicator.gather(message_(lasting_));
    if (ranked_.first()) return;
    if (n > 0) ranked_.local.upload(RowMatrix(z_.tail(n).transpose()), local_part(y));
    add_earlier(all);
  }

  // What ranks before the last one have left, at the beginning of this slab.
  void add_earlier(const RowMatrix& all) {
    const int rank = ranked_.communicator.rank();
    if (lasting_.empty() || rank < 2) return;
    Vector carried = Vector::Zero(all.cols());
    for (int r = 0; r + 1 < rank; ++r) {
      carried += all.row(r).transpose();
      carried = (powers_[std::size_t(r)] * carried).eval();
    }
    z_(lasting_) += carried;
  }

  // What the plan takes of z needs no addition to v. Whether something is left that does.
  bool hand_over() {
    if (!plan_->begin_with) return true;
    const std::vector<bool>& taken = plan_->begin_with(z_);
    const Index n = Index(taken.size());
    if (left_.size() == 0) {
      left_.resize(n);
      for (Index l = 0; l < n; ++l) left_[l] = taken[std::size_t(l)] ? 0 : 1;
    }
    if (left_.isZero(0)) return false;
    Eigen::Map<RowMatrix>(z_.data(), state_.size() / n, n).array().rowwise() *= left_.array();
    return true;
  }

  void take_start(const Array& D) {
    if constexpr (modal) {
      RowMatrix values;
      ranked_.download(D, values);
      if (ranked_.first()) state_.start_from(values);
      at_rest_ = false;
    }
  }

  RankedBackend ranked_;
  Slabs slabs_;
  State state_;
  Index added_to_;  ///< the last row that step 5 has changed
  std::unique_ptr<Convolution> plan_;
  std::vector<Index> lasting_;  ///< values of the state that go to all ranks
  std::vector<decltype(std::declval<State>().power({}, 0))>
      powers_;               ///< what they do over a slab, from that of rank 1 on
  Vector message_;           ///< the state at the end of the slab, and the last row of y
  Vector z_;                 ///< the same of the rank before, and what is added to it
  Eigen::RowVectorXd left_;  ///< 1 for modes that the plan leaves out, 0 for others
  bool at_rest_ = true;      ///< x0 has no part in z
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
  const LagTable& table = *std::get<const LagTable*>(weights);
  if (table.exponentials) return std::make_unique<SlabConvolution<SharedState, LagTable>>(ranked, table, slabs);
  throw Error("ranks",
              "found " + std::to_string(ranked.communicator.size()) +
                  " for a convolution over lag weights, which does not split over time",
              "run it on one rank");
}

std::unique_ptr<Convolution> make_slab_convolution(const RankedBackend& ranked, const StageRecurrence& stages,
                                                   const Slabs& slabs) {
  if (ranked.local.fused().slabs) return nullptr;
  return std::make_unique<SlabConvolution<StageState, StageRecurrence>>(ranked, stages, slabs);
}

}  // namespace bromwich
