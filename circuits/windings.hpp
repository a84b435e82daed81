#pragma once
// Coupled inductors: which store a flux of their own, and which follow them as windings of an ideal transformer.
//
//     flux = L i,   L_jk = K_jk sqrt(L_j L_k).
//
// Where L is singular (K = 1), windings D follow a base B: with T = L_DB L_BB^{-1},
//
//     v_D = T v_B,   L_BB i_m' = v_B,   i_m = i_B + T^T i_D.

#include "circuits/netlist.hpp"
#include "core/base/types.hpp"

#include <vector>

namespace bromwich::circuits {

/// Inductors that are coupled with each other, by their numbers among the elements.
struct WindingGroup {
  std::vector<Index> inductors;
  Matrix inductance;         ///< L
  std::vector<Index> order;  ///< base first, then the windings that follow: positions in `inductors`
  Index base = 0;            ///< how many are in the base
  Matrix ratios;             ///< T, in the order
};

/// Inductors without a coupling are groups of one. Throws Error where L is not positive semidefinite.
std::vector<WindingGroup> winding_groups(const Netlist&);

/// The same group with `first` (a position in `inductors`) in its base.
WindingGroup with_base(WindingGroup, Index first);

}  // namespace bromwich::circuits
