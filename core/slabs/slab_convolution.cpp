#include "core/slabs/slab_convolution.hpp"

#include "core/base/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>

namespace bromwich {

namespace {

// Rows after which `largest`^rows is forgotten, at most `most`.
Index remembered(double largest, Index most) {
  if (largest == 0) return std::min<Index>(1, most);
  if (!(largest < 1)) return most;
  const double rows = std::ceil(std::log(forgotten) / std::log(largest));
  return rows < double(most) ? std::max<Index>(1, Index(rows)) : most;
}

// Eight modes side by side, with all exponentials of a mode: they stay in the nearest cache.
class ModalState {
 public:
  explicit ModalState(const ModalRecurrence& r)
      : K_(r.exponentials()), n_(r.modes()), decay_(r.decay), output_(r.output), start_(r.start), initial_(r.initial) {
    if (initial_.size() == 0) initial_ = RowMatrix::Zero(K_, n_);
    slowest_ = K_ > 0 ? Vector(decay_.cwiseAbs().colwise().maxCoeff().transpose()) : Vector(Vector::Zero(n_));
  }

  Index size() const { return K_ * n_; }
  /// z of an array, as row 0 begins it.
  Vector start(const double* y0) const {
    RowMatrix z = initial_;
    for (Index k = 0; k < K_; ++k) z.row(k) += start_.row(k).cwiseProduct(Eigen::Map<const Eigen::RowVectorXd>(y0, n_));
    return Eigen::Map<const Vector>(z.data(), z.size());
  }
  /// The part of x0 in it.
  Vector initial() const { return Eigen::Map<const Vector>(initial_.data(), initial_.size()); }
  void start_from(const RowMatrix& D) {
    initial_ = (decay_.array() == 0).select(0, D.array() * decay_.array() / output_.array());
  }

  /// z <- the state after rows 1 .. rows of y.
  void advance(HostRows& y, Index rows, const HostThreads& threads, Vector& z) const {
    in_blocks(threads, [&](Index begin, Index count) {
      const Index known = remembered(slowest_.segment(begin, count).maxCoeff(), rows);
      std::vector<Lanes> E = block(decay_.data(), begin, count), state = block(z.data(), begin, count);
      if (known < rows) std::fill(state.begin(), state.end(), Lanes{});
      for (Index j = rows - known + 1; j <= rows; ++j) {
        const Lanes now = lanes_of(y.row(j) + begin, count);
        for (std::size_t k = 0; k < E.size(); ++k)
          for (std::size_t i = 0; i < width; ++i) state[k][i] = E[k][i] * state[k][i] + now[i];
      }
      for (std::size_t k = 0; k < E.size(); ++k)
        for (Index i = 0; i < count; ++i) z[Index(k) * n_ + begin + i] = state[k][std::size_t(i)];
    });
  }

  /// v_j += C E^{j-1} z for rows 1 .. rows.
  void add(const Vector& z, Index rows, const HostThreads& threads, HostRows& v) const {
    in_blocks(threads, [&](Index begin, Index count) {
      const Index known = remembered(slowest_.segment(begin, count).maxCoeff(), rows);
      const std::vector<Lanes> E = block(decay_.data(), begin, count), C = block(output_.data(), begin, count);
      std::vector<Lanes> state = block(z.data(), begin, count);
      for (std::size_t k = 0; k < E.size(); ++k)
        for (std::size_t i = 0; i < width; ++i) state[k][i] *= C[k][i];
      for (Index j = 1; j <= known; ++j) {
        Lanes sum{};
        for (std::size_t k = 0; k < E.size(); ++k)
          for (std::size_t i = 0; i < width; ++i) {
            sum[i] += state[k][i];
            state[k][i] *= E[k][i];
          }
        double* row = v.row(j) + begin;
        for (Index i = 0; i < count; ++i) row[i] += sum[std::size_t(i)];
      }
    });
  }

  /// Values of a state that outlive `steps` steps.
  std::vector<Index> lasting(Index steps) const {
    std::vector<Index> found;
    for (Index i = 0; i < size(); ++i)
      if (!(std::pow(std::abs(decay_.data()[i]), double(steps)) <= forgotten)) found.push_back(i);
    return found;
  }
  /// values <- E^steps values, for those values of a state.
  void carry(const std::vector<Index>& which, Index steps, Vector& values) const {
    for (std::size_t i = 0; i < which.size(); ++i) values[Index(i)] *= std::pow(decay_.data()[which[i]], double(steps));
  }

 private:
  static constexpr std::size_t width = 8;
  using Lanes = std::array<double, width>;

  void in_blocks(const HostThreads& threads, const std::function<void(Index begin, Index count)>& body) const {
    if (K_ == 0) return;
    const Index blocks = (n_ + Index(width) - 1) / Index(width);
    threads.each_range(blocks, 1, [&](Index first, Index last) {
      for (Index b = first; b < last; ++b) body(b * Index(width), std::min(Index(width), n_ - b * Index(width)));
    });
  }
  static Lanes lanes_of(const double* values, Index count) {
    Lanes lanes{};
    if (count == Index(width))
      std::copy_n(values, width, lanes.begin());
    else
      std::copy_n(values, count, lanes.begin());
    return lanes;
  }
  std::vector<Lanes> block(const double* table, Index begin, Index count) const {
    std::vector<Lanes> rows;
    for (Index k = 0; k < K_; ++k) rows.push_back(lanes_of(table + k * n_ + begin, count));
    return rows;
  }

