#include "circuits/circuit.hpp"

#include "circuits/gates.hpp"
#include "circuits/operating_point.hpp"
#include "circuits/reduction.hpp"
#include "core/base/error.hpp"

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
  const std::size_t independent = u.size();
  for (const Gate& gate : r.gates) {
    const SwitchModel& model = netlist.elements[std::size_t(gate.element)].gate;
    Control control{gate.control[0], {}};
    for (std::size_t k = 1; k < independent; ++k)
      if (gate.control[Index(k)] != 0) control.sources.push_back({&u[k], gate.control[Index(k)]});
    u.push_back(gate_waveform(
        switch_times(control, model.threshold + model.hysteresis, model.threshold - model.hysteresis, netlist.stop),
        gate.open, gate.closed));
  }
  return u;
}

/// shapes times the sources whose columns are not zero, and their slopes.
TimeFunction combination(const Matrix& of_u, const Matrix& of_slope,
                         const std::shared_ptr<const std::vector<Waveform>>& u) {
  std::vector<Index> used, used_slope;
  for (Index k = 0; k < of_u.cols(); ++k) {
    if (!of_u.col(k).isZero(0)) used.push_back(k);
    if (of_slope.size() > 0 && !of_slope.col(k).isZero(0)) used_slope.push_back(k);
  }
  if (used.empty() && used_slope.empty()) return {};
  Matrix shapes(of_u.rows(), Index(used.size() + used_slope.size()));
  if (!used.empty()) shapes.leftCols(Index(used.size())) = of_u(Eigen::all, used);
  if (!used_slope.empty()) shapes.rightCols(Index(used_slope.size())) = of_slope(Eigen::all, used_slope);
  const TimeFunction time = [u, used, used_slope](double t, Eigen::Ref<Vector> value) {
    Index at = 0;
    for (const Index k : used) value[at++] = (*u)[std::size_t(k)].value(t);
    for (const Index k : used_slope) value[at++] = (*u)[std::size_t(k)].slope(t);
  };
  return SeparableSource{std::move(shapes), time};
}

/// Those of the sources that f or g see. Times that differ by rounding are one.
std::vector<double> breakpoints(const Matrix& F, const Matrix& G, const Matrix& G_slope, const std::vector<Waveform>& u,
                                double T) {
  std::vector<double> all;
  for (std::size_t k = 0; k < u.size(); ++k) {
    const Index i = Index(k);
    if (F.col(i).isZero(0) && G.col(i).isZero(0) && G_slope.col(i).isZero(0)) continue;
    const std::vector<double> own = u[k].breakpoints(T);
    all.insert(all.end(), own.begin(), own.end());
  }
  std::sort(all.begin(), all.end());
  const double rounding = 64 * epsilon * T;
  all.erase(std::unique(all.begin(), all.end(), [&](double a, double b) { return b - a <= rounding; }), all.end());
  return all;
}

