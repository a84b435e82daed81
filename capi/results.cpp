// Results: numbers, words and arrays.

#include "capi/arrays.hpp"
#include "capi/failures.hpp"
#include "capi/handles.hpp"
#include "core/solve/switch_errors.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <string_view>

using namespace bromwich;
using namespace bromwich::capi;

namespace {

static_assert(int(Status::solved) == BROMWICH_SOLVED && int(Status::tolerance_not_met) == BROMWICH_TOLERANCE_NOT_MET &&
              int(Status::infeasible) == BROMWICH_INFEASIBLE && int(Status::unsupported) == BROMWICH_UNSUPPORTED &&
              int(Status::nonfinite) == BROMWICH_NONFINITE && int(Status::interrupted) == BROMWICH_INTERRUPTED);

bromwich_summary summary_of(const Result& r) {
  bromwich_summary s{};
  s.status = int32_t(r.status);
  s.well_posed = r.well_posed ? 1 : 0;
  s.rows = r.t.size();
  s.steps = r.steps;
  s.iterations = r.iterations;
  s.residual = r.residual;
  s.error_estimate = r.error_estimate.value_or(NAN);
  s.boundary_residual = r.boundary_residual.value_or(NAN);
  s.kernel_error = r.kernel_error;
  s.infeasible_at = r.infeasible_at.value_or(NAN);
  s.seconds = r.seconds.total;
  return s;
}

const char* text_of(const Result& r, std::string_view name) {
  if (name == "status") return to_string(r.status);
  if (name == "method") return to_string(r.method);
  if (name == "reason") return r.reason.c_str();
  if (name == "warning") return r.warning.c_str();
  if (name == "backend") return r.backend.c_str();
  if (name == "kernel") return r.kernel.c_str();
  return nullptr;
}

RowMatrix switch_rows(const bromwich_result& r) {
  std::vector<Switch> found = switches_with_errors(r.scene, *r.backend, r.options, r.result);
  const std::vector<Index>& free = r.scene.free_rows;  // their y changes sign without a switch
  std::erase_if(found, [&](const Switch& s) { return std::binary_search(free.begin(), free.end(), s.component); });
  RowMatrix rows(Index(found.size()), 4);
  for (std::size_t k = 0; k < found.size(); ++k)
    rows.row(Index(k)) << found[k].t, double(found[k].component), found[k].on ? 1 : 0, found[k].error;
  return rows;
}

RowMatrix slack_rows(const bromwich_result& r) {
  if (r.result.trace.size() == 0 && r.result.y.size() > 0)
    throw Error("w", fmt::format("is not recorded by method {}", to_string(r.result.method)), "use another method");
  return slack(r.scene, r.result);
}

/// Computed at the first call.
template <class Make>
const RowMatrix& kept(std::optional<RowMatrix>& array, Make&& make) {
  if (!array) array = make();
  return *array;
}

HandedOver array_of(bromwich_result& r, const std::string& name) {
  if (name == "t") return HandedOver(r.result.t);
  if (name == "y") return HandedOver(r.result.y);
  if (name == "x") return HandedOver(r.result.x);
  if (name == "w") return HandedOver(kept(r.w, [&] { return slack_rows(r); }));
  if (name == "integral") return HandedOver(kept(r.integral, [&] { return integral_of_y(r.result); }));
  if (name == "switches") return HandedOver(kept(r.switches, [&] { return switch_rows(r); }));
  if (name == "outputs") {
    if (!r.circuit) throw Error("name", "found 'outputs' of a scene that is no netlist", "use x or y");
    return HandedOver(kept(r.outputs, [&] { return output_values(*r.circuit, r.result); }));
  }
  const std::vector<std::string> known{"t", "y", "w", "x", "integral", "switches", "outputs"};
  throw Error("name", fmt::format("found '{}'", name) + suggestion(name, known), "use " + join(known));
}

const char* entry(const std::vector<std::string>& names, int64_t k) {
  return k >= 0 && k < int64_t(names.size()) ? names[std::size_t(k)].c_str() : "";
}

std::unique_ptr<bromwich_result> at(const bromwich_result& r, const double* times, int64_t count) {
  given_array(times, count, "times");
  auto made = std::make_unique<bromwich_result>();
  made->result = at_times(r.scene, *r.backend, r.result, std::vector<double>(times, times + count));
  made->scene = r.scene;
  made->circuit = r.circuit;
  made->backend = r.backend;
  made->options = r.options;
  return made;
}

}  // namespace

int bromwich_result_summary(const bromwich_result* result, bromwich_summary* summary) {
  return guarded([&] {
    const Result& found = given(result, "result").result;
    const std::size_t size = given(summary, "summary").size;
    if (size <= offsetof(bromwich_summary, status))
      throw Error("summary.size", fmt::format("found {}", size), "set it to sizeof(bromwich_summary)");
    bromwich_summary made = summary_of(found);
    made.size = size;
    std::memcpy(summary, &made, std::min(size, sizeof made));
  });
}

const char* bromwich_result_text(const bromwich_result* result, const char* name) {
  return result && name ? text_of(result->result, name) : nullptr;
}

int bromwich_result_array(bromwich_result* result, const char* name, const double** values, int64_t* rows,
                          int64_t* columns) {
  return guarded([&] { hand_over(array_of(given(result, "result"), &given(name, "name")), values, rows, columns); });
}

int64_t bromwich_result_state(const bromwich_result* result, int64_t column) {
  if (!result || column < 0 || column >= int64_t(result->result.x_components.size())) return -1;
  return result->result.x_components[std::size_t(column)];
}

const char* bromwich_result_name(const bromwich_result* result, const char* array, int64_t column) {
  if (!result || !array) return "";
  const std::string_view name = array;
  if (name == "x") return entry(result->scene.names.x, bromwich_result_state(result, column));
  if (name == "y") return entry(result->scene.names.y, column);
  if (name == "w") return entry(result->scene.names.w, column);
  if (name == "outputs" && result->circuit && column >= 0 && column < int64_t(result->circuit->outputs.size()))
    return result->circuit->outputs[std::size_t(column)].name.c_str();
  return "";
}

int bromwich_result_at(const bromwich_result* result, const double* times, int64_t count, bromwich_result** rows) {
  return guarded([&] { given(rows, "rows") = at(given(result, "result"), times, count).release(); });
}

void bromwich_result_free(bromwich_result* result) { delete result; }
