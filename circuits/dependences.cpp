#include "circuits/dependences.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::circuits {

namespace {

constexpr double rounding_of_sum = 1e-9;  ///< of the largest coefficient: rounding of the network's solution

// "V(C2) = V1 - 0.5 V(C1)".
std::string equation(const std::string& left, const Terms& terms, const std::vector<std::string>& names) {
  double largest = 0;
  for (const auto& [k, factor] : terms) largest = std::max(largest, std::abs(factor));
  std::string sum;
  for (const auto& [k, factor] : terms) {
    if (!(std::abs(factor) > rounding_of_sum * largest)) continue;
    const std::string size = fmt::format("{:.6g}", std::abs(factor));
    sum += factor < 0 ? (sum.empty() ? "-" : " - ") : (sum.empty() ? "" : " + ");
    sum += size == "1" ? names[std::size_t(k)] : size + " " + names[std::size_t(k)];
  }
  return left + " = " + (sum.empty() ? "0" : sum);
}

}  // namespace

std::vector<Dependence> dependences(const Netlist& netlist, const NormalTree& tree, const Reduction& r) {
  const auto element = [&](Index i) -> const Element& { return netlist.elements[std::size_t(i)]; };
  std::vector<std::string> names = r.states;
  const Index states = Index(names.size());
  names.resize(std::size_t(states + r.sources));
  for (std::size_t k = 0; k < r.inputs.size(); ++k) names[std::size_t(states) + 1 + k] = element(r.inputs[k]).name;
  for (std::size_t k = 0; k < r.memories.size(); ++k)
    names[names.size() - r.memories.size() + k] = element(r.memories[k]).name;
  std::vector<Dependence> found;
  for (std::size_t k = 0; k < r.excess.size(); ++k) {
    const Element& e = element(r.excess[k]);
    Terms terms;
    for (Rows::InnerIterator one(r.P, Index(k)); one; ++one) terms.push_back({one.col(), one.value()});
    for (Rows::InnerIterator one(r.Q, Index(k)); one; ++one) terms.push_back({states + one.col(), one.value()});
    found.push_back({e.kind == 'C' ? Dependence::loop : Dependence::cutset,
                     equation(fmt::format("{}({})", e.kind == 'C' ? "V" : "I", e.name), terms, names)});
  }
  std::vector<std::string> across;
  for (const Element& e : netlist.elements) across.push_back(fmt::format("V({})", e.name));
  for (const WindingGroup& g : tree.groups)
    for (std::size_t k = std::size_t(g.base); k < g.order.size(); ++k) {
      Terms terms;
      for (Index a = 0; a < g.base; ++a)
        terms.push_back({g.inductors[std::size_t(g.order[std::size_t(a)])], g.ratios(Index(k) - g.base, a)});
      found.push_back(
          {Dependence::winding, equation(across[std::size_t(g.inductors[std::size_t(g.order[k])])], terms, across)});
    }
  return found;
}

}  // namespace bromwich::circuits
