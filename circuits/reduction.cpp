#include "circuits/reduction.hpp"

#include "circuits/normal_tree.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich::circuits {

namespace {

using Eigen::RowVectorXd;

constexpr double bound = 1e6;       ///< amperes and volts: no circuit of this kind of model has more
constexpr double leak = 1e-9;       ///< amperes through an open switch: its two multipliers then have one solution
constexpr double no_effect = 1e-9;  ///< of the largest coefficient: rounding of the network's solution

// "V(C2) = V1 - 0.5 V(C1)". Coefficients that are rounding of 1 are 1, and those that are rounding of 0 left out.
std::string equation(const std::string& left, const Terms& terms, const std::vector<std::string>& names) {
  double largest = 0;
  for (const auto& [k, factor] : terms) largest = std::max(largest, std::abs(factor));
  std::string sum;
  for (const auto& [k, factor] : terms) {
    if (!(std::abs(factor) > no_effect * largest)) continue;
    const std::string size = fmt::format("{:.6g}", std::abs(factor));
    sum += factor < 0 ? (sum.empty() ? "-" : " - ") : (sum.empty() ? "" : " + ");
    sum += size == "1" ? names[std::size_t(k)] : size + " " + names[std::size_t(k)];
  }
  return left + " = " + (sum.empty() ? "0" : sum);
}

class Reducer {
 public:
  explicit Reducer(const Netlist& netlist)
      : netlist_(netlist), nodes_(number_nodes(netlist)), tree_(normal_tree(netlist, nodes_)) {}

  Reduction run() {
    number_signals();
    for (std::size_t i = 0; i < netlist_.elements.size(); ++i) add_branches(Index(i));
    for (const Index node : tree_.grounded) {
      branches_.push_back({.of_voltage = true, .from = node, .to = 0});
      made_.notes.push_back(fmt::format("node {} is joined to ground: its part had no path to it", name_of(node)));
    }
    network_ = solve_network(branches_, Index(nodes_.size()), signals_);
    if (network_.singular_node >= 0 || network_.singular_branch >= 0) refuse_singular();
    reduce_storage();
    add_pairs();
    add_gates();
    add_outputs();
    describe();
    return std::move(made_);
  }

 private:
  const Element& element(Index i) const { return netlist_.elements[std::size_t(i)]; }
  bool in_tree(Index i) const { return tree_.in_tree[std::size_t(i)] != 0; }
  bool follows(Index i) const { return tree_.follows[std::size_t(i)] != 0; }
  Index from(const Element& e) const { return nodes_.at(e.nodes[0]); }
  Index to(const Element& e) const { return nodes_.at(e.nodes[1]); }
  std::string name_of(Index node) const {
    for (const auto& [name, i] : nodes_)
      if (i == node) return node == 0 ? "0" : netlist_.written.at(name);
    return "?";
  }

  /// Signals of one element: where it has them.
  struct Own {
    Index storage = -1;     ///< its row of K s' = d
    Index signal = -1;      ///< x or d of a storage element
    Index y = -1, y2 = -1;  ///< multipliers
    Index source = -1;      ///< of u
    std::vector<Index> branches;
  };

  // s = (x, y, u, d).
  void number_signals() {
    const Index count = Index(netlist_.elements.size());
    own_.resize(std::size_t(count));
    std::vector<Index> kept, excess;
    for (Index i = 0; i < count; ++i) {
      const Element& e = element(i);
      if (e.kind == 'C') (in_tree(i) ? kept : excess).push_back(i);
      if (e.kind == 'L' && !follows(i)) (in_tree(i) ? excess : kept).push_back(i);
      Own& own = own_[std::size_t(i)];
      if (e.kind == 'D') own.y = pairs_++;
      if (e.kind == 'D' && std::isfinite(e.diode.reverse)) own.y2 = pairs_++;
      if (e.kind == 'S' || e.kind == 'W') own.y = pairs_++, own.y2 = pairs_++;
      if (e.kind == 'V' || e.kind == 'I') own.source = ++sources_, made_.inputs.push_back(i);
    }
    for (Index i = 0; i < count; ++i)
      if (element(i).kind == 'S' || element(i).kind == 'W') own_[std::size_t(i)].source = ++sources_;
    ++sources_;  // number 0 is the constant 1
    states_ = Index(kept.size());
    excess_ = Index(excess.size());
    storage_ = kept;
    storage_.insert(storage_.end(), excess.begin(), excess.end());
    signals_ = states_ + pairs_ + sources_ + excess_;
    for (std::size_t k = 0; k < storage_.size(); ++k) {
      Own& own = own_[std::size_t(storage_[k])];
      own.storage = Index(k);
      own.signal = Index(k) < states_ ? Index(k) : Index(k) + pairs_ + sources_;
    }
    made_.storage = kept;
    made_.excess = excess;
    made_.sources = sources_;
  }
  Index of_y(Index i) const { return states_ + i; }
  Index of_u(Index i) const { return states_ + pairs_ + i; }

