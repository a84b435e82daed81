#include "circuits/reduction.hpp"

#include "circuits/branches.hpp"
#include "circuits/dependences.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::circuits {

namespace {

using Triplets = std::vector<Eigen::Triplet<double>>;

constexpr double bound = 1e6;       ///< amperes and volts: no circuit of this kind of model has more
constexpr double leak = 1e-9;       ///< amperes through an open switch: its two multipliers then have one solution
constexpr double no_effect = 1e-9;  ///< of the largest coefficient: rounding of the network's solution

class Reducer {
 public:
  Reducer(const Netlist& netlist, const std::vector<char>& remembers)
      : netlist_(netlist),
        remembers_(remembers),
        nodes_(number_nodes(netlist)),
        tree_(normal_tree(netlist, nodes_)),
        s_(number_signals(netlist, tree_, remembers)),
        branches_(make_branches(netlist, nodes_, tree_, s_)),
        followers_(followers(netlist, tree_)) {
    names_.resize(nodes_.size());
    for (const auto& [name, i] : nodes_) names_[std::size_t(i)] = i == 0 ? "0" : netlist.written.at(name);
  }

  /// Switches that the state of the circuit controls, and that are numbered as if it did not: then the result is not
  /// complete.
  const std::vector<Index>& controlled() const { return controlled_; }

  Reduction run() {
    for (const Index node : tree_.grounded) {
      branches_.all.push_back({.of_voltage = true, .from = node, .to = 0});
      made_.notes.push_back(
          fmt::format("node {} is joined to ground: its part had no path to it", names_[std::size_t(node)]));
    }
    network_ = solve_network(branches_.all, Index(nodes_.size()), s_.count());
    if (network_.singular_node >= 0 || network_.singular_branch >= 0) refuse_singular();
    made_.inputs = s_.inputs;
    made_.sources = s_.sources;
    made_.memories = s_.memories;
    sum_currents();
    reduce_storage();
    add_gates();
    if (!controlled_.empty()) return {};
    add_pairs();
    add_conditions();
    add_outputs();
    made_.dependences = dependences(netlist_, tree_, made_);
    for (const Element& e : netlist_.elements)
      if ((e.kind == 'D' || e.kind == 'S' || e.kind == 'W') && opens(e)) made_.open.push_back(e.name);
    return std::move(made_);
  }

 private:
  const Element& element(Index i) const { return netlist_.elements[std::size_t(i)]; }
  const OwnSignals& own(Index i) const { return s_.own[std::size_t(i)]; }
  bool in_tree(Index i) const { return tree_.in_tree[std::size_t(i)] != 0; }
  bool remembers(Index i) const { return remembers_[std::size_t(i)] != 0; }
  Index node(const Element& e, std::size_t k) const { return nodes_.at(e.nodes[k]); }

  [[noreturn]] void refuse_singular() const {
    std::string where;
    const Place* place = &netlist_.elements.front().place;
    if (const Index at = network_.singular_node; at >= 0) {
      where = "node " + names_[std::size_t(at)];
      for (auto e = netlist_.elements.rbegin(); e != netlist_.elements.rend(); ++e)
        if (node(*e, 0) == at || node(*e, 1) == at) place = &e->place;
    }
    for (std::size_t i = 0; i < branches_.of.size(); ++i)
      if (const auto& [first, count] = branches_.of[i];
          network_.singular_branch >= first && network_.singular_branch < first + count)
        where = netlist_.elements[i].name, place = &netlist_.elements[i].place;
    throw Error(to_string(*place), fmt::format("the resistive network is singular; involved: {}", where),
                "add a resistance there, or give diodes and switches a finite Roff");
  }

  // Currents of elements and voltages across them, over s.
  void sum_currents() {
    const Index elements = Index(netlist_.elements.size());
    Triplets sums, differences;
    for (Index i = 0; i < elements; ++i) {
      const auto& [first, count] = branches_.of[std::size_t(i)];
      for (Index b = first; b < first + count; ++b) sums.emplace_back(int(i), int(b), 1.0);
      differences.emplace_back(int(i), int(node(element(i), 0)), 1.0);
      differences.emplace_back(int(i), int(node(element(i), 1)), -1.0);
    }
    Rows of_branches(elements, Index(branches_.all.size())), of_nodes(elements, Index(nodes_.size()));
    of_branches.setFromTriplets(sums.begin(), sums.end());
    of_nodes.setFromTriplets(differences.begin(), differences.end());
    currents_ = of_branches * network_.currents;
    voltages_ = of_nodes * network_.voltages;
  }

