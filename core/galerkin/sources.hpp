#pragma once
// f and g in the conditions of an interval. On an interval, or on each of its pieces, f is the parabola through three
// Gauss points and g enters by these points. Pieces end at breakpoints of the scene; an interval or piece on which the
// parabolas miss further values by a good part of their range is halved. With E, C, F and q of the pieces s_0 < s < s_1
// of an interval, d = s_1 - s_0, and x the state that f has caused before,
//
//     q_left = Σ d ((1 - s_0) p_left + (1 - s_1) p_right),   q_right = Σ d (s_0 p_left + s_1 p_right),   p = q + C x,
//     x <- E x + F.
//
// An interval of one piece needs none of that.

#include "../scene/scene.hpp"

#include <array>
#include <map>

namespace bromwich {

/// A part of [0, 1].
struct SourcePart {
  double begin = 0, end = 1;
};

class GalerkinSources {
 public:
  GalerkinSources(const Scene&, const DenseDynamics&, const Matrix& entry, std::vector<double> breakpoints);

  /// Adds f and g on [t, t + h] to F (m) and q (2n).
  void add(double t, double h, Eigen::Ref<Vector> F, Eigen::Ref<Vector> q);

  /// Intervals that were divided so far.
  Index divided() const { return divided_; }

  /// The mean of f on [t, t + h].
  Vector mean_of_f(double t, double h);

 private:
  /// Contribution of the values at the Gauss points of a piece, and its matrices E and C.
  struct Response {
    std::array<Matrix, 3> state, moments;
    Matrix E, C;
  };
  struct Samples {
    std::array<Vector, 3> f, g;
  };

  const Response& response(double length);
  Samples sample(double t, double length);
  bool agrees(double t, double length, const Samples&, double probe);
  bool resolved(double t, double length, const Samples&);
  bool well_resolved(double t, double length, const Samples&);
  bool breaks(double t, double h) const;
  std::vector<SourcePart> parts(double t, double h);
  void split(double t, double h, double begin, double end, int depth, std::vector<SourcePart>& parts);
  void add_piece(double length, const Samples&, Eigen::Ref<Vector> F, Eigen::Ref<Vector> q);

  const Scene& scene_;
  const DenseDynamics& dynamics_;
  Matrix entry_;
  std::vector<double> breakpoints_;
  std::map<double, Response> responses_;  ///< by length
  Vector range_f_, range_g_;              ///< largest values so far
  Index divided_ = 0;
};

}  // namespace bromwich
