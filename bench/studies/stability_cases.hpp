#pragma once
// What the hard cases of `bromwich bench stability` are made of, and the groups they come in: one source for spectra,
// matrices, scales and sizes, one for sources, one for starts and contacts.

#include "bench/studies/stability.hpp"

#include <functional>
#include <initializer_list>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace bromwich::app::hard {

constexpr double pi = std::numbers::pi;

/// A function of time with its derivative, by component.
struct Motion {
  std::function<double(Index i, double t)> x, slope;
};
using Switch = std::function<double(Index i, double t)>;

/// Smooth motions of m components, for t in [0, 2] stretched to [0, T].
Motion cosines(Index m, double T);
Switch sines(double T, double turns = 2);

/// The scene with x = motion and y = max(S, 0), w = max(-S, 0).
Scene manufactured(const Dynamics& dynamics, const LcpMatrix& M, double T, Motion motion, Switch S);

/// m x n, entries cos(i + 2 j).
Matrix ports(Index m, Index n);
/// [2 -1; -1 2].
Matrix two();

class Catalogue {
 public:
  explicit Catalogue(bool quick) : quick_(quick) {}

  std::vector<HardCase> all();

 private:
  HardCase& add(const std::string& group, const std::string& name, Scene scene,
                const std::string& reference = "manufactured");
  HardCase& dense(const std::string& group, const std::string& name, const Matrix& A, const Matrix& M, double T);
  static Matrix stiff(std::initializer_list<double> values);
  static Matrix oscillators(std::initializer_list<double> frequencies, double growth);
  static Matrix chain(Index m, double diagonal, double above);

  void spectra();
  void matrices();

  /// x has kinks, so that f jumps: `periods` triangles, two edges each.
  void edges(const std::string& name, double periods, bool told, bool y_jumps);
  void sources();
  /// y = (1 - |t - c|/d)+, x' = y/d: the contact is short and moves x by 1.
  void contact();
  /// x' = -100 x + 1000 y, w = x + y/2 - 10 sin(2 pi turns t): x follows the peaks of a sine that coarse grids do not
  /// resolve.
  void rectifier(double turns);
  void pulse(bool told);

  void starts();
  /// A mass that flies freely meets a rigid stop and loses its velocity.
  static Scene at_stop(double stiffness, double weight, double T);
  void falling();
  void braked();
  /// x' in -Sgn x: y = (s, the negative part of x), Sgn = 1 - 2 s.
  void sliding();
  /// Two relays: the state rotates around the origin and reaches it at t = 2 after infinitely many switches.
  void zeno();

  static Scene in_units(const Matrix& A, double T, const Vector& x, const Vector& y, const Vector& w);
  void times_and_scales();
  /// Heat in a rod of m cells, n contacts spread over it.
  void rod(Index m, Index n);
  /// Many constraints on few states.
  void wide(Index n);
  void sizes();

  bool quick_;
  std::vector<HardCase> list_;
};

}  // namespace bromwich::app::hard
