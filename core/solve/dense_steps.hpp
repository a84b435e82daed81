#pragma once
// Rows between the time points of a result by steps from the time point before.

#include "../adapted/steps_between.hpp"
#include "../base/types.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// t = t_row + part h, 0 <= part < 1.
struct Place {
  Index row;
  double part;
};

inline constexpr double same_point = 1e-9;  ///< of a step: written with fewer digits a time point still is one

/// Throws Error for t outside [0, T].
Place place(const Result&, double T, double t);
bool on_grid(const std::vector<Place>&);

/// Whether y is not a line between time points, or its state there cannot be computed from it.
bool by_steps(const Scene&, const Result&);

/// By the method of the result, from the time point before: where y jumps from step to step this is its state, its y,
/// and the integral of y from there.
void sample_by_steps(const Scene&, Backend&, const Result&, const std::vector<Place>&, Result& sampled);

/// Rows between the time points of a march, each from the time point before: by shorter steps whose matrices are kept
/// where they suit, otherwise by a march of its own.
class RowsBetween {
 public:
  /// Steps of length h. Scene and backend have to outlive the object.
  RowsBetween(const Scene&, Backend&, double h);

  /// Row k, and the integral of y over the step so far, s behind the time point t with the state x and y. False: it is
  /// not solved.
  bool take(double t, const Vector& x, const Vector& y, double s, Index k, Result& sampled);
  /// The same by kept steps alone.
  bool by_steps(double t, const Vector& x, const Vector& y, double s, Index k, Result& sampled);

 private:
  bool march(double t, const Vector& x, double s, Index k, Result& sampled);

  const Scene& scene_;
  Backend& backend_;
  std::optional<StepsBetween> steps_;
};

}  // namespace bromwich
