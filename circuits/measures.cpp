#include "circuits/measures.hpp"

#include "circuits/cards.hpp"
#include "circuits/values.hpp"
#include "core/base/error.hpp"
#include "files/scene_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

namespace bromwich {

namespace {

using circuits::lower;

enum class Kind { average, rms, least, largest, peak, integral, find, when, between, parameter };

struct Event {
  std::optional<Probe> passes;  ///< 0
  std::string text;             ///< "V(out) = 5"
  int rising = 0;
  long count = 1;  ///< from 1; 0: the last
  double after = 0;
  std::optional<double> at;
};

struct Measure {
  std::string name, where;
  Kind kind = Kind::average;
  std::optional<Probe> probe;
  std::string expression;  ///< of a parameter
  std::optional<double> from, to, at;
  Event event, target;
};

const std::map<std::string, Kind> kinds{{"avg", Kind::average},    {"rms", Kind::rms},   {"min", Kind::least},
                                        {"max", Kind::largest},    {"pp", Kind::peak},   {"integ", Kind::integral},
                                        {"find", Kind::find},      {"when", Kind::when}, {"trig", Kind::between},
                                        {"param", Kind::parameter}};
const std::set<std::string> keys{"from", "to", "at", "when", "rise", "fall", "cross", "td", "targ", "trig", "val"};

// Words at blanks outside of parentheses, braces and quotes; '=' is one of its own. "==", "<=" and ">=" are not split.
std::vector<std::string> words_of(const std::string& text) {
  std::vector<std::string> words;
  std::string word;
  int depth = 0;
  bool quoted = false;
  const auto end = [&] {
    if (!word.empty()) words.push_back(word);
    word.clear();
  };
  for (const char c : text) {
    if (c == '\'' || c == '"') quoted = !quoted;
    depth += int(c == '(' || c == '{') - int(c == ')' || c == '}');
    const bool inner = depth > 0 || quoted;
    if (!inner && (c == ' ' || c == '\t')) {
      end();
    } else if (!inner && c == '=') {
      end();
      words.emplace_back("=");
    } else {
      word += c;
    }
  }
  end();
  return words;
}

class MeasureReader {
 public:
  MeasureReader(const Circuit& circuit, const MeasureCard& card) : circuit_(circuit), where_(card.where) {
    words_ = words_of(card.text);
  }

  Measure read() {
    Measure m;
    m.where = where_;
    ++at_;  // .meas
    if (is("tran")) ++at_;
    if (is("ac") || is("dc") || is("op") || is("noise")) refuse(fmt::format("{} is not an analysis here", words_[at_]));
    m.name = next();
    const std::string kind = lower(next());
    const auto known = kinds.find(kind);
    if (known == kinds.end()) refuse(fmt::format("{}: '{}' is unknown", m.name, kind));
    m.kind = known->second;
    switch (m.kind) {
      case Kind::parameter:
        skip_equals();
        m.expression = circuits::without_braces(rest());
        return m;
      case Kind::when:
        m.event = event();
        break;
      case Kind::between:
        m.event = event();
        if (!is("targ")) refuse(m.name + ": TRIG without TARG");
        ++at_;
        m.target = event();
        break;
      default:
        m.probe.emplace(circuit_, expression(), where_);
        if (m.kind == Kind::find && is("when")) {
          ++at_;
          m.event = event();
        }
    }
    while (at_ < words_.size()) {
      const std::string key = lower(next());
      auto& value = key == "from" ? m.from : key == "to" ? m.to : m.at;
      if (key != "from" && key != "to" && key != "at") refuse(fmt::format("{}: '{}' is not understood", m.name, key));
      value = number();
    }
    if (m.kind == Kind::find && !m.at && !m.event.passes) refuse(m.name + ": FIND without AT or WHEN");
    return m;
  }

 private:
  [[noreturn]] void refuse(const std::string& found) const {
    throw Error(where_, ".meas " + found, "write .meas NAME AVG V(out) FROM=1m TO=2m, see docs/netlists.md");
  }
  bool is(const char* word) const { return at_ < words_.size() && lower(words_[at_]) == word; }
  std::string next() {
    if (at_ >= words_.size()) refuse("ends too early");
    return words_[at_++];
  }
  void skip_equals() {
    if (is("=")) ++at_;
  }
  double number() {
    skip_equals();
    const std::string word = lower(next());
    if (const auto plain = circuits::spice_number(word)) return *plain;
    return constant_expression(circuits::without_braces(word), circuit_.parameters, where_);
  }
  std::string rest() {
    std::string all;
    while (at_ < words_.size()) all += words_[at_++] + " ";
    if (all.empty()) refuse("ends too early");
    return all.substr(0, all.size() - 1);
  }
  // Words up to the next key or '='.
  std::string expression() {
    std::string all;
    while (at_ < words_.size() && words_[at_] != "=" && !keys.contains(lower(words_[at_])))
      all += (all.empty() ? "" : " ") + words_[at_++];
    if (all.empty()) refuse("ends too early");
    return circuits::without_braces(all);
  }
  Event event() {
    Event e;
    if (is("at")) {
      ++at_;
      e.at = number();
      return e;
    }
    const std::string left = expression();
    std::string right = "0";
    if (is("=")) {
      ++at_;
      right = expression();
    } else if (is("val")) {
      ++at_;
      skip_equals();
      right = expression();
    }
    if (const auto plain = circuits::spice_number(lower(right))) right = fmt::format("{:.17g}", *plain);
    e.text = left + " = " + right;
    e.passes.emplace(circuit_, fmt::format("({}) - ({})", left, right), where_);
    for (bool more = true; more;) {
      more = false;
      for (const auto& [key, direction] : {std::pair("rise", 1), {"fall", -1}, {"cross", 0}})
        if (is(key)) {
          ++at_, more = true;
          e.rising = direction;
          skip_equals();
          if (is("last"))
            e.count = 0, ++at_;
          else
            e.count = long(number());
          if (e.count < 0 || (e.count == 0 && lower(words_[at_ - 1]) != "last")) refuse("counts from 1");
        }
      if (is("td")) {
        ++at_, more = true;
        e.after = number();
      }
    }
    return e;
  }