  Index K_, n_;
  RowMatrix decay_, output_, start_, initial_;
  Vector slowest_;
};

// The state of a dense recurrence, one column.
class DenseState {
 public:
  explicit DenseState(const DenseRecurrence& r) : r_(r) {
    // Until a power by doubling is forgotten; its norm bounds those of later ones as long as it is below 1.
    for (Matrix power = r.decay; memory_ < most_memory; power = (power * power).eval(), memory_ *= 2)
      if (power.cwiseAbs().rowwise().sum().maxCoeff() <= forgotten) break;
  }

  Index size() const { return r_.decay.rows(); }
  Vector start(const double* y0) const { return r_.start * Eigen::Map<const Vector>(y0, r_.start.cols()); }

  void advance(HostRows& y, Index rows, const HostThreads&, Vector& z) const {
    const Index known = std::min(memory_, rows);
    if (known < rows) z.setZero();
    Vector fresh(z.size());
    for (Index j = rows - known + 1; j <= rows; ++j) {
      fresh.noalias() = r_.decay * z;
      fresh.noalias() += r_.input * Eigen::Map<const Vector>(y.row(j), r_.input.cols());
      z.swap(fresh);
    }
  }
  void add(const Vector& carried, Index rows, const HostThreads&, HostRows& v) const {
    Vector z = carried, fresh(z.size());
    for (Index j = 1; j <= std::min(memory_, rows); ++j) {
      Eigen::Map<Vector>(v.row(j), r_.output.rows()).noalias() += r_.output * z;
      fresh.noalias() = r_.decay * z;
      z.swap(fresh);
    }
  }

  std::vector<Index> lasting(Index steps) const {
    std::vector<Index> all;
    for (Index i = 0; steps < memory_ && i < size(); ++i) all.push_back(i);
    return all;
  }
  void carry(const std::vector<Index>& which, Index steps, Vector& values) const {
    if (!which.empty()) values = matrix_power(r_.decay, steps) * values;
  }

 private:
  static constexpr Index most_memory = Index(1) << 30;

  DenseRecurrence r_;
  Index memory_ = 1;
};

// The weights of one rank. Where row 0 is a copy of another rank's row, its part in the state comes by message, and lag
// 1 outside of the exponentials is that of any row. x0 comes as a state too.
ModalRecurrence of_rank(const ModalRecurrence& r, bool first) {
  ModalRecurrence local = r;
  local.initial.resize(0, 0);
  if (first) return local;
  local.start.setZero();
  local.s1 = local.w1;
  return local;
}
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
      : ranked_(ranked), slabs_(slabs), state_(weights) {
    const Weights local = of_rank(weights, ranked.first());
    plan_ = ranked.local.convolution(WeightsRef(&local), slabs.rows());
    const int ranks = ranked.communicator.size();
    Index shortest = slabs.steps;
    for (int r = 1; r + 1 < ranks; ++r) shortest = std::min(shortest, slabs.count(r));
    if (ranks > 2) lasting_ = state_.lasting(shortest);
    if constexpr (modal) start_from = [this](const Array& D) { take_start(D); };
  }

  void apply(const Array& y, Array& v, Index first) override {
    const bool idle = slabs_.here(first) >= slabs_.rows();  // all rows are those of the call before
    HostRows rows(ranked_.local, local_part(y));
    const Vector z = exchange(y, rows, idle);
    if (idle) return;
    plan_->apply(local_part(y), local_part(v), 0);
    if (z.isZero(0)) return;
    HostRows out(ranked_.local, local_part(v));
    state_.add(z, slabs_.rows() - 1, ranked_.local, out);
    out.put();
  }

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
  std::unique_ptr<Convolution> plan_;
  std::vector<Index> lasting_;  ///< values of the state that go to all ranks
  Vector message_;              ///< the state at the end of the slab, and the last row of y
};

}  // namespace

std::unique_ptr<Convolution> make_slab_convolution(const RankedBackend& ranked, WeightsRef weights,
                                                   const Slabs& slabs) {
  if (const auto* modal = std::get_if<const ModalRecurrence*>(&weights))
    return std::make_unique<SlabConvolution<ModalState, ModalRecurrence>>(ranked, **modal, slabs);
  if (const auto* dense = std::get_if<const DenseRecurrence*>(&weights))
    return std::make_unique<SlabConvolution<DenseState, DenseRecurrence>>(ranked, **dense, slabs);
  throw Error("ranks",
              "found " + std::to_string(ranked.communicator.size()) +
                  " for a convolution over lag weights, which does not split over time",
              "run it on one rank");
}

}  // namespace bromwich
