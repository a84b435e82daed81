#pragma once
// Options of solve_nonlinear.

#include "../core/base/types.hpp"
#include "../core/result/method.hpp"

#include <functional>

namespace bromwich {

enum class NonlinearMethod { automatic, march, iteration, newton, pointwise };

/// "automatic", "march", ...
inline const char* to_string(NonlinearMethod method) {
  switch (method) {
    case NonlinearMethod::automatic:
      return "automatic";
    case NonlinearMethod::march:
      return "march";
    case NonlinearMethod::iteration:
      return "iteration";
    case NonlinearMethod::newton:
      return "newton";
    case NonlinearMethod::pointwise:
      break;
  }
  return "pointwise";
}

struct NonlinearOptions {
  NonlinearMethod method = NonlinearMethod::automatic;
  Index steps = 0;                   ///< J; 0: the default of the linear part
  double tolerance = 1e-12;          ///< of the last change, relative to the largest |y| and |x|
  Index most_newton = 30;            ///< Newton iterations of a step or window
  Index most_iterations = 200;       ///< linear solves of a window
  Method inner = Method::automatic;  ///< of the linear solves
  /// Error of x and y, of the mean of y where it may jump, relative to the largest value of each component; steps are
  /// halved until it is reached. 0: one grid.
  double error = 0;
  Index max_steps = Index(1) << 18;  ///< of the finest grid
  /// Of one grid: half the step confirms a result of which its own steps raise doubts (doubts.hpp).
  bool confirm = true;
  bool concurrent = false;  ///< several threads may call phi, gamma and their derivatives at once
  std::function<bool()> interrupted = {};
};

}  // namespace bromwich
