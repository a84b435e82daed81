#include "core/certificate/defect.hpp"

#include "core/dynamics/dense.hpp"

#include <utility>

namespace bromwich {

namespace {

constexpr int most_halvings = 6;                          ///< of a part, for sources
constexpr std::array<double, 2> part_shares{0.75, 0.25};  ///< of the nodes of a part, in means

}  // namespace

Defect::Defect(const Scene& scene, const Matrix& M, const LinearSteps& y, double step_length)
    : d_(*scene.dynamics->small_state()),
      M_(M),
      T_(scene.T),
      h_(step_length),
      n_(scene.constraints()),
      y_(y),
      sources_(scene),
      kept_(scene, division, at_once),
      weights_(d_.A, d_.B, d_.N, M_, sources_.has_f()),
      phis_(d_.A),
      x_(scene.x0),
      terms_(Vector::Zero(n_)),
      answers_(terms_),
      largest_(terms_),
      sum_(terms_),
      at_(terms_) {}

void Defect::pass(const Part& p) { pass_halved(p, most_halvings); }

void Defect::pass_halved(const Part& p, int halvings) {
  const PartSources s = sources_.on(p);
  if (halvings > 0 && !sources_.resolves(p, s)) {
    for (const Part& half : halves(p)) pass_halved(half, halvings - 1);
    return;
  }
  look_inside(p, weights_.of(p.length), s);
}

void Defect::look_inside(const Part& p, const PartWeights& w, const PartSources& s) {
  Vector Y(2 * n_);
  for (std::size_t i = 0; i < 2; ++i)
    Y.segment(Index(i) * n_, n_) = y_.at(p.step, p.begin + part_nodes[i] * (p.end - p.begin));
  for (std::size_t i = 0; i < 2; ++i) {
    const Vector y = Y.segment(Index(i) * n_, n_);
    Vector x = w.decay[i] * x_ + w.drive[i] * Y;
    for (std::size_t k = 0; k < 3 && sources_.has_f(); ++k) x.noalias() += w.input[i][k] * s.f[k];
    const Vector slack = M_ * y + d_.N * x + s.g[i], off = slack.cwiseMin(w.answer[i].cwiseProduct(y)).cwiseAbs();
    terms_ = terms_.cwiseMax(M_.cwiseAbs() * y.cwiseAbs() + d_.N.cwiseAbs() * x.cwiseAbs() + s.g[i].cwiseAbs());
    answers_ = answers_.cwiseMax(w.answer[i]);
    sum_ += part_shares[i] * p.length / T_ * off;
    at_ = (off.array() > largest_.array()).select((p.from + part_nodes[i] * (p.to - p.from)) / T_, at_);
    largest_ = largest_.cwiseMax(off);
    if (i == 1) x_ = x;
  }
}

void Defect::make_places() {
  const Index m = d_.A.rows();
  const PartWeights& part = weights_.of(h_ / double(division));
  for (Index k = 0; k < division; ++k)
    for (std::size_t i = 0; i < 2; ++i) {
      Place p;
      p.at = (double(k) + part_nodes[i]) / double(division);
      p.share = part_shares[i] / double(division);
      p.answer = part.answer[i];
      const auto phi = phis_.phis(p.at * h_);
      p.decay = (*phi)[0];
      p.input.resize(m, 3 * m);  // ∫_0^{ch} e^{(ch-s)A} (s/h)^k ds
      p.input << p.at * h_ * (*phi)[1], h_ * p.at * p.at * (*phi)[2], 2 * h_ * p.at * p.at * p.at * (*phi)[3];
      const Matrix constant = p.input.leftCols(m) * d_.B, linear = p.input.middleCols(m, m) * d_.B;
      p.drive.resize(m, 2 * n_);
      p.drive << constant - linear, linear;
      places_.push_back(std::move(p));
    }
}

RowMatrix Defect::pass_kept(Index first) {
  if (places_.empty()) make_places();
  const Index steps = kept_.steps(), m = x_.size();
  Matrix y(steps, 2 * n_), f;
  y << y_.begins(first, steps), y_.ends(first, steps);
  if (kept_.has_f()) {
    f.resize(steps, 3 * m);
    f << kept_.f(0), kept_.f(1), kept_.f(2);
  }
  const Place& end = places_.back();
  RowMatrix rows = y * end.drive.transpose();
  if (kept_.has_f()) rows.noalias() += f * end.input.transpose();
  Matrix from(steps, m);
  Vector next(m);
  for (Index k = 0; k < steps; ++k) {
    from.row(k) = x_.transpose();
    next.noalias() = end.decay * x_;
    x_ = next + rows.row(k).transpose();
    rows.row(k) = x_.transpose();
  }
  for (const Place& p : places_) look_at(p, first, from, y, f);
  kept_.clear();
  return rows;
}

// One row a step. `from`: the states at their begins.
void Defect::look_at(const Place& p, Index first, const Matrix& from, const Matrix& y, const Matrix& f) {
  Matrix x = from * p.decay.transpose();
  x.noalias() += y * p.drive.transpose();
  if (kept_.has_f()) x.noalias() += f * p.input.transpose();
  const Matrix here = (1 - p.at) * y.leftCols(n_) + p.at * y.rightCols(n_);
  Matrix w = here * M_.transpose(), terms = here.cwiseAbs() * M_.cwiseAbs().transpose();
  w.noalias() += x * d_.N.transpose();
  terms.noalias() += x.cwiseAbs() * d_.N.cwiseAbs().transpose();
  if (kept_.has_g()) {
    const Matrix g = kept_.g(0) + p.at * (kept_.g(1) + p.at * kept_.g(2));
    w += g;
    terms += g.cwiseAbs();
  }
  const Matrix off = w.cwiseMin(here * p.answer.asDiagonal()).cwiseAbs();
  terms_ = terms_.cwiseMax(terms.colwise().maxCoeff().transpose());
  answers_ = answers_.cwiseMax(p.answer);
  sum_ += p.share * h_ / T_ * off.colwise().sum().transpose();
  for (Index i = 0; i < n_; ++i) {
    Index step = 0;
    const double most = off.col(i).maxCoeff(&step);
    if (!(most > largest_[i])) continue;
    largest_[i] = most;
    at_[i] = (double(first + step - 1) + p.at) * h_ / T_;
  }
}

void Defect::summarise(Certificate& c) const {
  const Vector size = terms_.cwiseMax(1e-290);
  c.mean_defect = sum_.cwiseQuotient(size).maxCoeff();
  c.largest_defect = largest_.cwiseQuotient(size).maxCoeff(&c.defect_row);
  c.defect_at = at_[c.defect_row];
}

}  // namespace bromwich
