// Complementarity problems without dynamics, and Laplace inversion.

#include "bromwich/laplace_inversion.hpp"
#include "bromwich/lcp_batch.hpp"
#include "capi/arrays.hpp"
#include "capi/failures.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>

using namespace bromwich;
using namespace bromwich::capi;

namespace {

static_assert(int(LcpStatus::solved) == BROMWICH_LCP_SOLVED && int(LcpStatus::infeasible) == BROMWICH_LCP_INFEASIBLE &&
              int(LcpStatus::unsolved) == BROMWICH_LCP_UNSOLVED && int(LcpStatus::nonfinite) == BROMWICH_LCP_NONFINITE);

LcpBatchResult lcp_solved(Index n, Index count, const double* M, Index matrices, int order, const char* name,
                          const double* q) {
  if (n < 0 || count < 0)
    throw Error(n < 0 ? "n" : "count", fmt::format("found {}", n < 0 ? n : count), "give 0 or more");
  if (matrices != 1 && matrices != count)
    throw Error("matrices", fmt::format("found {}", matrices), fmt::format("give 1 or {}", count));
  given_array(M, matrices * n * n, "M");
  given_array(q, count * n, "q");
  std::vector<Matrix> all;
  for (Index k = 0; k < matrices; ++k) all.push_back(matrix_from(M + k * n * n, n, n, order, "M"));
  const RowMatrix right = Eigen::Map<const RowMatrix>(q, count, n);
  LcpBatchOptions options;
  options.lcp_class = class_of(name);
  const auto backend = make_cpu_backend();
  return matrices == 1 ? lcp_batch(LcpMatrix(all.front()), right, *backend, options)
                       : lcp_batch(all, right, *backend, options);
}

/// Calls F of the caller, whose complex numbers lie as those of the library: real part, imaginary part.
LaplaceTransform transform_of(bromwich_transform F, void* user, Index components) {
  return [=](const ComplexVector& s) -> ComplexMatrix {
    using Rows = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Rows values = Rows::Zero(s.size(), components);
    if (const int code =
            F(s.size(), reinterpret_cast<const double*>(s.data()), reinterpret_cast<double*>(values.data()), user);
        code != 0)
      throw Stopped(fmt::format("F: the function returned {}; return 0 to go on", code));
    return values;
  };
}

}  // namespace

int bromwich_lcp(int64_t n, int64_t count, const double* M, int64_t matrices, int order, const char* name,
                 const double* q, double* y, double* w, int32_t* status, double* residual) {
  return guarded([&] {
    const LcpBatchResult found = lcp_solved(n, count, M, matrices, order, name, q);
    if (y) std::copy_n(found.y.data(), found.y.size(), y);
    if (w) std::copy_n(found.w.data(), found.w.size(), w);
    if (residual) std::copy_n(found.residual.data(), found.residual.size(), residual);
    for (std::size_t k = 0; status && k < found.status.size(); ++k) status[k] = int32_t(found.status[k]);
  });
}

int bromwich_invert(bromwich_transform F, void* user, int64_t components, const double* t, int64_t count,
                    const double* singularities, int64_t singularity_count, double accuracy, double* f, double* error) {
  return guarded([&] {
    if (!F) throw Error("F", "is NULL", "give a function");
    if (components < 1) throw Error("components", fmt::format("found {}", components), "give 1 or more");
    given_array(t, count, "t");
    given_array(f, count * components, "f");
    given_array(singularities, 2 * singularity_count, "singularities");
    InversionOptions options;
    options.accuracy = accuracy;
    for (int64_t k = 0; k < singularity_count; ++k)
      options.singularities.emplace_back(singularities[2 * k], singularities[2 * k + 1]);
    const Vector times = Eigen::Map<const Vector>(t, count);
    const LaplaceInverse found = invert_laplace(transform_of(F, user, components), times, options);
    Eigen::Map<RowMatrix>(f, count, components) = found.f.real();
    if (error) Eigen::Map<RowMatrix>(error, count, components) = found.error;
  });
}
