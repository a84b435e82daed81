#include "app/command_sweep.hpp"

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/columns.hpp"
#include "app/interaction.hpp"
#include "app/log.hpp"
#include "app/machine.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/ranks.hpp"
#include "app/scene_blocks.hpp"
#include "app/scene_choice.hpp"
#include "app/sweep_scenes.hpp"
#include "app/sweep_table.hpp"
#include "app/text.hpp"
#include "batch/batch.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/build_info.hpp"
#include "core/scene/component_names.hpp"
#include "core/scene/separable.hpp"
#include "files/sweep.hpp"
#include "files/sweep_file.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <sstream>
#include <utility>
#include <vector>

namespace bromwich::app {

namespace {

constexpr double block_share = 0.25;          ///< of the memory, for the results of one block
constexpr double most_block_bytes = 1e9;      ///< of them
constexpr Index most_scenes_together = 8192;  ///< the next block is faster in memory that was used than in fresh memory
constexpr double bytes_of_a_scene = 1e4;      ///< of a scene that was read: its expressions and names

class SweepRun {
 public:
  SweepRun(const SolveArguments& arguments, const std::string& name, ParameterValues settings, Sweep sweep)
      : arguments_(arguments), settings_(settings), reading_(name, std::move(settings), std::move(sweep)) {
    check_sweep_arguments(arguments_, settings_, sweep_);
    choice_ = reading_.first();
    options_.method = parse_method(arguments.method);
    if (!arguments.steps.empty()) options_.steps = parse_steps(arguments.steps);
    parse_error_control(arguments, options_, choice_.scene, choice_.circuit != nullptr);
    if (!arguments.iteration_tolerance.empty())
      options_.iteration_tolerance = parse_iteration_tolerance(arguments.iteration_tolerance);
    choose_columns();
    options_.trace = by_hdf5() || need_trace(columns_) ||
                     std::any_of(measures_.begin(), measures_.end(),
                                 [](const Measure& m) { return m.column.kind == ColumnKind::w; });
    if (!controls_error(options_)) options_.steps = steps_of(choice_.scene, options_);
    choose_times();
    states_ = recorded_components(choice_.scene, options_);
    if (columns_.empty() && measures_.empty()) columns_ = default_columns(choice_.scene, states_);
    std::erase_if(columns_, [](const Column& c) { return c.kind == ColumnKind::mode; });
    table_.emplace(sweep_, columns_, measures_, states_, arguments.at.empty() ? std::vector<double>() : times_);
  }

  int run() {
    const int threads = threads_of_rank(arguments_.threads.empty() ? 0 : parse_threads(arguments_.threads));
    backend_ = choose_backend(arguments_.backend, choice_.scene, options_, Index(states_.size()), threads);
    beside_ = backends_beside(*backend_);
    predict();
    ProgressLine progress(options_.iteration_tolerance);
    if (progress.visible())
      options_.progress = [&progress, this](const Progress& p) {
        progress.show({first_ + p.iteration, 0, sweep_.scenes()});
      };
    catch_interrupts();
    options_.interrupted = interrupted;
    Timer timer;
    if (ranks().size() > 1 || !arguments_.restart.empty()) {
      solve_over_ranks();
      if (!first_rank()) return exit_solved;
    }
    if (arguments_.out.empty()) {
      each_block([](const SceneBlock&) {});
    } else if (by_hdf5()) {
      write_hdf5();
    } else {
      OutputFile("--out", arguments_.out, ".csv").write([this](std::FILE* file) { write_csv(file); });
    }
    seconds_all_ = timer.lap();
    if (kept_) kept_->remove();
    progress.finish();
    print(arguments_.json ? dump(json()) : summary());
    if (solved() == sweep_.scenes()) return exit_solved;
    complain(fmt::format("{} of {} scenes are not solved", sweep_.scenes() - solved(), sweep_.scenes()));
    return exit_not_solved;
  }

