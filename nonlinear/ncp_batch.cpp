#include "nonlinear/ncp_batch.hpp"

#include "core/lcp/active_set.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>

namespace bromwich {

namespace {

constexpr double rounding_of_newton = 1e-8;  ///< changes below that no longer halve are rounding
constexpr double shortest = 1e-3;            ///< part of a Newton step that is tried
constexpr Index of_a_thread = 16;            ///< problems in a range

// max |min(d_i y_i, F_i)|, in the units of F; infinite where F is not finite.
double natural_map(const Vector& d, const Vector& y, const Vector& F) {
  if (!F.allFinite()) return INFINITY;
  return d.cwiseProduct(y).cwiseMin(F).cwiseAbs().maxCoeff();
}

// The problems of one thread.
class NcpSolver {
 public:
  explicit NcpSolver(const NcpBatch& batch) : batch_(batch) {}

  bool solve(Index k, Vector& y, Index& iterations) {
    double before = INFINITY;
    for (Index i = 0; i < batch_.most_newton; ++i) {
      ++iterations;
      Vector F(y.size());
      Matrix J(y.size(), y.size());
      batch_.F_and_jacobian(k, y, F, J);
      Vector next = y;
      if (!F.allFinite() || !J.allFinite() || !solve_linear(J, F - J * y, next)) return false;
      const double change = (next - y).cwiseAbs().maxCoeff(), size = std::max(next.maxCoeff(), y.maxCoeff());
      const bool small = change <= rounding_of_newton * size;  // where the natural map falls to rounding
      y = small ? next : damped(k, J.diagonal().cwiseAbs(), F, y, next);
      if (change <= batch_.tolerance * size || (small && change > before / 2)) return true;
      before = change;
    }
    return false;
  }

 private:
  // The class of the last matrix is tried first: its test costs more than the problem.
  bool solve_linear(const Matrix& J, const Vector& q, Vector& y) {
    const auto as = [&](LcpClass c) {
      ActiveSetLcp lcp(J, c);
      lcp.start_from(y);
      Vector found = y;
      if (!lcp.solve(q, found).solved || !found.allFinite()) return false;
      y = found.cwiseMax(0);
      return true;
    };
    if (class_ && as(*class_)) return true;
    class_ = selection_class(LcpMatrix(J), LcpClass::automatic);
    return as(*class_);
  }

  // The longest of the steps 1, 1/2, 1/4, ... that reduces the natural map; the whole one where none does.
  Vector damped(Index k, const Vector& d, const Vector& F, const Vector& y, const Vector& next) const {
    const double now = natural_map(d, y, F);
    Vector there(y.size());
    for (double part = 1; part > shortest; part /= 2) {
      const Vector at = part == 1 ? next : Vector(y + part * (next - y));
      batch_.F(k, at, there);
      if (natural_map(d, at, there) <= (1 - 0.1 * part) * now) return at;
    }
    return next;
  }

  const NcpBatch& batch_;
  std::optional<LcpClass> class_;
};

}  // namespace

NcpReport solve_ncps(const NcpBatch& batch, const HostThreads& threads, RowMatrix& y) {
  NcpReport report;
  std::mutex mutex;
  share(threads, batch.problems, of_a_thread, [&](Index first, Index last) {
    NcpSolver solver(batch);
    NcpReport own;
    for (Index k = first; k < last; ++k) {
      Vector one = y.row(k).transpose().cwiseMax(0);
      const bool solved = one.size() == 0 || solver.solve(k, one, own.newton);
      y.row(k) = one.transpose();
      own.solved += solved;
      if (!solved && own.first_unsolved < 0) own.first_unsolved = k;
    }
    const std::lock_guard lock(mutex);
    report.solved += own.solved;
    report.newton += own.newton;
    if (own.first_unsolved >= 0 && (report.first_unsolved < 0 || own.first_unsolved < report.first_unsolved))
      report.first_unsolved = own.first_unsolved;
  });
  return report;
}

}  // namespace bromwich
