// Many scenes side by side.

#include "batch/batch.hpp"

#include "capi/arrays.hpp"
#include "capi/failures.hpp"
#include "capi/handles.hpp"
#include "capi/settings.hpp"
#include "cpu/cpu_backend.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <string_view>
#include <utility>

struct bromwich_batch {
  bromwich::BatchResult result;
  bromwich::Vector infeasible_at;
};

using namespace bromwich;
using namespace bromwich::capi;

namespace {

std::unique_ptr<bromwich_batch> solved(const bromwich_scene* const* scenes, int64_t count,
                                       const std::vector<double>& times, const char* text,
                                       const bromwich_hooks* hooks) {
  if (count < 1) throw Error("count", fmt::format("found {}", count), "give one scene or more");
  given_array(scenes, count, "scenes");
  std::vector<Scene> list;
  for (int64_t k = 0; k < count; ++k) list.push_back(given(scenes[k], "scenes").complete());
  Settings settings = settings_of(text, list.front(), scenes[0]->circuit != nullptr);
  listen(settings.options, hooks_of(hooks));
  const std::shared_ptr<Backend> backend = backend_of(settings, list.front());
  Batch batch = batch_of(std::move(list));
  batch.times = times;
  MakeBackend beside;
  if (backend->name() == "cpu") beside = [] { return std::shared_ptr<Backend>(make_cpu_backend(1)); };
  auto made = std::make_unique<bromwich_batch>();
  made->result = solve_batch(batch, *backend, settings.options, beside);
  made->infeasible_at = Eigen::Map<const Vector>(made->result.infeasible_at.data(), count);
  return made;
}

HandedOver array_of(const bromwich_batch& batch, const std::string& name) {
  const BatchResult& r = batch.result;
  if (name == "t") return HandedOver(r.t);
  if (name == "y") return HandedOver(r.y);
  if (name == "w") return HandedOver(r.w);
  if (name == "x") return HandedOver(r.x);
  if (name == "residual") return HandedOver(r.residual);
  if (name == "infeasible_at") return HandedOver(batch.infeasible_at);
  const std::vector<std::string> known{"t", "y", "w", "x", "residual", "infeasible_at"};
  throw Error("name", fmt::format("found '{}'", name) + suggestion(name, known), "use " + join(known));
}

bool has(const bromwich_batch* batch, int64_t k) { return batch && k >= 0 && k < batch->result.scenes; }

}  // namespace

int bromwich_solve_batch(const bromwich_scene* const* scenes, int64_t count, const double* times, int64_t time_count,
                         const char* options, const bromwich_hooks* hooks, bromwich_batch** batch) {
  return guarded([&] {
    given_array(times, time_count, "times");
    const std::vector<double> rows(times, times + time_count);
    given(batch, "batch") = solved(scenes, count, rows, options, hooks).release();
  });
}

int bromwich_batch_status(const bromwich_batch* batch, int64_t k) {
  return has(batch, k) ? int(batch->result.status[std::size_t(k)]) : -1;
}

const char* bromwich_batch_text(const bromwich_batch* batch, int64_t k, const char* name) {
  if (!has(batch, k) || !name) return nullptr;
  const BatchResult& r = batch->result;
  const std::string_view wanted = name;
  const auto i = std::size_t(k);
  if (wanted == "status") return to_string(r.status[i]);
  if (wanted == "method") return to_string(r.method[i]);
  if (wanted == "reason") return r.reason[i].c_str();
  return wanted == "warning" ? r.warning[i].c_str() : nullptr;
}

int bromwich_batch_array(const bromwich_batch* batch, const char* name, const double** values, int64_t* rows,
                         int64_t* columns) {
  return guarded([&] { hand_over(array_of(given(batch, "batch"), &given(name, "name")), values, rows, columns); });
}

void bromwich_batch_free(bromwich_batch* batch) { delete batch; }
