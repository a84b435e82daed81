// Derivatives of all built-in scenes and all scene files of a folder, against central differences of solves.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/derivative_check.hpp"
#include "bench/studies/study.hpp"
#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "files/scene_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

namespace bromwich::app {

namespace {

constexpr Index grids = 10;         ///< from which the one with the largest margin is taken
constexpr Index large = 1000;       ///< states from which there is one grid
constexpr Index most_steps = 4000;  ///< of a scene whose default is longer

const std::map<Verdict, std::string> names{
    {Verdict::agrees, "agrees"}, {Verdict::undecided, "undecided"}, {Verdict::differs, "differs"}};

struct Given {
  std::string name;
  std::function<Scene()> scene;
};

std::vector<Given> all_scenes(const BenchRequest& request) {
  std::vector<Given> all;
  if (!request.scene)
    for (const SceneRecipe& recipe : scene_catalogue())
      all.push_back({recipe.name, [name = recipe.name] { return make_scene(name); }});
  if (!request.scene || std::filesystem::exists(*request.scene))
    for (const auto& path : scene_files(request.scene.value_or(examples_folder)))
      all.push_back({path.filename(), [path] { return read_scene_file(path).scene; }});
  else
    all.push_back({*request.scene, [&request] { return choose_scene(*request.scene, request.settings).scene; }});
  return all;
}

Json row_of(const Given& given, const DerivativeCheck& c) {
  Json row{{"scene", given.name}, {"states", c.states}, {"constraints", c.constraints}, {"kind", c.kind}};
  row["reason"] = c.reason;
  row["error"] = c.error;
  row["refused"] = c.refused;
  if (c.kind.empty()) return row;
  row[c.kind == "located" ? "switches" : "steps"] = c.steps;
  row["margin"] = c.margin;
  row["T"] = c.T;
  row["identity"] = std::isnan(c.identity) ? Json() : Json(c.identity);
  row["largest_error"] = c.largest_error();
  row["noise"] = c.noise;
  row["verdict"] = names.at(c.verdict());
  return row;
}

}  // namespace

BenchReport bench_derivatives(const BenchRequest& request, Backend& backend) {
  BenchReport report;
  report.scene = request.scene.value_or("all built-in scenes and examples");
  report.details["error"] =
      "by each datum: largest |jvp - central difference| over the largest change, of y or of x (with located switches "
      "of the integral of y, too), whichever is larger, over all time points";
  report.details["T"] =
      "half of that of the scene, or less, where it grows so that the noise of differences is above 1e-6";
  report.details["noise"] = "of the discrete solution: the same between two differences with steps of 1 : 2";
  report.details["verdict"] =
      "agrees: all errors at most 1e-6 (located: 1e-4); undecided: an error above that, but no more than ten times the "
      "noise of its differences; differs: an error above both";
  report.details["identity"] = "largest |<u, J v> - <J^T u, v>| / (|u| |J v|), u and v drawn";
  report.details["margin"] = "smallest max(y_i, w_i) relative to the largest; located: or the smallest transversality";
  std::vector<std::vector<std::string>> lines{{"scene", "m", "n", "kind", "margin", "error", "identity", "refused"}};
  std::map<Verdict, Index> count;
  for (const Given& given : all_scenes(request)) {
    DerivativeCheck c;
    try {
      const Scene scene = given.scene();
      const Index steps = request.steps > 0 ? request.steps : std::min(scene.steps(), most_steps);
      c = check_derivatives(scene, backend, steps, request.quick || scene.states() > large ? 1 : grids);
    } catch (const Error& unread) {
      c.reason = unread.what();
    }
    const Json row = row_of(given, c);
    if (!c.kind.empty()) ++count[c.verdict()];
    std::string refused = c.reason;
    for (const auto& [name, why] : c.refused) refused += (refused.empty() ? "" : ", ") + name;
    lines.push_back({given.name, fmt::format("{}", c.states), fmt::format("{}", c.constraints), c.kind,
                     scientific(c.margin), scientific(c.kind.empty() ? NAN : c.largest_error()), scientific(c.identity),
                     refused.substr(0, 60)});
    print(fmt::format("{}: {} {} {}\n", given.name, c.kind, scientific(c.kind.empty() ? NAN : c.largest_error()),
                      refused));
    report.rows.push_back(row);
  }
  report.notes.push_back(fmt::format("{} scenes agree within {:.0e} (located {:.0e}), {} are undecided, {} differ",
                                     count[Verdict::agrees], expected_discrete, expected_located,
                                     count[Verdict::undecided], count[Verdict::differs]));
  print_with_notes(table(lines), report);
  return report;
}

}  // namespace bromwich::app
