#include "files/sweep.hpp"

#include "core/base/error.hpp"
#include "files/include.hpp"
#include "files/sections.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace bromwich {

namespace {

// Values that vary together: columns of one axis of the product.
struct Axis {
  std::vector<std::string> names;
  RowMatrix values;
};

constexpr const char* forms =
    "give a list [1, 2, 5], {from = 1, to = 10, points = 4}, with log = true for equal ratios, or a draw {uniform = "
    "[a, b]}, {log_uniform = [a, b]} or {normal = [mean, deviation]}";

// splitmix64: the same numbers on every machine.
class Draws {
 public:
  explicit Draws(std::uint64_t seed) : state_(seed) {}
  double uniform() {  // in (0, 1)
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return (double((z ^ (z >> 31)) >> 11) + 0.5) * 0x1p-53;
  }
  double normal() {  // Box and Muller
    const double radius = std::sqrt(-2 * std::log(uniform()));
    return radius * std::cos(2 * std::numbers::pi * uniform());
  }

 private:
  std::uint64_t state_;
};

class SweepReader {
 public:
  SweepReader(const Document& document, const toml::table& table, const Section& section,
              std::vector<std::string> known)
      : document_(document), table_(table), section_(section), known_(std::move(known)) {}

  Sweep read() {
    order_keys();
    for (const std::string& key : keys_)
      if (const toml::node& node = *table_.get(key); is_draw(node)) drawn_.push_back(key);
    if (!drawn_.empty()) draw();
    if (!drawn_.empty() != section_.has("draws"))
      throw Error(section_.where("draws"), drawn_.empty() ? "is given without a parameter to draw" : "is missing",
                  drawn_.empty() ? "add one such as R = {uniform = [1, 2]}" : "give the number of draws");
    for (const std::string& key : keys_)
      if (std::find(drawn_.begin(), drawn_.end(), key) == drawn_.end()) add_axis(key);
    if (section_.has("file")) add_file();
    if (axes_.empty()) throw Error(section_.where("file"), "has no parameter", forms);
    return section_.word("combine", {"product", "rows"}) == "rows" ? rows() : product();
  }

 private:
  static constexpr const char* reserved_[] = {"file", "draws", "seed", "combine", "columns"};

  [[noreturn]] void refuse(const std::string& key, const std::string& found, const std::string& remedy) const {
    throw Error(section_.where(key), found, remedy);
  }

  // In the order of the file, which is that of the columns.
  void order_keys() {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (std::find(std::begin(reserved_), std::end(reserved_), name) != std::end(reserved_)) continue;
      check_name(section_.where(name), name);
      keys_.push_back(name);
    }
    std::stable_sort(keys_.begin(), keys_.end(), [&](const std::string& a, const std::string& b) {
      const auto place = [&](const std::string& k) { return table_.get(k)->source().begin; };
      return std::pair(place(a).line, place(a).column) < std::pair(place(b).line, place(b).column);
    });
  }

  void check_name(const std::string& where, const std::string& name) const {
    if (std::find(known_.begin(), known_.end(), name) != known_.end()) return;
    throw Error(where, fmt::format("'{}' is no parameter{}", one_line(name), suggestion(name, known_)),
                "use one of " + join(known_));
  }

  double number(const toml::node& node, const std::string& key) const {
    if (const auto* text = node.as_string()) return document_.expressions.number(text->get(), section_.where(key));
    const double value = value_of(node);
    if (!std::isfinite(value)) refuse(key, "found " + kind(node), "give finite numbers, or expressions in quotes");
    return value;
  }

  static bool is_draw(const toml::node& node) {
    const toml::table* t = node.as_table();
    return t && (t->contains("uniform") || t->contains("log_uniform") || t->contains("normal"));
  }

  void check_keys(const std::string& key, const toml::table& table, const std::vector<std::string>& allowed) const {
    for (const auto& [word, node] : table)
      if (const std::string found(word.str()); std::find(allowed.begin(), allowed.end(), found) == allowed.end())
        refuse(key, fmt::format("has the key '{}'{}", one_line(found), suggestion(found, allowed)),
               "use " + join(allowed));
  }

