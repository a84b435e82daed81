#pragma once
// Steps of structures with rigid contacts. A step is divided where contacts close, and where sliding ends. On
// each part forces are constant, the flow is exact, and one problem of velocities at its end gives the forces:
//
//     0 <= z  ⊥  W z + q >= 0,   W = M + speeds D   (impact_rows.hpp),
//
// with the closed contacts alone, so that their speeds vanish at the end or they open. Positions are put back onto the
// closed contacts, from which they are off by the cube of the part. Where a contact closes, the same problem with
// D = B has the impulses p as unknowns and Newton's law: w'+ + e w'- >= 0. What is left behind of y is part of it, and
// complementary to M p. Where a contact that parts would be back within a small part of a step, it stays closed:
// bounces end in rest. Whole steps on which nothing changes are taken by HeldImpacts. Friction on circles has another
// direction at the end of a part than at its begin: its impulse is the mean of both (impact_problem.hpp).

#include "../lcp/march_report.hpp"
#include "bromwich/result.hpp"
#include "held_impacts.hpp"
#include "impact_flow.hpp"
#include "impact_problem.hpp"
#include "impact_rows.hpp"
#include "smooth_sources.hpp"

#include <cmath>
#include <optional>
#include <vector>

namespace bromwich {

class ImpactSteps {
 public:
  /// The rows have to outlive the steps. `h`: length of the steps.
  ImpactSteps(const ImpactRows&, double h, const Vector& x0);

  /// At t = 0, with the sources behind it. False: the problem of impulses stays unsolved.
  bool start(const SmoothSources&);
  /// Steps over these sources, which follow those of the last call. False: unsolved.
  bool pass(const SmoothSources&);
  /// Before a step: its integral of y begins.
  void begin_step() { integral_.setZero(); }

  const Vector& x() const { return x_; }
  const Vector& y() const { return shown_; }            ///< at the end of the last part
  const Vector& first() const { return first_; }        ///< y of the first part of all
  const Vector& integral() const { return integral_; }  ///< of y over the step, impulses included
  const std::vector<Impact>& impacts() const { return impacts_; }
  double residual() const { return residual_; }  ///< of all problems, relative to their terms
  MarchReport& report() { return report_; }

 private:
  // Values and slopes of all w, without M y, and the sizes of their terms.
  struct Look {
    Vector w, slope, size, size_of_slope;
    /// A speed below this is none: rounding of its terms, and of what the terms of its rate do over a step.
    double rest(Index i, double h) const { return no_speed * (size[i] + h * size_of_slope[i]); }
  };
  struct Part {
    std::vector<Index> rows;
    Vector z, y, x;  ///< n, n, m: impulses, their means, and at the end
    Vector shown;    ///< n: y at the end
  };
  struct Event {
    double at = INFINITY;     ///< within the part; infinite: none
    std::vector<Index> gaps;  ///< that close there; none: sliding ends
    bool rests = false;       ///< sliding has ended at the begin
  };
  Look look(const SmoothSources&, double s, const Vector& x, const Vector& y) const;
  // A combination of two rows: the speed in the direction in which a contact slides at the begin of a part.
  struct Sliding {
    Index first, second;
    Eigen::Vector2d along;
    double of(const Vector& v) const { return along[0] * v[first] + along[1] * v[second]; }
  };
  Matrix matrix(double d, const std::vector<Index>& rows) const;
  ImpactProblem problem(double d, const std::vector<Index>& rows) const;
  std::vector<ImpactCone> cones_among(const std::vector<Index>& rows) const;
  Matrix slides(const SmoothSources&, double s, const std::vector<Index>& rows) const;
  bool goes_on(const Sliding&, const Look& begin, const Look& there) const;
  std::vector<Sliding> sliding(const Look& begin, const Look& end, const std::vector<Index>& rows) const;
  bool take(const SmoothSources&, double from, double d, Part&);
  bool solve(ImpactProblem&, const Vector& q, const Matrix& slides, ImpactSolution&);
  bool solve_part(double d, const std::vector<Index>& rows, const Vector& q, const Matrix& slides, ImpactSolution&);
  Event first_event(const SmoothSources&, double from, double d, const Part&);
  bool turns_far(const SmoothSources&, double from, double d, const Part&) const;
  double first_turn(const SmoothSources&, double from, double d, const Look& begin, const Look& end, const Part&);
  Vector slips(const SmoothSources&, double s, const Vector& x) const;
  void show_given_bounds(const SmoothSources&, double s, Part&) const;
  Vector y_at_begin(const SmoothSources&, const Part&) const;
  Vector falling(const SmoothSources&, double s) const;
  bool is_brief(double speed, double falls) const;
  bool strike(const SmoothSources&, double s, const std::vector<Index>& gaps);
  void open(const SmoothSources&, double s, const Vector& z);
  void put_back(const SmoothSources&, double s, const std::vector<Index>& more);
  void prepare_to_put_back(const std::vector<Index>& held);
  bool goes_on_as_before(const SmoothSources&);

  // Of steps, sizes of terms and sources.
  static constexpr double no_speed = 1e-11;   ///< of the terms of w': less is no speed
  static constexpr double at_bound = 1e-9;    ///< of the bound of friction: less than that below it slips
  static constexpr double same_time = 1e-9;   ///< of a step: contacts that close at once
  static constexpr double brief_turn = 1e-6;  ///< of a step: sliding that ends so early has ended there before
  static constexpr double shorter = 64;       ///< parts for the forces while sliding goes on
  static constexpr double shortest_flight = 1.0 / 512;  ///< of a step, of a bounce that another one follows
  static constexpr double kink = 1e-3;        ///< of the slopes of g, which parabolas know up to the square of a step
  static constexpr double most_turn = 0.995;  ///< cosine of the angle by which sliding turns on a part, 0.1 radians
  static constexpr double shortest_turn = 1e-3;  ///< of a step: shorter parts are not divided for that
  static constexpr Index most_parts = 1024;      ///< of a step and row: more than flights of one contact
  static double value(const Matrix& c, Index i, double s) { return c(i, 0) + s * (c(i, 1) + s * c(i, 2)); }
  static Vector values(const Matrix& c, double s) { return c.col(0) + s * (c.col(1) + s * c.col(2)); }
  static Vector slopes(const Matrix& c, double s) { return c.col(1) + 2 * s * c.col(2); }
  static QuadraticColumns from_there(const Matrix& c, double s) { return {values(c, s), slopes(c, s), c.col(2)}; }
  using Kind = ImpactRows::Kind;

  const ImpactRows& rows_;
  ImpactFlow flow_;
  const double h_;
  const Eigen::SparseMatrix<double, Eigen::RowMajor> N_;
  const SparseMatrix size_of_N_, size_of_NA_;
  const ImpactResponse response_;
  std::optional<HeldImpacts> held_impacts_;
  std::vector<char> closed_before_, active_before_;  ///< at the begin of the last step, and rows with y > 0
  // Of whole steps with these rows.
  std::vector<Index> kept_rows_;
  std::optional<ImpactProblem> kept_;
  Vector x_, y_, shown_, first_, integral_;
  std::vector<char> closed_;
  std::vector<Index> held_;
  Matrix onto_held_;  ///< pseudoinverse of N onto, of held_
  std::vector<Impact> impacts_;
  bool rests_ = false;  ///< sliding on circles has ended at the begin of the part
  double residual_ = 0;
  MarchReport report_;
};

}  // namespace bromwich
