#include "circuits/netlist.hpp"

#include "circuits/analysis.hpp"
#include "circuits/behaviour.hpp"
#include "circuits/levels.hpp"
#include "circuits/models.hpp"
#include "circuits/step_cards.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

namespace bromwich::circuits {

namespace {

[[noreturn]] void refuse(const Card& card, const std::string& found, const std::string& remedy) {
  throw Error(to_string(card.place), found, remedy);
}

const std::set<std::string> skipped{".options", ".option",   ".opt",   ".save",  ".probe", ".print",
                                    ".plot",    ".backanno", ".title", ".width", ".temp",  ".global"};
const std::set<std::string> other_analyses{".op", ".dc", ".noise", ".tf", ".four", ".net", ".wave"};

// How many words an element has before its values.
std::size_t nodes_of(char kind) { return kind == 'E' || kind == 'G' || kind == 'S' ? 4 : 2; }

struct Scope {
  const Scope* outer = nullptr;
  std::string prefix;                        ///< "X1."
  std::map<std::string, std::string> ports;  ///< nodes of the subcircuit: those outside
  Parameters parameters;
  std::map<std::string, Model> models;
  const std::map<std::string, Subcircuit>* subcircuits = nullptr;
};

class Flattening {
 public:
  Flattening(Netlist& netlist, std::map<std::string, double> settings, bool control)
      : netlist_(netlist), settings_(std::move(settings)) {
    if (control) used_skipped_.insert(".control");
  }

  void top(const Level& level) {
    Scope scope;
    scope.subcircuits = &level.subcircuits;
    define(level.cards, scope);
    for (const Card& card : level.cards)
      if (const std::string name = card.words[0] == ".step" ? stepped_parameter(card) : ""; !name.empty())
        if (!scope.parameters.has(name)) scope.parameters.set(name, 0), only_stepped_.insert(name);
    for (const auto& [name, value] : settings_) {
      if (!scope.parameters.has(lower(name)))
        throw Error("--set", fmt::format("'{}' is no .param of the netlist", name), "use one of its .param names");
      scope.parameters.set(lower(name), value);
    }
    for (const Card& card : level.cards)
      if (card.words[0] == ".step") take_step(card, scope);
    for (const Card& card : level.cards) unread_.merge(read_analysis(card, scope.parameters, netlist_));
    for (const Card& card : level.cards) take(card, scope);
    netlist_.parameters = scope.parameters.values();
    for (const auto& [words, what] : {std::pair(&used_skipped_, "skipped: "), {&unread_, "not read: "}}) {
      std::string list;
      for (const std::string& word : *words) list += (list.empty() ? "" : " ") + word;
      if (!list.empty()) netlist_.notes.push_back(what + list);
    }
  }

 private:
  // Parameters, functions and models, which may stand behind their use.
  void define(const std::vector<Card>& cards, Scope& scope) {
    for (const Card& card : cards) {
      const std::string& word = card.words[0];
      if (word == ".param" || word == ".params") {
        for (const auto& [name, value] : card.given) scope.parameters.define(name, value, card.place);
      } else if (word == ".func") {
        define_function(card, scope);
      } else if (word == ".model") {
        Model model = read_model(card);
        scope.models[card.words[1]] = std::move(model);
      }
    }
  }

  // The first value is that of the parameter, unless .param or a setting gives one.
  void take_step(const Card& card, Scope& scope) {
    const std::string name = stepped_parameter(card);
    if (name.empty()) {
      unread_.insert(".step " + (card.words.size() > 1 ? card.words[1] : ""));
      return;
    }
    CircuitStep step = read_step(card, scope.parameters);
    const auto is_it = [&](const CircuitStep& other) { return other.name == name; };
    if (std::any_of(netlist_.steps.begin(), netlist_.steps.end(), is_it))
      refuse(card, fmt::format(".step: '{}' is stepped twice", name), "remove one of the two");
    const bool fixed = std::any_of(settings_.begin(), settings_.end(),
                                   [&](const auto& setting) { return lower(setting.first) == name; });
    if (fixed) return;
    if (only_stepped_.contains(name)) scope.parameters.set(name, step.values.front());
    netlist_.steps.push_back(std::move(step));
  }