 private:
  /// The columns of a CSV file, and the states that they or --states ask for.
  void choose_columns() {
    const bool asked = !arguments_.columns.empty();
    const bool of_file = !asked && !sweep_.columns.empty() && !by_hdf5() && arguments_.at.empty();
    try {
      if (asked || of_file)
        measures_ =
            parse_measures(asked ? arguments_.columns : sweep_.columns, choice_.scene, choice_.parameters, columns_);
      check_measures();
    } catch (const Error& error) {
      if (!of_file) throw;
      throw Error(sweep_.columns_place, error.found(), error.remedy());
    }
    std::vector<Column> read = columns_;
    for (const Measure& measure : measures_) read.push_back(measure.column);
    for (const Column& column : read)
      if (column.kind == ColumnKind::trace || column.kind == ColumnKind::mode)
        throw Error("--columns", fmt::format("asks for {} with [sweep]", column.name), "ask for y, w and x");
    if (read.empty() || !arguments_.states.empty())
      parse_states("--states", arguments_.states.empty() ? choice_.states : arguments_.states, choice_.scene, options_);
    const std::vector<Index> wanted = states_of(read);
    if (options_.states == StateSelection::all || wanted.empty()) return;
    options_.states = StateSelection::list;
    for (const Index i : wanted)
      if (std::find(options_.components.begin(), options_.components.end(), i) == options_.components.end())
        options_.components.push_back(i);
  }

  void check_measures() const {
    if (measures_.empty()) return;
    const bool spans = std::any_of(measures_.begin(), measures_.end(), [](const Measure& m) { return m.from; });
    if (!arguments_.at.empty())
      throw Error("--columns", fmt::format("asks for {} with --at", measures_[0].name), "leave one of the two out");
    if (by_hdf5())
      throw Error("--columns", fmt::format("asks for {} with --out .h5, which has all time points", measures_[0].name),
                  "write a .csv");
    if (spans && swept("T"))
      throw Error("--columns", "has a span of time for scenes with other T", "leave its times out: the span is [0, T]");
  }

  /// Rows that all scenes have: of --at, with a tolerance those of the steps of the file, otherwise those of the grid.
  void choose_times() {
    const double T = choice_.scene.T;
    const Index steps = steps_of(choice_.scene, options_);
    if (!arguments_.at.empty() && swept("T"))
      throw Error("--at", "is given for scenes with other T", "leave it out: rows are at the same parts of T");
    if (!arguments_.at.empty())
      times_ = parse_times(arguments_.at, T);
    else if (const Vector grid = time_grid(T, steps); controls_error(options_))
      times_.assign(grid.begin(), grid.end());
    steps_ = times_.empty() ? steps : Index(times_.size()) - 1;
  }

  bool swept(const char* name) const {
    return std::find(sweep_.names.begin(), sweep_.names.end(), name) != sweep_.names.end();
  }
  Vector times() const {
    if (!times_.empty() && !swept("T")) return Eigen::Map<const Vector>(times_.data(), Index(times_.size()));
    return time_grid(swept("T") ? 1 : choice_.scene.T, steps_);
  }

  bool by_hdf5() const { return std::filesystem::path(arguments_.out).extension() == ".h5"; }

  void predict() {
    Batch one;
    one.common = choice_.scene;
    one.times = times_;
    const int threads = backend_->device().threads;
    const double fixed = predicted_bytes(one, options_, 0, threads),
                 each = predicted_bytes(one, options_, 1, threads) - fixed + bytes_of_a_scene;
    const double limit = std::min(block_share * memory_bytes(), most_block_bytes);
    if (fixed + each > memory_bytes())
      throw Error("--steps", fmt::format("one scene needs {}", format_bytes(fixed + each)),
                  "use fewer --steps or fewer --states");
    together_ = std::clamp<Index>(Index((limit - fixed) / each), 1, std::min(sweep_.scenes(), most_scenes_together));
    predicted_ = fixed + each * double(together_);
  }

  // The ranks take blocks as they come to them, whose results lie in a folder until all are there. Without many ranks,
  // the blocks that a run before has left there are not solved again.
  void solve_over_ranks() {
    if (arguments_.out.empty())
      throw Error("--out", fmt::format("is missing for a sweep on {} ranks", ranks().size()),
                  "add --out FILE.h5 or FILE.csv");
    constexpr Index blocks_at_least = 64, lanes = 8;
    together_ =
        std::clamp<Index>(sweep_.scenes() / blocks_at_least / lanes * lanes, std::min(lanes, together_), together_);
    const bool again = !arguments_.restart.empty();
    kept_.emplace(again ? arguments_.restart : arguments_.out + ".parts", description());
    if (first_rank()) kept_->open(again);
    ranks().gather(Vector::Zero(1));
    Index next = 0;
    for (;; ++next) {
      first_ = together_ * (job().next_number ? job().next_number() : next);
      if (first_ >= sweep_.scenes() || interrupted()) break;
      if (kept_->has(first_)) continue;
      const SceneBlock block = solve_block(std::min(together_, sweep_.scenes() - first_));
      if (interrupted()) break;  // and some scenes of the block with it
      kept_->save(block);
    }
    ranks().gather(Vector::Zero(1));
  }