TimeFunction all_values(const std::shared_ptr<const std::vector<Waveform>>& u,
                        std::function<double(double)> Waveform::*which) {
  return [u, which](double t, Eigen::Ref<Vector> value) {
    for (std::size_t k = 0; k < u->size(); ++k) value[Index(k)] = ((*u)[k].*which)(t);
  };
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
    x[k] = e.initial ? *e.initial : e.kind == 'C' ? node(e.nodes[0]) - node(e.nodes[1]) : 0;
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

Vector start(const Netlist& netlist, const Reduction& r, const DenseDynamics& d, const Matrix& M, const Matrix& G,
             const Vector& u, const std::string& file, std::vector<std::string>& notes) {
  if (netlist.use_initial) return given_start(netlist, r, u, notes);
  const auto rest = operating_point(d.A, d.B, r.F * u, d.N, M, G * u, netlist.stop);
  if (!rest)
    throw Error(file, "there is no operating point to start from: the sources at t = 0 bring the circuit to no rest",
                "add uic to .tran, with IC= where the start is not zero");
  return *rest;
}

void add_outputs(const Reduction& r, Circuit& c) {
  for (const auto& [list, unit] : {std::pair(&r.voltages, "V"), {&r.currents, "A"}})
    for (const auto& [name, row] : *list)
      c.outputs.push_back({name, unit, row.z.transpose(), row.y.transpose(), row.u.transpose(), row.slope.transpose()});
}

CircuitReduction found(const Netlist& netlist, const Reduction& r) {
  CircuitReduction f;
  f.summary = fmt::format("{} elements, {} nodes: {} states, {} pairs, {} sources", netlist.elements.size(),
                          r.voltages.size(), r.states.size(), r.pairs.size(), r.inputs.size());
  f.states = r.states;
  for (const Pair& pair : r.pairs) f.pairs.push_back(pair.name);
  for (const Dependence& d : r.dependences)
    (d.kind == Dependence::loop     ? f.loops
     : d.kind == Dependence::cutset ? f.cutsets
                                    : f.windings)
        .push_back(d.equation);
  f.open = r.open;
  return f;
}

Circuit make_circuit(const Netlist& netlist, const std::string& file) {
  const Reduction r = reduce(netlist);
  const auto u = std::make_shared<const std::vector<Waveform>>(make_sources(netlist, r));
  const Index m = r.A.rows(), n = Index(r.pairs.size()), k = r.sources;
  Matrix N(n, m), M(n, n), G(n, k), G_slope(n, k);
  Circuit c;
  for (Index i = 0; i < n; ++i) {
    const Pair& pair = r.pairs[std::size_t(i)];
    N.row(i) = pair.w.z, M.row(i) = pair.w.y, G.row(i) = pair.w.u, G_slope.row(i) = pair.w.slope;
    c.scene.names.y.push_back(pair.name);
    c.scene.names.w.push_back(pair.name + ".w");
  }
  c.u = all_values(u, &Waveform::value);
  c.slope = all_values(u, &Waveform::slope);
  c.sources = k;
  DenseDynamics dynamics{r.A, r.B, N};
  Vector at_start(k);
  c.u(0, at_start);
  Scene& s = c.scene;
  s.name = netlist.title.empty() ? file : netlist.title;
  if (n == 0) {  // a linear circuit has a pair that is never active
    dynamics.B = Matrix::Zero(m, 1), dynamics.N = Matrix::Zero(1, m);
    M = Matrix::Identity(1, 1), G = G_slope = Matrix::Zero(1, k);
  }
  s.dynamics = dynamics;
  s.M = M;
  s.f = combination(r.F, {}, u);
  s.g = combination(G, G_slope, u);
  s.T = netlist.stop;
  s.time_unit = "s";
  s.breakpoints = breakpoints(r.F, G, G_slope, *u, s.T);
  s.breakpoints_are_all = true;
  c.notes = netlist.notes;
  c.notes.insert(c.notes.end(), r.notes.begin(), r.notes.end());
  s.x0 = start(netlist, r, dynamics, M, G, at_start, file, c.notes);
  s.names.x = r.states;
  for (const std::string& name : r.states) s.units.x.push_back(name[0] == 'V' ? "V" : "A");
  if (netlist.step > 0) {
    const Index rows = Index(std::floor((netlist.stop - netlist.start) / netlist.step * (1 + 1e-9)));
    if (rows >= 1 && rows <= 10'000'000) {
      s.default_steps = rows;
      c.times.resize(rows + 1);
      for (Index j = 0; j <= rows; ++j) c.times[j] = std::min(netlist.start + double(j) * netlist.step, netlist.stop);
    }
  }
  add_outputs(r, c);
  c.reduction = found(netlist, r);
  c.parameters = netlist.parameters;
  c.inputs = netlist.inputs;
  return c;
}

}  // namespace

Circuit parse_circuit(std::string_view netlist, const std::string& file_name, const std::filesystem::path& folder,
                      const std::map<std::string, double>& settings) {
  return make_circuit(read_netlist(netlist, file_name, folder, settings), file_name);
}

Circuit read_circuit(const std::filesystem::path& file, const std::map<std::string, double>& settings) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in)
    throw Error("SCENE", fmt::format("the file '{}' cannot be read", file.string()), "give the path of a netlist");
  Circuit c = parse_circuit(text.str(), file.filename().string(), file.parent_path(), settings);
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
  Vector u(c.sources), slope(c.sources);
  for (Index j = 0; j < rows; ++j) {
    c.u(r.t[j], u);
    c.slope(r.t[j], slope);
    for (std::size_t i = 0; i < c.outputs.size(); ++i) {
      const CircuitOutput& o = c.outputs[i];
      double v = o.of_x.dot(r.x.row(j)) + o.of_u.dot(u) + o.of_slope.dot(slope);
      if (!o.of_y.isZero(0)) v += o.of_y.dot(r.y.row(j));
      values(j, Index(i)) = v;
    }
  }
  return values;
}

}  // namespace bromwich
