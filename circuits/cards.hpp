#pragma once
// The lines of a netlist in SPICE's language, as cards of words.
//
// The first line is the title. `*` begins a comment line; `;`, ` $ ` and `//` end a line; a line that begins with `+`
// continues the one before, also behind comment lines. Letters count without their case.

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich::circuits {

/// Where something stands: "buck.cir: line 3".
struct Place {
  std::string file;
  int line = 0;
};
std::string to_string(const Place&);

struct Card {
  Place place;
  std::string text;  ///< one line, without comments, with its letters as they are written
  /// Words in lower case; a word in braces, quotes or parentheses keeps its blanks. `name=value` is a word of its own
  /// in `given`.
  std::vector<std::string> words;
  std::map<std::string, std::string> given;
};

struct Deck {
  std::string title;
  std::vector<Card> cards;
  std::vector<std::filesystem::path> inputs;  ///< the files that .include and .lib have read
  bool control = false;                       ///< a block .control ... .endc was skipped
};

/// `file_name`: in messages. .include and .lib read files relative to `folder`. Throws Error for a continuation without
/// a line before it, a brace without its partner, and a file that cannot be read.
Deck read_cards(std::string_view text, const std::string& file_name, const std::filesystem::path& folder);

std::string lower(std::string);

/// The words of a list such as "PULSE(0 5 0 10n)" or "V(out,0)": blanks, commas and parentheses separate.
std::vector<std::string> split_arguments(const std::string&);

}  // namespace bromwich::circuits
