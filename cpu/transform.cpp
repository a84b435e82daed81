// Sine transforms of the rows of a space-time array.
//
// S_ik = sqrt(2/(n+1)) sin(pi i k/(n+1)) is even or odd about the middle index, depending on the parity of k. A row is
// folded first, then multiplied by two matrices of half the size: half the multiplications of a full product. A fast
// transform is faster from n = 129 on if n + 1 has small factors, otherwise from about n = 1000 on.

#include "cpu/parts.hpp"

#include "cpu/folded_sine.hpp"
#include "cpu/real_fft.hpp"

#include <cmath>
#include <memory>
#include <vector>

namespace bromwich::cpu {

namespace {

constexpr Index largest_product = 1100;  ///< above it, rows are transformed by an FFT
constexpr Index row_block = 32;          ///< rows folded and multiplied together: their halves stay in L2

class ProductSine final : public RowTransform {
  static constexpr Index parallel_size = 1 << 18;  ///< multiplications: ten microseconds

 public:
  ProductSine(Index n, Team& team) : sine_(n), team_(team) {
    for (int t = 0; t < team.threads(); ++t)
      scratch_.push_back({RowMatrix(row_block, sine_.even), RowMatrix(row_block, sine_.odd),
                          RowMatrix(row_block, sine_.even), RowMatrix(row_block, sine_.odd)});
  }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const RowMatrix& x = host(in);
    const RowMatrix* a = add ? &host(*add) : nullptr;
    RowMatrix& y = host(out);
    const Index rows = x.rows(), count = (rows - first + row_block - 1) / row_block;
    team_.share(count, (rows - first) * sine_.n * sine_.n > parallel_size, [&](Index block, int thread) {
      const FlushDenormals flush;  // decay in time produces denormals, which cost a hundredfold
      const Index begin = first + block * row_block, size = std::min(row_block, rows - begin);
      transform(x, a, y, begin, size, scratch_[std::size_t(thread)]);
    });
  }

  std::size_t bytes() const override {
    return sizeof(double) *
           std::size_t(sine_.E.size() + sine_.O.size() + Index(scratch_.size()) * 2 * row_block * sine_.n);
  }

 private:
  struct Scratch {
    RowMatrix e, o, even, odd;
  };

  void transform(const RowMatrix& x, const RowMatrix* add, RowMatrix& y, Index begin, Index size, Scratch& s) const {
    for (Index j = 0; j < size; ++j) sine_.fold(x.row(begin + j).data(), s.e.row(j).data(), s.o.row(j).data());
    s.even.topRows(size).noalias() = s.e.topRows(size) * sine_.E;
    if (sine_.odd > 0) s.odd.topRows(size).noalias() = s.o.topRows(size) * sine_.O;
    for (Index j = 0; j < size; ++j) {
      const double* even = s.even.row(j).data();
      const double* odd = s.odd.row(j).data();
      double* to = y.row(begin + j).data();
      const double* plus = add ? add->row(begin + j).data() : nullptr;
      const auto interleave = [&](auto value) {
        for (Index q = 0; q < sine_.odd; ++q) {
          to[2 * q] = value(2 * q, even[q]);
          to[2 * q + 1] = value(2 * q + 1, odd[q]);
        }
        if (sine_.even > sine_.odd) to[sine_.n - 1] = value(sine_.n - 1, even[sine_.even - 1]);
      };
      if (plus)
        interleave([plus](Index i, double v) { return plus[i] + v; });
      else
        interleave([](Index, double v) { return v; });
    }
  }

  FoldedSine sine_;
  Team& team_;
  std::vector<Scratch> scratch_;
};

class FastVectorSine final : public VectorTransform {
 public:
  explicit FastVectorSine(Index n) : n_(n), scale_(1 / std::sqrt(2.0 * double(n + 1))), sine_(n) {}

  std::unique_ptr<VectorTransform> another() const override { return std::make_unique<FastVectorSine>(*this); }
  void apply(const double* in, double* out) override {
    sine_.apply(in, out);
    for (Index i = 0; i < n_; ++i) out[i] *= scale_;
  }

  Index n() const { return n_; }

 private:
  Index n_;
  double scale_;
  SineFft sine_;
};

/// Sine transform by a real FFT of length N = n + 1, N even. With y_j = sin(pi j/N) (x_j + x_{N-j}) + (x_j - x_{N-j}) /
/// 2 and its discrete Fourier transform Y, the sine sums are F_{2k} = -Im Y_k, F_{2k+1} = F_{2k-1} + Re Y_k, F_1 = Y_0
/// / 2. Half the work of SineFft, which pads to 2N. The running sum loses sqrt(N) eps in the odd half.
class HalvedVectorSine final : public VectorTransform {
 public:
  /// True if N is even and has small factors.
  static bool suits(Index n) { return n % 2 == 1 && fast_fft_length(n + 1) == n + 1; }

