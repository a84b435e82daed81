#pragma once
// Numbers of a circuit over time that its netlist does not name: differences of voltages, powers, and expressions of
// them.

#include "circuits/circuit.hpp"
#include "files/formula.hpp"

#include <string>
#include <vector>

namespace bromwich {

/// An expression of V(node), V(node, node), I(element), P(element), the time t, parameters of the netlist and numbers.
/// P is the power that an element takes: V(first node, second node) I(element). Letters count without their case.
class Probe {
 public:
  /// Throws Error(where, ...) for a text that is no expression, or names an unknown node or element.
  Probe(const Circuit&, const std::string& text, const std::string& where);

  /// V, I or P of an element.
  Probe(const Circuit&, char kind, const CircuitElement&);

  const std::string& text() const { return text_; }
  /// Without commas: "V(a)-V(b)" of V(a,b).
  const std::string& label() const { return label_; }
  const std::string& unit() const { return unit_; }  ///< V, A, W, or empty

  /// One value a row of output_values.
  Vector operator()(const Vector& t, const RowMatrix& outputs) const;

 private:
  /// V(from) - V(to), I, or their product, by the numbers of outputs; -1: ground.
  struct Term {
    char kind = 'v';  ///< v, i or p; of an element v is V(from, to)
    Index from = -1, to = -1, current = -1;
  };
  Term term(const Circuit&, char kind, const std::vector<std::string>& names, const std::string& where) const;

  std::string text_, label_, unit_;
  std::vector<Term> terms_;
  Formula formula_;
};

}  // namespace bromwich