  void add_axis(const std::string& key) {
    const toml::node& node = *table_.get(key);
    if (const toml::array* list = node.as_array()) return add_list(key, *list);
    const toml::table* range = node.as_table();
    if (!range) refuse(key, "found " + kind(node), forms);
    check_keys(key, *range, {"from", "to", "points", "log"});
    for (const char* word : {"from", "to", "points"})
      if (!range->contains(word)) refuse(key, fmt::format("has no '{}'", word), forms);
    const double from = number(*range->get("from"), key), to = number(*range->get("to"), key),
                 points = number(*range->get("points"), key);
    bool log = false;
    if (const toml::node* word = range->get("log")) {
      if (!word->is_boolean()) refuse(key, "found log = " + kind(*word), "give log = true or false");
      log = word->as_boolean()->get();
    }
    if (points != std::floor(points) || points < 1 || points > double(most_swept))
      refuse(key, fmt::format("found points = {}", points), "give a whole number from 1 on");
    if (log && !(from * to > 0))
      refuse(key, fmt::format("found log = true from {} to {}", from, to), "give ends of one sign, neither 0");
    RowMatrix values(Index(points), 1);
    for (Index i = 0; i < values.rows(); ++i) {
      const double s = points > 1 ? double(i) / (points - 1) : 0;
      values(i, 0) = i > 0 && i + 1 == values.rows() ? to
                     : log                           ? from * std::pow(to / from, s)
                                                     : from + s * (to - from);
    }
    axes_.push_back({{key}, std::move(values)});
  }

  void add_list(const std::string& key, const toml::array& list) {
    if (list.empty()) refuse(key, "found an empty list", forms);
    RowMatrix values(Index(list.size()), 1);
    for (std::size_t i = 0; i < list.size(); ++i) values(Index(i), 0) = number(*list.get(i), key);
    axes_.push_back({{key}, std::move(values)});
  }

  void draw() {
    const Index count = section_.positive_integer("draws", 1);
    const double seed = section_.has("seed") ? section_.number("seed") : 0;
    if (seed < 0 || seed != std::floor(seed) || seed > 0x1p53)
      refuse("seed", fmt::format("found {}", seed), "give a whole number from 0 on");
    Axis axis{drawn_, RowMatrix(count, Index(drawn_.size()))};
    for (std::size_t c = 0; c < drawn_.size(); ++c) {  // another parameter leaves the draws of this one as they are
      std::uint64_t hash = 1469598103934665603u;
      for (const unsigned char letter : drawn_[c]) hash = (hash ^ letter) * 1099511628211u;
      Draws draws(hash ^ std::uint64_t(seed));
      const toml::table& table = *table_.get(drawn_[c])->as_table();
      if (table.size() != 1) refuse(drawn_[c], "has other keys beside the law of its draws", forms);
      const std::string law(table.begin()->first.str());
      const toml::array* numbers = table.begin()->second.as_array();
      if (!numbers || numbers->size() != 2) refuse(drawn_[c], fmt::format("{} has not two numbers", law), forms);
      const double a = number(*numbers->get(0), drawn_[c]), b = number(*numbers->get(1), drawn_[c]);
      if (law == "normal" ? !(b >= 0) : !(a <= b) || (law == "log_uniform" && !(a > 0)))
        refuse(drawn_[c], fmt::format("found {} = [{}, {}]", law, a, b),
               law == "normal" ? "give a deviation from 0 on" : "give bounds in order, positive ones for log_uniform");
      for (Index k = 0; k < count; ++k) {
        const double u = law == "normal" ? draws.normal() : draws.uniform();
        axis.values(k, Index(c)) = law == "normal"    ? a + b * u
                                   : law == "uniform" ? a + u * (b - a)
                                                      : a * std::pow(b / a, u);
      }
    }
    axes_.push_back(std::move(axis));
  }

  // A table with the names of parameters as its header.
  void add_file() {
    const std::string name = section_.text("file", "");
    const toml::node& node = *table_.get("file");
    const std::string& in = node.source().path ? *node.source().path : document_.name;
    const std::filesystem::path path = document_.folders.at(in) / name;
    document_.read.push_back(path);
    const std::string text = read_text({name, path}, section_.where("file"));
    const std::size_t end = std::min(text.find('\n'), text.size());
    Axis axis;
    for (const std::string& word : split_list(one_line(std::string_view(text).substr(0, end)))) {
      check_name(name + ":1", one_line(word));
      axis.names.push_back(one_line(word));
    }
    axis.values = read_number_table("\n" + text.substr(std::min(end + 1, text.size())), name);
    if (axis.values.rows() == 0) throw Error(name + ":1", "has no rows", "give one row per scene below the names");
    if (axis.values.cols() != Index(axis.names.size()))
      throw Error(name + ":1", fmt::format("has {} names and {} columns", axis.names.size(), axis.values.cols()),
                  "give one name per column");
    axes_.push_back(std::move(axis));
  }