  static void define_function(const Card& card, Scope& scope) {
    std::string text;
    for (std::size_t i = 1; i < card.words.size(); ++i) text += card.words[i];
    const std::size_t open = text.find('('), close = text.find(')');
    if (open == std::string::npos || close == std::string::npos)
      refuse(card, ".func without arguments in parentheses", "write .func f(a,b) {a*b}");
    std::string body = text.substr(close + 1);
    if (const auto given = card.given.begin(); body.empty() && given != card.given.end()) body = given->second;
    scope.parameters.define_function(text.substr(0, open), split_arguments(text.substr(open, close - open + 1)), body);
  }

  void take(const Card& card, const Scope& scope) {
    const std::string& word = card.words[0];
    if (word[0] == '.') return take_directive(card, scope);
    const char kind = char(std::toupper(static_cast<unsigned char>(word[0])));
    if (kind == 'X') return take_subcircuit(card, scope);
    if (kind == 'K') return take_coupling(card, scope);
    if (kind == 'B' || ((kind == 'E' || kind == 'G') && card.words.size() == 3))
      return take_behaviour(card, scope, kind);
    if (std::string("RCLVIEGFHDSW").find(kind) == std::string::npos)
      refuse(card, fmt::format("{}: elements of kind {} are not read", written_name(card), kind),
             "use S with a .model SW for a transistor that switches, D for a junction");
    Element e;
    e.kind = kind;
    e.place = card.place;
    e.name = scope.prefix + written_name(card);
    if (!names_.insert(lower(e.name)).second) refuse(card, fmt::format("{} is there twice", e.name), "rename one");
    const std::size_t nodes = nodes_of(kind);
    const bool by_current = kind == 'F' || kind == 'H' || kind == 'W';
    if (card.words.size() < 1 + nodes + (by_current ? 1 : 0))
      refuse(card, fmt::format("{}: {} words are too few", e.name, card.words.size()), "give its nodes and its value");
    for (std::size_t i = 1; i <= nodes; ++i) {
      if (nodes == 4 && i > 2 && (card.words[i].starts_with("poly") || card.words[i].starts_with("value")))
        refuse(card, fmt::format("{}: {} is not read", e.name, card.words[i]), "give two controlling nodes and a gain");
      e.nodes.push_back(node(card.words[i], scope, card));
    }
    if (by_current) e.controlled_by = lower(scope.prefix) + card.words[nodes + 1];
    read_values(card, scope, 1 + nodes + (by_current ? 1 : 0), e);
    netlist_.elements.push_back(std::move(e));
  }

  // B1 a b V={...} or I={...}; E1 a b VALUE={...}, G1 a b VALUE={...}.
  void take_behaviour(const Card& card, const Scope& scope, char kind) {
    Element e;
    e.kind = 'B';
    e.place = card.place;
    e.name = scope.prefix + written_name(card);
    if (!names_.insert(lower(e.name)).second) refuse(card, fmt::format("{} is there twice", e.name), "rename one");
    const std::string text = lower(card.text);
    const std::size_t equals = text.find('=');
    const char* const remedy =
        kind == 'B' ? "write B1 a b V={2*V(c)} or I={...}" : "write E1 a b c d GAIN or VALUE={...}";
    if (card.words.size() < 3 || equals == std::string::npos) refuse(card, e.name + " has no expression", remedy);
    std::string what = text.substr(0, equals);
    what.erase(what.find_last_not_of(' ') + 1);
    what = what.substr(what.find_last_of(" ,") + 1);
    if (kind == 'B' ? what != "v" && what != "i" : what != "value")
      refuse(card, fmt::format("{}: '{}' is unknown", e.name, what), remedy);
    e.of_voltage = what == "v" || (what == "value" && kind == 'E');
    for (std::size_t k = 1; k <= 2; ++k) e.nodes.push_back(node(card.words[k], scope, card));
    std::string expression = card.text.substr(equals + 1);
    expression.erase(0, expression.find_first_not_of(' '));
    const BehaviourNames outside{[&](const std::string& name) { return node(name, scope, card); },
                                 [&](const std::string& name) { return lower(scope.prefix) + name; }};
    for (Element& one : behavioural_source(std::move(e), expression, scope.parameters, outside))
      netlist_.elements.push_back(std::move(one));
  }