  Branch& add(Index i, bool of_voltage) {
    own_[std::size_t(i)].branches.push_back(Index(branches_.size()));
    branches_.push_back({.of_voltage = of_voltage, .from = from(element(i)), .to = to(element(i))});
    return branches_.back();
  }

  void add_branches(Index i) {
    const Element& e = element(i);
    const Own& own = own_[std::size_t(i)];
    switch (e.kind) {
      case 'R':
        add(i, false).slope = 1 / e.value;
        return;
      case 'C':
        add(i, in_tree(i)).signals = {{own.signal, 1}};
        return;
      case 'L':
        return add_inductor(i);
      case 'V':
      case 'I':
        add(i, e.kind == 'V').signals = {{of_u(own.source), 1}};
        return;
      case 'E':
      case 'G':
        add(i, e.kind == 'E').voltages = {{{nodes_.at(e.nodes[2]), nodes_.at(e.nodes[3])}, e.value}};
        return;
      case 'F':
      case 'H':
        add(i, e.kind == 'H').currents = {{controlling_branch(e), e.value}};
        return;
      case 'D':
        return add_diode(i);
      default:
        return add_switch(i);
    }
  }

  // The branch of the voltage source that an element names. Sources keep their order, so it may come later.
  Index controlling_branch(const Element& e) const {
    for (std::size_t k = 0; k < netlist_.elements.size(); ++k)
      if (netlist_.elements[k].kind == 'V' && lower(netlist_.elements[k].name) == e.controlled_by)
        return branch_before(k);
    throw Error(to_string(e.place), fmt::format("{}: there is no voltage source '{}'", e.name, e.controlled_by),
                "name a voltage source, one of 0 V where there is none");
  }
  // The number of the first branch of element k, whether it is made already or not.
  Index branch_before(std::size_t k) const {
    Index count = 0;
    for (std::size_t i = 0; i < k; ++i) {
      const Element& e = netlist_.elements[i];
      const bool parallel = (e.kind == 'S' || e.kind == 'W') && !opens(e);
      count += parallel ? 2 : 1;
    }
    return count;
  }

  void add_inductor(Index i) {
    const Own& own = own_[std::size_t(i)];
    for (const WindingGroup& g : tree_.groups)
      for (std::size_t k = 0; k < g.order.size(); ++k) {
        if (g.inductors[std::size_t(g.order[k])] != i) continue;
        if (Index(k) >= g.base) {  // v = T v_B
          Branch& b = add(i, true);
          for (Index a = 0; a < g.base; ++a) {
            const Element& base = element(g.inductors[std::size_t(g.order[std::size_t(a)])]);
            b.voltages.push_back({{from(base), to(base)}, g.ratios(Index(k) - g.base, a)});
          }
          return;
        }
        Branch& b = add(i, in_tree(i));
        b.signals = {{own.signal, 1}};
        if (!in_tree(i))  // i = i_m - T^T i_D
          for (const auto& [other, ratio] : followers(i))
            b.currents.push_back({branch_before(std::size_t(other)), -ratio});
        return;
      }
  }

  // The windings that follow a base inductor, with their ratios.
  Terms followers(Index i) const {
    Terms found;
    for (const WindingGroup& g : tree_.groups)
      for (Index a = 0; a < g.base; ++a)
        if (g.inductors[std::size_t(g.order[std::size_t(a)])] == i)
          for (Index k = g.base; k < Index(g.order.size()); ++k)
            found.push_back({g.inductors[std::size_t(g.order[std::size_t(k)])], g.ratios(k - g.base, a)});
    return found;
  }

