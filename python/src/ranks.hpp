#pragma once
// Ranks of a communicator of mpi4py, which bromwich._ranks wraps. The package is not linked with MPI: any MPI that
// mpi4py knows will do.

#include "core/result/options.hpp"
#include "core/scene/scene.hpp"
#include "core/seam/communicator.hpp"

#include <nanobind/nanobind.h>

namespace bromwich::python {

namespace nb = nanobind;

/// Each operation is a call of Python, with views of the values. What Python raises leaves the solve.
class PythonRanks final : public Communicator {
 public:
  explicit PythonRanks(nb::object ranks);

 private:
  void do_shift(const Vector& right, Vector& left) override;
  void do_gather(const Vector& values, RowMatrix& all) override;
  void do_maximum(Vector& values) override;
  void do_broadcast(double* values, Index count, int root) override;

  nb::object ranks_;
};

/// Throws Error, on all ranks, if their scenes or options differ: by sizes, sums of A, B, N, M and x0, and values of f
/// and g at a few times.
void check_same(Communicator&, const Scene&, const Options&);

}  // namespace bromwich::python