  // What decides about the results of a block.
  std::string description() const {
    std::string text = fmt::format(
        "{} scenes, {} a block, {} steps, method {}, tolerances {} {} {} {} {}, states {}, times {}\n", sweep_.scenes(),
        together_, steps_, to_string(options_.method), options_.tolerance, options_.tolerance_x, options_.tolerance_y,
        options_.absolute_tolerance, options_.iteration_tolerance, fmt::join(states_, ","), fmt::join(times_, ","));
    text += by_hdf5() ? "all time points\n" : table_->header();
    for (const auto& [name, value] : settings_) text += fmt::format("{} = {}\n", name, value);
    for (const std::filesystem::path& input : sweep_.inputs) {
      std::ifstream in(input, std::ios::binary);
      std::ostringstream contents;
      contents << in.rdbuf();
      text += contents.str();
    }
    return text;
  }

  template <class Take>
  void each_block(const Take& take) {
    for (first_ = 0; first_ < sweep_.scenes(); first_ += together_) {
      SceneBlock block = kept_ ? kept_->load(first_) : solve_block(std::min(together_, sweep_.scenes() - first_));
      ++blocks_;
      in_lanes_ += block.in_lanes;
      seconds_read_ += block.seconds_read;
      seconds_ += block.seconds;
      take(block);
      for (const auto& [from, to] :
           {std::pair(&block.status, &status_), {&block.reason, &reason_}, {&block.warning, &warning_}})
        std::move(from->begin(), from->end(), std::back_inserter(*to));
    }
  }

  SceneBlock solve_block(Index count) {
    SceneBlock block;
    block.first = first_, block.count = count;
    block.status.assign(std::size_t(count), to_string(Status::unsupported));
    block.warning.resize(std::size_t(count));
    Timer timer;
    ReadScenes read = reading_.read(first_, count, *backend_, interrupted);
    block.reason = std::move(read.errors);
    block.seconds_read = timer.lap();
    const std::vector<Index>& places = read.places;
    BatchResult result;
    if (!read.scenes.empty()) result = solved(std::move(read.scenes), places, read.same_sources);
    for (Index i = 0; i < count; ++i) {
      const std::size_t to = std::size_t(i);
      if (places[to] < 0) continue;
      const std::size_t place = std::size_t(places[to]);
      block.status[to] = to_string(result.status[place]);
      block.reason[to] = std::move(result.reason[place]);
      block.warning[to] = std::move(result.warning[place]);
    }
    block.in_lanes = result.in_lanes;
    block.seconds = result.seconds;
    if (by_hdf5())
      keep_arrays(block, std::move(result), places, {steps_ + 1, choice_.scene.constraints(), Index(states_.size())});
    else if (!arguments_.out.empty())
      block.rows = table_->rows(block, result, places, *backend_);
    return block;
  }

  BatchResult solved(std::vector<Scene> scenes, const std::vector<Index>& places, bool same_sources) {
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (places[i] < 0) continue;
      const Scene& scene = scenes[std::size_t(places[i])];
      if (scene.states() != choice_.scene.states() || scene.constraints() != choice_.scene.constraints())
        throw Error(
            "[sweep]",
            fmt::format("scene {} has {} states and {} constraints, others {} and {}", first_ + Index(i),
                        scene.states(), scene.constraints(), choice_.scene.states(), choice_.scene.constraints()),
            "sweep parameters that do not change the size");
    }
    for (Scene& scene : scenes) scene.default_steps = choice_.scene.default_steps;
    Batch batch = batch_of(std::move(scenes));
    batch.times = times_;
    batch.same_sources = same_sources;
    return solve_batch(batch, *backend_, options_, beside_);
  }

  // ---- Files.

  void write_csv(std::FILE* file) {
    std::fputs(table_->header().c_str(), file);
    each_block([&](const SceneBlock& block) { std::fwrite(block.rows.data(), 1, block.rows.size(), file); });
  }

