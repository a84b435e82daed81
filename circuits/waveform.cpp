#include "circuits/waveform.hpp"

#include "core/base/error.hpp"
#include "files/slope.hpp"
#include "files/switch_times.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich::circuits {

namespace {

constexpr double pi = std::numbers::pi;

// Points of a piecewise linear function; two of equal time are a jump.
struct Points {
  std::vector<double> t, v;

  double value(double at) const {
    const auto next = std::upper_bound(t.begin(), t.end(), at);
    if (next == t.begin()) return v.front();
    if (next == t.end()) return v.back();
    const std::size_t k = std::size_t(next - t.begin());
    return v[k - 1] + (v[k] - v[k - 1]) * (at - t[k - 1]) / (t[k] - t[k - 1]);
  }
  double slope(double at) const {
    const auto next = std::upper_bound(t.begin(), t.end(), at);
    if (next == t.begin() || next == t.end()) return 0;
    const std::size_t k = std::size_t(next - t.begin());
    return (v[k] - v[k - 1]) / (t[k] - t[k - 1]);
  }
};

Waveform from_points(Points points) {
  Waveform w;
  w.linear = true;
  w.breakpoints = [times = points.t](double T) {
    std::vector<double> all;
    for (const double t : times)
      if (t > 0 && t < T && (all.empty() || t > all.back())) all.push_back(t);
    return all;
  };
  w.slope = [points](double t) { return points.slope(t); };
  w.value = [points = std::move(points)](double t) { return points.value(t); };
  return w;
}

// PULSE(v1 v2 delay rise fall width period [cycles])
Waveform pulse(const std::vector<double>& a, double stop, const Place& place, bool settled) {
  const auto at = [&a](std::size_t i, double otherwise) { return i < a.size() ? a[i] : otherwise; };
  const double v1 = at(0, 0), v2 = at(1, 0), delay = at(2, 0), rise = at(3, 0), fall = at(4, 0);
  const double width = at(5, stop > 0 ? stop : INFINITY), period = at(6, INFINITY), cycles = at(7, INFINITY);
  if (rise < 0 || fall < 0 || width < 0 || !(period > 0))
    throw Error(to_string(place), "PULSE has a negative time", "give times of 0 or more, and a positive period");
  // A period as long as its edges and more: what is left of an edge is cut off.
  Points one{{0, rise, rise + width, rise + width + fall}, {v1, v2, v2, v1}};
  Waveform w;
  w.linear = true;
  const bool always = settled && std::isfinite(period) && !(cycles > 0 && std::isfinite(cycles));
  const double last = cycles > 0 ? cycles : INFINITY;
  // Whether t is in a pulse, and where in it. Times within rounding of the begin of a period belong to it.
  const auto place_in = [=](double t, double& inside) {
    inside = t - delay;
    if (inside < 0 && !always) return false;
    if (!std::isfinite(period)) return true;
    double k = std::floor(inside / period);
    if (inside - (k + 1) * period >= 0) ++k;
    if (inside - k * period < 0) --k;
    if (k >= last) return false;
    inside -= k * period;
    return true;
  };
  w.value = [=](double t) {
    double inside = 0;
    return place_in(t, inside) ? one.value(inside) : v1;
  };
  w.slope = [=](double t) {
    double inside = 0;
    return place_in(t, inside) ? one.slope(inside) : 0.0;
  };
  w.period = std::isfinite(period) && !(cycles > 0 && std::isfinite(cycles)) ? period : 0;
  w.breakpoints = [=](double T) {
    constexpr double most_periods = 1e7;
    if (std::min(last, (T - delay) / period) > most_periods)
      throw Error(to_string(place),
                  fmt::format("PULSE has {:.3g} periods up to the end of .tran", (T - delay) / period),
                  "shorten .tran");
    std::vector<double> all;
    for (double k = always ? -std::ceil(std::max(delay, 0.0) / period) - 1 : 0; k < last; ++k) {
      const double start = std::isfinite(period) ? delay + k * period : delay;
      if (!(start < T)) break;
      for (const double edge : one.t)
        if (const double t = start + edge; edge <= period && t > 0 && t < T && (all.empty() || t > all.back()))
          all.push_back(t);
      if (!std::isfinite(period)) break;
    }
    return all;
  };
  return w;
}

// SIN(offset amplitude frequency [delay [damping [degrees]]])
Waveform sine(const std::vector<double>& a, bool settled) {
  const auto at = [&a](std::size_t i) { return i < a.size() ? a[i] : 0.0; };
  const double offset = at(0), amplitude = at(1), omega = 2 * pi * at(2), delay = at(3), damping = at(4), phase = at(5);
  const bool always = settled && damping == 0;
  Waveform w;
  w.constant = amplitude == 0 || (omega == 0 && damping == 0);
  w.value = [=](double t) {
    const double s = always ? t - delay : std::max(0.0, t - delay);
    return offset + amplitude * (damping == 0 ? 1 : std::exp(-s * damping)) * sine_of(omega * s, phase);
  };
  w.slope = [=](double t) {
    const double s = t - delay;
    if (s < 0 && !always) return 0.0;
    return amplitude * std::exp(-s * damping) *
           (omega * sine_of(omega * s, phase + 90) - damping * sine_of(omega * s, phase));
  };
  w.breakpoints = [delay, always](double T) {
    return !always && delay > 0 && delay < T ? std::vector<double>{delay} : std::vector<double>{};
  };
  w.period = damping == 0 && at(2) > 0 ? 1 / at(2) : 0;
  return w;
}

// EXP(v1 v2 delay1 tau1 delay2 tau2)
Waveform exponential(const std::vector<double>& a, const Place& place) {
  if (a.size() < 6 || !(a[3] > 0) || !(a[5] > 0))
    throw Error(to_string(place), "EXP needs six numbers with positive time constants",
                "write EXP(v1 v2 td1 tau1 td2 tau2)");
  const double v1 = a[0], step = a[1] - a[0], d1 = a[2], tau1 = a[3], d2 = a[4], tau2 = a[5];
  Waveform w;
  w.value = [=](double t) {
    double v = v1;
    if (t > d1) v -= step * std::expm1(-(t - d1) / tau1);
    if (t > d2) v += step * std::expm1(-(t - d2) / tau2);
    return v;
  };
  w.slope = [=](double t) {
    double v = 0;
    if (t >= d1) v += step / tau1 * std::exp(-(t - d1) / tau1);
    if (t >= d2) v -= step / tau2 * std::exp(-(t - d2) / tau2);
    return v;
  };
  w.breakpoints = [=](double T) {
    std::vector<double> all;
    for (const double t : {std::min(d1, d2), std::max(d1, d2)})
      if (t > 0 && t < T && (all.empty() || t > all.back())) all.push_back(t);
    return all;
  };
  return w;
}

// SFFM(offset amplitude carrier index signal)
Waveform modulated(const std::vector<double>& a) {
  const auto at = [&a](std::size_t i) { return i < a.size() ? a[i] : 0.0; };
  const double offset = at(0), amplitude = at(1), carrier = 2 * pi * at(2), index = at(3), signal = 2 * pi * at(4);
  Waveform w;
  w.value = [=](double t) { return offset + amplitude * std::sin(carrier * t + index * std::sin(signal * t)); };
  w.slope = [=](double t) {
    return amplitude * std::cos(carrier * t + index * std::sin(signal * t)) *
           (carrier + index * signal * std::cos(signal * t));
  };
  w.breakpoints = [](double) { return std::vector<double>{}; };
  if (signal == 0)
    w.period = carrier > 0 ? 2 * pi / carrier : 0;
  else if (carrier > 0)
    w.period = common_period({2 * pi / carrier, 2 * pi / signal});
  return w;
}

Points points_of(const std::vector<double>& a, const Place& place) {
  Points p;
  if (a.empty() || a.size() % 2 != 0)
    throw Error(to_string(place), "PWL has no pairs of time and value", "write PWL(t0 v0 t1 v1 ...)");
  for (std::size_t i = 0; i < a.size(); i += 2) {
    if (!p.t.empty() && a[i] < p.t.back())
      throw Error(to_string(place), fmt::format("PWL: {} follows {}", a[i], p.t.back()), "give increasing times");
    p.t.push_back(a[i]);
    p.v.push_back(a[i + 1]);
  }
  return p;
}

}  // namespace

