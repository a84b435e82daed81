// Scenes in arrays, by threads of the host. Arrays out of its reach are copied.

#include "core/seam/scene_arrays.hpp"

#include "core/base/error.hpp"
#include "core/seam/backend.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>

namespace bromwich {

namespace {

using namespace scene_steps;

constexpr Index scenes_of_a_range = 8;

/// The numbers of an array that is read.
class Read {
 public:
  Read(Backend& backend, const Array* array) : array_(array) {
    if (array_ && !array_->host_values()) backend.download(*array_, copy_);
  }
  /// Of scene k, `rows` rows each. Arrays of `rows` rows are shared.
  const double* of(Index k, Index rows) const {
    if (!array_) return nullptr;
    const double* all = array_->host_values() ? array_->host_values() : copy_.data();
    return array_->rows() > rows ? all + k * rows * array_->cols() : all;
  }

 private:
  const Array* array_;
  RowMatrix copy_;
};

/// Those of an array that is written; it has them when this ends.
class Written {
 public:
  Written(Backend& backend, Array* array) : backend_(backend), array_(array) {
    if (array_ && !array_->host_values()) copy_.setZero(array_->rows(), array_->cols());
  }
  void hand_over() {
    if (array_ && !array_->host_values()) backend_.upload(copy_, *array_);
  }
  double* of(Index k, Index rows) {
    if (!array_) return nullptr;
    return (array_->host_values() ? array_->host_values() : copy_.data()) + k * rows * array_->cols();
  }

 private:
  Backend& backend_;
  Array* array_;
  RowMatrix copy_;
};

Sets<> sets_of(const StoredSets& s) { return {s.V.data(), s.rows.data(), s.columns.data(), s.all_solutions}; }

class HostSceneArrays final : public SceneArrays {
 public:
  HostSceneArrays(Backend& backend, const SceneArraysProblem& problem, Index scenes)
      : backend_(backend), p_(problem), tables_(p_), rows_(p_.J + 1), scenes_(scenes), states_(std::size_t(scenes)) {
    s_ = {p_.m,
          p_.n,
          p_.J,
          p_.h,
          p_.E.data(),
          p_.L.data(),
          p_.R.data(),
          p_.B.data(),
          p_.N.data(),
          p_.M.data(),
          tables_.left.data(),
          tables_.right.data(),
          sets_of(p_.steps),
          sets_of(p_.start)};
    Matrices<const double*>& rows = checks_.rows;
    rows.m = p_.m, rows.J = p_.J, rows.h = p_.h, rows.most_growth = p_.most_growth;
    rows.E = rows.growth_E = p_.E.data(), rows.L = tables_.left.data(), rows.R = tables_.right.data();
    rows.N = p_.N.data(), rows.M = p_.M.data(), rows.B = p_.B.data();
    rows.growth_G = tables_.growth_G.data();
    rows.size_of_E = tables_.size_of_E.data(), rows.size_of_R = tables_.size_of_R.data();
    rows.part = tables_.part.data(), rows.y_unit = rows.w_unit = tables_.ones.data();
    checks_.longest = p_.longest.size() > 0 ? p_.longest.data() : nullptr;
    checks_.zeros = tables_.zeros.data();
  }

  Index scenes() const override { return scenes_; }
  std::size_t bytes() const override { return 0; }

  States solve(const SceneSources& of, Array& y) override {
    const Read x0(backend_, of.x0), f(backend_, of.f), g(backend_, of.g);
    Written to(backend_, &y);
    States states;
    states.resize(std::size_t(scenes_));
    each([&](auto n, Index k) {
      const auto steps = steps_of<n>(f.of(k, rows_), g.of(k, rows_));
      steps.solve(x0.of(k, 1), HeldRows{to.of(k, rows_), n}, states[std::size_t(k)]);
    });
    to.hand_over();
    return states;
  }

  States follow(const SceneSources& of, Array& y, Array& x, Array& w) override {
    of_ = of, y_ = &y, x_ = &x;
    const Read x0(backend_, of.x0), f(backend_, of.f), g(backend_, of.g), along(backend_, &y);
    Written to_x(backend_, &x), to_w(backend_, &w);
    states_.assign(std::size_t(scenes_), {});
    each([&](auto n, Index k) {
      const auto steps = steps_of<n>(f.of(k, rows_), g.of(k, rows_));
      HeldState& state = states_[std::size_t(k)];
      const HeldRows own_x{to_x.of(k, rows_), p_.m};
      const double* const own_y = along.of(k, rows_);
      steps.follow({own_y, n}, x0.of(k, 1), own_x, {to_w.of(k, rows_), n}, state);
      if (!checks_.longest) return;
      RowMatrix y_rows = Eigen::Map<const RowMatrix>(own_y, rows_, n), drift(rows_, p_.m);
      steps.doubt(checks_, {y_rows.data(), n}, own_x, {drift.data(), p_.m}, state);
    });
    to_x.hand_over();
    to_w.hand_over();
    return states_;
  }

