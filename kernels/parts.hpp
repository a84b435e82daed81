#pragma once
// The makers of the plans of kernels/.

#include "core/seam/chunk_march.hpp"
#include "core/seam/point_responses.hpp"
#include "core/seam/scene_arrays.hpp"
#include "core/seam/scene_march.hpp"
#include "kernels/device.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich::cuda {

std::unique_ptr<RowTransform> make_sine_transform(const Device&, Index n, Index rows);
/// The three implementations: one kernel for n + 1 a power of two, 16 to 4096 (`has_sine_rows`), a product with the
/// dense matrix, and cuFFT.
bool has_sine_rows(Index n);
std::unique_ptr<RowTransform> make_sine_rows(const Device&, Index n);
std::unique_ptr<RowTransform> make_sine_product(const Device&, Index n);
std::unique_ptr<RowTransform> make_sine_fft(const Device&, Index n, Index rows);
/// Rows P^T for an n x n matrix P.
std::unique_ptr<RowTransform> make_row_product(const Device&, const Matrix& P);
/// Three directions and more: the shortest ones together. A side with sine modes takes `make_sine_transform`.
std::unique_ptr<RowTransform> make_face_transform(const Device&, const FaceBasis&, Way);
std::unique_ptr<Convolution> make_convolution(const Device&, const DenseRecurrence&, Index rows);
std::unique_ptr<Convolution> make_convolution(const Device&, const ModalRecurrence&, Index rows);
/// The two implementations, used alone or on different modes. The scan takes modes 0 .. modes - 1. The direct sum takes
/// modes first .. n - 1 with weights up to lag lengths[l] of mode l, on the given stream, for a recurrence without
/// `initial`.
/// All modes, with the rates that each group of them needs (core/kernel/shells.hpp), without `initial`.
std::unique_ptr<Convolution> make_shell_scan(const Device&, const ModalRecurrence&, Index rows);
std::unique_ptr<Convolution> make_modal_scan(const Device&, const ModalRecurrence&, Index modes, Index rows);
std::unique_ptr<Convolution> make_direct_convolution(const Device&, cudaStream_t, const ModalRecurrence&,
                                                     const std::vector<Index>& lengths, Index first, Index rows);
std::unique_ptr<Convolution> make_convolution(const Device&, const LagTable&, Index rows);
/// Records operations as a CUDA graph; empty above the size at which launch overhead is hidden.
std::function<void()> record(const Device&, Index values, const std::function<void()>& operations);
void upload_product(const Device&, const RowMatrix& amplitudes, const Matrix& shapes, Array& to);
void upload_projection(const Device&, const Vector& values, const Array& P, Array& to);
void inject(const Device&, const Array& fine, Array& coarse);
void interpolate(const Device&, const Array& coarse, const Array* old, Array& fine);
void restrict_problem(const Device&, const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                      Array& coarse_r, Array& coarse_y, Array& old);
void take_stages(const Device&, const Array& stages, Array& first, Array& second);
void put_stages(const Device&, const Array& first, const Array& second, Array& stages);
void sweep_stages(const Device&, const StageDivisors&, const Array& r, const Array& v, Array& y);
void restrict_stages(const Device&, const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                     Array& coarse_r, Array& coarse_y, Array& old);
/// Of core/seam/slab_operations.hpp.
void move_rows(const Device&, const Array* from, Index first, Index ratio, Array& to, Index begin, Index count);
void download_rows(const Device&, const Array& from, Index first, Index count, double* to);
void upload_rows(const Device&, const double* from, Array& to, Index first, Index count);
void interpolate_rows(const Device&, const Array& coarse, const Array* old, Index ratio, Index first, Array& fine);
std::unique_ptr<CarriedConvolution> make_carried_scan(const Device&, const ModalRecurrence&,
                                                      const std::vector<Index>& ends, int rank);
void add(const Device&, const Array& b, double s, const Array& c, Array& a);
std::unique_ptr<Differences> make_differences(const Device&, std::size_t slots);
bool alternates(const Device&, const Array& y, Index run, double part);
/// Null if the matrix is too large for these kernels.
std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Device&, const Tridiagonal&, LcpClass, double shift, Index rows);
/// Null where M is no five-point stencil on a face that a block can take.
std::unique_ptr<LcpBatch> make_projected_sweeps(const Device&, const ProjectedSweeps&, Index rows);
std::unique_ptr<LcpBatch> make_face_lcp(const Device&, const SparseMatrix& M, Index rows);
std::unique_ptr<LcpBatch> make_dense_lcp(const Device&, const Matrix&, LcpClass, Index rows);

/// With contact on a face of 2^k - 1 points in both directions; null elsewhere and where its iteration is slow.
std::unique_ptr<March> make_face_march(const Device&, Backend& host, const MarchProblem&, const ModalRecurrence&,
                                       Index rows);
/// Marches without a kernel run on `host`.
std::unique_ptr<March> make_march(const Device&, Backend& host, const MarchProblem&, Index rows);

/// Null for sparse maps with many states and for very long chains.
std::unique_ptr<StepChain> make_step_chain(const Device&, const StepChainProblem&);

/// Null for more than 8 states or 8 unknowns of a step.
std::unique_ptr<SceneMarch> make_scene_march(const Device&, const SceneMarchProblem&, Index scenes);

/// With m states, padded: 2, 4, 8 or 16 (core/seam/chunk_march.hpp).
template <Index m, bool continuous>
std::unique_ptr<ChunkMarch> make_chunks(const Device&, const ChunkMarchProblem&);
/// Null for sizes that it does not take.
std::unique_ptr<ChunkMarch> make_chunk_march(const Device&, const ChunkMarchProblem&);

/// Of core/seam/point_responses.hpp; the factors of the nodes by the threads of the host.
std::unique_ptr<PointResponses> make_point_responses(const Device&, const HostThreads&, const PointResponseProblem&);

/// Of core/seam/scene_arrays.hpp.
std::unique_ptr<SceneArrays> make_scene_arrays(const Device&, const SceneArraysProblem&, Index scenes);

/// Null for more than 32 states.
std::unique_ptr<AffineChain> make_affine_chain(const Device&, const AffineChainSizes&);

/// Shifted solves of sparse dynamics: by cuDSS if the user asks for it (kernels/cudss.hpp). The backend `host` solves
/// what is left, or all of it. Waits for the results.
ComplexMatrix sparse_resolvent(const Device&, Backend& host, const Dynamics&, const ComplexVector& nodes);

/// Of core/seam/shared_memory.hpp.
std::shared_ptr<double> numbers(Index values);
void read(const Device&, const double* from, Array& to);
void write(const Device&, const Array& from, double* to);
void to_host(const Device&, const void* from, std::size_t bytes, void* to);
void add_product(const Device&, const LcpMatrix& M, const Array& y, Array& q);

/// Shifted solves of dense scenes and Kronecker sums. Waits for the results.
class Resolvent {
 public:
  explicit Resolvent(const Device& device) : device_(device) {}

  ComplexMatrix operator()(const KroneckerDynamics&, const ComplexVector& nodes);
  ComplexMatrix operator()(const DenseDynamics&, const ComplexVector& nodes);

 private:
  const Device& device_;
};

}  // namespace bromwich::cuda
