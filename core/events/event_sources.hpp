#pragma once
// f and g of a scene as polynomials on the steps of the event-driven integration.

#include "../scene/scene.hpp"
#include "collocation.hpp"
#include "combination.hpp"

#include <map>
#include <memory>
#include <vector>

namespace bromwich {

/// Values of f and g at irregular times of [0, T], each found when it is first asked for. Integrations of scenes that
/// differ in x0 alone may share them: the values of expressions take longer than all that is done with them.
struct SourceLooks {
  static constexpr Index count = 16384;

  std::vector<char> known;  ///< of each time; empty: none
  RowMatrix f, g;           ///< count x m and count x n
  /// Of the scene in modes of its memories.
  std::map<std::vector<Index>, std::shared_ptr<SourceLooks>> in_modes = {};
};

/// The longest time between breakpoints, 0 and T.
double longest_span(const std::vector<double>& breakpoints, double T);

/// Of an integration over sources that may bend, at least.
inline constexpr double fewest_steps = 48;

/// The longest step of an integration. Of sources that may bend it is a part of T: more would pass between samples
/// unseen. Lines between breakpoints hide nothing. `number`, from 1: integrations of different numbers look at
/// different times.
double longest_step(const Scene&, const std::vector<double>& breakpoints, std::size_t number);

class EventSources {
 public:
  /// A scene with dense dynamics that outlives the object. `looks`: those of the same f, g and T, or null.
  explicit EventSources(const Scene&, std::shared_ptr<SourceLooks> looks = {});

  /// Of sources that are not known to be lines between breakpoints: a look may find more than the samples.
  bool may_bend() const;
  Vector f(double t) const;  ///< m values, as x' = A x + B y + f takes them
  Vector g(double t) const;  ///< n values

  struct Polynomials {
    LegendreCoefficients f, g;    ///< of m and n components
    Vector off_f, off_g;          ///< largest differences from the sources that were seen, m and n values
    Vector unknown_f, unknown_g;  ///< differences up to these are rounding of t or of terms
  };
  /// On [t, t + h], which no breakpoint divides; the differences are those at Collocation::checks.
  Polynomials sample(double t, double h) const;
  void sample(double t, double h, Polynomials&) const;
  /// Increases the differences to those at both ends: a kink may lie between an end and the next sample.
  void look_at_ends(double t, double h, Polynomials&) const;
  /// Increases the differences to those at the times of SourceLooks: a pulse may lie between the samples, unless the
  /// scene knows of none. Returns how many these are.
  Index look_between(double t, double h, Polynomials&) const;

 private:
  /// f or g: shapes times functions of time.
  struct Source {
    TimeFunction time;  ///< empty: 0
    Index count = 0;    ///< of its values
    Combination shapes;
    Index width;  ///< values of f or g
    bool linear;

    /// `by`: of the given source; empty: none.
    Source(const TimeFunction& given, Index width, const Matrix& by);
    bool bends() const { return time && !linear; }
  };

  void evaluate(const Source&, double t, Vector& value) const;
  void sample(const Source&, double t, double h, LegendreCoefficients&, Vector& off, Vector& unknown) const;
  void look(double t, double h, double at, Polynomials&) const;
  void look_up(Index k, double time) const;

  const Scene& scene_;
  Source f_, g_;
  std::shared_ptr<SourceLooks> looks_;
  // Storage of a sample.
  mutable Vector of_time_, value_;
  mutable LegendreCoefficients in_time_;
};

}  // namespace bromwich
