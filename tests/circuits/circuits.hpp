#pragma once
// Netlists of the tests.

#include "circuits/circuit.hpp"
#include "core/solve/dense_output.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <map>
#include <string>

namespace bromwich::test {

/// Cards behind a title line.
inline Circuit circuit_of(const std::string& cards) { return parse_circuit("title\n" + cards, "test.cir"); }

/// What a refused netlist is told, or "".
inline std::string message_of(const std::string& cards) {
  try {
    circuit_of(cards);
    return "";
  } catch (const std::exception& error) {
    return error.what();
  }
}

/// The periodic state of a circuit that was read with a period, with all states.
inline Result periodic_state(const Circuit& c, Backend& backend) {
  Options options = options_for(Method::automatic, 16);
  options.states = StateSelection::all;
  const Result r = solve(c.scene, backend, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r;
}

/// Outputs by name at the time t; empty where the circuit is not solved.
inline std::map<std::string, double> values_at(const Circuit& c, double t, double tolerance) {
  Options options;
  options.tolerance_x = tolerance;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result r = solve(c.scene, *backend, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  std::map<std::string, double> all;
  if (r.status != Status::solved) return all;
  const RowMatrix row = output_values(c, at_times(c.scene, *backend, r, {t}));
  for (std::size_t i = 0; i < c.outputs.size(); ++i) all[c.outputs[i].name] = row(0, Index(i));
  return all;
}

}  // namespace bromwich::test
