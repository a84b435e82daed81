#pragma once
// Elements with memory: thyristors, switches with hysteresis, thermostats, friction that holds more than it slows.

#include "time_function.hpp"
#include "types.hpp"

#include <string>
#include <vector>

namespace bromwich {

/// A memory is in one of its modes at a time. A mode adds to the scene while it lasts,
///
///     E x' = (A + A_mode) x + (B + B_mode) y + f + f_mode(t),     w = (N + N_mode) x + (M + M_mode) y + g + g_mode(t),
///
/// and is left at a located time, for another mode, where its conditions hold. Several memories add up.
struct Memory {
  /// Holds where x . x(t) + y . y(t) + time(t) > 0.
  struct Condition {
    Vector x = {};           ///< m, or empty: 0; one more for each memory of the scene sees the numbers of their modes
    Vector y = {};           ///< n, or empty: 0
    TimeFunction time = {};  ///< one value; empty = 0
    Index guard = -1;        ///< of a scene that a solve makes: the row of w that is the negative of all that
  };

  /// A state that jumps.
  struct Jump {
    Index state = 0;
    double value = 0;  ///< behind it
  };

  struct Leave {
    std::string to;
    std::vector<Condition> when;  ///< all of them hold
    std::vector<Jump> set = {};   ///< states that jump then
  };

  /// What is empty adds nothing. A mode that nothing leaves stays.
  struct Mode {
    std::string name;
    TimeFunction f = {};            ///< m values, whatever Scene::f_entry is
    TimeFunction g = {};            ///< n values
    Matrix A = {}, B = {};          ///< m x m, m x n
    Matrix N = {}, M = {};          ///< n x m, n x n
    std::vector<Leave> leave = {};  ///< the first that holds is taken
  };

  std::string name;
  std::vector<Mode> modes;
  std::string start = {};  ///< the mode at t = 0; empty: the first. One whose conditions hold is left at once.
  Index state = -1;        ///< of a scene that a solve makes: the state that is the number of the mode

  /// x_i > value, x_i < value, of m states.
  static Condition above(Index i, double value, Index m);
  static Condition below(Index i, double value, Index m);
};

/// A mode that begins.
struct ModeChange {
  double t = 0;
  Index memory = 0, from = 0, to = 0;  ///< numbers in Scene::memories and Memory::modes
};

}  // namespace bromwich