  explicit HalvedVectorSine(Index n)
      : n_(n),
        scale_(std::sqrt(2.0 / double(n + 1))),
        sine_(n),
        y_(Vector::Zero(n + 1)),
        Y_((n + 1) / 2 + 1),
        fft_(RealFft::forward_of_aligned(n + 1)) {
    for (Index j = 0; j < n; ++j) sine_[j] = scale_ * std::sin(M_PI * double(j + 1) / double(n + 1));
  }

  std::unique_ptr<VectorTransform> another() const override { return std::make_unique<HalvedVectorSine>(*this); }
  void apply(const double* in, double* out) override {
    const double half = 0.5 * scale_;
    double* y = y_.data() + 1;
    for (Index j = 0; j < n_; ++j) y[j] = sine_[j] * (in[j] + in[n_ - 1 - j]) + half * (in[j] - in[n_ - 1 - j]);
    y_[0] = 0;
    fft_.forward(y_.data(), Y_.data());
    double odd = out[0] = 0.5 * Y_[0].real();
    for (Index k = 1; 2 * k < n_; ++k) {
      out[2 * k - 1] = -Y_[k].imag();
      out[2 * k] = odd += Y_[k].real();
    }
  }

 private:
  Index n_;
  double scale_;
  Vector sine_, y_;
  ComplexVector Y_;
  RealFft fft_;
};

class FastSine final : public RowTransform {
  static constexpr Index parallel_size = 1 << 12;  ///< values: ten microseconds

 public:
  FastSine(Index n, Index rows, Team& team)
      : n_(n), scratch_(rows * n > parallel_size ? team.threads() : 1, n), team_(team) {
    rows_.push_back(make_vector_sine(n));
    for (Index t = 1; t < scratch_.rows(); ++t) rows_.push_back(rows_[0]->another());
  }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const RowMatrix& x = host(in);
    const RowMatrix* a = add ? &host(*add) : nullptr;
    RowMatrix& y = host(out);
    const Index count = x.rows() - first;
    team_.share(count, count * n_ > parallel_size, [&](Index i, int thread) {
      const FlushDenormals flush;
      const Index j = first + i;
      VectorTransform& row = *rows_[std::size_t(thread)];
      if (!a) return row.apply(x.row(j).data(), y.row(j).data());
      auto buffer = scratch_.row(thread);
      row.apply(x.row(j).data(), buffer.data());
      y.row(j) = a->row(j) + buffer;
    });
  }

  std::size_t bytes() const override { return sizeof(double) * std::size_t(3 * scratch_.size()); }

 private:
  Index n_;
  std::vector<std::unique_ptr<VectorTransform>> rows_;
  RowMatrix scratch_;
  Team& team_;
};

class ProductVectorSine final : public VectorTransform {
 public:
  explicit ProductVectorSine(Index n) : sine_(n), e_(sine_.even), o_(sine_.odd), even_(sine_.even), odd_(sine_.odd) {}

  std::unique_ptr<VectorTransform> another() const override { return std::make_unique<ProductVectorSine>(*this); }
  void apply(const double* in, double* out) override {
    sine_.fold(in, e_.data(), o_.data());
    even_.noalias() = sine_.E.transpose() * e_;
    odd_.noalias() = sine_.O.transpose() * o_;
    for (Index q = 0; q < sine_.odd; ++q) {
      out[2 * q] = even_[q];
      out[2 * q + 1] = odd_[q];
    }
    if (sine_.even > sine_.odd) out[sine_.n - 1] = even_[sine_.even - 1];
  }

 private:
  FoldedSine sine_;
  Vector e_, o_, even_, odd_;
};

}  // namespace

std::unique_ptr<VectorTransform> make_vector_sine(Index n) {
  // A single row makes the product a matrix-vector product, bound by loads: fast transforms win at much smaller n.
  if (n <= 128) return std::make_unique<ProductVectorSine>(n);
  if (HalvedVectorSine::suits(n)) return std::make_unique<HalvedVectorSine>(n);
  return std::make_unique<FastVectorSine>(n);
}

std::unique_ptr<RowTransform> make_sine_transform(Index n, Index rows, Team& team) {
  if (n <= 128 || (n <= largest_product && !HalvedVectorSine::suits(n))) return std::make_unique<ProductSine>(n, team);
  return std::make_unique<FastSine>(n, rows, team);
}

}  // namespace bromwich::cpu
