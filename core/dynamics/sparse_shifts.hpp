#pragma once
// Solves with zE - A and its transpose at many shifts z, one right side for each, for gradients with respect to x0.
//
// The elimination of core/dynamics/sparse_solves.hpp, eight shifts at a time, with its factors kept: of each front the
// pivots, what is below them and, unless A and E are symmetric, what is to their right. One order serves all shifts.

#include "../base/threads.hpp"
#include "sparse.hpp"

#include <memory>

namespace bromwich {

class SparseShifts {
 public:
  explicit SparseShifts(const SparseDynamics&);
  ~SparseShifts();

  /// Of some shifts.
  class Factors {
   public:
    virtual ~Factors() = default;
    virtual std::size_t bytes() const = 0;
    /// Column p: (z_p E - A)^{-1} of column p of `right`, or of the transposed matrix.
    virtual ComplexMatrix solve(const ComplexMatrix& right, bool transposed, const HostThreads&) const = 0;
  };
  /// Null where pivots are so small that a known solution is not found: elimination with pivoting is needed. Must not
  /// outlive this object.
  std::shared_ptr<const Factors> factorize(const ComplexVector& nodes, const HostThreads&) const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace bromwich
