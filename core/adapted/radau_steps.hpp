#pragma once
// Steps of linear dynamics over the parts of a tree: Radau IIA with complementarity at both stages (the formulas are
// those of core/host/stage_step.hpp), implicit Euler at the begin of the shortest parts, where the state may jump. Each
// length has its own factorization and its own problem.

#include "../scene/scene.hpp"
#include "tree_march.hpp"

#include <cmath>
#include <memory>
#include <string>

namespace bromwich {

/// Why a scene is not taken; empty: it is.
std::string unsuited_to_radau_steps(const Scene&);

class RadauSteps {
 public:
  /// The scene has to outlive the steps.
  RadauSteps(const Scene&, LcpClass);
  ~RadauSteps();

  /// False: the problem of the step is not solved.
  bool take(const Part&, const TreeRow& from, TreeRow& to);
  /// Of the shortest steps so far: the solutions of longer ones agree with theirs.
  bool well_posed() const { return well_posed_; }
  Index problems() const { return problems_; }
  Index newton() const { return newton_; }

 private:
  template <class Scalar>
  struct Family;
  struct Sources;
  template <class Scalar>
  bool advance(Family<Scalar>&, const Part&, const TreeRow& from, TreeRow& to);

  const Scene& scene_;
  Matrix M_;
  LcpClass class_;
  std::unique_ptr<Sources> sources_;
  std::unique_ptr<Family<Complex>> radau_;
  std::unique_ptr<Family<double>> euler_;
  double shortest_ = INFINITY;
  bool well_posed_ = true;
  Index problems_ = 0, newton_ = 0;
};

}  // namespace bromwich
