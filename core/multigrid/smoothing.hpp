#pragma once
// The shifted functional iteration as a smoother in time,
//
//     y^{k+1} in SOL(M + D I, r + K y^k - D y^k),
//
// which has the fixed points of the plain one (D = 0). Where y > 0 and sine modes diagonalise both M and K, an error
// with mode l and frequency omega (per step) is multiplied by (D - K^_l(omega)) / (M^_l + D), K^_l(omega) = Σ_d W_d,l
// e^{-i omega d}. A grid with R times the step does not represent the frequencies in [pi/(2R), pi].

#include "../kernel/recurrence.hpp"
#include "../lcp/stencil.hpp"

#include <optional>
#include <vector>

namespace bromwich {

struct Smoothing {
  double shift = 0;  ///< D
  std::vector<double>
      unseen;  ///< factor, maximum over modes and frequencies invisible to the grids with R = 2, 4, 8, ...
  double smooth_factor = 0;  ///< maximum over modes at frequency 0, that is for Σ_d W_d over all steps

  double factor() const { return unseen.front(); }
};

/// M as the sweeps of all grids see it.
struct SweptMatrix {
  SweptMatrix() = default;
  SweptMatrix(const LcpMatrix&, const FaceBasis&);

  std::optional<Stencil> stencil;  ///< on the grid of the modes (core/lcp/stencil.hpp); empty: another matrix
  Vector eigenvalues;              ///< of the stencil, in the order of the modes
};

/// The D that minimises the factor for R = 2, with M and M + D I M-matrices. Larger R are included as long as the
/// factors are below `useful`. Empty unless M is a stencil with neighbours <= 0. The modes are sampled from the
/// smoothest to the roughest.
std::optional<Smoothing> best_smoothing(const SweptMatrix&, const ModalRecurrence&, Index steps, double useful = 0);

}  // namespace bromwich