Waveform constant_waveform(double value) {
  Waveform w;
  w.value = [value](double) { return value; };
  w.slope = [](double) { return 0.0; };
  w.breakpoints = [](double) { return std::vector<double>{}; };
  w.linear = w.constant = true;
  return w;
}

double sine_of(double angle, double phase) {
  const double quarters = std::round(phase / 90), rest = (phase - 90 * quarters) * pi / 180;
  switch (int(quarters - 4 * std::floor(quarters / 4))) {
    case 0:
      return std::sin(angle + rest);
    case 1:
      return std::cos(angle + rest);
    case 2:
      return -std::sin(angle + rest);
    default:
      return -std::cos(angle + rest);
  }
}

double common_period(const std::vector<double>& periods) {
  constexpr double most = 1e4, rounding = 1e-9;
  if (periods.empty()) return 0;
  const double longest = *std::max_element(periods.begin(), periods.end());
  for (double k = 1; k <= most; ++k) {
    const double T = k * longest;
    if (std::all_of(periods.begin(), periods.end(),
                    [&](double p) { return std::abs(T / p - std::round(T / p)) <= rounding * T / p; }))
      return T;
  }
  return 0;
}

Waveform waveform_of_time(const std::string& expression, const Place& place) {
  constexpr long most_work = 20'000'000;  // evaluations in a search for jumps
  const Formula by_time = read_formula(expression, {}, to_string(place), {{"time", 0}});
  Formula in_time = by_time;
  for (Instruction& step : in_time.program)
    if (step.operation == Operation::variable) step.operation = Operation::time;
  Waveform w;
  w.value = [in_time](double t) { return in_time(t); };
  w.slope = [by_time](double t) {
    const std::vector<double> at{t};
    Slopes slopes{t, at, 0};
    std::vector<Slope> stack;
    return execute(by_time, slopes, stack)->slope;
  };
  w.breakpoints = [in_time, place](double T) {
    long work = most_work;
    SwitchTimes found = switch_times(in_time, T, work);
    if (!found.complete)
      throw Error(to_string(place), "has more jumps and kinks than can be found in the time of .tran",
                  "end it earlier");
    std::erase_if(found.times, [T](double t) { return !(t > 0) || !(t < T); });
    return found.times;
  };
  return w;
}

