#pragma once
// Steps of structures with rigid contacts. A step is divided where contacts close, and where sliding ends. On
// each part forces are constant, the flow is exact, and one problem of velocities at its end gives the forces:
//
//     0 <= z  ⊥  W z + q >= 0,   W = M + speeds D   (impact_rows.hpp),
//
// with the closed contacts alone, so that their speeds vanish at the end or they open. Positions are put back onto the
// closed contacts, from which they are off by the cube of the part. Where a contact closes, the same problem with
// D = B has the impulses p as unknowns and Newton's law: w'+ + e w'- >= 0. What is left behind of y is part of it, and
// complementary to M p. Where a contact that parts would be back within an eighth of a step, it stays closed: it would
// rise by less than the square of the step.

#include "../lcp/active_set.hpp"
#include "../lcp/march_report.hpp"
#include "impact_flow.hpp"
#include "impact_rows.hpp"

#include <map>
#include <optional>
#include <vector>

namespace bromwich {

/// f and g on a part of a step where both are smooth: columns of 1, s, s^2 with the time s from `begin`.
struct SmoothSources {
  double begin = 0, length = 0;
  Matrix f, g;          ///< m x 3 and n x 3
  bool breaks = false;  ///< g or its slope may jump at `begin`
};

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
  const Vector& y() const { return y_; }                ///< of the last part
  const Vector& first() const { return first_; }        ///< y of the first part of all
  const Vector& integral() const { return integral_; }  ///< of y over the step, impulses included
  Index impacts() const { return impacts_; }
  double residual() const { return residual_; }  ///< of all problems, relative to their terms
  MarchReport& report() { return report_; }

 private:
  // Values and slopes of all w, without M y, and the sizes of their terms.
  struct Look {
    Vector w, slope, size, size_of_slope;
  };
  struct Part {
    std::vector<Index> rows;
    Vector z, y, x;  ///< n, n, m: at the end
  };
  struct Event {
    double at;                ///< within the part; infinite: none
    std::vector<Index> gaps;  ///< that close there; none: sliding ends
  };
  Look look(const SmoothSources&, double s, const Vector& x, const Vector& y) const;
  Matrix problem(double d, const std::vector<Index>& rows) const;
  bool take(const SmoothSources&, double from, double d, Part&);
  bool solve(ActiveSetLcp&, const Matrix& W, const Vector& q, Vector& z);
  bool solve_part(double d, const std::vector<Index>& rows, const Vector& q, Vector& z);
  Event first_event(const SmoothSources&, double from, double d, const Part&);
  double first_turn(const SmoothSources&, double from, double d, const Look& begin, const Look& end, const Part&);
  void follow_idle(const SmoothSources&, double s, Part&) const;
  Vector y_at_begin(const SmoothSources&, const Part&) const;
  Vector falling(const SmoothSources&, double s) const;
  bool is_brief(double speed, double falls) const;
  bool strike(const SmoothSources&, double s, const std::vector<Index>& gaps);
  void open(const SmoothSources&, double s, const Vector& z);
  void put_back(const SmoothSources&, double s, const std::vector<Index>& more);

  const ImpactRows& rows_;
  ImpactFlow flow_;
  const double h_;
  const Eigen::SparseMatrix<double, Eigen::RowMajor> N_;
  const ImpactResponse response_;
  // Of whole steps with these rows.
  std::vector<Index> kept_rows_;
  Matrix kept_problem_;
  std::optional<ActiveSetLcp> kept_;
  Vector x_, y_, first_, integral_;
  std::vector<char> closed_;
  std::vector<Index> held_;
  Matrix onto_held_;  ///< pseudoinverse of N onto, of held_
  Index impacts_ = 0;
  double residual_ = 0;
  MarchReport report_;
};

}  // namespace bromwich
