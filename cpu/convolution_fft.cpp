// Causal convolution along time with tabulated lag weights, by FFT of length >= 2J. Modal tables take one transform per
// mode. Dense tables take one per input and output column, with a small matrix product per frequency.
//
// The error of an FFT is relative to its largest input. Where weights grow like e^{sigma t}, inputs and weights are
// damped by e^{-sigma t}, which commutes with causal convolution.

#include "cpu/parts.hpp"
#include "cpu/real_fft.hpp"

#include <cmath>
#include <vector>

namespace bromwich::cpu {

Index fast_fft_length(Index n) {
  Index best = 1;
  while (best < n) best *= 2;
  for (Index five = 1; five < best; five *= 5)
    for (Index three = five; three < best; three *= 3) {
      Index length = three;
      while (length < n) length *= 2;
      best = std::min(best, length);
    }
  return best;
}

namespace {

class FftConvolution final : public Convolution {
 public:
  FftConvolution(const LagTable& table, Index rows, Team& team)
      : n_(table.outputs),
        k_(table.inputs),
        modal_(table.modal),
        rows_(rows),
        team_(team),
        fft_(fast_fft_length(2 * rows)),
        weights_(table.W.cols(), fft_.frequencies()),
        start_(table.S),
        damping_(damping(growth(table.W), rows)),
        real_(team.threads(), fft_.length()),
        work_((modal_ ? 0 : k_) + Index(team.threads()), padded(fft_.frequencies())) {
    // The factor 1/length of the inverse transform is folded into the weights.
    Vector padded(fft_.length());
    for (Index c = 0; c < weights_.rows(); ++c) {
      padded.setZero();
      padded.head(rows) = table.W.col(c).cwiseProduct(damping_) / double(fft_.length());
      fft_.forward(padded.data(), weights_.row(c).data());
    }
  }

  void apply(const Array& y_array, Array& v_array, Index) override {
    const RowMatrix& y = host(y_array);
    RowMatrix& v = host(v_array);
    if (modal_)
      apply_modal(y, v);
    else
      apply_dense(y, v);
    v.row(0).setZero();
  }

  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(2 * weights_.size() + start_.size() + real_.size() + 2 * work_.size());
  }

 private:
  // Column c of y from row 1 on (y_0 has its own weights), padded with zeros.
  void column_spectrum(const RowMatrix& y, Index c, double* real, Complex* out) const {
    real[0] = 0;
    for (Index j = 1; j < rows_; ++j) real[j] = damping_[j] * y(j, c);
    std::fill(real + rows_, real + fft_.length(), 0.0);
    fft_.forward(real, out);
  }

  void apply_modal(const RowMatrix& y, RowMatrix& v) {
    team_.share(n_, [&](Index l, int thread) {
      double* real = real_.row(thread).data();
      auto spectrum = work_.row(thread).head(fft_.frequencies());
      column_spectrum(y, l, real, spectrum.data());
      spectrum.array() *= weights_.row(l).array();
      fft_.backward(spectrum.data(), real);
      const double y0 = y(0, l);
      for (Index j = 0; j < rows_; ++j) v(j, l) = real[j] / damping_[j] + start_(j, l) * y0;
    });
  }

  void apply_dense(const RowMatrix& y, RowMatrix& v) {
    team_.share(k_, [&](Index c, int thread) { column_spectrum(y, c, real_.row(thread).data(), work_.row(c).data()); });
    team_.share(n_, [&](Index i, int thread) {
      double* real = real_.row(thread).data();
      auto sum = work_.row(k_ + thread).head(fft_.frequencies());
      sum.setZero();
      for (Index c = 0; c < k_; ++c)
        sum.array() += weights_.row(i * k_ + c).array() * work_.row(c).head(sum.size()).array();
      fft_.backward(sum.data(), real);
      for (Index j = 0; j < rows_; ++j)
        v(j, i) = real[j] / damping_[j] + start_.row(j).segment(i * k_, k_).dot(y.row(0));
    });
  }

  Index n_, k_;
  bool modal_;
  Index rows_;
  Team& team_;
  RealFft fft_;
  Spectra weights_;
  RowMatrix start_;
  Vector damping_;  ///< rows
  RowMatrix real_;
  Spectra work_;
};

}  // namespace

std::unique_ptr<Convolution> make_convolution(const LagTable& table, Index rows, Team& team) {
  return std::make_unique<FftConvolution>(table, rows, team);
}

}  // namespace bromwich::cpu
