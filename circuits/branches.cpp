#include "circuits/branches.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

namespace bromwich::circuits {

namespace {

class BranchMaker {
 public:
  BranchMaker(const Netlist& netlist, const std::map<std::string, Index>& nodes, const NormalTree& tree,
              const Signals& signals)
      : netlist_(netlist),
        nodes_(nodes),
        tree_(tree),
        signals_(signals),
        followers_(followers(netlist, tree)),
        sources_(voltage_sources(netlist)) {}

  Branches run() {
    Index next = 0;
    for (const Element& e : netlist_.elements) {
      const Index own = (e.kind == 'S' || e.kind == 'W') && !opens(e) ? 2 : 1;  // a resistance beside it
      made_.of.emplace_back(next, own);
      next += own;
    }
    set_bases();
    for (std::size_t i = 0; i < netlist_.elements.size(); ++i) add_branches(Index(i));
    for (std::size_t i = 0; i < netlist_.elements.size(); ++i)
      if (element(Index(i)).kind == 'B') add_currents_of_form(Index(i));
    return std::move(made_);
  }

 private:
  const Element& element(Index i) const { return netlist_.elements[std::size_t(i)]; }
  bool in_tree(Index i) const { return tree_.in_tree[std::size_t(i)] != 0; }
  Index node(const Element& e, std::size_t k) const { return nodes_.at(e.nodes[k]); }
  Index branch(Index i) const { return made_.of[std::size_t(i)].first; }

  void set_bases() {
    bases_.resize(netlist_.elements.size());
    for (std::size_t i = 0; i < followers_.size(); ++i)
      for (const auto& [other, ratio] : followers_[i]) bases_[std::size_t(other)].emplace_back(Index(i), ratio);
  }

  Branch& add(Index i, bool of_voltage) {
    made_.all.push_back({.of_voltage = of_voltage, .from = node(element(i), 0), .to = node(element(i), 1)});
    return made_.all.back();
  }

  void add_branches(Index i) {
    const Element& e = element(i);
    const OwnSignals& own = signals_.own[std::size_t(i)];
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
        add(i, e.kind == 'V').signals = {{signals_.of_u(own.source), 1}};
        return;
      case 'E':
      case 'G':
        add(i, e.kind == 'E').voltages = {{{node(e, 2), node(e, 3)}, e.value}};
        return;
      case 'F':
      case 'H':
        add(i, e.kind == 'H').currents = {{controlling_branch(e), e.value}};
        return;
      case 'B':
        return add_form(i);
      case 'P':
        add(i, true).signals = {{signals_.of_y(own.y), 1}};
        return;
      case 'U':
        add(i, true).signals = {{signals_.of_u(own.source), 1}};
        return;
      case 'D':
        return add_diode(i);
      default:
        return add_switch(i);
    }
  }

  Index controlling_branch(const Element& e) const {
    if (const auto found = sources_.find(e.controlled_by); found != sources_.end()) return branch(found->second);
    throw Error(to_string(e.place), fmt::format("{}: there is no voltage source '{}'", e.name, e.controlled_by),
                "name a voltage source, one of 0 V where there is none");
  }

  void add_form(Index i) {
    const Element& e = element(i);
    Branch& b = add(i, e.of_voltage);
    b.signals = {{signals_.of_u(0), e.form->constant}};
    for (const LinearForm::OfVoltage& one : e.form->voltages)
      b.voltages.push_back({{nodes_.at(one.from), nodes_.at(one.to)}, one.factor});
  }

  // After all branches: a branch that states its current is written out.
  void add_currents_of_form(Index i) {
    const Element& e = element(i);
    for (const LinearForm::OfCurrent& one : e.form->currents) {
      const Index of = element_named(netlist_, one.element, e);
      const auto& [first, count] = made_.of[std::size_t(of)];
      for (Index k = first; k < first + count; ++k) {
        const Branch& other = made_.all[std::size_t(k)];
        Branch& b = made_.all[std::size_t(branch(i))];
        if (other.of_voltage) {
          b.currents.emplace_back(k, one.factor);
          continue;
        }
        if (element(of).kind == 'B')
          throw Error(to_string(e.place),
                      fmt::format("{}: {} is a source of current with an expression", e.name, element(of).name),
                      "measure its current by a source of 0 V in series");
        if (other.slope != 0) b.voltages.push_back({{other.from, other.to}, one.factor * other.slope});
        for (const auto& [signal, factor] : other.signals) b.signals.emplace_back(signal, one.factor * factor);
        for (const auto& [pair, factor] : other.voltages) b.voltages.push_back({pair, one.factor * factor});
        for (const auto& [branch, factor] : other.currents) b.currents.emplace_back(branch, one.factor * factor);
      }
    }
  }

