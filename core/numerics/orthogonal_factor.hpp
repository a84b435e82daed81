#pragma once
// The factor Q of a QR factorization as a matrix. Eigen's product of reflections takes seconds to compile, here once.

#include "../base/types.hpp"

#include <Eigen/QR>

namespace bromwich {

/// The product of reflections that `householderQ()` of a factorization of an m x n matrix returns: Q, m x m.
using Reflections = Eigen::HouseholderSequence<Matrix, Vector>;

/// Q, m x m.
Matrix orthogonal_factor(const Reflections&);

/// The first `count` columns of Q, m x count.
Matrix orthogonal_columns(const Reflections&, Index count);

}  // namespace bromwich
