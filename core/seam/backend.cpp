#include "core/seam/backend.hpp"

namespace bromwich {

void Backend::upload_projection(const Vector& values, const Array& P, Array& to) {
  constexpr Index together = 64;  // rows of X, by one thread
  const Eigen::Map<const RowMatrix> X(values.data(), to.cols(), P.cols());
  RowMatrix weights, product(to.rows(), to.cols());
  download(P, weights);
  each_range(X.rows(), together, [&](Index first, Index last) {
    product.middleCols(first, last - first).noalias() = weights * X.middleRows(first, last - first).transpose();
  });
  upload(product, to);
}

}  // namespace bromwich
