// symbol          variable            shape
// P, r_k          Directions          n x n, K
//
// The other symbols are those of pole_choice.hpp.

#include "core/kernel/pole_fit.hpp"

#include "core/base/text.hpp"
#include "core/kernel/pole_choice.hpp"
#include "core/numerics/orthogonal_factor.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace pole_fitting {

namespace {

constexpr double forgotten = 1e-10;   ///< of K(h): where a direction has decayed
constexpr double negligible = 2e-13;  ///< contribution of one row of the state to the scaled H
constexpr Index most_columns = 64;    ///< of phi; more are better served by lag weights

// P and r_k.
struct Directions {
  Matrix P;
  std::vector<Index> count;
};

// Adds directions to the first `known` columns of P until what is left of K in its rows is below `level`.
Index add_directions(Matrix left, double level, Matrix& P, Index known) {
  left -= (left * P.leftCols(known)).eval() * P.leftCols(known).transpose();
  while (known < P.cols()) {
    Index row = 0;
    const double most = left.rowwise().norm().maxCoeff(&row);
    if (!(most > level)) break;
    Vector q = left.row(row).transpose() / most;
    for (int pass = 0; pass < 2; ++pass) {
      q -= P.leftCols(known) * (P.leftCols(known).transpose() * q);
      q.normalize();
    }
    P.col(known++) = q;
    left -= (left * q).eval() * q.transpose();
  }
  return known;
}

Directions find_directions(const DiscreteProblem& p, const Samples& s, const FitNodes& plan, const Picked& picked) {
  const Index K = picked.poles.size(), n = s.n;
  const Vector& poles = picked.poles;
  const LeastSquares fit(cauchy(plan, 0, plan.fitted, poles, 1 / p.scene.T));
  RowMatrix residues(K, s.fitted.of_y.cols());
  share(p.backend, s.fitted.of_y.cols(), 8192, [&](Index first, Index last) {
    residues.middleCols(first, last - first) = ((1 / p.scene.T - poles.array()).matrix().asDiagonal() *
                                                fit.solve(s.fitted.of_y.middleCols(first, last - first)).topRows(K));
  });
  const auto kernel_at = [&](double t) {
    RowMatrix at(s.outputs, n);
    Eigen::Map<Eigen::RowVectorXd>(at.data(), at.size()) = (poles.array() * t).exp().matrix().transpose() * residues;
    return at;
  };
  const double level = std::max(forgotten, 3 * picked.error) * kernel_at(p.h).cwiseAbs().maxCoeff();
  Directions d{Matrix::Zero(n, n), std::vector<Index>(std::size_t(K), n)};
  Index known = 0;
  for (Index k = 0; k < K && -poles[k] * p.h < 1; ++k) {
    if (known < n) known = add_directions(kernel_at(-1 / poles[k]), level, d.P, known);
    d.count[std::size_t(k)] = known;
  }
  const Eigen::HouseholderQR<Matrix> qr(d.P.leftCols(known));
  const Matrix full = known > 0 ? orthogonal_columns(qr.householderQ(), n) : Matrix::Identity(n, n);
  d.P.rightCols(n - known) = full.rightCols(n - known);
  return d;
}

// The matrices of all rows times P.
void rotate(const HostThreads& threads, const Matrix& P, Index outputs, RowMatrix& data) {
  share(threads, data.rows(), 1, [&](Index r, Index) {
    Eigen::Map<RowMatrix> H(data.row(r).data(), outputs, P.rows());
    H = (H * P).eval();
  });
}

// The first pole of every direction.
std::vector<Index> first_poles(const Directions& d) {
  std::vector<Index> first(std::size_t(d.P.cols()), 0);
  for (std::size_t b = 0; b < first.size(); ++b)
    while (d.count[std::size_t(first[b])] <= Index(b)) ++first[b];
  return first;
}

class Assembly {
 public:
  Assembly(const DiscreteProblem& p, Samples& s, const FitNodes& plan, const Picked& picked, const Directions& d)
      : p_(p), s_(s), plan_(plan), poles_(picked.poles), d_(d), unit_(1 / p.scene.T) {
    model_.n = s.n;
    model_.components = s.outputs - s.n;
    model_.distinct = poles_.size();
    model_.basis = d.P;
    columns_ = cauchy(plan, 0, plan.fitted, poles_, unit_);
    reach_.resize(poles_.size());
    for (Index k = 0; k < poles_.size(); ++k) {
      reach_[k] = 0;
      for (Index i = 0; i < plan.count(); ++i)
        reach_[k] = std::max(reach_[k], plan.weight[i] / std::abs(plan.nodes[std::size_t(i)] - poles_[k]));
    }
  }

