#include "circuits/cards.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <sstream>

namespace bromwich::circuits {

namespace {

bool blank(char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; }

std::string trimmed(const std::string& s) {
  const auto first = std::find_if_not(s.begin(), s.end(), blank);
  const auto last = std::find_if_not(s.rbegin(), s.rend(), blank).base();
  return first < last ? std::string(first, last) : std::string();
}

std::string without_comment(const std::string& line) {
  std::size_t end = std::min({line.find(';'), line.find("//"), line.find(" $ ")});
  if (end == std::string::npos && line.size() >= 2 && line.substr(line.size() - 2) == " $") end = line.size() - 2;
  return trimmed(line.substr(0, end));
}

// Where a group that begins at `from` with '{', '(' or a quote ends: behind its last letter.
std::size_t end_of_group(const std::string& s, std::size_t from, const Place& place) {
  const char open = s[from], close = open == '{' ? '}' : open == '(' ? ')' : open;
  int depth = 0;
  for (std::size_t i = from; i < s.size(); ++i) {
    if (s[i] == close && (open == close ? i > from : --depth == 0)) return i + 1;
    if (open != close && s[i] == open) ++depth;
  }
  throw Error(to_string(place), fmt::format("'{}' has no '{}'", open, close), "close it on the same card");
}

// Words of a card; blanks around '=' and before '(' do not separate.
std::vector<std::string> split_words(const std::string& text, const Place& place) {
  std::vector<std::string> words;
  std::string word;
  const auto end_word = [&] {
    if (!word.empty()) words.push_back(word);
    word.clear();
  };
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '{' || c == '(' || c == '\'' || c == '"') {
      const std::size_t end = end_of_group(text, i, place);
      word += text.substr(i, end - i);
      i = end;
    } else if (blank(c) || c == ',') {
      std::size_t next = text.find_first_not_of(" \t", i);
      if (c != ',' && next != std::string::npos && (text[next] == '=' || text[next] == '(') && !word.empty()) {
        i = next;
        continue;
      }
      if (!word.empty() && word.back() == '=') {  // the value follows
        i = next == i ? i + 1 : next;
        continue;
      }
      end_word();
      ++i;
    } else {
      word += c;
      ++i;
    }
  }
  end_word();
  return words;
}

Card make_card(const std::string& text, const Place& place) {
  Card card{place, text, {}, {}};
  for (std::string& word : split_words(text, place)) {
    word = lower(std::move(word));
    const std::size_t equals = word.find('=');
    const bool grouped = word[0] == '{' || word[0] == '(' || word[0] == '\'';
    const bool plain = equals == std::string::npos || equals == 0 || grouped;
    if (plain || (equals > word.find('(') && word[equals - 1] != ')'))  // "d(ron=10m)", but not "v(out)=5"
      card.words.push_back(word);
    else
      card.given[word.substr(0, equals)] = word.substr(equals + 1);
  }
  return card;
}

std::string contents(const std::filesystem::path& file, const Place& place) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in)
    throw Error(to_string(place), fmt::format("the file '{}' cannot be read", file.string()), "correct its name");
  return text.str();
}

class Reader {
 public:
  explicit Reader(Deck& deck) : deck_(deck) {}

  void read(std::string_view text, const std::string& file, const std::filesystem::path& folder, bool titled) {
    if (++depth_ > 20) throw Error(file, "files include each other without end", "remove an .include");
    std::string line, joined;
    Place place{file, 0}, start = place;
    bool skipping = false;
    const auto finish = [&] {
      if (!joined.empty()) take(joined, start, folder, skipping);
      joined.clear();
    };
    std::istringstream lines{std::string(text)};
    while (std::getline(lines, line)) {
      ++place.line;
      std::replace(line.begin(), line.end(), '\t', ' ');
      if (titled && place.line == 1) {
        const std::size_t begin = line.find_first_not_of("* ");  // LTspice puts a star before the title
        deck_.title = begin == std::string::npos ? "" : trimmed(line.substr(begin));
        continue;
      }
      const std::string first = trimmed(line);
      if (first.empty() || first[0] == '*') continue;
      if (first[0] == '+') {
        if (joined.empty())
          throw Error(to_string(place), "continues no line", "remove the '+', or put a card before it");
        joined += " " + without_comment(first.substr(1));
        continue;
      }
      finish();
      if (ended_) break;
      joined = without_comment(" " + first);
      start = place;
    }
    finish();
    --depth_;
  }

 private:
  void take(const std::string& text, const Place& place, const std::filesystem::path& folder, bool& skipping) {
    const std::string word = lower(text.substr(0, text.find_first_of(" \t")));
    if (word == ".endc") {
      skipping = false;
      return;
    }
    if (skipping || ended_) return;
    if (word == ".control") {
      skipping = deck_.control = true;
      return;
    }
    if (word == ".end") {
      ended_ = depth_ == 1;
      return;
    }
    if (word != ".include" && word != ".inc" && word != ".lib") {
      deck_.cards.push_back(make_card(text, place));
      return;
    }
    std::string name = trimmed(text.substr(word.size()));
    if (name.size() > 1 && (name[0] == '"' || name[0] == '\'')) name = name.substr(1, name.find(name[0], 1) - 1);
    const std::filesystem::path file = folder / name;
    const std::string inner = contents(file, place);
    deck_.inputs.push_back(file);
    read(inner, name, file.parent_path(), false);
  }

  Deck& deck_;
  int depth_ = 0;
  bool ended_ = false;
};

}  // namespace

std::string to_string(const Place& place) {
  return place.line > 0 ? fmt::format("{}: line {}", place.file, place.line) : place.file;
}

std::string lower(std::string s) {
  for (char& c : s) c = char(std::tolower(static_cast<unsigned char>(c)));
  return s;
}

std::vector<std::string> split_arguments(const std::string& text) {
  std::vector<std::string> words;
  std::string word;
  int braces = 0;
  for (const char c : text + " ") {
    if (c == '{') ++braces;
    if (c == '}') --braces;
    if (braces == 0 && (blank(c) || c == ',' || c == '(' || c == ')')) {
      if (!word.empty()) words.push_back(word);
      word.clear();
    } else {
      word += c;
    }
  }
  return words;
}

Deck read_cards(std::string_view text, const std::string& file_name, const std::filesystem::path& folder) {
  Deck deck;
  Reader(deck).read(text, file_name, folder, true);
  return deck;
}

}  // namespace bromwich::circuits
