#pragma once
// The parts and switches of an event-driven solution, and the linear maps of changes along them. See
// derivatives/switched_derivative.hpp for the equations.

#include "../core/events/event_driven.hpp"
#include "../core/events/regime.hpp"
#include "part_maps.hpp"
#include "solution_derivative.hpp"
#include "switched_bounds.hpp"

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {

/// Data on which a condition depends: a derivative with respect to them may be one of one side only.
struct ConditionedData {
  bool start = false;  ///< x0
  bool rates = false;  ///< f, A, B and E, which enter x'
  bool rows = false;   ///< g, N and M, which enter w

  bool all() const { return start && rates && rows; }
};

/// The change of the data while the memories of the scene are in these modes; none without memories.
using ChangeInModes = std::function<const DataChange&(const std::vector<Index>& modes)>;

class SwitchedTape {
 public:
  /// E of a change is here the matrix D of f~ = ... + D x'. The scene has E = I, and the rows of its memories.
  /// `along_some`: a solution that has derivatives along some changes alone is taken, too.
  SwitchedTape(const Scene&, const EventSolution&, const Vector& times, bool along_some = false);

  const DerivativeMargin& margin() const { return margin_; }
  std::vector<double> switch_times() const;
  const std::vector<Index>& one_sided() const { return one_sided_; }
  const std::string& without_M() const { return without_M_; }
  /// Empty, or why only some changes have a derivative: what is zero together at a switch has to stay zero with them.
  const std::string& only_along() const { return only_along_; }
  /// Those that only_along is about; vjp leaves them out.
  const ConditionedData& conditioned() const { return conditioned_; }

  /// may_move: no error where something that has to stay zero does not.
  enum class Zeros : char { stay, may_move };
  /// x0: m, or empty: 0; that of the changes does not count.
  SolutionChange jvp(const ChangeInModes&, const Vector& x0, const std::vector<MovingJump>& = {},
                     Zeros = Zeros::stay) const;
  /// Of a change that is the same in all modes.
  DataChange vjp(const SolutionChange&) const;

  /// The scene in the modes that the solution comes to.
  const std::map<std::vector<Index>, Regime>& regimes() const { return regimes_; }

 private:
  using Bounded = BoundedJet;
  // A mode with (x, integral of y) as its state.
  struct Mode {
    const Regime* regime;
    SwitchedMode rows;
    Matrix A;      ///< [[A_S, 0], [Y_x, 0]]
    Bounded kept;  ///< the changes of the state that keep the constraints, m rows of all changes

    const SystemMatrices& system() const { return regime->system; }
  };
  // Legendre coefficients of f and g, or of f~ and g~, on a part.
  struct Sources {
    Matrix f, g;
    Vector terms_of_f = {}, terms_of_g = {};  ///< what f~ and g~ are made of, where something has to stay zero
  };
  // A piece of the solution in one mode. All polynomials are those on [begin, begin + length].
  struct Piece {
    const Mode* mode;
    double begin, length, until;      ///< until: of [0, 1], where it ends
    Matrix x, y, rate;                ///< of the solution; rate: x'
    Sources sources;                  ///< of the scene
    Vector most_y = {}, most_w = {};  ///< sizes of the components up to here, see find_sizes
  };
  struct Part {
    Index piece;
    double from, width;  ///< of [0, 1] of the piece
    const PartMaps* maps;
    Matrix inputs;                  ///< polynomials on the part from those on the piece
    Index interval;                 ///< j: the part lies within t_j and t_{j+1}
    Index first_row = 0, row = -1;  ///< the times at the begin, the last of which begins the interval; -1: none
    Index change = -1;              ///< the Switch at the begin; -1: none
    /// Components that are zero on the whole piece, and have to stay so with a change.
    std::vector<Index> rests = {};
  };
  struct Impulse {
    const Mode* mode;
    Vector p, move, rate;   ///< p, B p, and x' in this mode after it
    Jet rebound;            ///< e times the velocities before it, rows as the constraints of the mode
    Vector rebound_rate;    ///< by f and g alone
    Matrix by_restitution;  ///< of the rebound, by e: constraints x n
  };
  // What vanishes beside a switch and is no part of it: y_i or w_i with its rate, or (component = -1) the constraints
  // on the state of the mode after it. With a change it has to vanish, too.
  struct Condition {
    bool before;
    Index component;
    double rate;
    std::string found;
  };
  // At a time that depends on the solution, or at one that does not.
  struct Switch {
    double t = 0;
    bool moves = false;
    Index component = -1;
    Jet row;          ///< c, 1 row
    double rate = 0;  ///< c'
    Vector rate_before, rate_after, y_before, y_after;
    std::vector<Index> set;  ///< states that memories set, before the impulses
    std::vector<Impulse> impulses;
    std::vector<Condition> conditions = {};
  };
  struct State {
    Vector x, integral;
    Vector largest;  ///< what x_i of a change is made of, up to here; empty where nothing has to stay zero
    Zeros zeros = Zeros::stay;
  };
  // Of the constraints S that are zero together: with v of `right` y + v solves the same problem and moves no state,
  // and u of `left` is not in any w_S. Both n x k.
  struct Ambiguity {
    Matrix right, left;
  };

  // Of the components that are not negative in the mode, relative to their sizes.
  struct Sample {
    double t;
    Index piece;
    std::size_t part;
    Vector c;
  };

  /// Constraints of the scene in the modes of a regime.
  using Rows = std::pair<const Regime*, std::vector<Index>>;

  const Regime* regime_of(const Scene&, const std::vector<Index>& modes);
  const Mode* mode_of(const Rows& active);
  const PartMaps* maps_of(const Mode*, double length);
  void add_pieces(const Scene&, const EventSolution&);
  void add_parts(const EventSolution&, const std::vector<double>& breakpoints);
  void cut(Index piece, double end, Index& row);
  void add_switch(const EventSolution&, std::size_t k, const std::vector<double>& breakpoints);
  Bounded component(const Mode&, Index i) const;
  Vector polynomial(const Piece&, Index i) const;
  JetValues values_of(const Sources&, const Piece&, double at) const;
  void add_values(const JetValues& bar, const Piece&, double at, Sources& to) const;
  Vector rate_of(const Mode&, const JetValues&) const;
  void find_sizes(const EventSolution&);
  double size_of(const Piece&, Index i) const;
  bool vanishes(const Piece&, double at, Index i) const;
  bool is_alike_beyond(const Mode&, Index i);
  Bounded saltation(const Switch&, const Piece* before, Bounded& dt) const;
  void check(Switch&, const Piece* before, const Piece& after);
  void check_conditions(const Switch&, bool before, const Piece&, double at, const Sources&, const Vector& x,
                        const Vector& terms_of_x, double dt) const;
  void measure();
  bool may_rest(const std::vector<Sample>&, std::size_t first, std::size_t last, Index i);
  std::vector<char> resting(const std::vector<Sample>&, Index i);
  void measure_run(const std::vector<Sample>&, bool to_end);
  void add_condition(const std::string& found, const Bounded& rows, bool at_start);
  void check_zero(const Bounded& rows, const Sources&, JetValues u, const Vector& terms_of_x, double added,
                  double terms_added, const std::string& found) const;
  void add_terms(const Part&, const DataChange&, Sources&) const;
  static Vector terms_of(const State&);
  void check_rest(const Part&, double share, const Sources&, const State&) const;
  double least_beside(const std::vector<Sample>&, std::size_t k, Index i) const;
  void judge_M();
  void find_ambiguity(const Rows& together);
  void find_singular(const Rows& S);
  void find_singular_between(const Rows& from, const std::vector<Index>& to, Index component);
  void check_ambiguities(const ChangeInModes&) const;
  void check_structure(const ChangeInModes&) const;
  void check_restitution(const ChangeInModes&) const;
  Matrix by_restitution(const Mode&, const EventImpulse&, const JetValues& before);
  static Vector change_by_M(const Impulse&, const DataChange&);

  const Piece& piece_of(const Part& p) const { return pieces_[std::size_t(p.piece)]; }
  Sources changed(const Part&, const DataChange&) const;
  void add_changed(const Part&, const Sources& bar, DataChange& to) const;
  Matrix table_part(const RowMatrix&, const Part&) const;
  void add_table_part(const Matrix& bar, const Part&, RowMatrix& to) const;
  Matrix inputs(const Part&, const Sources&) const;
  void add_inputs(const Part&, const Matrix& bar, Sources& to) const;
  void add_terms(const Part&, const Sources&, State&) const;
  void advance(const Part&, const Sources&, State&) const;
  void advance_back(const Part&, Sources& of, State& bar) const;
  void project(const Part&, const Sources&, State&) const;
  void project_back(const Part&, Sources& of, State& bar) const;
  /// `moved`: the change of the time of a switch that is at a breakpoint.
  void pass(const Switch&, const Part* before, const Sources& of_before, const Part& after, const Sources& of_after,
            const DataChange&, State&, double moved) const;
  void leave_out_conditioned(DataChange& gradient) const;
  std::vector<double> moved_parts(const std::vector<MovingJump>&) const;
  void pass_back(const Switch&, const Part* before, Sources& of_before, const Part& after, Sources& of_after,
                 DataChange& to, State& bar) const;
  void write(Index row, const Part&, double at, const State&, const Sources&, SolutionChange&) const;
  void read(Index row, const Part&, double at, const SolutionChange&, State& bar, Sources& of) const;
  Sources no_sources() const {
    return {Matrix::Zero(Collocation::degree + 1, m_), Matrix::Zero(Collocation::degree + 1, n_)};
  }

  Index m_, n_;
  double T_;
  Vector t_;
  std::map<std::vector<Index>, Regime> regimes_;
  std::map<Rows, Mode> modes_;
  std::map<std::pair<const Mode*, long long>, PartMaps> maps_;
  std::vector<Piece> pieces_;
  std::vector<Part> parts_;
  std::vector<Switch> switches_;
  DerivativeMargin margin_;
  std::vector<Index> one_sided_;
  std::vector<Index> inelastic_;  ///< constraints that have struck with e = 0
  bool along_some_;
  std::string without_M_, only_along_;
  std::map<std::pair<const Mode*, Index>, bool> alike_beyond_;  ///< see is_alike_beyond
  std::map<Rows, Ambiguity> ambiguities_;                       ///< of each set that was looked at; most are empty
  std::map<Rows, Matrix> singular_;  ///< left kernels of M_SS, n x k, that a change of M has to keep
  ConditionedData conditioned_;
};

}  // namespace bromwich
