#pragma once
// A solution in pieces: what measures of contacts are integrals over.

#include "mechanism.hpp"

#include <vector>

namespace bromwich {

/// A span of time in which no contact changes.
struct ContactSpan {
  struct Sample {
    double t, weight;  ///< of a quadrature on the span
    Vector x, y;       ///< m and n
  };
  struct Jump {
    Vector before, after, p;  ///< x on both sides, and the impulse of y
    bool impact = true;       ///< false: too small to be seen as one
  };
  double begin = 0, end = 0;
  std::vector<Sample> samples;
  std::vector<Jump> jumps;   ///< at the begin, in their order
  std::vector<char> active;  ///< n: w_i = 0
};

struct ContactSpans {
  bool located = false;
  Vector first, last;  ///< x at both ends
  std::vector<ContactSpan> spans;
};

/// Between located switches where the method locates them, by one more integration; otherwise one span for each step,
/// with the means of x and y there.
ContactSpans contact_spans(const Mechanism&, const Result&);

}  // namespace bromwich