  // Chosen rows of what elements have.
  template <class Choose>
  Rows rows_of(const std::vector<Index>& elements, const Choose& choose) const {
    Triplets all;
    for (std::size_t k = 0; k < elements.size(); ++k) {
      const auto add = [&](const Rows& of, Index row, double factor) {
        for (Rows::InnerIterator e(of, row); e; ++e) all.emplace_back(int(k), int(e.col()), factor * e.value());
      };
      choose(elements[k], add);
    }
    Rows made(Index(elements.size()), s_.count());
    made.setFromTriplets(all.begin(), all.end());
    return made;
  }

  Rows storage_matrix() const {
    Triplets all;
    for (std::size_t k = 0; k < s_.storage.size(); ++k)
      if (const Element& e = element(s_.storage[k]); e.kind == 'C') all.emplace_back(int(k), int(k), e.value);
    for (const WindingGroup& g : tree_.groups)
      for (Index a = 0; a < g.base; ++a)
        for (Index b = 0; b < g.base; ++b) {
          const Index p = g.order[std::size_t(a)], q = g.order[std::size_t(b)];
          all.emplace_back(int(own(g.inductors[std::size_t(p)]).storage), int(own(g.inductors[std::size_t(q)]).storage),
                           g.inductance(p, q));
        }
    Rows K(Index(s_.storage.size()), Index(s_.storage.size()));
    K.setFromTriplets(all.begin(), all.end());
    return K;
  }

  void reduce_storage() {
    const Index m = s_.states, n = s_.pairs, k = s_.sources, t = s_.excess;
    made_.storage.assign(s_.storage.begin(), s_.storage.begin() + m);
    made_.excess.assign(s_.storage.begin() + m, s_.storage.end());
    for (const Index i : made_.storage)
      made_.states.push_back(fmt::format("{}({})", element(i).kind == 'C' ? "V" : "I", element(i).name));
    const Rows V = rows_of(made_.storage, [&](Index i, const auto& add) {  // the flow d
      add(element(i).kind == 'C' ? currents_ : voltages_, i, 1);
    });
    Rows S = rows_of(made_.excess, [&](Index i, const auto& add) {  // what is stored
      add(element(i).kind == 'C' ? voltages_ : currents_, i, 1);
      for (const auto& [other, ratio] : followers_[std::size_t(i)]) add(currents_, other, ratio);
    });
    check_excess(S);
    S.prune([](Index, Index, double value) { return std::abs(value) > no_effect; });
    const Rows K = storage_matrix(), K_kept = K.topRows(m), K_excess = K.bottomRows(t);
    made_.P = columns(S, 0, m), made_.Q = columns(S, m + n, k);
    const Rows Vd = columns(V, m + n + k, t), Ktt = columns(K_excess, m, t), Kct = columns(K_kept, m, t);
    D_of_x_ = columns(K_excess, 0, m) + Rows(Ktt * made_.P);
    D_of_slope_ = Ktt * made_.Q;
    const Rows E = columns(K_kept, 0, m) + Rows(Kct * made_.P) - Rows(Vd * D_of_x_);
    const Rows of_excess = Rows(Vd * Ktt) - Kct;
    const BlockSolution found = solve_in_blocks(E, beside(columns(V, 0, m + n + k), of_excess));
    if (found.singular >= 0)
      throw Error(to_string(element(made_.storage[std::size_t(found.singular)]).place),
                  "what the capacitors and inductors store is not independent",
                  "check capacitances, inductances and controlled sources");
    X_ = columns(found.Z, 0, m + n + k);  // x' = X (x, y, u) + H u'
    made_.jump = columns(found.Z, m + n + k, t);
    made_.H = made_.jump * made_.Q;
    made_.A = columns(X_, 0, m);
    made_.B = columns(X_, m, n);
    made_.F = columns(X_, m + n, k) + Rows(made_.A * made_.H);
  }

  // What is in excess depends on states and sources alone.
  void check_excess(const Rows& S) const {
    for (Index k = 0; k < S.rows(); ++k)
      for (Rows::InnerIterator e(S, k); e; ++e) {
        const bool of_y = e.col() >= s_.states && e.col() < s_.of_u(0), of_d = e.col() >= s_.of_u(s_.sources);
        if (!(of_y || of_d) || std::abs(e.value()) <= no_effect) continue;
        const Element& one = element(made_.excess[std::size_t(k)]);
        throw Error(
            to_string(one.place),
            fmt::format("{} closes a loop with controlled sources or windings that other elements decide", one.name),
            "put a small resistance in series with it");
      }
  }