  std::vector<char> forward(const SceneChange& c, const SceneRows<Array>& out) override {
    const Along along(*this);
    const Read x0(backend_, c.of.x0), f(backend_, c.of.f), g(backend_, c.of.g), matrices(backend_, c.matrices);
    Written y(backend_, out.y), x(backend_, out.x), w(backend_, out.w), integral(backend_, out.integral);
    std::vector<char> decided(std::size_t(scenes_), 0);
    each([&](auto n, Index k) {
      const HeldState& state = states_[std::size_t(k)];
      if (state.verdict != HeldState::fine) return;
      const auto steps = steps_of<n>(along.f.of(k, rows_), nullptr);
      const Index m = p_.m;
      decided[std::size_t(k)] =
          steps.forward({along.y.of(k, rows_), n}, {along.x.of(k, rows_), m}, state,
                        {x0.of(k, 1), {f.of(k, rows_), m}, {g.of(k, rows_), n}, matrices.of(k, 1)},
                        {{y.of(k, rows_), n}, {x.of(k, rows_), m}, {w.of(k, rows_), n}, {integral.of(k, rows_), n}});
    });
    for (Written* table : {&y, &x, &w, &integral}) table->hand_over();
    return decided;
  }

  std::vector<char> backward(const SceneRows<const Array>& of, const SceneGradient& bar) override {
    const Along along(*this);
    const Read y(backend_, of.y), x(backend_, of.x), w(backend_, of.w), integral(backend_, of.integral);
    Written x0(backend_, bar.x0), f(backend_, bar.f), g(backend_, bar.g), matrices(backend_, bar.matrices);
    std::vector<char> decided(std::size_t(scenes_), 0);
    each([&](auto n, Index k) {
      const HeldState& state = states_[std::size_t(k)];
      if (state.verdict != HeldState::fine) return;
      const auto steps = steps_of<n>(along.f.of(k, rows_), nullptr);
      const Index m = p_.m;
      decided[std::size_t(k)] =
          steps.backward({along.y.of(k, rows_), n}, {along.x.of(k, rows_), m}, state,
                         {{y.of(k, rows_), n}, {x.of(k, rows_), m}, {w.of(k, rows_), n}, {integral.of(k, rows_), n}},
                         {x0.of(k, 1), {f.of(k, rows_), m}, {g.of(k, rows_), n}, matrices.of(k, 1)});
    });
    for (Written* table : {&x0, &f, &g, &matrices}) table->hand_over();
    return decided;
  }

 private:
  // What the last `follow` was given.
  struct Along {
    Read f, y, x;
    explicit Along(const HostSceneArrays& a)
        : f(a.backend_, a.of_.f), y(a.backend_, checked(a.y_)), x(a.backend_, a.x_) {}
    static const Array* checked(const Array* y) {
      if (!y) throw Error("derivative", "has no solution yet", "call follow first");
      return y;
    }
  };

  template <Index n>
  HeldSteps<0, n> steps_of(const double* f, const double* g) const {
    return {s_, {f, p_.m}, {g, n}};
  }

  // use(n, k), n a constant.
  template <class Use>
  void each(const Use& use) const {
    const auto of = [&]<Index n>(std::integral_constant<Index, n> size) {
      backend_.each_range(scenes_, scenes_of_a_range, [&](Index first, Index last) {
        for (Index k = first; k < last; ++k) use(size, k);
      });
    };
    const auto choose = [&]<Index... n>(std::integer_sequence<Index, n...>) {
      ((p_.n == n + 1 ? of(std::integral_constant<Index, n + 1>()) : void()), ...);
    };
    choose(std::make_integer_sequence<Index, most_held>());
  }

  Backend& backend_;
  const SceneArraysProblem p_;
  const SceneArraysTables tables_;
  HeldMatrices s_;
  HeldChecks checks_;
  Index rows_, scenes_;
  SceneSources of_;
  const Array *y_ = nullptr, *x_ = nullptr;
  States states_;
};

}  // namespace

SceneArraysTables::SceneArraysTables(const SceneArraysProblem& p)
    : left(p.L * p.B),
      right(p.R * p.B),
      growth_G(p.E * right + left),
      size_of_E(p.E.cwiseAbs()),
      size_of_R(right.cwiseAbs()),
      part(p.m),
      ones(Vector::Ones(p.n)),
      zeros(Vector::Zero(std::max(p.m, p.n))) {
  for (Index i = 0; i < p.m; ++i) part[i] = std::cos(1.0 + 2.399963 * double(i));
}

bool steps_many_scenes(const Backend& backend) { return bool(backend.fused().scene_arrays); }

std::unique_ptr<SceneArrays> make_scene_arrays(Backend& backend, const SceneArraysProblem& problem, Index scenes) {
  if (problem.m < 1 || problem.n < 1 || problem.m > most_held || problem.n > most_held)
    throw Error("scene", std::to_string(problem.m) + " states and " + std::to_string(problem.n) + " constraints",
                "scenes in arrays have 1 to " + std::to_string(most_held) + " of each");
  if (const auto& make = backend.fused().scene_arrays)
    if (auto made = make(problem, scenes)) return made;
  return std::make_unique<HostSceneArrays>(backend, problem, scenes);
}

}  // namespace bromwich
