#pragma once
// What the two ways to the solution of an engineering scene share: edges, sources, sizes, and one implicit stage.

#include "tests/support/switched_flow.hpp"

#include <Eigen/Dense>

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich::oracle {

/// LU of a matrix whose rows and columns have sizes of many decades.
class ScaledLu {
 public:
  explicit ScaledLu(Matrix K);
  Vector solve(const Vector& b) const;

 private:
  Vector rows_, columns_;
  Eigen::PartialPivLU<Matrix> lu_;
};

/// Stages of a piece: x at t and at the nodes of Radau IIA of order 5.
extern const double radau_nodes[3];

class FlowBase {
 public:
  Flow run();

 protected:
  /// `resistance`: added to the diagonal of M, relative to what else limits y.
  FlowBase(const EngineeringScene&, const Vector& x0, double T, double resistance);
  virtual ~FlowBase() = default;
  /// From one edge to the next one.
  virtual void piece(double begin, double end) = 0;

  Vector signals(double t) const;  ///< pulses and steps have the values of the piece
  void undecided(const std::string& reason, double t);
  /// Of a change of x, relative to the largest values so far.
  double size_of(const Vector& change) const;

  /// States that touch a constraint: what w lacks to 0 is divided by short steps, where rounding of double would move
  /// their speed.
  using Wide = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
  struct Stage {
    Wide x;
    Vector y;
  };
  /// x = from + h (A x + B y + F u(t)), y >= 0, w >= 0 complementary; basis_ is its basis.
  std::optional<Stage> stage(const Wide& from, double t, double h);

  const EngineeringScene& s_;
  Index m_, n_;
  Matrix M_;
  Vector x_;
  double unit_ = 0;  ///< the shortest time of a source
  std::vector<char> basis_;
  Flow flow_;

 private:
  struct Gains {
    ScaledLu lu;
    Matrix gain, M;
  };
  void make_edges();
  const Gains& gains(double h);

  double middle_ = 0;
  std::vector<double> edges_;
  std::map<double, std::unique_ptr<Gains>> gains_;
};

}  // namespace bromwich::oracle