  // Rows over s as rows over (z, y, u, u'): x = z + H u, d = D_x x' + D_u u'.
  Forms forms(const Rows& over) const {
    const Index m = s_.states, n = s_.pairs, k = s_.sources;
    const Rows of_d = columns(over, m + n + k, s_.excess), of_slope = of_d * D_of_x_;
    const Rows all = columns(over, 0, m + n + k) + Rows(of_slope * X_);
    Forms f{columns(all, 0, m), columns(all, m, n), columns(all, m + n, k), {}};
    f.u = Rows(f.u) + Rows(f.z * made_.H);
    f.slope = Rows(of_slope * made_.H) + Rows(of_d * D_of_slope_);
    return f;
  }

  // A row of a pair: `factor` times row `row` of what elements or nodes have, and other terms.
  void add_row(const std::string& name, const Rows& of, Index row, double factor, const Terms& others) {
    const int at = int(made_.pairs.size());
    for (Rows::InnerIterator e(of, row); e; ++e) pair_rows_.emplace_back(at, int(e.col()), factor * e.value());
    for (const auto& [signal, value] : others) pair_rows_.emplace_back(at, int(signal), value);
    made_.pairs.push_back(name);
  }

  void add_pairs() {
    for (Index i = 0; i < Index(netlist_.elements.size()); ++i) {
      if (element(i).kind == 'D') add_diode(i);
      if (element(i).kind == 'P')
        add_row(element(i).name, form_of(*element(i).form, element(i)), 0, -1, {{s_.of_y(own(i).y), 1}});
      if (element(i).kind == 'S' || element(i).kind == 'W') add_switch(i);
    }
    Rows w(Index(made_.pairs.size()), s_.count());
    w.setFromTriplets(pair_rows_.begin(), pair_rows_.end());
    made_.w = forms(w);
  }

  void add_diode(Index i) {
    const Element& e = element(i);
    const Index one = s_.of_u(0), y = s_.of_y(own(i).y), y2 = s_.of_y(own(i).y2);
    const auto [forward, on] = conducting_line(e);
    const bool breaks = own(i).y2 >= 0;
    if (opens(e) && in_tree(i)) {
      add_row(e.name, currents_, i, 1, breaks ? Terms{{y2, 1}} : Terms{});
    } else {
      Terms others{{one, forward}, {y, on}};
      if (e.thyristor)
        others.insert(others.end(), {{one, e.thyristor->blocks}, {s_.of_u(own(i).source), -e.thyristor->blocks}});
      add_row(e.name, voltages_, i, -1, others);
    }
    if (breaks) add_row(e.name + ".reverse", voltages_, i, 1, {{one, e.diode.reverse}, {y2, e.diode.on_reverse}});
  }

  // bound - s, bound + s, with s the current, or v - Ron i
  void add_switch(Index i) {
    const Element& e = element(i);
    const Index one = s_.of_u(0), y = s_.of_y(own(i).y), y2 = s_.of_y(own(i).y2);
    const bool tree_form = opens(e) && in_tree(i);
    const Rows& of = tree_form ? currents_ : voltages_;
    const double on = tree_form ? 0 : e.gate.on;
    const auto [open, closed] = tree_form ? std::pair(leak, bound) : std::pair(bound, 0.0);
    const Index source = s_.of_u(own(i).source);
    const Terms limit = remembers(i) ? Terms{{one, open}, {source, closed - open}} : Terms{{source, 1}};
    const auto with = [&](double sign) {
      Terms terms = limit;
      terms.insert(terms.end(), {{y, sign * on}, {y2, -sign * on}});
      return terms;
    };
    add_row(e.name + ".p", of, i, -1, with(1));
    add_row(e.name + ".q", of, i, 1, with(-1));
  }

  // On above `close`, off below `open`: signal - close and open - signal.
  void add_conditions() {
    Rows all(0, s_.count());
    for (const Index i : s_.memories) {
      const Element& e = element(i);
      Rows signal = control_of(e);
      double close = e.gate.threshold + e.gate.hysteresis, open = e.gate.threshold - e.gate.hysteresis;
      if (e.thyristor) {
        close = open = 1;
        signal /= e.thyristor->gate;
        signal.coeffRef(0, s_.of_y(own(i).y)) += 1 / e.thyristor->holding;
      }
      for (const auto& [sign, threshold] : {std::pair(1.0, close), {-1.0, open}}) {
        Rows condition = sign * signal;
        condition.coeffRef(0, s_.of_u(0)) -= sign * threshold;
        all = below(all, condition);
      }
    }
    made_.conditions = forms(all);
  }

  Rows form_of(const LinearForm& form, const Element& e) const {
    Rows row(1, s_.count());
    row.insert(0, s_.of_u(0)) = form.constant;
    for (const LinearForm::OfVoltage& one : form.voltages)
      row += one.factor *
             Rows(Rows(network_.voltages.row(nodes_.at(one.from))) - Rows(network_.voltages.row(nodes_.at(one.to))));
    for (const LinearForm::OfCurrent& one : form.currents)
      row += one.factor * Rows(currents_.row(element_named(netlist_, one.element, e)));
    return row;
  }

