#pragma once
// Responses of an inverse Laplace transform whose contour is another one at every time point, (2.17) of the paper:
//
//     v_j = Re Σ_p c_p R_p ∫_0^{t_j} e^{z_p (t_j - s)} u(s) ds,   R_p = N (z_p I - A)^{-1} B,   j = 1..J,   v_0 = 0,
//
// for u piecewise linear on the grid t_j = j h. With x = h z_p and q = e^x the integral is
//
//     h (phi2(x) u_j + phi1(x)^2 Σ_{l=1}^{j-1} q^{j-1-l} u_l + q^{j-1} (phi1 - phi2)(x) u_0).

#include "../base/plan.hpp"
#include "../base/threads.hpp"
#include "../base/types.hpp"
#include "array.hpp"

#include <memory>
#include <vector>

namespace bromwich {

class Backend;

/// The contours of the time points first, first + 1, ...
struct PointContours {
  Index first = 1;
  std::vector<Index> begin;  ///< those of point first + i are begin[i] .. begin[i + 1] - 1
  ComplexVector nodes;       ///< z_p, 1/time
  ComplexVector weights;     ///< c_p

  Index points() const { return Index(begin.size()) - 1; }
};

/// What a node gives to its time point, c_p included.
struct PointFactor {
  Complex step;   ///< q
  Complex first;  ///< c h q^{j-1} (phi1 - phi2), of u_0
  Complex inner;  ///< c h phi1^2, of Σ q^{j-1-l} u_l
  Complex last;   ///< c h phi2, of u_j
  Index terms;    ///< of that sum, from l = j-1 down, which are not below 1e-18 of the first one
};

struct PointResponseProblem {
  double h = 0;        ///< step
  Index inputs = 0;    ///< k, columns of u
  Index outputs = 0;   ///< n, columns of v
  bool modal = false;  ///< n = k, and R_p has n values, each of its own column; otherwise n x k, row by row
};

class PointResponses : public Plan {
 public:
  /// More time points. R: a row for each node, as Backend::resolvent gives it.
  virtual void add(const PointContours&, ComplexMatrix R) = 0;
  /// u: (J+1) x k, v: (J+1) x n, not the same array. All points 1..J must have been added.
  virtual void apply(const Array& u, Array& v) = 0;
};

/// An optional operation of a backend, which one method needs: such a backend is one of these, too.
class PointResponder {
 public:
  virtual ~PointResponder() = default;
  virtual std::unique_ptr<PointResponses> point_responses(const PointResponseProblem&) = 0;
};

/// By the backend, or by the threads of the host, with arrays copied where they are not in its memory.
std::unique_ptr<PointResponses> make_point_responses(Backend&, const PointResponseProblem&);

/// One for each node.
std::vector<PointFactor> point_factors(const HostThreads&, double h, const PointContours&);

}  // namespace bromwich
