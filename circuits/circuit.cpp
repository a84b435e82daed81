#include "circuits/circuit.hpp"

#include "circuits/gates.hpp"
#include "circuits/measures.hpp"
#include "circuits/operating_point.hpp"
#include "circuits/reduction.hpp"
#include "circuits/windings.hpp"
#include "core/base/error.hpp"
#include "core/base/time_function.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <sstream>

namespace bromwich {

namespace {

using namespace circuits;

/// Bounds of a gated switch: one value while it is open, another while it is closed.
Waveform gate_waveform(SwitchTimes times, double open, double closed) {
  Waveform w;
  w.linear = true;
  const auto shared = std::make_shared<const SwitchTimes>(std::move(times));
  w.value = [=](double t) {
    const auto& list = shared->times;
    const auto passed = std::upper_bound(list.begin(), list.end(), t) - list.begin();
    return (passed % 2 == 0) == shared->on_at_start ? closed : open;
  };
  w.slope = [](double) { return 0.0; };
  w.breakpoints = [=](double) { return shared->times; };
  return w;
}

/// u: 1, the independent sources, the bounds of gates.
std::vector<Waveform> make_sources(const Netlist& netlist, const Reduction& r) {
  std::vector<Waveform> u{constant_waveform(1)};
  for (const Index i : r.inputs) u.push_back(netlist.elements[std::size_t(i)].source);
  u.reserve(u.size() + r.gates.size());  // controls point at the sources
  for (const Gate& gate : r.gates) {
    const SwitchModel& model = netlist.elements[std::size_t(gate.element)].gate;
    Control control{0, {}};
    for (const auto& [k, factor] : gate.control)
      if (k == 0) control.constant += factor;
    for (const auto& [k, factor] : gate.control)
      if (k > 0) control.sources.push_back({&u[std::size_t(k)], factor});
    const auto found = [&](std::optional<bool> on) {
      return switch_times(control, model.threshold + model.hysteresis, model.threshold - model.hysteresis, netlist.stop,
                          on);
    };
    SwitchTimes times = found({});
    if (netlist.periodic && times.times.size() % 2 != 0) times = found(!times.on_at_start);  // as it ends it begins
    u.push_back(gate_waveform(std::move(times), gate.open, gate.closed));
  }
  return u;
}

/// Columns of u: of modes, and of all else.
Rows of_modes(const Rows& over_u, const Reduction& r) {
  const Index count = Index(r.memories.size());
  return columns(over_u, r.sources - count, count);
}
Rows of_sources(const Rows& over_u, const Reduction& r) {
  return columns(over_u, 0, r.sources - Index(r.memories.size()));
}

/// Whether columns have an entry.
std::vector<char> used_columns(const Rows& m) {
  std::vector<char> used(std::size_t(m.cols()), 0);
  for (Index i = 0; i < m.rows(); ++i)
    for (Rows::InnerIterator e(m, i); e; ++e)
      if (e.value() != 0) used[std::size_t(e.col())] = 1;
  return used;
}

std::vector<Index> numbers_of(const std::vector<char>& used) {
  std::vector<Index> numbers;
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k]) numbers.push_back(Index(k));
  return numbers;
}

/// shapes times the sources whose columns are not zero, and their slopes.
TimeFunction combination(const Rows& of_u, const Rows& of_slope,
                         const std::shared_ptr<const std::vector<Waveform>>& u) {
  const std::vector<Index> used = numbers_of(used_columns(of_u)), used_slope = numbers_of(used_columns(of_slope));
  if (used.empty() && used_slope.empty()) return {};
  Matrix shapes(of_u.rows(), Index(used.size() + used_slope.size()));
  const SparseMatrix by_columns = of_u, slopes_by_columns = of_slope;
  Index at = 0;
  for (const Index k : used) shapes.col(at++) = by_columns.col(k);
  for (const Index k : used_slope) shapes.col(at++) = slopes_by_columns.col(k);
  TimeFunction time = [u, used, used_slope](double t, Eigen::Ref<Vector> value) {
    Index i = 0;
    for (const Index k : used) value[i++] = (*u)[std::size_t(k)].value(t);
    for (const Index k : used_slope) value[i++] = (*u)[std::size_t(k)].slope(t);
  };
  const auto lines = [&](const std::vector<Index>& all) {
    return std::all_of(all.begin(), all.end(), [&](Index k) { return (*u)[std::size_t(k)].linear; });
  };
  if (lines(used) && lines(used_slope)) time = LinearSource{time};
  return SeparableSource{std::move(shapes), time};
}