  // The voltage or the current that controls a switch or a thyristor: one row.
  Rows control_of(const Element& e) const {
    if (e.kind == 'U') return form_of(*e.form, e);
    if (e.kind != 'W') return Rows(network_.voltages.row(node(e, 2))) - Rows(network_.voltages.row(node(e, 3)));
    const std::map<std::string, Index> sources = voltage_sources(netlist_);
    const auto source = sources.find(e.controlled_by);
    if (source == sources.end())
      throw Error(to_string(e.place), fmt::format("{}: there is no voltage source '{}'", e.name, e.controlled_by),
                  "name a voltage source, one of 0 V where there is none");
    return currents_.row(source->second);
  }

  void add_gates() {
    const Index gates = Index(made_.inputs.size()) + 1;  // sources behind this number are bounds of gates
    for (Index i = 0; i < Index(netlist_.elements.size()); ++i) {
      const Element& e = element(i);
      if ((e.kind != 'S' && e.kind != 'W' && e.kind != 'U') || remembers(i)) continue;
      Gate gate{i, own(i).source, leak, bound, {}};
      double of_sources = 0, of_others = 0;
      const Rows control = control_of(e);
      for (Rows::InnerIterator one(control, 0); one; ++one) {
        const Index source = one.col() - s_.of_u(0);
        const bool independent = source >= 0 && source < gates;
        if (independent) gate.control.push_back({source, one.value()});
        double& largest = independent ? of_sources : of_others;
        largest = std::max(largest, std::abs(one.value()));
      }
      if (of_others > no_effect * std::max(of_sources, 1e-3)) controlled_.push_back(i);
      if (e.kind == 'U')
        gate.open = 0, gate.closed = 1;
      else if (!(opens(e) && in_tree(i)))
        gate.open = bound, gate.closed = 0;
      made_.gates.push_back(std::move(gate));
    }
  }

  void add_outputs() {
    std::vector<char> hidden(names_.size(), 0);
    for (const Element& e : netlist_.elements)
      if (e.hidden) hidden[std::size_t(nodes_.at(e.nodes[0]))] = 1;
    std::vector<std::pair<std::string, Index>> voltages, currents;
    for (Index i = 1; i < Index(names_.size()); ++i)
      if (!hidden[std::size_t(i)]) voltages.emplace_back(fmt::format("V({})", names_[std::size_t(i)]), i);
    std::sort(voltages.begin(), voltages.end());
    for (std::size_t i = 0; i < netlist_.elements.size(); ++i)
      if (const Element& e = netlist_.elements[i]; !e.hidden)
        currents.emplace_back(fmt::format("I({})", e.name), Index(i));
    const auto chosen = [this](const auto& some, const Rows& of_all) {
      Triplets order;
      for (const auto& [name, i] : some) {
        order.emplace_back(int(order.size()), int(i), 1.0);
        made_.outputs.push_back(name);
      }
      Rows rows(Index(some.size()), of_all.rows());
      rows.setFromTriplets(order.begin(), order.end());
      return Rows(rows * of_all);
    };
    const Rows of_nodes = chosen(voltages, network_.voltages);
    made_.nodes = of_nodes.rows();
    made_.of_outputs = forms(below(of_nodes, chosen(currents, currents_)));
  }

  const Netlist& netlist_;
  const std::vector<char>& remembers_;
  std::map<std::string, Index> nodes_;
  NormalTree tree_;
  Signals s_;
  Branches branches_;
  std::vector<Terms> followers_;
  std::vector<std::string> names_;  ///< of nodes
  NetworkSolution network_;
  Rows currents_, voltages_;  ///< of elements, over s
  Rows D_of_x_, D_of_slope_, X_;
  Triplets pair_rows_;
  std::vector<Index> controlled_;
  Reduction made_;
};

}  // namespace

Reduction reduce(const Netlist& given) {
  Netlist netlist = given;
  const std::vector<std::string> opened = open_large_resistances(netlist, number_nodes(netlist));
  std::vector<char> remembers;
  for (const Element& e : netlist.elements) remembers.push_back(e.thyristor.has_value());
  for (;;) {
    Reducer reducer(netlist, remembers);
    Reduction made = reducer.run();
    if (reducer.controlled().empty()) {
      if (!opened.empty()) made.notes.push_back(fmt::format("Roff of {} counts as open", fmt::join(opened, ", ")));
      return made;
    }
    for (const Index i : reducer.controlled()) remembers[std::size_t(i)] = 1;
  }
}

}  // namespace bromwich::circuits