  std::shared_ptr<const PoleModel> make(Index sources, bool with_x0) {
    model_.sources = sources;
    model_.direct = Matrix::Zero(s_.outputs, s_.n + sources);
    fit_y();
    fit_others(sources, with_x0);
    const Index rows = Index(pole_.size());
    model_.poles.resize(rows);
    model_.output.resize(s_.outputs, rows);
    for (Index r = 0; r < rows; ++r) {
      model_.poles[r] = poles_[pole_[std::size_t(r)]];
      model_.output.col(r) = output_[std::size_t(r)];
    }
    model_.error = error();
    return std::make_shared<const PoleModel>(std::move(model_));
  }

 private:
  void fit_y() {
    const Index n = s_.n;
    rotate(p_.backend, d_.P, s_.outputs, s_.fitted.of_y);
    const std::vector<Index> first = first_poles(d_);
    Matrix direct(s_.outputs, n);
    for (Index b = 0; b < n;) {
      Index end = b;
      while (end < n && first[std::size_t(end)] == first[std::size_t(b)] && end - b < together) ++end;
      fit_directions(b, end, first[std::size_t(b)], direct);
      b = end;
    }
    for (Index i = 0; i < s_.outputs; ++i) direct.row(i) *= s_.scale_of(i, 0);
    model_.direct.leftCols(n) = direct * d_.P.transpose();
    model_.driven = Index(pole_.size());
  }

  // Directions b..end-1 with poles from `from` on.
  void fit_directions(Index b, Index end, Index from, Matrix& direct) {
    const Index width = end - b, K = poles_.size();
    RowMatrix data(s_.fitted.of_y.rows(), s_.outputs * width);
    for (Index r = 0; r < data.rows(); ++r)
      Eigen::Map<RowMatrix>(data.row(r).data(), s_.outputs, width) =
          Eigen::Map<const RowMatrix>(s_.fitted.of_y.row(r).data(), s_.outputs, s_.n).middleCols(b, width);
    const LeastSquares fit(columns_.rightCols(K + 1 - from));
    RowMatrix c(K + 1 - from, data.cols());
    share(p_.backend, data.cols(), 4096,
          [&](Index a, Index z) { c.middleCols(a, z - a) = fit.solve(data.middleCols(a, z - a)); });
    for (Index k = from; k <= K; ++k) {
      const Eigen::Map<const RowMatrix> values(c.row(k - from).data(), s_.outputs, width);
      if (k == K) {
        direct.middleCols(b, width) = values;
        continue;
      }
      for (Index a = 0; a < width; ++a) add_row(k, b + a, values.col(a) * (unit_ - poles_[k]), 0);
    }
  }

  void fit_others(Index sources, bool with_x0) {
    const Matrix c = s_.width > 0 ? LeastSquares(columns_).solve(s_.fitted.others) : Matrix(0, 0);
    const Index K = poles_.size();
    for (Index f = 0; f < s_.width; ++f) {
      const bool x0 = with_x0 && f == s_.width - 1;
      if (x0) model_.forced = Index(pole_.size()) - model_.driven;
      for (Index k = 0; k < K; ++k) {
        Vector values(s_.outputs);
        for (Index i = 0; i < s_.outputs; ++i) values[i] = c(k, i * s_.width + f) * (unit_ - poles_[k]);
        add_row(k, x0 ? -1 : f, values, 1 + f);
      }
      if (x0) direct_of_x0_.resize(s_.outputs);
      for (Index i = 0; i < s_.outputs; ++i)
        (x0 ? direct_of_x0_[i] : model_.direct(i, s_.n + f)) = c(K, i * s_.width + f) * s_.scale_of(i, 1 + f);
    }
    if (!with_x0) model_.forced = sources > 0 ? Index(pole_.size()) - model_.driven : 0;
  }