/// Those of the sources that f, g or the conditions of memories see. Times that differ by rounding are one.
std::vector<double> breakpoints(const Reduction& r, const std::vector<Waveform>& u, double T) {
  std::vector<char> seen(u.size(), 0);
  for (const Rows* rows : {&r.F, &r.w.u, &r.w.slope, &r.conditions.u, &r.conditions.slope}) {
    const std::vector<char> more = used_columns(of_sources(*rows, r));
    for (std::size_t k = 0; k < seen.size(); ++k) seen[k] |= more[k];
  }
  std::vector<double> all;
  for (const Index k : numbers_of(seen)) {
    const std::vector<double> own = u[std::size_t(k)].breakpoints(T);
    all.insert(all.end(), own.begin(), own.end());
  }
  std::sort(all.begin(), all.end());
  const double rounding = 64 * epsilon * T;
  std::erase_if(all, [&](double t) { return t <= rounding || t >= T - rounding; });
  all.erase(std::unique(all.begin(), all.end(), [&](double a, double b) { return b - a <= rounding; }), all.end());
  return all;
}

TimeFunction all_values(const std::shared_ptr<const std::vector<Waveform>>& u,
                        std::function<double(double)> Waveform::*which) {
  const TimeFunction all = [u, which](double t, Eigen::Ref<Vector> value) {
    for (std::size_t k = 0; k < u->size(); ++k) value[Index(k)] = ((*u)[k].*which)(t);
  };
  return std::all_of(u->begin(), u->end(), [](const Waveform& w) { return w.linear; }) ? LinearSource{all} : all;
}

/// What IC= and .ic give to elements that store; others have 0.
Vector given_state(const Netlist& netlist, const std::vector<Index>& storage) {
  const auto node = [&](const std::string& name) {
    const auto found = netlist.initial.find(name);
    return found == netlist.initial.end() ? 0.0 : found->second;
  };
  Vector x(Index(storage.size()));
  for (Index k = 0; k < x.size(); ++k) {
    const Element& e = netlist.elements[std::size_t(storage[std::size_t(k)])];
    x[k] = e.initial ? *e.initial : e.kind == 'C' ? node(e.nodes[0]) - node(e.nodes[1]) : 0;  // else a current
  }
  return x;
}

/// With uic. Capacitors in loops and inductors in cutsets share what they are given: charge and flux are kept.
Vector given_start(const Netlist& netlist, const Reduction& r, const Vector& u, std::vector<std::string>& notes) {
  Vector x = given_state(netlist, r.storage);
  const Vector s = given_state(netlist, r.excess), off = r.P * x + r.Q * u - s;
  const Vector given = x;
  x += r.jump * off;
  const auto note = [&](const Vector& before, const Vector& after, const std::vector<Index>& elements) {
    for (Index k = 0; k < before.size(); ++k) {
      if (!(std::abs(after[k] - before[k]) > 1e-9 * std::max(std::abs(after[k]), std::abs(before[k])))) continue;
      const Element& e = netlist.elements[std::size_t(elements[std::size_t(k)])];
      notes.push_back(fmt::format(
          "{}({}) jumps from {:.6g} to {:.6g} at t = 0: it is in a {}", e.kind == 'C' ? "V" : "I", e.name, before[k],
          after[k],
          e.kind == 'C' ? "loop of capacitors and voltage sources" : "cutset of inductors and current sources"));
    }
  };
  note(given, x, r.storage);
  note(s, r.P * x + r.Q * u, r.excess);
  return x - r.H * u;
}