  void add_inductor(Index i) {
    if (tree_.follows[std::size_t(i)]) {  // v = T v_B
      Branch& b = add(i, true);
      for (const auto& [base, ratio] : bases_[std::size_t(i)])
        b.voltages.push_back({{node(element(base), 0), node(element(base), 1)}, ratio});
      return;
    }
    Branch& b = add(i, in_tree(i));
    b.signals = {{signals_.own[std::size_t(i)].signal, 1}};
    if (!in_tree(i))  // i = i_m - T^T i_D
      for (const auto& [other, ratio] : followers_[std::size_t(i)]) b.currents.push_back({branch(other), -ratio});
  }

  void add_diode(Index i) {
    const Element& e = element(i);
    const OwnSignals& own = signals_.own[std::size_t(i)];
    const Index y = signals_.of_y(own.y), y2 = own.y2 < 0 ? -1 : signals_.of_y(own.y2);
    const auto [forward, on] = conducting_line(e);
    if (opens(e) && in_tree(i)) {  // v = V* + R' (i + y2) - y
      Branch& b = add(i, true);
      b.slope = on;
      b.signals = {{signals_.of_u(0), forward}, {y, -1}};
      if (y2 >= 0) b.signals.push_back({y2, on});
      return;
    }
    Branch& b = add(i, false);  // i = v / Roff + y - y2
    b.slope = opens(e) ? 0 : 1 / e.diode.off;
    b.signals = {{y, 1}};
    if (y2 >= 0) b.signals.push_back({y2, -1});
  }

  void add_switch(Index i) {
    const Element& e = element(i);
    const OwnSignals& own = signals_.own[std::size_t(i)];
    const Terms p_less_q{{signals_.of_y(own.y), 1}, {signals_.of_y(own.y2), -1}};
    if (opens(e) && in_tree(i)) {  // v = Ron s + p - q
      Branch& b = add(i, true);
      b.slope = e.gate.on;
      b.signals = p_less_q;
      return;
    }
    add(i, false).signals = p_less_q;  // s = p - q
    if (!opens(e)) add(i, false).slope = 1 / e.gate.off;
  }

  const Netlist& netlist_;
  const std::map<std::string, Index>& nodes_;
  const NormalTree& tree_;
  const Signals& signals_;
  std::vector<Terms> followers_, bases_;
  std::map<std::string, Index> sources_;
  Branches made_;
};

}  // namespace

std::pair<double, double> conducting_line(const Element& e) {
  const DiodeModel& d = e.diode;
  if (opens(e)) return {d.forward, d.on};
  return {d.forward * d.off / (d.off - d.on), d.on == 0 ? 0 : 1 / (1 / d.on - 1 / d.off)};
}

std::vector<Terms> followers(const Netlist& netlist, const NormalTree& tree) {
  std::vector<Terms> found(netlist.elements.size());
  for (const WindingGroup& g : tree.groups)
    for (Index a = 0; a < g.base; ++a)
      for (Index k = g.base; k < Index(g.order.size()); ++k)
        found[std::size_t(g.inductors[std::size_t(g.order[std::size_t(a)])])].push_back(
            {g.inductors[std::size_t(g.order[std::size_t(k)])], g.ratios(k - g.base, a)});
  return found;
}

Index element_named(const Netlist& netlist, const std::string& name, const Element& asks) {
  for (std::size_t i = 0; i < netlist.elements.size(); ++i)
    if (lower(netlist.elements[i].name) == name) return Index(i);
  throw Error(to_string(asks.place), fmt::format("{}: there is no element '{}'", asks.name, name),
              "name an element of the netlist");
}

std::map<std::string, Index> voltage_sources(const Netlist& netlist) {
  std::map<std::string, Index> found;
  for (std::size_t i = 0; i < netlist.elements.size(); ++i)
    if (netlist.elements[i].kind == 'V') found.emplace(lower(netlist.elements[i].name), Index(i));
  return found;
}

Branches make_branches(const Netlist& netlist, const std::map<std::string, Index>& nodes, const NormalTree& tree,
                       const Signals& signals) {
  return BranchMaker(netlist, nodes, tree, signals).run();
}

}  // namespace bromwich::circuits
