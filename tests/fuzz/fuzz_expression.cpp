// Expressions of t: as a function, its values at three times, and its switch times.

#include "files/expression.hpp"
#include "tests/fuzz/read.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return bromwich::fuzz::accepts([&] {
    bromwich::Expressions expressions;
    expressions.define("R", 2, "R");
    expressions.define("Q", 4, "Q");
    const std::string full = expressions.in_full(std::string(bromwich::fuzz::text(data, size)), "fuzz");
    const bromwich::TimeFunction function = expressions.in_time({full});
    bromwich::Vector value(1);
    for (const double t : {0.0, 0.3, 1.0}) function(t, value);
    expressions.switch_times({full}, 1);
  });
}
