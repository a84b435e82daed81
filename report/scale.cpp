#include "report/scale.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

namespace bromwich::report {

namespace {

constexpr double largest_label = 1e5, smallest_label = 1e-3;  ///< beyond, numbers have a power of ten

/// 1, 2 or 5 times a power of ten, for about `count` parts of `length`.
double tick_step(double length, int count) {
  const double raw = length / count, power = std::pow(10, std::floor(std::log10(raw)));
  for (const double factor : {1., 2., 5.})
    if (raw <= factor * power * 1.4) return factor * power;  // the nearest in ratio
  return 10 * power;
}

/// From 1, 2 or 5 times a power of ten to another one; whole decades where there are many.
Range round_range(double lo, double hi) {
  const auto power = [](double exponent) { return std::pow(10, exponent); };
  Range range{power(std::floor(std::log10(lo) + 1e-9)), power(std::ceil(std::log10(hi) - 1e-9))};
  if (hi < 100 * lo)
    for (const double factor : {2., 5.}) {
      const double below = factor * power(std::floor(std::log10(lo) + 1e-9));
      const double above = power(std::ceil(std::log10(hi) - 1e-9)) / factor;
      if (below <= lo * (1 + 1e-9)) range.lo = below;
      if (above >= hi * (1 - 1e-9)) range.hi = above;
    }
  if (range.hi <= range.lo) range.hi = 10 * range.lo;
  return range;
}

}  // namespace

std::string escaped(const std::string& text) {
  std::string safe;
  for (const char c : text) switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      default:
        // Other control characters have no place in XML.
        safe += static_cast<unsigned char>(c) < ' ' && c != '\n' && c != '\t' ? ' ' : c;
    }
  return safe;
}

std::string short_number(double value, int digits) {
  if (!std::isfinite(value)) return std::isnan(value) ? "–" : value > 0 ? "∞" : "−∞";
  std::string text = fmt::format("{:.{}g}", value, digits);
  const double size = std::abs(value);
  if (size >= largest_label || (size > 0 && size < smallest_label)) text = fmt::format("{:.{}e}", value, digits - 1);
  const std::size_t e = text.find('e');
  if (e != std::string::npos) {
    std::string mantissa = text.substr(0, e);
    if (mantissa.find('.') != std::string::npos) {
      mantissa.erase(mantissa.find_last_not_of('0') + 1);
      if (mantissa.back() == '.') mantissa.pop_back();
    }
    text = fmt::format("{}e{}", mantissa, std::stoi(text.substr(e + 1)));
  }
  std::string signs;
  for (const char c : text) signs += c == '-' ? std::string("−") : std::string(1, c);
  return signs;
}

ScaledUnit with_prefix(const std::string& unit, double largest) {
  constexpr std::array<std::string_view, 21> taking{"s", "V", "A", "W",  "m",  "g",   "Hz",  "F",   "H", "N",  "J",
                                                    "C", "K", "T", "Pa", "Wb", "mol", "rad", "ohm", "Ω", "bar"};
  constexpr std::array<const char*, 10> prefixes{"f", "p", "n", "µ", "m", "", "k", "M", "G", "T"};
  constexpr int of_none = 5;
  constexpr double least = 0.1, most = 1e4;  // read without a prefix
  const bool plain = !std::isfinite(largest) || largest == 0 || (largest >= least && largest < most);
  if (plain || std::find(taking.begin(), taking.end(), unit) == taking.end()) return {unit, 1};
  const int thousands = int(std::floor(std::log10(largest) / 3));
  if (thousands < -of_none || thousands + of_none >= int(prefixes.size())) return {unit, 1};
  return {prefixes[std::size_t(thousands + of_none)] + unit, std::pow(10, 3 * thousands)};
}

Scale::Scale(double lo, double hi, double from, double to, bool logarithmic)
    : lo_(lo),
      hi_(hi > lo       ? hi
          : logarithmic ? 10 * lo
                        : lo + 1),
      from_(from),
      to_(to),
      logarithmic_(logarithmic) {}

double Scale::operator()(double value) const {
  const double part = logarithmic_ ? std::log(value / lo_) / std::log(hi_ / lo_) : (value - lo_) / (hi_ - lo_);
  return from_ + part * (to_ - from_);
}

std::vector<Tick> Scale::ticks(int count) const {
  if (logarithmic_) return decades(count);
  const double step = tick_step(hi_ - lo_, count);
  std::vector<Tick> ticks;
  for (double k = std::ceil(lo_ / step - 1e-9); k * step <= hi_ + 1e-9 * step; ++k)
    ticks.push_back({k * step + 0.0, short_number(k * step + 0.0)});  // + 0: no negative zero
  return ticks;
}

std::vector<Tick> Scale::decades(int count) const {
  const int first = int(std::floor(std::log10(lo_) + 1e-9)), last = int(std::ceil(std::log10(hi_) - 1e-9));
  const int stride = std::max(1, int(std::ceil(double(last - first) / count)));
  std::vector<Tick> ticks;
  for (int e = first; e <= last; ++e)
    for (const double factor : {1., 2., 5.}) {
      const double value = factor * std::pow(10, e);
      if (value < lo_ * (1 - 1e-9) || value > hi_ * (1 + 1e-9)) continue;
      if (factor > 1 && last - first > 2) continue;
      const bool labelled = (e - first) % stride == 0 || last - first <= 2;
      ticks.push_back({value, labelled ? short_number(value) : ""});
    }
  return ticks;
}

bool apart(double lo, double hi) { return hi - lo > 1e-12 * std::max(std::abs(lo), std::abs(hi)); }

Range range_of(const std::vector<double>& values, bool logarithmic) {
  double lo = INFINITY, hi = -INFINITY;
  for (const double v : values) {
    if (!std::isfinite(v) || (logarithmic && !(v > 0))) continue;
    lo = std::min(lo, v);
    hi = std::max(hi, v);
  }
  if (!(lo <= hi)) return logarithmic ? Range{1e-1, 1} : Range{0, 1};
  if (logarithmic) return round_range(lo, hi);
  if (!apart(lo, hi)) {
    const double pad = lo == 0 ? 1 : 0.1 * std::abs(lo);
    return {lo == 0 ? 0 : lo - pad, hi + pad};
  }
  const double pad = 0.04 * (hi - lo);
  const double rounding = 1e-9 * (hi - lo);
  const bool from_zero = lo >= -rounding && lo < 0.5 * hi, to_zero = hi <= rounding && hi > 0.5 * lo;
  return {from_zero ? 0 : lo - pad, to_zero ? 0 : hi + pad};
}

}  // namespace bromwich::report
