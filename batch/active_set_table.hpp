#pragma once
// All active sets of one small matrix M, for many problems LCP(q, M): the matrix V(S) with
//
//     (y_S, w_I) = V(S) q,   y_S = -M_SS^{-1} q_S,   w_I = q_I - M_IS M_SS^{-1} q_S,
//
// in scaled units, y = C y~ and w = R^{-1} w~ (core/lcp/solution.hpp). A set is computed when it is first used. Several
// threads may use the table at once.

#include "../core/lcp/lcp_class.hpp"
#include "../core/lcp/solution.hpp"

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <vector>

namespace bromwich {

inline constexpr Index largest_tabulated = 8;  ///< n

class ActiveSetTable {
 public:
  struct Entry {
    bool usable = false;  ///< M_SS is well conditioned and the set may be that of a solution
    std::array<double, largest_tabulated* largest_tabulated> V = {};  ///< n x n row by row, of q in its own units
  };

  /// With `least_of`, only sets whose block of that matrix is an M-matrix are usable (see ActiveSetLcp).
  ActiveSetTable(const Matrix& M, const Matrix* least_of);

  const Entry& at(unsigned set) const;
  Index size() const { return M_.rows(); }
  const Matrix& matrix() const { return M_; }
  const RowMatrix& scaled_matrix() const { return scaled_; }  ///< R M C
  double row_scale(Index i) const { return scale_.rows[i]; }
  double column_scale(Index i) const { return scale_.columns[i]; }
  const Vector& row_scales() const { return scale_.rows; }
  const Vector& column_scales() const { return scale_.columns; }

  /// Semismooth Newton from `set`, which it changes. `value` gets (y_S, w_I), n numbers in scaled units. False where it
  /// meets a set that is not usable or comes back to one.
  bool solve(const double* q, unsigned& set, double* value) const;

 private:
  void make(unsigned set, Entry&) const;

  Matrix M_;
  bool judged_;
  RowMatrix least_of_;
  Equilibration scale_;
  RowMatrix scaled_;
  mutable std::mutex mutex_;
  mutable std::vector<std::unique_ptr<Entry>> entries_;
  mutable std::vector<std::atomic<const Entry*>> ready_;
};

/// Whether LCP(q, M) has a solution beside y, as another_solution finds it, from inverses that are kept.
class OtherSolutions {
 public:
  explicit OtherSolutions(const Matrix& M);
  bool any(const Vector& q, const Vector& y) const;

 private:
  Matrix M_, size_of_M_;
  std::vector<Matrix> inverses_;  ///< n x n with zeros outside S; empty where M_SS is singular
  bool singular_ = false;         ///< some block is
};

}  // namespace bromwich
