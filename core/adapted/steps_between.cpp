#include "core/adapted/steps_between.hpp"

#include "core/adapted/radau_steps.hpp"
#include "core/host/step_lcp.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

constexpr double parts_of_step = 8;
constexpr double equal_times = 1e-12;    ///< of T
constexpr double equal_lengths = 1e-11;  ///< lengths that differ by rounding share their matrices
constexpr double most_numbers = 5e7;     ///< in the matrices of all lengths, about

}  // namespace

// A step with y linear, or the same at all its times.
struct StepsBetween::OfLength {
  OfLength(const PartWeights& given, const Matrix& N, const Matrix& M) : w(given) {
    const Index n = M.rows();
    Matrix none = Matrix::Zero(2 * n, 2 * n), whole = none;
    for (Index i = 0; i < 2; ++i) {
      none.block(i * n, i * n, n, n) = M;
      whole.middleRows(i * n, n) = N * w.drive[std::size_t(i)];
    }
    linear = std::make_unique<host::StepLcp>(none + whole, M, LcpClass::unknown, none);
    of_one = w.drive[1].leftCols(n) + w.drive[1].rightCols(n);
    constant = std::make_unique<host::StepLcp>(M + N * of_one, M, LcpClass::unknown, M);
  }

  PartWeights w;
  Matrix of_one;  ///< m x n: what y, the same at all times, does to x
  std::unique_ptr<host::StepLcp> linear, constant;
};

StepsBetween::StepsBetween(const Scene& scene, double h)
    : scene_(scene),
      d_(*scene.dynamics->small_state()),
      M_(to_dense(scene.M)),
      h_(h),
      same_time_(equal_times * scene.T),
      sources_(scene) {}

StepsBetween::~StepsBetween() = default;

bool StepsBetween::suit(const Scene& scene) {
  const DenseDynamics* d = scene.dynamics->small_state();
  return d && d->E.size() == 0 && unsuited_to_radau_steps(scene).empty();
}

StepsBetween::OfLength& StepsBetween::of(double length) {
  const double same = equal_lengths * length, size = double(d_.A.rows() + 2 * M_.rows());
  const auto near = kept_.lower_bound(length - same);
  if (near != kept_.end() && near->first <= length + same) return *near->second;
  if (!weights_ || double(kept_.size()) * 8 * size * size > most_numbers) {
    kept_.clear();
    weights_ = std::make_unique<PartWeightsFamily>(d_.A, d_.B, d_.N, M_, sources_.has_f());
  }
  return *(kept_[length] = std::make_unique<OfLength>(weights_->of(length), d_.N, M_));
}

bool StepsBetween::take(const Part& p) {
  OfLength& step = of(p.length);
  const Index n = M_.rows();
  const PartSources f = sources_.on(p);
  std::array<Vector, 2> x;
  Vector q(2 * n), Y = Vector::Zero(2 * n);
  for (std::size_t i = 0; i < 2; ++i) {
    x[i] = step.w.decay[i] * row_.x;
    for (std::size_t k = 0; k < 3 && sources_.has_f(); ++k) x[i] += step.w.input[i][k] * f.f[k];
    q.segment(Index(i) * n, n) = d_.N * x[i] + f.g[i];
  }
  if (!q.allFinite()) return false;
  const bool jumps = is_shortest(p);
  if ((q.array() < 0).any()) {
    host::StepLcp& lcp = jumps ? *step.constant : *step.linear;
    if (!lcp.well_posed()) lcp.start_from(jumps ? row_.y : Vector(row_.y.replicate(2, 1)));
    MarchReport report;
    Vector y = Vector::Zero(jumps ? n : 2 * n);
    if (!lcp.solve(jumps ? Vector(q.tail(n)) : q, y, 0, report)) return false;
    Y = jumps ? Vector(y.replicate(2, 1)) : y;
    x[1] += step.w.drive[1] * Y;
  }
  row_.x = x[1];
  row_.y = Y.tail(n);
  row_.integral += p.length * (0.75 * Y.head(n) + 0.25 * Y.tail(n));
  return true;
}

bool StepsBetween::breaks_in(double from, double until) const {
  const std::vector<double>& breaks = scene_.breakpoints;
  const auto next = std::lower_bound(breaks.begin(), breaks.end(), from - same_time_);
  return next != breaks.end() && *next <= until + same_time_;
}

// From one end, breakpoint or asked time to the next, in steps of equal length, or of doubled ones behind a jump.
bool StepsBetween::pass(double a, double b, bool layer) {
  const double length = b - a, most = layer ? h_ / parts_of_step / length : 1 / std::ceil(length / h_ * parts_of_step);
  for (double begin = 0; begin < 1;) {
    const double wanted = !layer ? begin + most : begin == 0 ? shortest_part : std::min(2 * begin, begin + most);
    const double end = wanted > 1 - shortest_part ? 1 : wanted;
    Part part;
    part.begin = begin;
    part.end = end;
    part.length = (layer ? end - begin : most) * length;
    part.from = a + begin * length;
    part.to = end == 1 ? b : a + end * length;
    if (!take(part)) return false;
    begin = end;
  }
  return true;
}

const TreeRow* StepsBetween::at(double begin, const Vector& x, const Vector& y, double s) {
  const double end = begin + s;
  if (begin_ != begin || end < t_) {
    row_ = {x, y.allFinite() ? y : Vector(Vector::Zero(y.size())), Vector::Zero(y.size())};
    begin_ = t_ = begin;
  }
  const std::vector<double>& breaks = scene_.breakpoints;
  while (end - t_ > same_time_) {
    const auto next = std::upper_bound(breaks.begin(), breaks.end(), t_ + same_time_);
    const double stop = next != breaks.end() && *next < end - same_time_ ? *next : end;
    if (!pass(t_, stop, t_ == begin ? begin == 0 || breaks_in(begin - h_, begin) : breaks_in(t_, t_))) {
      begin_ = NAN;
      return nullptr;
    }
    t_ = stop;
  }
  return &row_;
}

}  // namespace bromwich
