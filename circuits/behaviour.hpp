#pragma once
// B sources: expressions of voltages, currents and parameters that are piecewise linear.
//
//     max(a, b) = b + p,    p = max(0, a - b):   0 <= p ⊥ p - (a - b) >= 0
//     if(a > b, x, y) = y + (x - y) u,           u = 1 where a > b, else 0
//
// Each p and u becomes an element of its own, a source of voltage of a hidden node, so that an expression is a linear
// form of node voltages and currents. abs, min, limit, uramp, table are made of p; u, stp, sgn, &&, || and ! of u;
// schmitt is u with memory. What depends on time alone is an independent source, whatever its function.

#include "circuits/netlist.hpp"

#include <functional>
#include <string>
#include <vector>

namespace bromwich::circuits {

/// What names of an expression are outside of it.
struct BehaviourNames {
  std::function<std::string(const std::string&)> node, element;  ///< in lower case, of the whole netlist
};

/// The elements of a source with this expression, `source` last: its name, place and first two nodes are given. Throws
/// Error naming the place where the expression is not piecewise linear.
std::vector<Element> behavioural_source(Element source, const std::string& expression, const Parameters&,
                                        const BehaviourNames&);

}  // namespace bromwich::circuits