bool begins_on(const Element& e) { return e.initial && *e.initial != 0; }

/// u(0), modes included.
Vector sources_at_start(const Netlist& netlist, const Reduction& r, const TimeFunction& sources) {
  Vector u(r.sources);
  const Index memories = Index(r.memories.size());
  sources(0, u.head(r.sources - memories));
  for (Index k = 0; k < memories; ++k)
    u[r.sources - memories + k] = begins_on(netlist.elements[std::size_t(r.memories[std::size_t(k)])]) ? 1 : 0;
  return u;
}

Vector start(const Netlist& netlist, const Reduction& r, const Vector& u, const std::string& file,
             std::vector<std::string>& notes) {
  if (netlist.use_initial) return given_start(netlist, r, u, notes);
  const auto rest = operating_point(r.A, r.B, r.F * u, r.w.z, r.w.y, r.w.u * u, netlist.stop);
  if (!rest)
    throw Error(file, "there is no operating point to start from: the sources at t = 0 bring the circuit to no rest",
                "add uic to .tran, with IC= where the start is not zero");
  return *rest;
}

void add_elements(const Netlist& netlist, Index nodes, Circuit& c) {
  std::map<std::string, Index> voltages;
  for (std::size_t i = 0; i < c.outputs.size(); ++i) voltages.emplace(c.outputs[i].name, Index(i));
  const auto node = [&](const std::string& name) {
    return name == "0" ? -1 : voltages.at(fmt::format("V({})", netlist.written.at(name)));
  };
  std::vector<Index> numbers;  // of elements of the netlist
  for (const Element& e : netlist.elements) {
    const Index i = Index(c.elements.size());
    numbers.push_back(i);
    if (e.hidden) continue;
    c.elements.push_back({e.name, e.kind, node(e.nodes[0]), node(e.nodes[1]), nodes + i});
    if (e.kind == 'C') c.stores.push_back({i, i, e.value});
  }
  for (const WindingGroup& g : winding_groups(netlist))
    for (std::size_t a = 0; a < g.inductors.size(); ++a)
      for (std::size_t b = 0; b < g.inductors.size(); ++b)
        if (const double L = g.inductance(Index(a), Index(b)); L != 0)
          c.stores.push_back({numbers[std::size_t(g.inductors[a])], numbers[std::size_t(g.inductors[b])], L});
}

void add_outputs(const Reduction& r, Circuit& c) {
  for (const std::string& name : r.outputs) c.outputs.push_back({name, name[0] == 'V' ? "V" : "A"});
  c.of_x = r.of_outputs.z, c.of_y = r.of_outputs.y;
  c.of_u = of_sources(r.of_outputs.u, r), c.of_slope = of_sources(r.of_outputs.slope, r);
  c.of_modes = of_modes(r.of_outputs.u, r);
}

