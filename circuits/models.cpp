#include "circuits/models.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>

namespace bromwich::circuits {

namespace {

class Values {
 public:
  Values(const Model& model, const Parameters& parameters) : model_(model), parameters_(parameters) {}

  bool has(const char* name) const { return model_.given.contains(name); }
  double operator()(const char* name, double otherwise) const {
    const auto found = model_.given.find(name);
    return found == model_.given.end() ? otherwise : parameters_.value(found->second, model_.card.place, name);
  }
  double resistance(const char* name, double otherwise) const {
    const double r = (*this)(name, otherwise);
    if (!(r >= 0)) throw Error(to_string(model_.card.place), fmt::format("{} = {}", name, r), "give 0 or more ohm");
    return r;
  }

 private:
  const Model& model_;
  const Parameters& parameters_;
};

}  // namespace

Model read_model(const Card& card) {
  if (card.words.size() < 3)
    throw Error(to_string(card.place), ".model without a name or a type", "write .model NAME D(Ron=10m Vfwd=0.5)");
  Model model{card, {}, card.given};
  std::string rest = card.words[2];
  for (std::size_t i = 3; i < card.words.size(); ++i) rest += " " + card.words[i];
  const std::size_t open = rest.find('(');
  model.type = rest.substr(0, std::min(open, rest.find(' ')));
  if (open == std::string::npos) return model;
  // name = value, with any blanks around '='
  std::string inner;
  for (std::size_t i = open; i < rest.size(); ++i) {
    if (rest[i] == ' ' && (inner.empty() || inner.back() == '=' || rest.find_first_not_of(' ', i) == rest.find('=', i)))
      continue;
    inner += rest[i];
  }
  for (const std::string& word : split_arguments(inner)) {
    const std::size_t equals = word.find('=');
    if (equals != std::string::npos) model.given[word.substr(0, equals)] = word.substr(equals + 1);
  }
  return model;
}

DiodeModel diode_model(const Model& model, const Parameters& parameters) {
  const Values value(model, parameters);
  DiodeModel d;
  const bool straight = value.has("ron") || value.has("roff") || value.has("vfwd");
  if (straight) {
    d.on = value.resistance("ron", 1);
    d.off = value.has("roff") ? value.resistance("roff", INFINITY) : INFINITY;
    d.forward = value("vfwd", 0);
    d.reverse = value("vrev", INFINITY);
    d.on_reverse = value.resistance("rrev", d.on);
  } else {
    constexpr double thermal = 25.85e-3;  // volts, at 27 degrees
    const double saturation = value("is", 1e-14), ideality = value("n", 1);
    if (!(saturation > 0) || !(ideality > 0))
      throw Error(to_string(model.card.place), "Is and N are not positive", "give positive numbers");
    d.forward = ideality * thermal * std::log(1 / saturation + 1);
    d.on = value.resistance("rs", 0);
    d.reverse = value("bv", INFINITY);
    d.on_reverse = d.on;
    d.straightened = fmt::format("model {}: a junction, taken as a straight line of {:.4g} V and {:.4g} ohm",
                                 model.card.words[1], d.forward, d.on);
    std::string others;
    for (const auto& [name, given] : model.given)
      if (name != "is" && name != "n" && name != "rs" && name != "bv") others += (others.empty() ? "" : " ") + name;
    if (!others.empty()) d.straightened += ", without " + others;
  }
  if (!(d.off > d.on)) throw Error(to_string(model.card.place), "Roff is not above Ron", "give a larger Roff");
  if (!(d.reverse > 0)) throw Error(to_string(model.card.place), "Vrev is not positive", "give a positive Vrev");
  return d;
}

std::pair<DiodeModel, ThyristorModel> thyristor_model(const Model& model, const Parameters& parameters) {
  constexpr double largest_off = 1e7;  // ohm
  const Values value(model, parameters);
  DiodeModel d;
  d.on = value.resistance("ron", 1e-3);
  d.off = value.resistance("roff", 1e6);
  d.forward = value("vfwd", 0);
  ThyristorModel t;
  const auto positive = [&](const char* name, double otherwise) {
    const double v = value(name, otherwise);
    if (!(v > 0)) throw Error(to_string(model.card.place), fmt::format("{} = {}", name, v), "give a positive value");
    return v;
  };
  t.gate = positive("vgt", t.gate);
  t.holding = positive("ih", t.holding);
  t.blocks = positive("vdrm", t.blocks);
  if (!(d.off > d.on && d.off <= largest_off))
    throw Error(to_string(model.card.place), fmt::format("Roff = {} of a thyristor", d.off),
                "give one above Ron, up to 10 megohm: it carries what the holding current leaves");
  return {d, t};
}

SwitchModel switch_model(const Model& model, const Parameters& parameters, std::vector<std::string>& notes) {
  const Values value(model, parameters);
  SwitchModel s;
  s.on = value.resistance("ron", 1);
  s.off = value.has("roff") ? value.resistance("roff", INFINITY) : INFINITY;
  if (value.has("von") || value.has("voff")) {  // PSpice
    const double on = value("von", 1), off = value("voff", 0);
    s.threshold = (on + off) / 2;
    s.hysteresis = (on - off) / 2;
  } else {
    s.threshold = value.has("it") ? value("it", 0) : value("vt", 0);
    s.hysteresis = value.has("ih") ? value("ih", 0) : value("vh", 0);
  }
  if (s.hysteresis < 0) {
    s.hysteresis = -s.hysteresis;
    notes.push_back(fmt::format("model {}: Vh < 0 (smoothing) is taken as a hysteresis of {:.4g}", model.card.words[1],
                                s.hysteresis));
  }
  if (!(s.off > s.on)) throw Error(to_string(model.card.place), "Roff is not above Ron", "give a larger Roff");
  return s;
}

}  // namespace bromwich::circuits
