#pragma once
// The time axis of a certificate: the steps of a result divided into parts whose lengths are those of a dyadic tree,
// d 2^-k, so that they share exponentials and factors. No part holds a breakpoint of a source, and behind each of them
// parts begin short and double.

#include "../scene/source_steps.hpp"

#include <array>
#include <map>
#include <vector>

namespace bromwich {

inline constexpr double shortest_part = 0x1p-16;  ///< of the longest one: breakpoints are moved to multiples

inline constexpr std::array<double, 2> part_nodes{1.0 / 3, 1};  ///< of a part: those of Radau IIA

struct Part {
  Index step = 0;             ///< of the result, from row step - 1 to row step
  double begin = 0, end = 0;  ///< within the step, 0 .. 1
  double length = 0;          ///< in time
  double from = 0, to = 0;    ///< where sources are looked at; both ends lie on one side of every breakpoint
};

std::array<Part, 2> halves(const Part&);

/// The parts of step after step. `t`: rows of the result with equal steps; `breakpoints`: increasing; each step has
/// `division` parts or more. `marks`: more times at which a part ends.
class StepParts {
 public:
  StepParts(const Vector& t, const std::vector<double>& breakpoints, Index division,
            const std::vector<double>& marks = {});

  /// Whether the next step has `division` equal parts: no breakpoint at its begin, and none or a mark inside.
  bool next_is_plain() const;
  /// Passes over the next step, and appends its parts where they are wanted.
  void pass(std::vector<Part>* wanted = nullptr);

 private:
  const Vector& t_;
  Index division_, j_ = 1;
  double near_, length_;
  std::map<double, bool> ends_;  ///< whether a layer begins there
  std::map<double, bool>::const_iterator next_;
  bool jumped_ = true;  ///< t = 0: x0 may be off the constraints
};

/// The parts of all steps, increasing in time.
std::vector<Part> divide(const Vector& t, const std::vector<double>& breakpoints, Index division,
                         const std::vector<double>& marks = {});

}  // namespace bromwich