  // V* and R' of the line beyond which a diode conducts.
  static std::pair<double, double> line(const DiodeModel& d, bool open) {
    if (open) return {d.forward, d.on};
    return {d.forward * d.off / (d.off - d.on), d.on == 0 ? 0 : 1 / (1 / d.on - 1 / d.off)};
  }

  void add_diode(Index i) {
    const Element& e = element(i);
    const Own& own = own_[std::size_t(i)];
    const auto [forward, on] = line(e.diode, opens(e));
    if (opens(e) && in_tree(i)) {  // v = V* + R' (i + y2) - y
      Branch& b = add(i, true);
      b.slope = on;
      b.signals = {{of_u(0), forward}, {of_y(own.y), -1}};
      if (own.y2 >= 0) b.signals.push_back({of_y(own.y2), on});
      return;
    }
    Branch& b = add(i, false);  // i = v / Roff + y - y2
    b.slope = opens(e) ? 0 : 1 / e.diode.off;
    b.signals = {{of_y(own.y), 1}};
    if (own.y2 >= 0) b.signals.push_back({of_y(own.y2), -1});
  }

  void add_switch(Index i) {
    const Element& e = element(i);
    const Own& own = own_[std::size_t(i)];
    if (opens(e) && in_tree(i)) {  // v = Ron s + p - q
      Branch& b = add(i, true);
      b.slope = e.gate.on;
      b.signals = {{of_y(own.y), 1}, {of_y(own.y2), -1}};
      return;
    }
    add(i, false).signals = {{of_y(own.y), 1}, {of_y(own.y2), -1}};  // s = p - q
    if (!opens(e)) add(i, false).slope = 1 / e.gate.off;
  }

  [[noreturn]] void refuse_singular() const {
    std::string where;
    const Element* named = nullptr;
    const Place* place = &netlist_.elements.front().place;
    if (network_.singular_node >= 0) {
      where = "node " + name_of(network_.singular_node);
      for (auto e = netlist_.elements.rbegin(); e != netlist_.elements.rend(); ++e)
        if (from(*e) == network_.singular_node || to(*e) == network_.singular_node) place = &e->place;
    }
    for (std::size_t i = 0; i < own_.size(); ++i)
      for (const Index b : own_[i].branches)
        if (b == network_.singular_branch) named = &netlist_.elements[i];
    if (named) where = named->name, place = &named->place;
    throw Error(to_string(*place), fmt::format("the resistive network is singular; involved: {}", where),
                "add a resistance there, or give diodes and switches a finite Roff");
  }

  // Voltage across an element, and the current through all its branches, over s.
  RowVectorXd voltage(Index i) const { return network_.voltage(from(element(i)), to(element(i))); }
  RowVectorXd current(Index i) const {
    RowVectorXd sum = RowVectorXd::Zero(signals_);
    for (const Index b : own_[std::size_t(i)].branches) sum += network_.currents.row(b);
    return sum;
  }
  // The flow of a storage element, d, and what it stores, s.
  RowVectorXd flow(Index i) const { return element(i).kind == 'C' ? current(i) : voltage(i); }
  RowVectorXd stored(Index i) const {
    if (element(i).kind == 'C') return voltage(i);
    RowVectorXd s = current(i);
    for (const auto& [other, ratio] : followers(i)) s += ratio * current(other);
    return s;
  }

  Matrix storage_matrix() const {
    const Index n = Index(storage_.size());
    Matrix K = Matrix::Zero(n, n);
    for (Index k = 0; k < n; ++k)
      if (const Element& e = element(storage_[std::size_t(k)]); e.kind == 'C') K(k, k) = e.value;
    for (const WindingGroup& g : tree_.groups)
      for (Index a = 0; a < g.base; ++a)
        for (Index b = 0; b < g.base; ++b) {
          const Index p = g.order[std::size_t(a)], q = g.order[std::size_t(b)];
          K(own_[std::size_t(g.inductors[std::size_t(p)])].storage,
            own_[std::size_t(g.inductors[std::size_t(q)])].storage) = g.inductance(p, q);
        }
    return K;
  }

