#pragma once
// Small random scenes of every class and spectrum: 1 to 6 states, 1 to 6 constraints.

#include "core/scene/scene.hpp"

#include <array>
#include <cstdint>
#include <string>

namespace bromwich::oracle {

enum class Family {
  dominant,    ///< P: strictly diagonally dominant, random signs
  definite,    ///< P: L L^T + I/2 + skew
  h_plus,      ///< P: a dominant matrix with scaled rows and columns, random signs
  general_p,   ///< P by rejection, n <= 4: neither H+ nor definite in general
  m_matrix,    ///< Z and P
  fold,        ///< Z, not P: M-matrix minus a multiple of the identity, solutions may merge and vanish
  low_rank,    ///< PSD: L L^T of lower rank + skew
  skew,        ///< PSD: no symmetric part
  zero,        ///< M = 0, mostly N = B^T
  duplicated,  ///< PSD: a definite matrix with some constraints stated twice
  indefinite,  ///< unknown: random entries
};
constexpr Index families = 11;
const char* to_string(Family);

enum class Spectrum { real, sector, imaginary, unstable, stiff, non_normal, singular, zero, nilpotent };
constexpr Index spectra = 9;

struct RandomScene {
  Scene scene;
  Index steps;
  Family family;
  Spectrum spectrum;
};

/// The family is number seed % families; everything else is random. In some scenes y, the state, all data or time have
/// sizes from 1e-6 to 1e6. The discrete problem need not have a solution.
RandomScene any_scene(std::uint32_t seed);

}  // namespace bromwich::oracle
