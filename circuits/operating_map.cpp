#include "circuits/operating_map.hpp"

#include "circuits/balance.hpp"
#include "circuits/cards.hpp"
#include "circuits/measures.hpp"
#include "core/base/error.hpp"
#include "core/seam/backend.hpp"
#include "core/solve/solve.hpp"

#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <optional>
#include <thread>

namespace bromwich {

namespace {

using circuits::lower;

constexpr Index most_points = 10'000'000;

enum class MapKind : char { mean, rms, min, max, ripple, thd, end, power, efficiency, measure };

/// A word of the columns, in terms of one circuit.
struct MapColumn {
  MapKind kind = MapKind::end;
  std::size_t measure = 0;  ///< its number
  std::string unit = {};
  std::optional<Probe> probe = {};
};

const CircuitElement& element_named(const Circuit& c, const std::string& name, const std::string& where) {
  for (const CircuitElement& e : c.elements)
    if (lower(e.name) == lower(name)) return e;
  throw Error(where, fmt::format("there is no element '{}'", name), "use a name of the netlist");
}

/// What stands in the parentheses behind `function`; nothing for another word.
std::optional<std::string> argument_of(const std::string& word, const std::string& function) {
  if (!lower(word).starts_with(function + "(") || word.back() != ')') return std::nullopt;
  return word.substr(function.size() + 1, word.size() - function.size() - 2);
}

MapColumn read_column(const Circuit& c, const std::string& word, const std::string& where) {
  static constexpr std::pair<const char*, MapKind> functions[] = {{"mean", MapKind::mean},     {"rms", MapKind::rms},
                                                                  {"min", MapKind::min},       {"max", MapKind::max},
                                                                  {"ripple", MapKind::ripple}, {"thd", MapKind::thd}};
  const auto of_probe = [](MapKind kind, Probe probe) {
    const std::string unit = kind == MapKind::thd ? "" : probe.unit();
    return MapColumn{kind, 0, unit, std::move(probe)};
  };
  if (lower(word) == "efficiency") return {MapKind::efficiency};
  if (const auto element = argument_of(word, "power"))
    return of_probe(MapKind::power, Probe(c, 'P', element_named(c, *element, where)));
  for (const auto& [name, kind] : functions)
    if (const auto argument = argument_of(word, name)) return of_probe(kind, Probe(c, *argument, where));
  const std::vector<MeasuredValue> measures = measures_of(c);
  for (std::size_t k = 0; k < measures.size(); ++k)
    if (lower(measures[k].name) == lower(word)) return {MapKind::measure, k, measures[k].unit};
  return of_probe(MapKind::end, Probe(c, word, where));
}

double efficiency(const Circuit& c, const CircuitWaveforms& w) {
  std::vector<ElementPower> powers;
  for (const CircuitElement& e : c.elements) powers.push_back({e.name, e.kind, 0, 0, 0, w.mean(Probe(c, 'P', e))});
  return use_of_power(powers).efficiency;
}

double value(const MapColumn& column, const Circuit& c, const CircuitWaveforms& w,
             const std::vector<MeasuredValue>& measures) {
  const auto& probe = column.probe;
  switch (column.kind) {
    case MapKind::mean:
    case MapKind::power:
      return w.mean(*probe);
    case MapKind::rms:
      return w.rms(*probe);
    case MapKind::min:
      return w.min(*probe);
    case MapKind::max:
      return w.max(*probe);
    case MapKind::ripple:
      return w.peak_to_peak(*probe);
    case MapKind::thd:
      return numbers(*probe, w).distortion;
    case MapKind::end:
      return w.values(*probe, {w.to()})[0];
    case MapKind::efficiency:
      return efficiency(c, w);
    case MapKind::measure:
      break;
  }
  return measures[column.measure].value;
}

/// All combinations, the last step varies fastest.
RowMatrix combinations(const std::vector<CircuitStep>& steps, const std::string& where) {
  Index points = steps.empty() ? 0 : 1;
  for (const CircuitStep& s : steps) {
    const Index more = Index(s.values.size());
    if (more == 0) throw Error(where, fmt::format("'{}' has no value", s.name), "give one or more");
    if (points > most_points / more)
      throw Error(where, fmt::format("are more than {} operating points", most_points), "give fewer values");
    points *= more;
  }
  if (points == 0) throw Error(where, "there is no parameter to step", "add .step param NAME first last increment");
  RowMatrix all(points, Index(steps.size()));
  for (Index i = 0; i < points; ++i) {
    Index rest = i;
    for (Index k = Index(steps.size()) - 1; k >= 0; --k) {
      const std::vector<double>& values = steps[std::size_t(k)].values;
      all(i, k) = values[std::size_t(rest % Index(values.size()))];
      rest /= Index(values.size());
    }
  }
  return all;
}

std::map<std::string, double> values_at(const std::vector<CircuitStep>& steps, const RowMatrix& settings, Index i) {
  std::map<std::string, double> all;
  for (std::size_t k = 0; k < steps.size(); ++k) all[steps[k].name] = settings(i, Index(k));
  return all;
}

class MapRun {
 public:
  MapRun(const ReadCircuit& read, const Options& options, OperatingMap& map, const std::string& where)
      : read_(read), options_(options), map_(map), where_(where) {}