// Off adds nothing.
void add_memories(const Netlist& netlist, const Reduction& r, const std::shared_ptr<const std::vector<Waveform>>& u,
                  const std::string& file, Scene& s) {
  if (!r.memories.empty() && !s.dynamics->small_state())
    throw Error(file,
                fmt::format("{} is controlled by the state, and there are {} states",
                            netlist.elements[std::size_t(r.memories[0])].name, r.states.size()),
                "make the circuit smaller, or control the switch by independent sources");
  const Index m = s.states(), memories = Index(r.memories.size());
  const auto constant = [](const Vector& value) -> TimeFunction {
    if (value.isZero(0)) return {};
    return SeparableSource{value, one_at_all_times()};
  };
  const Matrix f = Matrix(of_modes(r.F, r)), g = Matrix(of_modes(r.w.u, r));
  for (std::size_t k = 0; k < r.memories.size(); ++k) {
    const Element& e = netlist.elements[std::size_t(r.memories[k])];
    const auto condition = [&](Index row) {
      const auto of = [row](const Rows& all) { return Rows(all.middleRows(row, 1)); };
      const auto entries = [&](const Rows& all) { return Vector(Matrix(of(all)).transpose()); };
      Vector x = Vector::Zero(m + memories);  // of resistances alone: no entries of z
      x.head(r.conditions.z.cols()) = entries(r.conditions.z);
      x.tail(memories) = entries(of_modes(r.conditions.u, r));
      return Memory::Condition{
          .x = std::move(x),
          .y = entries(r.conditions.y),
          .time = combination(of(of_sources(r.conditions.u, r)), of(of_sources(r.conditions.slope, r)), u)};
    };
    const Index off = 2 * Index(k);
    s.memories.push_back({.name = e.name,
                          .modes = {{.name = "off", .leave = {{.to = "on", .when = {condition(off)}}}},
                                    {.name = "on",
                                     .f = constant(f.col(Index(k))),
                                     .g = constant(g.col(Index(k))),
                                     .leave = {{.to = "off", .when = {condition(off + 1)}}}}},
                          .start = begins_on(e) ? "on" : "off"});
  }
}

/// Small systems are dense: located switches need it.
void set_matrices(const Reduction& r, Scene& s) {
  constexpr Index most_dense = 200;
  const Index m = std::max<Index>(r.A.rows(), 1), n = Index(r.pairs.size());
  Rows A = r.A, B = r.B, N = r.w.z, M = r.w.y;
  if (r.A.rows() == 0) {
    A = Rows(1, 1), B = Rows(1, n), N = Rows(n, 1);
    A.insert(0, 0) = -1 / s.T;
  }
  if (n == 0) {  // a linear circuit has a pair that is never active
    B = Rows(m, 1), N = Rows(1, m), M = Rows(1, 1);
    M.insert(0, 0) = 1;
  }
  if (m <= most_dense)
    s.dynamics = DenseDynamics{Matrix(A), Matrix(B), Matrix(N)};
  else
    s.dynamics = SparseDynamics{SparseMatrix(A), SparseMatrix(B), SparseMatrix(N)};
  if (n <= most_dense)
    s.M = Matrix(M);
  else
    s.M = SparseLcpMatrix(SparseMatrix(M));
}

CircuitReduction found(const Reduction& r) {
  CircuitReduction f;
  f.summary = fmt::format("{} elements, {} nodes: {} states, {} pairs, {} sources", Index(r.outputs.size()) - r.nodes,
                          r.nodes, r.states.size(), r.pairs.size(), r.inputs.size());
  f.states = r.states;
  f.pairs = r.pairs;
  std::vector<std::string>* const of_kind[] = {&f.loops, &f.cutsets, &f.windings};
  for (const Dependence& d : r.dependences) of_kind[d.kind]->push_back(d.equation);
  f.open = r.open;
  return f;
}

}  // namespace

