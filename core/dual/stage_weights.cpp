#include "core/dual/stage_weights.hpp"

#include "core/host/stage_coefficients.hpp"

#include <cmath>

namespace bromwich {

namespace {

// One exponential with x = h s.
struct StageTerm {
  double decay, seen[2], input[2], within[2][2];
  StageTerm(double x, double h) {
    const double over = 1 / (1 - 2 * x / 3 + x * x / 6);
    seen[0] = (1 - x / 3) * over;
    seen[1] = decay = (1 + x / 3) * over;
    input[0] = 0.75 * h * over;
    input[1] = (0.25 - x / 6) * h * over;
    within[0][0] = (5.0 / 12 - x / 6) * h * over;
    within[0][1] = -h * over / 12;
    within[1][0] = input[0];
    within[1][1] = input[1];
  }
};

// F(a^{-1}/h) from F at one of its eigenvalues.
void within_step(const std::function<Complex(Complex)>& F, double h, double (&w0)[2][2]) {
  const host::Coefficients<Complex> c;
  const Complex value = F(c.mu / h);
  for (int a = 0; a < 2; ++a)
    for (int b = 0; b < 2; ++b) w0[a][b] = 2 * (c.v[a] * c.w[b] * value).real();
}

// c/(z - s) in the weights of lag d: factor c decay^{d-1}.
struct Exponential {
  double decay, factor;
};

// Those of a fit, and its linear part, which ends with lag 1.
std::shared_ptr<const SharedExponentials> exponentials_of(const PoleSum& sum, double of_lag_1,
                                                          const std::function<Exponential(double rate)>& weights_of) {
  const Index K = sum.rates.size();
  auto all = std::make_shared<SharedExponentials>();
  all->decay = Vector::Zero(K + 1);
  all->output.resize(K + 1, sum.functions());
  for (Index k = 0; k < K; ++k) {
    const Exponential one = weights_of(sum.rates[k]);
    all->decay[k] = one.decay;
    all->output.row(k) = one.factor * sum.coefficients.row(k);
  }
  all->output.row(K) = of_lag_1 * sum.linear.transpose();
  return all;
}

}  // namespace

StageRecurrence stage_recurrence(const PoleSum& sum, const Vector& mu, double h,
                                 const std::function<Complex(Index mode, Complex z)>& exact) {
  const Index n = mu.size(), K = sum.rates.size();
  StageRecurrence r;
  r.decay.resize(K, n);
  for (int a = 0; a < 2; ++a) {
    r.input[a].resize(K, n);
    r.output[a].resize(K, n);
    r.w1[a].resize(n);
    for (int b = 0; b < 2; ++b) r.w0[a][b].resize(n);
  }
  for (Index l = 0; l < n; ++l) {
    const Index column = sum.functions() > 1 ? l : 0;
    for (Index k = 0; k < K; ++k) {
      const StageTerm term(h * (sum.rates[k] + mu[l]), h);
      r.decay(k, l) = term.decay;
      for (int a = 0; a < 2; ++a) {
        r.input[a](k, l) = term.input[a];
        r.output[a](k, l) = sum.coefficients(k, column) * term.seen[a];
      }
    }
    double w0[2][2];
    within_step([&](Complex z) { return exact(l, z); }, h, w0);
    for (int a = 0; a < 2; ++a) {
      r.w1[a][l] = -sum.linear[column] * radau_inverse_ones[a] / h;
      for (int b = 0; b < 2; ++b) r.w0[a][b][l] = w0[a][b];
    }
  }
  return r;
}

std::shared_ptr<const StageTables> stage_tables(const PoleSum& sum, Index n, double h, Index J) {
  const Index K = sum.rates.size(), size = n * n;
  auto tables = std::make_shared<StageTables>();
  for (int a = 0; a < 2; ++a)
    for (int b = 0; b < 2; ++b) {
      RowMatrix powers(J + 1, K);
      for (Index k = 0; k < K; ++k) {
        const StageTerm term(h * sum.rates[k], h);
        powers(0, k) = term.within[a][b];
        for (Index d = 1; d <= J; ++d)
          powers(d, k) = d == 1 ? term.seen[a] * term.input[b] : powers(d - 1, k) * term.decay;
      }
      LagTable table{n, n, false, RowMatrix(powers * sum.coefficients), RowMatrix::Zero(J + 1, size)};
      table.W.row(0) += (radau_inverse[a][b] / h) * sum.linear.transpose();
      if (a == b) table.W.row(0) += sum.constant.transpose();
      const double of_lag_1 = b == 1 ? -radau_inverse_ones[a] / h : 0;
      if (b == 1) table.W.row(1) += of_lag_1 * sum.linear.transpose();
      table.exponentials = exponentials_of(sum, of_lag_1, [&](double rate) {
        const StageTerm term(h * rate, h);
        return Exponential{term.decay, term.seen[a] * term.input[b]};
      });
      tables->parts[a][b] = std::move(table);
    }
  return tables;
}

std::unique_ptr<Convolution> StageTables::convolution(Backend& backend, Index n, Index rows) const {
  const Weights* const pointers[2][2] = {{&parts[0][0], &parts[0][1]}, {&parts[1][0], &parts[1][1]}};
  return backend.stage_convolution(pointers, n, rows);
}

LagTable euler_table(const PoleSum& sum, Index n, double h, Index J) {
  const Index K = sum.rates.size();
  RowMatrix powers(J + 1, K);
  for (Index k = 0; k < K; ++k) {
    const double E = 1 / (1 - h * sum.rates[k]);
    powers(0, k) = h * E;
    for (Index d = 1; d <= J; ++d) powers(d, k) = powers(d - 1, k) * E;
  }
  LagTable table{n, n, false, RowMatrix(powers * sum.coefficients), RowMatrix::Zero(J + 1, n * n)};
  table.W.row(0) += (sum.constant + sum.linear / h).transpose();
  table.W.row(1) -= sum.linear.transpose() / h;
  table.exponentials = exponentials_of(sum, -1 / h, [h](double rate) {
    const double E = 1 / (1 - h * rate);
    return Exponential{E, h * E * E};
  });
  return table;
}

}  // namespace bromwich
