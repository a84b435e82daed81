#pragma once
// Many linear complementarity problems at once,
//
//     0 <= y_k  ⊥  w_k = M y_k + q_k >= 0,   or with a matrix M_k of each.
//
// The class of M says which solution is meant: the only one (P), the least (Z), the one of least norm (PSD); of an
// unknown class, any. Every solution is checked by its residual.

#include "backend.hpp"
#include "lcp.hpp"
#include "types.hpp"

#include <string>
#include <vector>

namespace bromwich {

enum class LcpStatus {
  solved,
  infeasible,  ///< there is no solution: proven
  unsolved,    ///< no solution was found, and none is excluded
  nonfinite,   ///< M or q has an entry that is not finite
};

/// "solved", "infeasible", ...
const char* to_string(LcpStatus);

struct LcpBatchOptions {
  LcpClass lcp_class = LcpClass::automatic;
  /// K x n, first active sets {y > 0}; empty: none is active. They change the time that a solution takes, and of an
  /// unknown class possibly which solution it is.
  RowMatrix start;
};

struct LcpBatchResult {
  RowMatrix y, w;  ///< K x n, a row for each problem; NaN where there is no solution
  std::vector<LcpStatus> status;
  Vector residual;                ///< max_i |min(y_i, w_i)| / (|q_i| + Σ_j |m_ij| y_j), rows and columns of M scaled
  Vector margin;                  ///< min_i max(y_i, w_i), scaled alike; near 0 where an index is in neither set
  std::vector<Index> iterations;  ///< active sets tried; of problems that were solved side by side their mean
  std::vector<LcpClass> classes;  ///< of M, one entry if it is shared
  Index solved() const;
};

/// Problems with one M: K x n right sides q. They are solved side by side by the backend; what it leaves is solved
/// singly on the host. Throws Error where shapes do not fit, where a shared M is not finite, and where it is not of the
/// stated class.
LcpBatchResult lcp_batch(const LcpMatrix& M, const RowMatrix& q, Backend&, const LcpBatchOptions& = {});

/// A matrix for each problem, on the threads of the host.
LcpBatchResult lcp_batch(const std::vector<Matrix>& M, const RowMatrix& q, Backend&, const LcpBatchOptions& = {});

}  // namespace bromwich
