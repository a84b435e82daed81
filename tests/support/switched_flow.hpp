#pragma once
// The solution of an engineering scene, by a method that shares no code with the solver: Radau IIA of order 5 with the
// complementary basis held while y and w keep their signs, steps halved towards a change of sign, and two short steps
// of implicit Euler over it and over every edge of a source, whose problems Lemke's method solves. The basis of the
// last one is held from there on. Jumps of the state come from the same short steps. stepped_flow is
// the second opinion.

#include "tests/support/engineering_scene.hpp"

#include <string>
#include <vector>

namespace bromwich::oracle {

struct FlowSteps {
  double error = 1e-9;        ///< of a step, relative to the largest values so far
  double crossing = 2e-7;     ///< length of the short steps, relative to T or the shortest time of a source
  double longest = 1.0 / 60;  ///< step, relative to the same: y may dip below zero between stages
  long most = 300000;         ///< steps after which the flow is undecided
};

struct Flow {
  struct Piece {
    double t, h;
    Matrix nodes;  ///< m x 4: x at t and at the stages
  };
  bool decided = false;
  std::string reason;      ///< why it is undecided
  double T = 0, unit = 0;  ///< end, and the shortest time of a source
  long events = 0, steps = 0;
  Vector largest;     ///< of every component of x
  double driven = 0;  ///< what the sources can move a state to within their shortest time, by weight
  std::vector<Piece> pieces;

  /// Limits of the value at t from the left and from the right.
  Vector left(double t) const;
  Vector right(double t) const;
  Vector end() const { return pieces.back().nodes.col(3); }
};

Flow switched_flow(const EngineeringScene&, const FlowSteps& = {});
Flow switched_flow(const EngineeringScene&, const Vector& x0, double T, const FlowSteps& = {});

/// Largest distance of two flows at `count` times, each component relative to max(|x_i|, 1e-3 of the largest, by
/// weight). Where x jumps the nearer limit counts.
double distance(const EngineeringScene&, const Flow&, const Flow&, Index count);
/// The scale for errors of every component.
Vector error_scale(const EngineeringScene&, const Flow&);

}  // namespace bromwich::oracle
