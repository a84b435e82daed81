#include "batch/batch_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/lcp/lcp_class.hpp"

#include <cmath>
#include <utility>

namespace bromwich {

BatchDerivative::BatchDerivative(const Batch& batch, const BatchResult& result, std::optional<bool> located,
                                 Backend* backend)
    : rows_(result.rows()) {
  batch.validate();
  if (!batch.times.empty() && !located.value_or(true))
    throw Error("times", "the rows of the result are not the time points of its grid",
                "solve without times, or take derivatives with located switches");
  if (!batch.times.empty()) located = true;
  const Scene first = scene_of(batch, 0);
  m_ = first.states(), n_ = first.constraints();
  const Index K = batch.own.empty() ? batch.scenes : Index(batch.own.size());
  if (result.scenes != K || result.y.rows() != K * rows_ || result.y.cols() != n_ || rows_ < 2)
    throw Error("result", text("has %ld scenes of %ld rows", long(result.scenes), long(rows_)),
                text("give the result of these %ld scenes", long(K)));
  all_.resize(std::size_t(K)), reason_.resize(std::size_t(K));
  if (backend && !located.value_or(false)) together_ = DerivativesSideBySide::make(batch, result, *backend);
  for (Index k = 0; k < K; ++k) try {
      check_interruption();
      if (has(k)) continue;
      prepare(k, scene_of(batch, k), result, located);
    } catch (const Error& e) {
      all_[std::size_t(k)] = {};
      reason_[std::size_t(k)] = e.what();
    }
}

void BatchDerivative::prepare(Index k, const Scene& scene, const BatchResult& result, std::optional<bool> located) {
  One& one = all_[std::size_t(k)];
  const Result r = single_result(scene, result, k);
  if (r.status != Status::solved)
    throw Error("derivative", text("the scene is not solved (%s)", to_string(r.status)), "differentiate solved scenes");
  if (located.value_or(y_may_jump(r)))
    one.switched = std::make_shared<SwitchedDerivative>(scene, r.t, true);
  else
    one.discrete = std::make_shared<SolutionDerivative>(scene, r);
}

std::vector<bool> BatchDerivative::located() const {
  std::vector<bool> found;
  for (const One& one : all_) found.push_back(one.switched != nullptr);
  return found;
}

std::vector<DerivativeMargin> BatchDerivative::margin() const {
  std::vector<DerivativeMargin> found;
  for (const One& one : all_)
    found.push_back(one.switched   ? one.switched->margin()
                    : one.discrete ? one.discrete->margin()
                                   : DerivativeMargin{.margin = 0, .transversality = 0});
  for (Index k = 0; k < scenes(); ++k)
    if (has(k)) found[std::size_t(k)] = together_->margin(k);
  return found;
}

Index BatchDerivative::side_by_side() const {
  Index count = 0;
  for (Index k = 0; k < scenes(); ++k) count += has(k);
  return count;
}

template <class Out, class In, class Of>
PerScene<Out> BatchDerivative::each(const std::vector<In>& given, const HostThreads& threads, const Out& none,
                                    const Of& of) const {
  if (given.size() != 1 && Index(given.size()) != scenes())
    throw Error("change", text("found %ld entries", long(given.size())),
                text("give one for all scenes, or %ld", long(scenes())));
  PerScene<Out> found{std::vector<Out>(std::size_t(scenes()), none), reason_};
  share_each(threads, scenes(), [&](Index k) {
    const One& one = all_[std::size_t(k)];
    if (!one.discrete && !one.switched) return;
    const In& change = given.size() == 1 ? given[0] : given[std::size_t(k)];
    try {
      found.value[std::size_t(k)] = one.discrete ? of(*one.discrete, change) : of(*one.switched, change);
    } catch (const Error& e) {
      if (e.argument() != "derivative" && !(e.argument() == "M" && one.switched && !one.switched->without_M().empty()))
        throw;
      found.reason[std::size_t(k)] = e.what();
    }
  });
  return found;
}

PerScene<SolutionChange> BatchDerivative::jvp(const std::vector<DataChange>& changes,
                                              const HostThreads& threads) const {
  const RowMatrix y = RowMatrix::Constant(rows_, n_, NAN), x = RowMatrix::Constant(rows_, m_, NAN);
  auto found =
      each(changes, threads, SolutionChange{y, x, y, y}, [](const auto& d, const DataChange& c) { return d.jvp(c); });
  if (together_) together_->jvp(changes, found.value, found.reason);
  return found;
}

PerScene<DataChange> BatchDerivative::vjp(const std::vector<SolutionChange>& functions,
                                          const HostThreads& threads) const {
  const Matrix B = Matrix::Constant(m_, n_, NAN);
  const DataChange none{Vector::Constant(m_, NAN),
                        RowMatrix::Constant(rows_, m_, NAN),
                        RowMatrix::Constant(rows_, n_, NAN),
                        Matrix::Constant(m_, m_, NAN),
                        B,
                        B.transpose(),
                        Matrix::Constant(n_, n_, NAN),
                        {}};
  auto found = each(functions, threads, none, [](const auto& d, const SolutionChange& c) { return d.vjp(c); });
  if (together_) together_->vjp(functions, found.value);
  return found;
}

}  // namespace bromwich