  void add_row(Index k, Index direction, Vector output, Index column) {
    if (output.cwiseAbs().maxCoeff() * reach_[k] <= negligible) return;
    for (Index i = 0; i < s_.outputs; ++i) output[i] *= s_.scale_of(i, column);
    pole_.push_back(k);
    if (direction >= 0) model_.direction.push_back(direction);
    output_.push_back(std::move(output));
  }

  // At the nodes held out, from the finished model.
  double error() const {
    double worst = 0;
    const Index n = s_.n;
    for (Index i = 0; i < held_out; ++i) {
      const Index node = plan_.fitted + watched + i;
      const Complex z = plan_.nodes[std::size_t(node)];
      const double weight = plan_.weight[node];
      ComplexMatrix H = ComplexMatrix::Zero(s_.outputs, n + s_.width);
      for (Index r = 0; r < model_.rows(); ++r) {
        const bool y = r < model_.driven, x0 = r >= model_.driven + model_.forced;
        const Index column = x0 ? n + s_.width - 1 : model_.direction[std::size_t(r)] + (y ? 0 : n);
        H.col(column) += (1.0 / (z - model_.poles[r])) * model_.output.col(r).cast<Complex>();
      }
      const Matrix Pt = d_.P.transpose();
      RowMatrix part[2] = {H.real(), H.imag()};
      for (int imaginary = 0; imaginary < 2; ++imaginary) {
        RowMatrix of_y = part[imaginary].leftCols(n) * Pt;
        if (!imaginary) of_y += model_.direct.leftCols(n);
        if (!imaginary && model_.sources > 0)
          part[0].middleCols(n, model_.sources) += model_.direct.rightCols(model_.sources);
        if (!imaginary && direct_of_x0_.size() > 0) part[0].rightCols(1) += direct_of_x0_;
        const Index row = i + imaginary * held_out;
        for (Index a = 0; a < s_.outputs; ++a) {
          for (Index b = 0; b < n; ++b)
            take(weight * of_y(a, b) / s_.scale_of(a, 0) - s_.held_out.of_y(row, a * n + b), worst);
          for (Index f = 0; f < s_.width; ++f)
            take(weight * part[imaginary](a, n + f) / s_.scale_of(a, 1 + f) - s_.held_out.others(row, a * s_.width + f),
                 worst);
        }
      }
    }
    return worst;
  }
  static void take(double difference, double& worst) {
    if (!(std::abs(difference) <= worst)) worst = std::isfinite(difference) ? std::abs(difference) : INFINITY;
  }

  static constexpr Index together = 128;  ///< directions in one least-squares problem: bounds its memory

  const DiscreteProblem& p_;
  Samples& s_;
  const FitNodes& plan_;
  const Vector& poles_;
  const Directions& d_;
  double unit_;
  Matrix columns_;
  Vector direct_of_x0_;  ///< D of x0: it acts at t = 0 alone, and the model leaves it out
  Vector reach_;         ///< largest weight/|z - s_k|
  PoleModel model_;
  std::vector<Index> pole_;
  std::vector<Vector> output_;
};

}  // namespace

}  // namespace pole_fitting

PoleFit fit_pole_model(const DiscreteProblem& p, const std::vector<Index>& components, PoleLimits limits) {
  using namespace pole_fitting;
  const Wide wide = widen(p, components);
  if (wide.sources > most_columns) return {.reason = "f has many columns"};
  const FitNodes plan(p.h, p.scene.T);
  PoleFit fit{.nodes = plan.count()};
  const auto missed = [&fit](Index poles, double error) {
    fit.error = error;
    fit.reason = text("%td real poles miss H(z) by %.1e", poles, error);
    return fit;
  };
  try {
    Samples samples = sample(p, wide, plan);
    if (!samples.finite()) return fit.reason = "H(z) is not finite", fit;
    const Picked picked = pick_poles(samples, plan, p.h, p.scene.T, limits.most_poles);
    if (!(picked.error <= 10 * limits.accepted_error)) return missed(picked.poles.size(), picked.error);
    const Directions directions = find_directions(p, samples, plan, picked);
    auto model = Assembly(p, samples, plan, picked, directions).make(wide.sources, wide.states > 0);
    if (!(model->error <= limits.accepted_error)) return missed(model->distinct, model->error);
    fit.error = model->error;
    fit.model = std::move(model);
  } catch (const SingularShift&) {
    fit.reason = "a node is an eigenvalue";
  }
  return fit;
}

}  // namespace bromwich
