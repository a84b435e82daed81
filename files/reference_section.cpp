#include "files/reference_section.hpp"

#include "core/base/error.hpp"
#include "core/result/result.hpp"
#include "files/names.hpp"
#include "files/scene_matrices.hpp"
#include "files/sections.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <tuple>
#include <vector>

namespace bromwich {

void require_entries(const FunctionValue& value, Index expected, const std::string& where, const char* meaning) {
  if (value.function && value.entries != expected)
    throw Error(where, fmt::format("has {} entries", value.entries), fmt::format("give {}, {}", expected, meaning));
}

namespace {

std::vector<std::string> status_words() {
  std::vector<std::string> words;
  for (const Status status : {Status::solved, Status::tolerance_not_met, Status::infeasible, Status::unsupported,
                              Status::nonfinite, Status::interrupted})
    words.emplace_back(to_string(status));
  return words;
}

}  // namespace

std::optional<Reference> read_reference(const Section& section, const Scene& scene) {
  if (!section.given()) return std::nullopt;
  Reference reference;
  reference.t = section.optional_number("t");
  reference.x = section.partly_known("x");
  reference.y = section.partly_known("y");
  reference.tolerance = section.optional_number("tolerance");
  reference.status = section.word("status", status_words());
  reference.infeasible_at = section.optional_number("infeasible_at");
  reference.source = section.text("source", "");
  for (const auto& [key, values, expected] :
       {std::tuple("x", &reference.x, scene.states()), std::tuple("y", &reference.y, scene.constraints())})
    if (!values->empty() && Index(values->size()) != expected)
      throw Error(section.where(key), fmt::format("has {} entries", values->size()), fmt::format("give {}", expected));
  if (reference.t && (*reference.t < 0 || *reference.t > scene.T))
    throw Error(section.where("t"), fmt::format("found {}", *reference.t), fmt::format("give 0 to T = {}", scene.T));
  if (!reference.t && !(reference.x.empty() && reference.y.empty()))
    throw Error(section.where("t"), "is missing", "add the time t of x and y");
  if (reference.tolerance && !(*reference.tolerance > 0))
    throw Error(section.where("tolerance"), fmt::format("found {}", *reference.tolerance), "give a positive number");
  return reference;
}

std::shared_ptr<const QuantityOfInterest> read_quantity(const Section& section, const Scene& scene) {
  if (!section.given()) return nullptr;
  QuadraticQuantity q;
  q.name = section.text("name", q.name);
  if (section.has("W")) q.W = sparse_value(section.matrix("W"));
  if (section.has("end_W")) q.end_W = sparse_value(section.matrix("end_W"));
  if (section.has("end_c")) q.end_c = section.vector("end_c");
  const FunctionValue c = section.function("c", scene.T);
  require_entries(c, scene.states(), section.where("c"), "one per state");
  q.c = c.function;
  q.breakpoints = c.switches.times;
  q.exact = section.optional_number("exact");
  std::shared_ptr<const QuantityOfInterest> quantity;
  const auto in_quantity = [&] {
    Places where;
    for (const char* key : {"W", "end_W", "end_c"}) where[key] = section.where(key);
    where["quantity"] = section.where("W");
    return where;
  };
  in_the_file(in_quantity, [&] { quantity = quadratic_quantity(q, scene.states()); });
  return quantity;
}

}  // namespace bromwich
