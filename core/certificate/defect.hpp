#pragma once
// The state that y of a result drives, by the exact flow, and the defect of complementarity inside its steps. Steps of
// equal length without breakpoints are taken many at once; the others part by part.

#include "../result/result.hpp"
#include "linear_steps.hpp"
#include "part_sources.hpp"
#include "part_weights.hpp"

namespace bromwich {

class Defect {
 public:
  static constexpr Index division = 3;   ///< parts of a step: odd, since nested grids may miss the same contact
  static constexpr Index at_once = 256;  ///< plain steps

  /// Dense dynamics. Scene, M and y have to outlive the object.
  Defect(const Scene&, const Matrix& M, const LinearSteps& y, double step_length);

  /// Keeps the next step, which is plain, for pass_kept. False: its sources are no parabolas, and pass has to take it.
  bool keep(double from, double to) { return kept_.add(from, to); }
  Index kept() const { return kept_.steps(); }
  /// Passes the steps that were kept, `first` and those behind. The states at their ends: one row each, x m.
  RowMatrix pass_kept(Index first);
  /// Passes one part of a step.
  void pass(const Part&);

  const Vector& x() const { return x_; }              ///< m, at the end of what was passed
  const Vector& terms() const { return terms_; }      ///< n: max_t (|M||y| + |N||x| + |g|)
  const Vector& answers() const { return answers_; }  ///< n: the largest change of w_i by y_i within a part
  void summarise(Certificate&) const;

 private:
  // From the begin of a step to a place inside: x(c h) = decay x + drive (y left, y right) + input (c_0, c_1, c_2).
  struct Place {
    double at, share;  ///< share of the step, in means
    Matrix decay, drive, input;
    Vector answer;  ///< of the part that holds it
  };
  void make_places();
  void pass_halved(const Part&, int halvings);
  void look_inside(const Part&, const PartWeights&, const PartSources&);
  void look_at(const Place&, Index first, const Matrix& from, const Matrix& y, const Matrix& f);

  const DenseDynamics& d_;
  const Matrix& M_;
  const double T_, h_;
  const Index n_;
  const LinearSteps& y_;
  PartSampler sources_;
  StepSources kept_;
  PartWeightsFamily weights_;
  PhiFamily phis_;
  std::vector<Place> places_;  ///< made when they are needed; the last is the end of the step
  Vector x_, terms_, answers_, largest_, sum_, at_;
};

}  // namespace bromwich