  void write_hdf5() {
    const Scene& scene = choice_.scene;
    ResultColumns columns;
    columns.constraints = scene.constraints();
    columns.slack = true;
    columns.states = states_;
    for (Index i = 0; i < scene.constraints(); ++i) columns.constraint_names.push_back(multiplier_name(scene, i));
    for (const Index i : states_) columns.state_names.push_back(state_name(scene, i));
    const bool own_T = swept("T");
    const auto file = create_sweep_hdf5({"--out", arguments_.out}, columns, sweep_, times());
    each_block([&](const SceneBlock& block) {
      file->append({sweep_.values.middleRows(block.first, block.count), block.residual, block.y, block.w, block.x},
                   *backend_);
    });
    Facts facts{{"title", scene.name},
                {"method", std::string(to_string(options_.method))},
                {"backend", backend_->name()},
                {"steps", std::int64_t(steps_)},
                {"version", std::string(build_info::version)},
                {"command", arguments_.command_line}};
    if (own_T) facts.emplace_back("time", std::string("t is the time over the T of each scene"));
    file->finish(status_, reason_, warning_, facts);
  }

  // ---- What is printed.

  Index solved() const { return std::count(status_.begin(), status_.end(), to_string(Status::solved)); }

  std::map<std::string, Index> counts() const {
    std::map<std::string, Index> found;
    for (const std::string& one : status_) ++found[one];
    return found;
  }

  std::string summary() const {
    std::string text =
        fmt::format("scene       {}, {} scenes over {}\n", choice_.scene.name, sweep_.scenes(), join(sweep_.names));
    text += fmt::format("size        {} constraints, {} states, {} {} each\n", choice_.scene.constraints(),
                        choice_.scene.states(), times_.empty() ? steps_ : Index(times_.size()),
                        times_.empty() ? "steps" : "rows");
    std::vector<std::string> words;
    for (const auto& [status, count] : counts()) words.push_back(fmt::format("{} {}", count, status));
    text += fmt::format("status      {}\n", join(words));
    const auto failed = std::find_if(reason_.begin(), reason_.end(), [](const std::string& r) { return !r.empty(); });
    if (failed != reason_.end())
      text += fmt::format("first       scene {}: {}\n", failed - reason_.begin(), one_line(*failed));
    text += fmt::format("method      {} on {}, {} scenes side by side\n", to_string(options_.method), backend_->name(),
                        in_lanes_);
    text += fmt::format("time        {}: scenes read {}, solved {}{}\n", format_seconds(seconds_all_),
                        format_seconds(seconds_read_), format_seconds(seconds_),
                        ranks().size() > 1 ? ", of all ranks" : "");
    text += fmt::format("memory      {} predicted, in {} block{}\n", format_bytes(predicted_), blocks_,
                        blocks_ == 1 ? "" : "s");
    return text + fmt::format("output      {}\n", arguments_.out.empty() ? "none; --out FILE.csv writes a row for each "
                                                                           "scene, --out FILE.h5 all time points"
                                                                         : arguments_.out);
  }

  Json json() const {
    Json object{{"scene", choice_.scene.name},
                {"scenes", sweep_.scenes()},
                {"parameters", sweep_.names},
                {"steps", steps_},
                {"solved", solved()},
                {"in_lanes", in_lanes_},
                {"seconds", {{"total", seconds_all_}, {"read", seconds_read_}, {"solve", seconds_}}},
                {"bytes_predicted", predicted_},
                {"blocks", blocks_}};
    object["status"] = counts();
    return object;
  }

  const SolveArguments& arguments_;
  ParameterValues settings_;
  SweepScenes reading_;
  const Sweep& sweep_ = reading_.sweep();
  SceneChoice choice_;
  Options options_;
  std::unique_ptr<Backend> backend_;
  MakeBackend beside_;               ///< kept from block to block
  std::optional<BlockFolder> kept_;  ///< of ranks, or of a run before
  std::vector<Index> states_;
  std::vector<Column> columns_;    ///< of a CSV file
  std::vector<Measure> measures_;  ///< likewise
  std::vector<double> times_;      ///< of the rows; empty: those of the grid
  std::optional<SweepTable> table_;
  std::vector<std::string> status_, reason_, warning_;
  Index steps_ = 0, first_ = 0, together_ = 1, blocks_ = 0, in_lanes_ = 0;
  double predicted_ = 0, seconds_all_ = 0, seconds_read_ = 0, seconds_ = 0;  ///< the last two: of all ranks
};

}  // namespace

std::optional<int> run_sweep(const SolveArguments& arguments, const std::string& scene,
                             const ParameterValues& settings) {
  std::error_code failure;
  if (std::filesystem::path(scene).extension() != ".toml" || !std::filesystem::is_regular_file(scene, failure))
    return std::nullopt;
  std::optional<Sweep> sweep = read_sweep(scene, settings);
  if (!sweep) return std::nullopt;
  return SweepRun(arguments, scene, settings, std::move(*sweep)).run();
}

}  // namespace bromwich::app
