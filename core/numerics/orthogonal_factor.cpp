#include "core/numerics/orthogonal_factor.hpp"

namespace bromwich {

Matrix orthogonal_factor(const Reflections& Q) { return Q; }

Matrix orthogonal_columns(const Reflections& Q, Index count) { return Q * Matrix::Identity(Q.rows(), count); }

}  // namespace bromwich