  const Circuit& circuit_;
  std::string where_;
  std::vector<std::string> words_;
  std::size_t at_ = 0;
};

std::string unit_of(const Measure& m) {
  if (m.kind == Kind::when || m.kind == Kind::between) return "s";
  if (!m.probe) return "";
  const std::string& u = m.probe->unit();
  if (m.kind != Kind::integral) return u;
  return u == "W" ? "J" : u == "A" ? "C" : u == "V" ? "Wb" : "";
}

class Evaluation {
 public:
  Evaluation(const Circuit& circuit, Backend& backend, const Result& result)
      : circuit_(circuit), backend_(backend), result_(result), known_(circuit.parameters) {}

  MeasuredValue operator()(const Measure& m) {
    MeasuredValue v{m.name, unit_of(m), NAN, ""};
    try {
      v.value = value(m, v.found);
    } catch (const Error& error) {
      if (m.kind == Kind::parameter) throw;
      v.found = error.found();
    }
    if (std::isfinite(v.value)) known_[lower(m.name)] = v.value;
    return v;
  }

 private:
  const CircuitWaveforms& span(const std::optional<double>& from, const std::optional<double>& to,
                               const std::string& where) {
    const std::pair<double, double> key{from.value_or(0), to.value_or(circuit_.scene.T)};
    auto& kept = spans_[key];
    if (!kept) kept = std::make_unique<CircuitWaveforms>(circuit_, backend_, result_, key.first, key.second, where);
    return *kept;
  }

  // NaN where it does not happen.
  double time_of(const Event& e, const Measure& m, std::string& found) {
    if (e.at) return *e.at;
    std::vector<double> times = span(m.from, m.to, m.where).crossings(*e.passes, e.rising);
    std::erase_if(times, [&](double t) { return t < e.after; });
    if (times.empty() || long(times.size()) < e.count) {
      found = fmt::format("{} is passed {} times", e.text, times.size());
      return NAN;
    }
    return e.count == 0 ? times.back() : times[std::size_t(e.count - 1)];
  }

  double value(const Measure& m, std::string& found) {
    const auto over = [&]() -> const CircuitWaveforms& { return span(m.from, m.to, m.where); };
    switch (m.kind) {
      case Kind::average:
        return over().mean(*m.probe);
      case Kind::rms:
        return over().rms(*m.probe);
      case Kind::least:
        return over().min(*m.probe);
      case Kind::largest:
        return over().max(*m.probe);
      case Kind::peak:
        return over().peak_to_peak(*m.probe);
      case Kind::integral:
        return over().integral(*m.probe);
      case Kind::find: {
        const double t = m.at ? *m.at : time_of(m.event, m, found);
        if (!(t >= 0 && t <= circuit_.scene.T * (1 + 1e-12))) {
          if (found.empty()) found = fmt::format("the time {:.6g} is outside of .tran", t);
          return NAN;
        }
        return over().values(*m.probe, {std::min(t, circuit_.scene.T)})[0];
      }
      case Kind::when:
        return time_of(m.event, m, found);
      case Kind::between: {
        const double begin = time_of(m.event, m, found);
        return std::isnan(begin) ? NAN : time_of(m.target, m, found) - begin;
      }
      case Kind::parameter:
        break;
    }
    return constant_expression(lower(m.expression), known_, m.where);
  }

  const Circuit& circuit_;
  Backend& backend_;
  const Result& result_;
  std::map<std::string, double> known_;
  std::map<std::pair<double, double>, std::unique_ptr<CircuitWaveforms>> spans_;
};

std::vector<Measure> read_all(const Circuit& c) {
  std::vector<Measure> all;
  for (const MeasureCard& card : c.measures) all.push_back(MeasureReader(c, card).read());
  return all;
}

}  // namespace

void check_measures(const Circuit& c) { read_all(c); }

std::vector<MeasuredValue> measures_of(const Circuit& c) {
  std::vector<MeasuredValue> all;
  for (const Measure& m : read_all(c)) all.push_back({m.name, unit_of(m), NAN, ""});
  return all;
}

std::vector<MeasuredValue> measured(const Circuit& c, Backend& backend, const Result& r) {
  Evaluation evaluate(c, backend, r);
  std::vector<MeasuredValue> all;
  for (const Measure& m : read_all(c)) all.push_back(evaluate(m));
  return all;
}

}  // namespace bromwich