Waveform read_waveform(const std::vector<std::string>& words, const Parameters& parameters, const Place& place,
                       double stop, bool settled) {
  std::string all;
  for (const std::string& word : words) all += word + " ";
  std::vector<std::string> list = split_arguments(all);
  double dc = 0;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const std::string& word = list[i];
    if (word == "dc" && i + 1 < list.size()) {
      dc = parameters.value(list[++i], place, "DC");
      continue;
    }
    if (word == "ac") {  // magnitude and phase of a small-signal analysis
      while (i + 1 < list.size() && is_number(list[i + 1])) ++i;
      continue;
    }
    const std::vector<std::string> rest(list.begin() + long(i) + 1, list.end());
    const auto numbers = [&] {
      std::vector<double> values;
      for (const std::string& one : rest) {
        if (one == "ac" || one == "dc") break;
        values.push_back(parameters.value(one, place, word));
      }
      return values;
    };
    if (word == "pulse") return pulse(numbers(), stop, place, settled);
    if (word == "sin" || word == "sine") return sine(numbers(), settled);
    if (word == "pwl") return from_points(points_of(numbers(), place));
    if (word == "exp") return exponential(numbers(), place);
    if (word == "sffm") return modulated(numbers());
    dc = parameters.value(word, place, "value");
  }
  return constant_waveform(dc);
}

}  // namespace bromwich::circuits
