#pragma once
// K^T of a discrete convolution, for adjoint equations: (M + K)^T mu = l runs backwards in time on the kernel of K.
// With v_j = Σ_{d<j} W_d y_{j-d} + S_j y_0 (j >= 1) and v_0 = 0,
//
//     (K^T u)_i = Σ_{j>=i} W_{j-i}^T u_j   (i >= 1),      (K^T u)_0 = Σ_{j>=1} S_j^T u_j,
//
// and u_0 has no effect. In reversed time, u~_k = u_{J+1-k}, the first is the convolution of u~ with W_d^T. Its kernel
// is B^T e^{A^T t} N^T; as a recurrence it has E^T, C^T for the input and G^T for the output.

#include "space_time_kernel.hpp"
#include "weights.hpp"

namespace bromwich {

/// The weights of K^T in reversed time; S and x0 are left out. Precondition: no PoleRecurrence.
Weights transposed(const Weights&);

class TransposedKernel {
 public:
  /// Of a K with these weights on rows - 1 steps; `weights` are applied in their form, a recurrence as a scan.
  TransposedKernel(Backend&, SharedWeights weights, Index rows);

  /// v = K^T u: u has a column for each output of K, v one for each input. Time is reversed on the host. `v` may be u.
  void apply(const Array& u, Array& v);
  /// The same for values on the host.
  RowMatrix apply(const RowMatrix& u);
  std::size_t bytes() const;

 private:
  Vector first_row(const RowMatrix& u) const;

  Backend& backend_;
  SharedWeights weights_;
  Index outputs_ = 0, inputs_ = 0, rows_ = 0;  ///< of K
  std::unique_ptr<SpaceTimeKernel> reversed_;  ///< null for few poles, whose adjoint state runs on the host
  std::unique_ptr<Array> u_, v_;               ///< in reversed time
};

}  // namespace bromwich
