#pragma once
// The steps of a march in stages, one after the other. Implicit Euler takes those in which the state jumps. This class
// keeps the data of the last steps that the next one needs.

#include "stage_stepper.hpp"

#include <array>
#include <map>
#include <memory>
#include <vector>

namespace bromwich::host {

class StageSteps {
 public:
  /// The problem must outlive the steps.
  explicit StageSteps(const StageProblem&);

  /// Before the first step from x0. `y0`: NaN where it is unknown; `seen`: N x0.
  void start(const Vector& x0, const Vector& y0, const Vector& seen);
  /// From x at row j - 1 to `next` at row j, with the stages of the problem, or with one stage if the state jumps or
  /// two have no solution. Null: unsolved.
  const Stepper* take(const Vector& x, Index j, Vector& next, MarchReport&);
  /// Notes the step that `take` returned, for the next one.
  void pass(const Stepper& used);

  /// The last step was an impact on a rigid constraint.
  bool impact() const { return impact_; }
  bool well_posed() const { return main_.well_posed(); }
  double length(Index j) const { return lengths_.size(lengths_.kind(j)); }
  std::size_t bytes() const;
  /// Position constraints with M_ii = 0, where y_i acts on the second or a higher derivative of w_i. With M_ii > 0 a
  /// contact is a spring, which throws back.
  const std::vector<bool>& rigid() const { return rigid_; }
  static std::vector<bool> rigid_constraints(const SparseMatrix& N, const SparseMatrix& B, const Matrix& M);

  std::vector<bool> touching;  ///< y_i > 0 at the end of the last step, or w_i(0) = 0
  Vector regular;              ///< largest y_i at the ends of steps without jumps

  /// Steps that are not the first: from here on with this `touching`, and with the largest y_i `before` them.
  void resume(const std::vector<bool>& touching, const Vector& before);
  /// The values of `before` with which all steps since then would have been the same.
  struct Range {
    Vector least, below;
    bool has(const Vector& before) const {
      return (before.array() >= least.array()).all() && (before.array() < below.array()).all();
    }
  };
  const Range& same_before() const { return same_before_; }
  /// The largest y_i at the ends of steps without jumps since then.
  const Vector& own_regular() const { return own_regular_; }

 private:
  bool exceeds_regular(Index i, double y) const;
  bool impacts(const Stepper&) const;
  bool jumps(const Stepper&, double h, const Vector& before, const Vector& after) const;
  bool moves(const Vector& y, const Stepper&, double h, const Vector& before, const Vector& after) const;
  Stepper& stepper(Index stages, std::size_t kind);

  const StageProblem& problem_;
  static constexpr std::size_t most_kept_ = 64, most_kept_bytes_ = std::size_t(1) << 31;  ///< of lengths
  Lengths lengths_;
  Stepper main_;
  std::array<std::map<std::size_t, std::unique_ptr<Stepper>>, 2> others_;  ///< by kind; one-stage and two-stage
  Vector other_;
  SparseMatrix B_, NB_;  ///< E^{-1} B; N E^{-1} B of a model of poles
  Matrix V_;             ///< modes of the face of a Kronecker sum
  std::vector<bool> rigid_;
  Vector own_regular_;
  mutable Range same_before_;
  bool impact_ = false;
};

/// S N x of a state in modes.
Vector seen_in_modes(const ModalStages&, const Vector& x);

}  // namespace bromwich::host
