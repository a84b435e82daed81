#pragma once
// Implicit Euler steps of very short length: they propose active sets, select impulses and pass accumulated events.

#include "../lcp/active_set.hpp"
#include "event_sources.hpp"
#include "mode.hpp"

#include <map>
#include <optional>
#include <vector>

namespace bromwich {

class ShortSteps {
 public:
  /// The first two have to outlive the object.
  ShortSteps(const SystemMatrices&, const EventSources&, double T);

  /// Whether the complementarity problems of short steps determine the solution. `lcp_class`: of M.
  bool unique(LcpClass lcp_class);

  /// Whether they determine y too, and not only the state. After `unique`.
  bool determine_y() const { return has_one_solution(class_) && !limit_of_P_; }
  /// Whether y of a step is that of least norm where it is not unique.
  bool of_least_norm() const { return selects_least_norm(class_); }

  struct Step {
    bool solved = false;
    Vector y, x;
    std::vector<Index> zero_w;  ///< w_i = 0, whether y_i is positive or not
    Matrix problem;             ///< of the step, with q
    Vector q, cover;            ///< cover: for Lemke's method, of the pairs
    Index pairs = 0;            ///< rows before the guards
    /// Of Lemke's method, where y_i = w_i = 0 too; empty if it ends on a ray.
    std::vector<Index> basis() const;
  };
  /// From x at t to t + h. `offset` is subtracted from g. The matrices of a length are kept for the next step.
  Step take(double t, double h, const Vector& x, const Vector& offset);

  /// Of the dynamics: max(1 / T, |eigenvalues of A|), whatever the units of the states.
  double rate() const { return rate_; }

 private:
  struct OfLength {
    Eigen::PartialPivLU<Matrix> lu;   ///< of I - hA
    Matrix moved, problem;            ///< h (I - hA)^{-1} B, M + N times that
    std::optional<ActiveSetLcp> lcp;  ///< none without pairs
  };
  OfLength& of_length(double h);
  Matrix response(double h) const;
  enum class Monotone { no, moves_the_state, yes };
  Monotone monotone(const Matrix& S) const;
  Matrix regularized(const Matrix& P) const;

  const SystemMatrices& system_;
  const EventSources& sources_;
  const Vector cover_;  ///< of the pairs, see the constructor; empty without rigid contacts
  double rate_;
  LcpClass class_ = LcpClass::P;  ///< of the matrix of a short step
  bool limit_of_P_ = false;       ///< it is of class P with any larger diagonal
  std::map<double, OfLength> known_;
};

}  // namespace bromwich