  void reduce_storage() {
    const Index m = states_, n = pairs_, k = sources_, t = excess_;
    const Matrix K = storage_matrix();
    Matrix V(m, signals_), S(t, signals_);
    for (Index i = 0; i < m; ++i) V.row(i) = flow(storage_[std::size_t(i)]);
    for (Index i = 0; i < t; ++i) S.row(i) = stored(storage_[std::size_t(m + i)]);
    for (Index i = 0; i < t; ++i) check_excess(S.row(i), storage_[std::size_t(m + i)]);
    const Matrix P = S.leftCols(m), Q = S.middleCols(m + n, k), Vd = V.rightCols(t);
    D_of_x_ = K.bottomLeftCorner(t, m) + K.bottomRightCorner(t, t) * P;
    D_of_slope_ = K.bottomRightCorner(t, t) * Q;
    const Matrix E = K.topLeftCorner(m, m) + K.topRightCorner(m, t) * P - Vd * D_of_x_;
    const Eigen::FullPivLU<Matrix> lu(E);
    if (m > 0 && !lu.isInvertible())
      throw Error(to_string(netlist_.elements.front().place),
                  "what the capacitors and inductors store is not independent",
                  "check capacitances, inductances and controlled sources");
    made_.P = P, made_.Q = Q;
    made_.jump = lu.solve(Matrix(Vd * K.bottomRightCorner(t, t) - K.topRightCorner(m, t)));
    made_.H = made_.jump * Q;
    X_ = lu.solve(V);  // x' = X (x, y, u) + H u'
    made_.A = X_.leftCols(m);
    made_.B = X_.middleCols(m, n);
    made_.F = X_.middleCols(m + n, k) + made_.A * made_.H;
    for (Index i = 0; i < m; ++i) {
      const Element& e = element(storage_[std::size_t(i)]);
      made_.states.push_back(fmt::format("{}({})", e.kind == 'C' ? "V" : "I", e.name));
    }
  }

  // What is in excess depends on states and sources alone.
  void check_excess(const RowVectorXd& s, Index i) const {
    const double other = std::max(pairs_ > 0 ? s.segment(states_, pairs_).cwiseAbs().maxCoeff() : 0.0,
                                  excess_ > 0 ? s.tail(excess_).cwiseAbs().maxCoeff() : 0.0);
    if (other > no_effect)
      throw Error(to_string(element(i).place),
                  fmt::format("{} closes a loop with controlled sources or windings that other elements decide",
                              element(i).name),
                  "put a small resistance in series with it");
  }

  // A row over s as one over (z, y, u, u'): x = z + H u, d = D_x x' + D_u u'.
  Row row(RowVectorXd s) const {
    const Index m = states_, n = pairs_, k = sources_;
    const RowVectorXd of_d = s.tail(excess_);
    if (excess_ > 0) s.head(m + n + k) += of_d * D_of_x_ * X_.leftCols(m + n + k);
    Row r{s.head(m), s.segment(m, n), s.segment(m + n, k), RowVectorXd::Zero(k)};
    r.u += r.z * made_.H;
    if (excess_ > 0) r.slope = of_d * (D_of_x_ * made_.H + D_of_slope_);
    return r;
  }

  RowVectorXd unit(Index signal, double factor = 1) const {
    RowVectorXd s = RowVectorXd::Zero(signals_);
    s[signal] = factor;
    return s;
  }

  void add_pairs() {
    for (Index i = 0; i < Index(netlist_.elements.size()); ++i) {
      const Element& e = element(i);
      const Own& own = own_[std::size_t(i)];
      if (e.kind == 'D') {
        const auto [forward, on] = line(e.diode, opens(e));
        RowVectorXd w;
        if (opens(e) && in_tree(i)) {
          w = current(i);
          if (own.y2 >= 0) w += unit(of_y(own.y2));
        } else {
          w = unit(of_u(0), forward) + unit(of_y(own.y), on) - voltage(i);
        }
        made_.pairs.push_back({e.name, row(w)});
        if (own.y2 >= 0)
          made_.pairs.push_back({e.name + ".reverse", row(unit(of_u(0), e.diode.reverse) +
                                                          unit(of_y(own.y2), e.diode.on_reverse) + voltage(i))});
      } else if (e.kind == 'S' || e.kind == 'W') {
        RowVectorXd s;
        if (opens(e) && in_tree(i))
          s = current(i);  // bound - s, bound + s
        else
          s = voltage(i) - unit(of_y(own.y), e.gate.on) + unit(of_y(own.y2), e.gate.on);  // of v - Ron s
        made_.pairs.push_back({e.name + ".p", row(unit(of_u(own.source)) - s)});
        made_.pairs.push_back({e.name + ".q", row(unit(of_u(own.source)) + s)});
      }
    }
  }