  void read_values(const Card& card, const Scope& scope, std::size_t first, Element& e) {
    const std::vector<std::string> rest(card.words.begin() + long(first), card.words.end());
    const auto given = [&](const char* name) -> std::optional<double> {
      const auto found = card.given.find(name);
      if (found == card.given.end()) return std::nullopt;
      return scope.parameters.value(found->second, card.place, e.name + ": " + name);
    };
    const auto number = [&] {
      if (rest.empty()) {
        for (const char* name : {"value", "r", "c", "l"})
          if (const auto v = given(name)) return *v;
        refuse(card, e.name + " has no value", "give one behind its nodes");
      }
      return scope.parameters.value(rest[0], card.place, e.name);
    };
    e.initial = given("ic");
    const bool on_or_off =
        card.words.size() > first + 1 && (card.words[first + 1] == "on" || card.words[first + 1] == "off");
    const bool all = e.kind == 'V' || e.kind == 'I' || ((e.kind == 'S' || e.kind == 'W') && on_or_off);
    name_unread(card, e.kind, all ? card.words.size() : first + 1);
    switch (e.kind) {
      case 'V':
      case 'I':
        e.source = read_waveform(rest, scope.parameters, card.place, netlist_.stop, netlist_.periodic);
        e.signal = read_signal(rest, scope.parameters, card.place);
        if (const auto r = given("rser"); r && *r != 0 && e.kind == 'V') parasitic(card, "rser", *r, e);
        return;
      case 'D':
        if (rest.empty()) refuse(card, e.name + " names no model", "give one, such as .model DI D(Ron=10m Vfwd=0.5)");
        e.diode = diode_model(model(rest[0], "d", card, scope, e), scope.parameters);
        if (!e.diode.straightened.empty()) note(e.diode.straightened);
        return;
      case 'S':
      case 'W':
        if (rest.empty()) refuse(card, e.name + " names no model", "give one, such as .model SI SW(Ron=10m Vt=0.5)");
        if (on_or_off) e.initial = rest[1] == "on" ? 1 : 0;
        if (const Model* found = find_model(rest[0], scope); e.kind == 'S' && found && found->type == "scr") {
          e.kind = 'D';
          std::tie(e.diode, e.thyristor) = thyristor_model(*found, scope.parameters);
          return;
        }
        e.gate =
            switch_model(model(rest[0], e.kind == 'S' ? "sw" : "csw", card, scope, e), scope.parameters, model_notes_);
        for (const std::string& one : model_notes_) note(one);
        model_notes_.clear();
        return;
      default:
        break;
    }
    e.value = number();
    if (e.kind == 'C' && !rest.empty() && rest[0].back() == 'f' && spice_number(rest[0].substr(0, rest[0].size() - 1)))
      note(fmt::format("{}: {} = {} is {:g} farad: f is femto", to_string(card.place), e.name, rest[0], e.value));
    if ((e.kind == 'R' && e.value == 0) || ((e.kind == 'C' || e.kind == 'L') && !(e.value > 0)))
      refuse(card, fmt::format("{} = {}", e.name, e.value),
             e.kind == 'R' ? "remove it and join its nodes, or give a resistance" : "give a positive value");
    for (const char* name : {"rser", "rpar", "lser"})
      if (const auto v = given(name); v && *v != 0) parasitic(card, name, *v, e);
  }

