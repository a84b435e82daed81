#include "core/dynamics/linear_system.hpp"

#include "core/base/text.hpp"

#include <string>

namespace bromwich {

SparseMatrix LinearSystem::rates_of_inputs(double h) const {
  if (!has_mass()) return inputs();
  const Complex z = 1e6 / h;  // beyond the spectrum that steps of length h resolve, and 10 digits above rounding
  const auto system = at_shift(z);
  if (!system) throw eigenvalue_at(z);
  return Matrix((z * system->solve(ComplexMatrix(Matrix(inputs()).cast<Complex>()))).real()).sparseView(0, 0);
}

ComplexMatrix LinearSystem::shifted_solves(const ComplexVector& nodes, const HostThreads& threads) const {
  ComplexMatrix R = solve_at(nodes, threads);
  for (Index p = 0; p < nodes.size(); ++p)
    if (!R.row(p).allFinite()) throw eigenvalue_at(nodes[p]);
  return R;
}

SingularShift eigenvalue_at(Complex z) {
  return SingularShift("resolvent",
                       text("found an eigenvalue of A at or next to the node %.6g%+.6gi", z.real(), z.imag()),
                       "choose nodes away from the spectrum");
}

void require_dense_size(Index states) {
  constexpr Index most = 4096;  // A takes 128 MiB
  if (states > most)
    throw Error("dynamics", "has " + std::to_string(states) + " states",
                "give at most " + std::to_string(most) + " for a dense form");
}

}  // namespace bromwich