Circuit make_circuit(const Netlist& netlist, const std::string& file) {
  const Reduction r = reduce(netlist);
  const auto u = std::make_shared<const std::vector<Waveform>>(make_sources(netlist, r));
  const Index m = std::max<Index>(r.A.rows(), 1);  // resistances alone: a state that stays 0
  Circuit c;
  for (const std::string& pair : r.pairs) {
    c.scene.names.y.push_back(pair);
    c.scene.names.w.push_back(pair + ".w");
  }
  c.u = all_values(u, &Waveform::value);
  c.slope = all_values(u, &Waveform::slope);
  c.sources = Index(u->size());
  for (const Waveform& one : *u) {
    const std::vector<double> own = one.breakpoints(netlist.stop);
    c.kinks.insert(c.kinks.end(), own.begin(), own.end());
  }
  Scene& s = c.scene;
  s.name = netlist.title.empty() ? file : netlist.title;
  s.T = netlist.stop;
  set_matrices(r, s);
  if (r.A.rows() > 0) s.f = combination(of_sources(r.F, r), Rows(m, c.sources), u);
  s.g = combination(of_sources(r.w.u, r), of_sources(r.w.slope, r), u);
  s.time_unit = "s";
  s.breakpoints = breakpoints(r, *u, s.T);
  s.breakpoints_are_all = s.no_pulses = true;
  c.notes = netlist.notes;
  c.notes.insert(c.notes.end(), r.notes.begin(), r.notes.end());
  if (netlist.periodic)
    s.boundary = BoundaryCondition{Matrix::Identity(m, m), -Matrix::Identity(m, m), Vector::Zero(m)};
  else
    s.x0 = r.A.rows() > 0 ? start(netlist, r, sources_at_start(netlist, r, c.u), file, c.notes) : Vector::Zero(1);
  add_memories(netlist, r, u, file, s);
  s.names.x = r.states;
  if (r.states.empty()) s.names.x = {"none"};
  const auto unit = [](const std::string& state) {
    return state.starts_with("V(") ? "V" : state.starts_with("I(") ? "A" : "";
  };
  for (const std::string& name : s.names.x) s.units.x.push_back(unit(name));
  if (netlist.step > 0) {
    const Index rows = Index(std::floor((netlist.stop - netlist.start) / netlist.step * (1 + 1e-9)));
    if (rows >= 1 && rows <= 10'000'000) {
      s.default_steps = rows;
      c.times.resize(rows + 1);
      for (Index j = 0; j <= rows; ++j) c.times[j] = std::min(netlist.start + double(j) * netlist.step, netlist.stop);
    }
  }
  add_outputs(r, c);
  add_elements(netlist, r.nodes, c);
  c.reduction = found(r);
  for (const auto& [place, text] : netlist.measures) c.measures.push_back({to_string(place), text});
  c.steps = netlist.steps;
  c.parameters = netlist.parameters;
  c.inputs = netlist.inputs;
  c.netlist = std::make_shared<const Netlist>(netlist);
  check_measures(c);
  return c;
}

Circuit parse_circuit(std::string_view netlist, const std::string& file_name, const std::filesystem::path& folder,
                      const std::map<std::string, double>& settings, std::optional<double> period) {
  return make_circuit(read_netlist(netlist, file_name, folder, settings, period), file_name);
}

Circuit read_circuit(const std::filesystem::path& file, const std::map<std::string, double>& settings,
                     std::optional<double> period) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in)
    throw Error("SCENE", fmt::format("the file '{}' cannot be read", file.string()), "give the path of a netlist");
  Circuit c = parse_circuit(text.str(), file.filename().string(), file.parent_path(), settings, period);
  c.inputs.push_back(file);
  return c;
}

bool is_netlist(const std::filesystem::path& file) {
  const std::string extension = lower(file.extension().string());
  return extension == ".cir" || extension == ".net" || extension == ".sp" || extension == ".ckt" ||
         extension == ".spice";
}

RowMatrix output_values(const Circuit& c, const Result& r) {
  const Index rows = r.t.size(), m = c.scene.states();
  RowMatrix values = RowMatrix::Constant(rows, Index(c.outputs.size()), NAN);
  if (r.x.rows() != rows || r.x.cols() != m) return values;
  RowMatrix u(rows, c.sources), slope(rows, c.sources);
  Vector now(c.sources);
  for (Index j = 0; j < rows; ++j) {
    c.u(r.t[j], now);
    u.row(j) = now;
    c.slope(r.t[j], now);
    slope.row(j) = now;
  }
  values.setZero();
  if (c.of_x.cols() == m) values += r.x * c.of_x.transpose();
  values += u * c.of_u.transpose();
  values += slope * c.of_slope.transpose();
  if (c.of_modes.cols() > 0 && c.of_modes.cols() == r.modes.cols()) values += r.modes * c.of_modes.transpose();
  if (c.of_y.cols() == r.y.cols()) values += r.y * c.of_y.transpose();
  return values;
}

}  // namespace bromwich
