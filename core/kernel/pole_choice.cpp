#include "core/kernel/pole_choice.hpp"

#include "core/numerics/orthogonal_factor.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich::pole_fitting {

namespace {

constexpr double largest_node = 8, smallest_node = 0.3;  ///< times 1/h and 1/T
constexpr double bend_length = 20, bend_angle = 140 * std::numbers::pi / 180;
constexpr double nodes_per_fold = 2.7;  ///< on the imaginary axis, for a factor of e
constexpr Index arc_nodes = 5, bend_nodes = 6, lanes = 8;
constexpr Index candidates = 240;
constexpr double slowest_candidate = 0.3, fastest_candidate = 300;  ///< times 1/T and 1/h
constexpr double dependent = 3e-15;  ///< part of a column of norm 1 outside the span of those picked before
constexpr double wanted_error = 1.5e-10;
constexpr Index probes = 96;

double log_between(double from, double to, double part) { return from * std::pow(to / from, part); }

// Nodes of the three parts; `offset` in (0, 1) places them between neighbours.
void place(double h, double T, Index on_axis, Index on_arc, Index on_bend, double offset, Nodes& nodes) {
  const auto part = [offset](Index i, Index count) { return (double(i) + offset) / double(count); };
  for (Index i = 0; i < on_axis; ++i)
    nodes.emplace_back(0, log_between(smallest_node / T, largest_node / h, part(i, on_axis)));
  for (Index i = 0; i < on_arc; ++i)
    nodes.push_back(std::polar(largest_node / h, std::numbers::pi / 2 * part(i, on_arc)));
  for (Index i = 0; i < on_bend; ++i)
    nodes.push_back((Complex(0, largest_node) + std::polar(bend_length * part(i, on_bend), bend_angle)) / h);
}

// Candidates in the order of a column-pivoted Gram-Schmidt, after the constant.
std::vector<Index> pick(Matrix columns) {
  const Index count = columns.cols() - 1;
  for (Index c = 0; c <= count; ++c) columns.col(c).normalize();
  const auto remove = [&columns](const Vector& q) { columns.noalias() -= q * (q.transpose() * columns).eval(); };
  remove(Vector(columns.col(count)));
  std::vector<Index> order;
  while (Index(order.size()) < count) {
    Index best = 0;
    const double most = std::sqrt(columns.leftCols(count).colwise().squaredNorm().maxCoeff(&best));
    if (!(most > dependent)) break;
    order.push_back(best);
    remove(Vector(columns.col(best) / most));
    columns.col(best).setZero();
  }
  return order;
}

// Entries that stand for all: a third from the diagonal, the others anywhere, and some of the other columns.
std::vector<Index> probed(Index outputs, Index n) {
  std::vector<Index> which;
  unsigned long long random = 1;
  const auto below = [&random](Index count) {
    random = random * 6364136223846793005ULL + 1442695040888963407ULL;
    return Index((random >> 33) % static_cast<unsigned long long>(count));
  };
  for (Index i = 0; i < probes; ++i) {
    const Index column = below(n), row = i % 3 == 0 ? column : below(outputs);
    which.push_back(row * n + column);
  }
  return which;
}

}  // namespace

FitNodes::FitNodes(double h, double T) {
  const double folds = std::log(largest_node * T / (smallest_node * h));
  Index on_axis = std::max<Index>(8, Index(std::ceil(nodes_per_fold * folds)));
  fitted = on_axis + arc_nodes + bend_nodes;
  const Index rest = (lanes - (fitted + watched + held_out) % lanes) % lanes;  // eight are eliminated together
  on_axis += rest;
  fitted += rest;
  place(h, T, on_axis, arc_nodes, bend_nodes, 0.5, nodes);
  place(h, T, watched - 2, 1, 1, 0.77, nodes);
  place(h, T, held_out - 3, 1, 2, 0.31, nodes);
  weight.resize(Index(nodes.size()));
  for (Index i = 0; i < weight.size(); ++i) {
    const Complex z = h * nodes[std::size_t(i)];
    weight[i] = std::sqrt(std::min(1.0, std::abs(z))) * std::exp(std::min(0.0, z.real()));
  }
}

Matrix cauchy(const FitNodes& plan, Index first, Index count, const Vector& poles, double unit) {
  const Index K = poles.size();
  Matrix columns(2 * count, K + 1);
  for (Index i = 0; i < count; ++i) {
    const Complex z = plan.nodes[std::size_t(first + i)];
    const double weight = plan.weight[first + i];
    for (Index k = 0; k < K; ++k) {
      const Complex value = weight * (unit - poles[k]) / (z - poles[k]);
      columns(i, k) = value.real();
      columns(count + i, k) = value.imag();
    }
    columns(i, K) = weight;
    columns(count + i, K) = 0;
  }
  return columns;
}