  // What a card has and no element here knows; `read`: how many of its words are read.
  void name_unread(const Card& card, char kind, std::size_t read) {
    static const std::map<char, std::set<std::string>> known{{'R', {"value", "r"}},
                                                             {'C', {"value", "c", "ic", "rser", "rpar", "lser"}},
                                                             {'L', {"value", "l", "ic", "rser", "rpar"}},
                                                             {'V', {"rser"}},
                                                             {'E', {"value"}},
                                                             {'G', {"value"}},
                                                             {'F', {"value"}},
                                                             {'H', {"value"}}};
    const auto names = known.find(kind);
    for (const auto& [name, value] : card.given)
      if (names == known.end() || !names->second.contains(name)) unread_.insert(written_name(card) + " " + name);
    for (std::size_t i = read; i < card.words.size(); ++i) unread_.insert(written_name(card) + " " + card.words[i]);
  }

  // R in series (Rser) or parallel (Rpar) as an element of its own.
  void parasitic(const Card& card, const std::string& name, double value, Element& e) {
    if (name == "lser") refuse(card, e.name + ": Lser is not read", "write the inductor as an element of its own");
    Element r;
    r.kind = 'R';
    r.place = e.place;
    r.name = e.name + "." + name;
    r.value = value;
    if (name == "rpar") {
      r.nodes = {e.nodes[0], e.nodes[1]};
    } else {
      const std::string inner = lower(e.name) + ".inner";
      netlist_.written.emplace(inner, e.name + ".inner");
      r.nodes = {inner, e.nodes[1]};
      e.nodes[1] = inner;
    }
    netlist_.elements.push_back(std::move(r));
  }

  static const Model* find_model(const std::string& name, const Scope& scope) {
    for (const Scope* s = &scope; s; s = s->outer)
      if (const auto found = s->models.find(name); found != s->models.end()) return &found->second;
    return nullptr;
  }

  const Model& model(const std::string& name, const std::string& type, const Card& card, const Scope& scope,
                     const Element& e) {
    if (const Model* found = find_model(name, scope)) {
      if (found->type != type)
        refuse(card, fmt::format("{}: the model '{}' is of type {}", e.name, name, found->type),
               fmt::format("give a model of type {}", type));
      return *found;
    }
    refuse(card, fmt::format("{}: there is no model '{}'", e.name, name),
           fmt::format("add .model {} {}(...)", name, type));
  }

  void take_directive(const Card& card, const Scope& scope) {
    const std::string& word = card.words[0];
    if (word == ".param" || word == ".params" || word == ".func" || word == ".model" || word == ".tran" ||
        word == ".ac" || word == ".step")
      return;
    if (word == ".ic" || word == ".nodeset") {
      for (const auto& [name, value] : card.given)
        if (word == ".nodeset" || !name.starts_with("v(") || name.back() != ')')
          unread_.insert(word + " " + name);
        else
          netlist_.initial[node(name.substr(2, name.size() - 3), scope, card)] =
              scope.parameters.value(value, card.place, ".ic");
      return;
    }
    if (word == ".meas" || word == ".measure") {
      netlist_.measures.emplace_back(card.place, card.text);
      return;
    }
    if (skipped.contains(word) || other_analyses.contains(word)) {
      used_skipped_.insert(word);
      return;
    }
    refuse(card, fmt::format("{} is unknown", word), "remove it");
  }

  void take_coupling(const Card& card, const Scope& scope) {
    Coupling k{scope.prefix + written_name(card), card.place, {}, 0};
    if (card.words.size() < 3) refuse(card, k.name + " names less than two inductors", "write K1 L1 L2 0.99");
    const bool implied = card.words.back()[0] == 'l';  // the value may be left out
    const std::size_t last = card.words.size() - (implied ? 0 : 1);
    for (std::size_t i = 1; i < last; ++i) k.inductors.push_back(lower(scope.prefix) + card.words[i]);
    k.value = implied ? 1 : scope.parameters.value(card.words.back(), card.place, k.name);
    if (!(std::abs(k.value) <= 1))
      refuse(card, fmt::format("{} = {}", k.name, k.value), "give a coupling from -1 to 1");
    netlist_.couplings.push_back(std::move(k));
  }

