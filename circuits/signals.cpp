#include "circuits/signals.hpp"

#include <cmath>
#include <string>

namespace bromwich::circuits {

Signals number_signals(const Netlist& netlist, const NormalTree& tree, const std::vector<char>& remembers) {
  const std::size_t count = netlist.elements.size();
  Signals s;
  s.own.resize(count);
  std::vector<Index> excess;
  for (std::size_t i = 0; i < count; ++i) {
    const Element& e = netlist.elements[i];
    const bool in_tree = tree.in_tree[i] != 0;
    OwnSignals& own = s.own[i];
    if (e.kind == 'C') (in_tree ? s.storage : excess).push_back(Index(i));
    if (e.kind == 'L' && !tree.follows[i]) (in_tree ? excess : s.storage).push_back(Index(i));
    if (e.kind == 'D') own.y = s.pairs++;
    if (e.kind == 'D' && std::isfinite(e.diode.reverse)) own.y2 = s.pairs++;
    if (e.kind == 'S' || e.kind == 'W') own.y = s.pairs++, own.y2 = s.pairs++;
    if (e.kind == 'P') own.y = s.pairs++;
    if (e.kind == 'V' || e.kind == 'I') own.source = s.sources++, s.inputs.push_back(Index(i));
  }
  for (std::size_t i = 0; i < count; ++i)
    if (!remembers[i] && std::string("SWU").find(netlist.elements[i].kind) != std::string::npos)
      s.own[i].source = s.sources++;
  for (std::size_t i = 0; i < count; ++i)
    if (remembers[i]) s.own[i].source = s.sources++, s.memories.push_back(Index(i));
  s.states = Index(s.storage.size());
  s.excess = Index(excess.size());
  s.storage.insert(s.storage.end(), excess.begin(), excess.end());
  for (std::size_t k = 0; k < s.storage.size(); ++k) {
    OwnSignals& own = s.own[std::size_t(s.storage[k])];
    own.storage = Index(k);
    own.signal = Index(k) < s.states ? Index(k) : Index(k) + s.pairs + s.sources;
  }
  return s;
}

}  // namespace bromwich::circuits