  Sweep named() const {
    Sweep sweep;
    for (const Axis& axis : axes_)
      for (const std::string& name : axis.names) {
        if (std::find(sweep.names.begin(), sweep.names.end(), name) != sweep.names.end())
          refuse("file", fmt::format("'{}' is given twice", name), "leave it out of the file or of [sweep]");
        sweep.names.push_back(name);
      }
    return sweep;
  }

  // The last axis varies fastest.
  Sweep product() const {
    Sweep sweep = named();
    double count = 1;
    for (const Axis& axis : axes_) count *= double(axis.values.rows());
    if (count > double(most_swept))
      refuse("combine", fmt::format("the product has {:.3g} scenes", count),
             fmt::format("give at most {}", most_swept));
    sweep.values.resize(Index(count), Index(sweep.names.size()));
    for (Index k = 0; k < sweep.values.rows(); ++k) {
      Index rest = k, column = Index(sweep.names.size());
      for (auto axis = axes_.rbegin(); axis != axes_.rend(); ++axis) {
        column -= axis->values.cols();
        sweep.values.row(k).segment(column, axis->values.cols()) = axis->values.row(rest % axis->values.rows());
        rest /= axis->values.rows();
      }
    }
    return sweep;
  }

  Sweep rows() const {
    Sweep sweep = named();
    const Index count = axes_[0].values.rows();
    sweep.values.resize(count, Index(sweep.names.size()));
    Index column = 0;
    for (const Axis& axis : axes_) {
      if (axis.values.rows() != count)
        refuse("combine",
               fmt::format("found rows, and {} has {} values where {} has {}", axis.names[0], axis.values.rows(),
                           axes_[0].names[0], count),
               "give lists of one length, or combine = \"product\"");
      sweep.values.middleCols(column, axis.values.cols()) = axis.values;
      column += axis.values.cols();
    }
    return sweep;
  }

  const Document& document_;
  const toml::table& table_;
  const Section& section_;
  std::vector<std::string> known_, keys_, drawn_;
  std::vector<Axis> axes_;
};

}  // namespace

ParameterValues Sweep::settings(Index scene) const {
  ParameterValues found;
  for (std::size_t c = 0; c < names.size(); ++c) found[names[c]] = values(scene, Index(c));
  return found;
}

std::optional<Sweep> parse_sweep(std::string_view toml, const std::string& file_name,
                                 const std::filesystem::path& folder, const ParameterValues& settings) {
  Document document{file_name};
  const toml::table root = read_with_includes(document, toml, folder / std::filesystem::path(file_name).filename());
  const Sections sections = read_sections(document, root);
  if (!sections.sweep.given()) return std::nullopt;
  ParameterValues others;
  read_parameters(document, sections.parameters, settings, others);
  read_definitions(document, sections.definitions);
  std::vector<std::string> known = document.order["parameters"];
  known.push_back("T");  // not steps: all scenes have the same rows
  Sweep sweep = SweepReader(document, *root.get("sweep")->as_table(), sections.sweep, std::move(known)).read();
  if (sections.sweep.has("columns")) {
    const toml::array* list = root["sweep"]["columns"].as_array();
    sweep.columns = join(sections.sweep.texts("columns", list ? Index(list->size()) : 1));
    sweep.columns_place = sections.sweep.where("columns");
  }
  sweep.inputs = std::move(document.read);
  return sweep;
}

std::optional<Sweep> read_sweep(const std::filesystem::path& file, const ParameterValues& settings) {
  const std::string name = one_line(file.string());
  std::optional<Sweep> found = parse_sweep(read_text({name, file}, name), name, file.parent_path(), settings);
  if (found) found->inputs.push_back(file);
  return found;
}

}  // namespace bromwich