  void add_gates() {
    for (Index i = 0; i < Index(netlist_.elements.size()); ++i) {
      const Element& e = element(i);
      if (e.kind != 'S' && e.kind != 'W') continue;
      RowVectorXd c;
      if (e.kind == 'S') {
        c = network_.voltage(nodes_.at(e.nodes[2]), nodes_.at(e.nodes[3]));
      } else {
        c = network_.currents.row(controlling_branch(e));
      }
      const Index gates = Index(made_.inputs.size()) + 1;  // sources behind this number are bounds of gates
      RowVectorXd others = c;
      others.segment(of_u(0), gates).setZero();
      const double own = c.segment(of_u(0), gates).cwiseAbs().maxCoeff();
      if (others.cwiseAbs().maxCoeff() > no_effect * std::max(own, 1e-3))
        throw Error(to_string(e.place), fmt::format("switch {} is controlled by the state of the circuit", e.name),
                    "control it by independent sources");
      const bool limits_current = opens(e) && in_tree(i);
      made_.gates.push_back({i, own_[std::size_t(i)].source, limits_current ? leak : bound, limits_current ? bound : 0,
                             c.segment(of_u(0), gates)});
    }
  }

  void add_outputs() {
    for (const auto& [name, i] : nodes_)
      if (i > 0)
        made_.voltages.push_back({fmt::format("V({})", netlist_.written.at(name)), row(network_.voltages.row(i))});
    std::sort(made_.voltages.begin(), made_.voltages.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    for (Index i = 0; i < Index(netlist_.elements.size()); ++i)
      made_.currents.push_back({fmt::format("I({})", element(i).name), row(current(i))});
  }

  void describe() {
    std::vector<std::string> names = made_.states;
    names.resize(std::size_t(states_ + sources_));
    for (std::size_t k = 0; k < made_.inputs.size(); ++k)
      names[std::size_t(states_) + 1 + k] = element(made_.inputs[k]).name;
    for (Index k = 0; k < excess_; ++k) {
      const Element& e = element(made_.excess[std::size_t(k)]);
      Terms terms;
      for (Index i = 0; i < states_; ++i) terms.push_back({i, made_.P(k, i)});
      for (Index i = 0; i < sources_; ++i) terms.push_back({states_ + i, made_.Q(k, i)});
      made_.dependences.push_back({e.kind == 'C' ? Dependence::loop : Dependence::cutset,
                                   equation(fmt::format("{}({})", e.kind == 'C' ? "V" : "I", e.name), terms, names)});
    }
    std::vector<std::string> across;
    for (const Element& e : netlist_.elements) across.push_back(fmt::format("V({})", e.name));
    for (const WindingGroup& g : tree_.groups)
      for (std::size_t k = std::size_t(g.base); k < g.order.size(); ++k) {
        Terms terms;
        for (Index a = 0; a < g.base; ++a)
          terms.push_back({g.inductors[std::size_t(g.order[std::size_t(a)])], g.ratios(Index(k) - g.base, a)});
        made_.dependences.push_back(
            {Dependence::winding, equation(across[std::size_t(g.inductors[std::size_t(g.order[k])])], terms, across)});
      }
    for (const Element& e : netlist_.elements)
      if ((e.kind == 'D' || e.kind == 'S' || e.kind == 'W') && opens(e)) made_.open.push_back(e.name);
  }

  const Netlist& netlist_;
  std::map<std::string, Index> nodes_;
  NormalTree tree_;
  Index states_ = 0, pairs_ = 0, sources_ = 0, excess_ = 0, signals_ = 0;
  std::vector<Own> own_;
  std::vector<Index> storage_;  ///< states, then what is in excess
  std::vector<Branch> branches_;
  NetworkSolution network_;
  Matrix D_of_x_, D_of_slope_, X_;
  Reduction made_;
};

}  // namespace

Reduction reduce(const Netlist& netlist) { return Reducer(netlist).run(); }

}  // namespace bromwich::circuits
