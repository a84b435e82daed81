#include "batch/batch_parameters.hpp"

#include "batch/derivatives_side_by_side.hpp"
#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr Index scenes_for_a_thread = 16;  ///< whose neighbours are kept

// A scene, its result, and the scenes beside it.
struct SceneBeside {
  Scene scene;
  Result result;
  std::vector<VariedParameter> parameters;
  std::vector<ParameterNeighbours> neighbours;
};

}  // namespace

BatchJacobian jacobian_of(const Batch& batch, const BatchResult& result, const ParametersOfScene& parameters,
                          Backend& backend, std::optional<bool> located, const HostThreads& threads) {
  batch.validate();
  const Index K = batch.own.empty() ? batch.scenes : Index(batch.own.size());
  if (result.scenes != K || result.rows() < 2)
    throw Error("result", text("has %ld scenes of %ld rows", long(result.scenes), long(result.rows())),
                text("give the result of these %ld scenes", long(K)));
  if (!batch.times.empty()) located = true;  // its rows are not the time points of a grid
  const Index P = Index(parameters(0).size());
  BatchJacobian found;
  found.by.assign(std::size_t(P), std::vector<SolutionChange>(std::size_t(K)));
  found.reason.resize(std::size_t(K));
  found.margin.assign(std::size_t(K), DerivativeMargin{.margin = 0, .transversality = 0});
  const auto attempt = [&](Index k, const auto& work) {
    try {
      work();
    } catch (const Error& e) {
      found.reason[std::size_t(k)] = e.what();
    }
  };
  const Index block = scenes_for_a_thread * threads.threads();
  for (Index first = 0; first < K; first += block) {
    check_interruption();
    const Index count = std::min(block, K - first);
    std::vector<SceneBeside> all{std::size_t(count)};
    for (Index i = 0; i < count; ++i)
      attempt(first + i, [&] {
        SceneBeside& p = all[std::size_t(i)];
        p.scene = scene_of(batch, first + i);
        p.result = single_result(p.scene, result, first + i);
        p.parameters = parameters(first + i);
        p.neighbours = neighbours_of_all(p.parameters, p.scene, p.result);
      });
    share_each(threads, count, [&](Index i) {
      const Index k = first + i;
      if (!found.reason[std::size_t(k)].empty()) return;
      attempt(k, [&] {
        SceneBeside& p = all[std::size_t(i)];
        const ParameterDerivative d(std::move(p.neighbours), p.scene, p.result, backend, p.parameters, located);
        std::vector<SolutionChange> by;
        for (Index j = 0; j < P; ++j) by.push_back(d.jvp(j));
        for (Index j = 0; j < P; ++j) found.by[std::size_t(j)][std::size_t(k)] = std::move(by[std::size_t(j)]);
        found.margin[std::size_t(k)] = d.of_data().margin();
      });
    });
  }
  return found;
}

}  // namespace bromwich
