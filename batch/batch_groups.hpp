#pragma once
// Groups of scenes of a batch that share their dynamics and M.

#include "../core/scene/natural_units.hpp"
#include "batch.hpp"

#include <vector>

namespace bromwich {

/// The scene from which sizes and times are taken.
inline const Scene& first_of(const Batch& b) { return b.own.empty() ? b.common : b.own.front(); }

/// Gives a copy of `common` what scene k has of its own. Precondition: `own` is empty.
void put_own_data(const Batch&, Index k, Scene&);
/// Some scene has A, B, N, M or E of its own.
bool own_matrices(const Batch&);
/// Some scene has f or g of its own.
bool own_sources(const Batch&);
/// With the largest values of f and g in their place, which natural units depend on.
Scene with_constant_sources(Scene);
/// Scenes that differ in x0, f and g at most, in lists.
std::vector<std::vector<Index>> groups_of(const Batch&);

}  // namespace bromwich
