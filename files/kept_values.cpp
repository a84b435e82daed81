#include "files/kept_values.hpp"

#include "files/names.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>

namespace bromwich {

namespace {

/// 0 and -0 have different reciprocals.
bool same_number(double a, double b) { return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b); }

}  // namespace

bool KeptValues::still_true(const Used& used) const {
  return std::all_of(used.begin(), used.end(), [this](const auto& one) {
    if (const double* value = std::get_if<double>(&one.second)) {
      const auto found = now_.parameters.find(one.first);
      return found != now_.parameters.end() && same_number(found->second, *value);
    }
    const auto found = now_.definitions.find(one.first);
    return found != now_.definitions.end() && found->second == std::get<std::string>(one.second);
  });
}

void KeptValues::use(const std::string& name) {
  if (open_.empty()) return;
  if (const auto parameter = now_.parameters.find(name); parameter != now_.parameters.end())
    return note(name, parameter->second);
  const std::string& text = now_.definitions.at(name);
  note(name, text);
  for (const Name& inside : names_in(text))
    if (const auto found = now_.parameters.find(inside.text); !inside.called && found != now_.parameters.end())
      note(inside.text, found->second);
}

void KeptValues::note(const std::string& name, const Meaning& meaning) {
  if (open_.empty()) return;
  Used& used = open_.back();
  if (std::none_of(used.begin(), used.end(), [&](const auto& one) { return one.first == name; }))
    used.emplace_back(name, meaning);
}

}  // namespace bromwich
