#include "circuits/levels.hpp"

#include "circuits/library.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

namespace bromwich::circuits {

namespace {

// From the card `at` on, up to the .ends of the subcircuit that `opened`.
Level sorted_from(const std::vector<Card>& cards, std::size_t& at, const Card* opened) {
  Level level;
  for (; at < cards.size(); ++at) {
    const Card& card = cards[at];
    if (card.words.empty()) continue;
    if (card.words[0] == ".ends") {
      if (opened) return level;
      throw Error(to_string(card.place), ".ends without .subckt", "remove it");
    }
    if (card.words[0] != ".subckt") {
      level.cards.push_back(card);
      continue;
    }
    if (card.words.size() < 2) throw Error(to_string(card.place), ".subckt without a name", "write .subckt NAME nodes");
    Subcircuit s{card, {}, card.given, {}, {}};
    for (std::size_t i = 2; i < card.words.size() && card.words[i] != "params:"; ++i) s.nodes.push_back(card.words[i]);
    Level inner = sorted_from(cards, ++at, &card);
    s.cards = std::move(inner.cards);
    s.inner = std::move(inner.subcircuits);
    level.subcircuits[card.words[1]] = std::move(s);
  }
  if (opened)
    throw Error(to_string(opened->place), fmt::format("subcircuit '{}' has no .ends", opened->words[1]), "add .ends");
  return level;
}

}  // namespace

Level sort_cards(const std::vector<Card>& cards) {
  std::size_t at = 0;
  return sorted_from(cards, at, nullptr);
}

const Level& library_level() {
  static const Level level = sort_cards(read_cards(library(), "library", {}).cards);
  return level;
}

}  // namespace bromwich::circuits