LeastSquares::LeastSquares(const Matrix& columns) : norms_(columns.colwise().norm().transpose()) {
  const Eigen::HouseholderQR<Matrix> qr(columns * norms_.cwiseInverse().asDiagonal());
  Qt_ = orthogonal_columns(qr.householderQ(), columns.cols()).transpose();
  R_ = qr.matrixQR().topRows(columns.cols()).triangularView<Eigen::Upper>();
}

Matrix LeastSquares::solve(const Eigen::Ref<const RowMatrix>& data) const {
  Matrix c = Qt_ * data;
  R_.triangularView<Eigen::Upper>().solveInPlace(c);
  return norms_.cwiseInverse().asDiagonal() * c;
}

Samples sample(const DiscreteProblem& p, const Wide& wide, const FitNodes& plan) {
  Samples s;
  s.n = wide.n;
  s.outputs = wide.outputs();
  s.width = wide.inputs() - wide.n;
  ComplexMatrix H =
      p.backend.resolvent(wide.dynamics, Eigen::Map<const ComplexVector>(plan.nodes.data(), plan.count()));
  H.array().colwise() *= plan.weight.cast<Complex>().array();
  s.scale = Matrix::Zero(2, 1 + s.width);
  for (Index i = 0; i < s.outputs; ++i)
    for (Index j = 0; j < wide.inputs(); ++j) {
      double& scale = s.scale(i < s.n ? 0 : 1, j < s.n ? 0 : 1 + j - s.n);
      scale = std::max(scale, H.col(i * wide.inputs() + j).cwiseAbs().maxCoeff());
    }
  s.scale = (s.scale.array() > 0).select(s.scale, 1);
  const auto split = [&](Index first, Index count, Samples::At& at) {
    at.of_y.resize(2 * count, s.outputs * s.n);
    at.others.resize(2 * count, s.outputs * s.width);
    share(p.backend, s.outputs, 1, [&](Index i, Index) {
      for (Index j = 0; j < wide.inputs(); ++j) {
        const auto values = H.col(i * wide.inputs() + j).segment(first, count);
        const bool y = j < s.n;
        auto to = y ? at.of_y.col(i * s.n + j) : at.others.col(i * s.width + j - s.n);
        const double scale = s.scale_of(i, y ? 0 : 1 + j - s.n);
        to.head(count) = values.real() / scale;
        to.tail(count) = values.imag() / scale;
      }
    });
  };
  split(0, plan.fitted, s.fitted);
  split(plan.fitted, watched, s.watched);
  split(plan.fitted + watched, held_out, s.held_out);
  return s;
}

Picked pick_poles(const Samples& s, const FitNodes& plan, double h, double T, Index most_poles) {
  Vector all(candidates);
  for (Index k = 0; k < candidates; ++k)
    all[k] = -log_between(slowest_candidate / T, fastest_candidate / h, double(k) / double(candidates - 1));
  const std::vector<Index> order = pick(cauchy(plan, 0, plan.fitted, all, 1 / T));
  const std::vector<Index> which = probed(s.outputs, s.n);
  const auto data = [&](const Samples::At& at) {
    RowMatrix values(at.of_y.rows(), Index(which.size()) + std::min(at.others.cols(), probes));
    values << at.of_y(Eigen::all, which), at.others.leftCols(std::min(at.others.cols(), probes));
    return values;
  };
  const RowMatrix fitted = data(s.fitted), beside = data(s.watched);
  Picked best;
  const Index most = std::min({Index(order.size()), 2 * plan.fitted - 8, most_poles});
  for (Index K = std::min<Index>(16, most); K <= most; K += 4) {
    std::vector<Index> chosen(order.begin(), order.begin() + K);
    std::sort(chosen.begin(), chosen.end());
    const Vector poles = all(chosen);
    const Matrix columns = cauchy(plan, 0, plan.fitted, poles, 1 / T);
    const Matrix c = LeastSquares(columns).solve(fitted);
    const double error =
        std::max((columns * c - fitted).cwiseAbs().maxCoeff(),
                 (cauchy(plan, plan.fitted, watched, poles, 1 / T) * c - beside).cwiseAbs().maxCoeff());
    if (error < 0.7 * best.error) best = {poles, error};
    if (best.error <= wanted_error) break;
  }
  return best;
}

}  // namespace bromwich::pole_fitting