  void point(Index i, Backend& backend) {
    if (stopped()) return;
    const std::size_t at = std::size_t(i);
    try {
      solve_point(i, backend);
    } catch (const Error& error) {
      map_.status[at] = Status::unsupported;
      map_.reason[at] = error.what();
    }
    const Index done = ++done_;
    if (options_.progress && of_caller()) options_.progress({done, 0, map_.points()});
  }

 private:
  // Callbacks are for the thread that called.
  bool of_caller() const { return std::this_thread::get_id() == caller_; }
  bool stopped() {
    if (options_.interrupted && of_caller() && options_.interrupted()) stop_ = true;
    return stop_;
  }

  void solve_point(Index i, Backend& backend) {
    const Circuit c = read_(values_at(map_.steps, map_.settings, i));
    Options options = options_;
    options.progress = {};
    options.log = {};
    options.interrupted = [this] { return stopped(); };
    options.states = StateSelection::all;
    const Result r = solve(c.scene, backend, options);
    const std::size_t at = std::size_t(i);
    map_.status[at] = r.status;
    map_.reason[at] = r.reason;
    map_.residual[i] = r.residual;
    if (r.status != Status::solved) return;
    const std::vector<MeasuredValue> measures = measured(c, backend, r);
    const CircuitWaveforms w(c, backend, r, c.times.size() > 0 ? c.times[0] : 0, c.scene.T, where_);
    for (std::size_t k = 0; k < map_.columns.size(); ++k)
      map_.values(i, Index(k)) = value(read_column(c, map_.columns[k], where_), c, w, measures);
  }

  const ReadCircuit& read_;
  const Options& options_;
  OperatingMap& map_;
  const std::string& where_;
  const std::thread::id caller_ = std::this_thread::get_id();
  std::atomic<Index> done_ = 0;
  std::atomic<bool> stop_ = false;
};

}  // namespace

Circuit first_point(const ReadCircuit& read, const std::vector<CircuitStep>& steps, const std::string& where) {
  const RowMatrix settings = combinations(steps, where);
  for (Index i = 0; i < settings.rows(); ++i) {
    try {
      return read(values_at(steps, settings, i));
    } catch (const Error&) {  // it is told of this point, in the map
    }
  }
  return read(values_at(steps, settings, 0));
}

std::vector<std::string> map_columns(const Circuit& c) {
  std::vector<std::string> words;
  for (const MeasuredValue& m : measures_of(c)) words.push_back(m.name);
  if (!words.empty()) return words;
  const bool periodic = c.scene.boundary.has_value();
  for (const CircuitOutput& o : c.outputs)
    if (o.name[0] == 'V' && o.name.find('.') == std::string::npos)
      words.push_back(periodic ? fmt::format("mean({})", o.name) : o.name);
  if (periodic) words.emplace_back("efficiency");
  return words;
}

OperatingMap operating_map(const ReadCircuit& read, const std::vector<CircuitStep>& steps,
                           const std::vector<std::string>& columns, const Options& options, const Backend& backend,
                           const MakeBackend& another, const std::string& where) {
  OperatingMap map;
  map.steps = steps;
  map.settings = combinations(steps, where);
  map.columns = columns;
  const std::size_t points = std::size_t(map.points());
  map.values = RowMatrix::Constant(map.points(), Index(columns.size()), NAN);
  map.residual = Vector::Constant(map.points(), NAN);
  map.status.assign(points, Status::interrupted);
  map.reason.assign(points, "stopped before it was solved");
  MapRun run(read, options, map, where);
  const Circuit first = first_point(read, steps, where);
  for (const std::string& word : columns) map.units.push_back(read_column(first, word, where).unit);
  const Index length = std::max<Index>(1, map.points() / (8 * std::max(1, backend.threads())));
  share(backend, map.points(), std::min<Index>(length, 64), [&](Index begin, Index end) {
    const std::shared_ptr<Backend> own = another();
    for (Index i = begin; i < end; ++i) run.point(i, *own);
  });
  return map;
}

}  // namespace bromwich