  void take_subcircuit(const Card& card, const Scope& scope) {
    if (++depth_ > 50) refuse(card, "subcircuits contain each other without end", "remove a call");
    std::vector<std::string> words;
    for (std::size_t i = 1; i < card.words.size() && card.words[i] != "params:"; ++i) words.push_back(card.words[i]);
    const std::string name = written_name(card);
    if (words.empty()) refuse(card, name + " names no subcircuit", "write X1 nodes NAME");
    const std::string called = words.back();
    words.pop_back();
    const Subcircuit* s = nullptr;
    for (const Scope* level = &scope; level && !s; level = level->outer)
      if (const auto found = level->subcircuits->find(called); found != level->subcircuits->end()) s = &found->second;
    if (const auto found = library_level().subcircuits.find(called); !s && found != library_level().subcircuits.end())
      s = &found->second;
    if (!s) refuse(card, fmt::format("{}: there is no subcircuit '{}'", name, called), "add its .subckt");
    if (s->nodes.size() != words.size())
      refuse(card,
             fmt::format("{}: subcircuit '{}' has {} nodes, found {}", name, called, s->nodes.size(), words.size()),
             "give as many nodes");
    Scope inner;
    inner.outer = &scope;
    inner.prefix = scope.prefix + name + ".";
    inner.parameters = Parameters(&scope.parameters);
    inner.subcircuits = &s->inner;
    for (std::size_t i = 0; i < words.size(); ++i) inner.ports[s->nodes[i]] = node(words[i], scope, card);
    for (const auto& [parameter, value] : s->defaults) inner.parameters.define(parameter, value, s->card.place);
    define(s->cards, inner);
    for (const auto& [parameter, value] : card.given)  // as the caller means them
      inner.parameters.set(parameter, scope.parameters.value(value, card.place, name + ": " + parameter));
    for (const Card& one : s->cards) take(one, inner);
    --depth_;
  }

  std::string node(const std::string& word, const Scope& scope, const Card& card) {
    if (word == "0" || word == "gnd") return "0";
    if (const auto port = scope.ports.find(word); port != scope.ports.end()) return port->second;
    const std::string name = lower(scope.prefix) + word;
    const std::string text = lower(card.text) + " ";
    std::size_t at = text.find(" " + word + " ");
    if (at != std::string::npos) ++at;
    const std::string as_written = at == std::string::npos ? word : card.text.substr(at, word.size());
    netlist_.written.emplace(name, scope.prefix + as_written);
    return name;
  }

  static std::string written_name(const Card& card) { return card.text.substr(0, card.text.find_first_of(" \t")); }

  void note(const std::string& line) {
    if (std::find(netlist_.notes.begin(), netlist_.notes.end(), line) == netlist_.notes.end())
      netlist_.notes.push_back(line);
  }

  Netlist& netlist_;
  std::map<std::string, double> settings_;
  std::set<std::string> names_, used_skipped_, unread_;
  std::set<std::string> only_stepped_;  ///< parameters that no .param defines
  std::vector<std::string> model_notes_;
  int depth_ = 0;
};

}  // namespace

Netlist read_netlist(std::string_view text, const std::string& file_name, const std::filesystem::path& folder,
                     const std::map<std::string, double>& settings, std::optional<double> period) {
  const Deck deck = read_cards(text, file_name, folder);
  Netlist netlist;
  netlist.title = deck.title;
  netlist.inputs = deck.inputs;
  netlist.periodic = period.has_value();
  const Level level = sort_cards(deck.cards);
  Flattening(netlist, settings, deck.control).top(level);
  if (netlist.elements.empty()) throw Error(file_name, "there is no element", "add elements behind the title line");
  const bool responses_alone = !(netlist.stop > 0) && !netlist.frequencies.empty();
  if (period || responses_alone) close_period(netlist, period.value_or(0), file_name);
  if (!(netlist.stop > 0)) throw Error(file_name, "there is no .tran", "add .tran STEP STOP");
  return netlist;
}

}  // namespace bromwich::circuits
