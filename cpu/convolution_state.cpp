// Causal convolution along time as a recurrence with a dense state (core/seam/recurrence.hpp): z_j = E z_{j-1} +
// G y_j.
//
// Chunked scan: (1) accumulate: the state that each chunk adds to zero, all chunks in parallel; (2) carry: z at the
// start of chunk c+1 = E^length z at the start of c + what c adds; (3) apply, again in parallel.

#include "cpu/parts.hpp"

#include <algorithm>

namespace bromwich::cpu {

namespace {

constexpr Index fewest_rows = 128;  ///< per chunk

class DenseScan final : public Convolution {
 public:
  DenseScan(const DenseRecurrence& r, Index rows, Team& team)
      : r_(r),
        team_(team),
        length_(std::max(shortest_chunk(r), (rows - 1 + team.threads() - 1) / team.threads())),
        chunks_(std::max<Index>(1, (rows - 1 + length_ - 1) / length_)),
        states_(r.decay.rows(), chunks_ + 1),
        next_(r.decay.rows(), chunks_),
        fresh_(r.decay.rows(), chunks_),
        power_(Matrix::Identity(r.decay.rows(), r.decay.rows())) {
    if (chunks_ > 1)
      for (Index i = 0; i < length_; ++i) power_ = power_ * r_.decay;
  }

  void apply(const Array& y_array, Array& v_array, Index first) override {
    const RowMatrix& y = host(y_array);
    RowMatrix& v = host(v_array);
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (first == 0) v.row(0).setZero();
    if (from >= chunks_) return;
    if (from == 0) states_.col(0) = r_.start * y.row(0).transpose();
    if (chunks_ - from == 1) {
      next_.col(from) = states_.col(from);
      return run(y, &v, from);
    }
    team_.share(chunks_ - 1 - from, [&](Index k, int) {
      const FlushDenormals flush;
      next_.col(from + k).setZero();
      run(y, nullptr, from + k);
    });
    for (Index c = from; c < chunks_ - 1; ++c) states_.col(c + 1) = power_ * states_.col(c) + next_.col(c);
    team_.share(chunks_ - from, [&](Index k, int) {
      const FlushDenormals flush;
      next_.col(from + k) = states_.col(from + k);
      run(y, &v, from + k);
    });
  }

  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(states_.size() + 2 * next_.size() + power_.size() + 3 * r_.decay.size());
  }

 private:
  // A chunk below about 10^5 operations costs less than waking a thread.
  static Index shortest_chunk(const DenseRecurrence& r) {
    const Index m = r.decay.rows(), n = r.output.rows(), k = r.input.cols();
    return std::max<Index>(fewest_rows, (1 << 17) / (1 + m * m + m * n + m * k + n * k));
  }

  // Advances next_.col(c) over the rows of chunk c; writes the output if v is given.
  void run(const RowMatrix& y, RowMatrix* v, Index c) {
    const Index m = r_.decay.rows(), n = r_.output.rows(), k = r_.input.cols();
    const Index begin = 1 + c * length_, end = std::min(y.rows(), begin + length_);
    double* z = next_.col(c).data();
    double* fresh = fresh_.col(c).data();
    for (Index j = begin; j < end; ++j) {
      const double* u = y.data() + j * k;
      if (v) {
        double* out = v->data() + j * n;
        for (Index i = 0; i < n; ++i) {
          double sum = 0;
          for (Index e = 0; e < m; ++e) sum += r_.output(i, e) * z[e];
          for (Index e = 0; e < k; ++e) sum += r_.w0(i, e) * u[e];
          out[i] = sum;
        }
      }
      for (Index i = 0; i < m; ++i) {
        double sum = 0;
        for (Index e = 0; e < m; ++e) sum += r_.decay(i, e) * z[e];
        for (Index e = 0; e < k; ++e) sum += r_.input(i, e) * u[e];
        fresh[i] = sum;
      }
      std::copy_n(fresh, m, z);
    }
  }

  DenseRecurrence r_;
  Team& team_;
  Index length_, chunks_;
  Matrix states_, next_, fresh_, power_;
};

}  // namespace

std::unique_ptr<Convolution> make_convolution(const DenseRecurrence& r, Index rows, Team& team) {
  return std::make_unique<DenseScan>(r, rows, team);
}

}  // namespace bromwich::cpu
