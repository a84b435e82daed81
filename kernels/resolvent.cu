// N (z_p I - A)^{-1} B at all nodes of a contour.
//
// Kronecker sum: sine mode l is one grid line with the shift z - mu_l, whose Green's function is known
// (core/dynamics/line_transfer.hpp). With s = z dx^2/c, 2 cosh theta = 2 + s and rho = e^{-theta}, |rho| <= 1, entry
// (i, j), i <= j, is
//
//     dx^2/c rho^{1+j-i} (1 - rho^{2i})/(1 - rho^2) (1 - rho^{2(Q+1-j)})/(1 - rho^{2(Q+1)}).
//
// Dense: LU factorizations with partial pivoting of all nodes at once; a single one fills a device only from about 700
// states on. Only min(n, k) right-hand sides are solved: N^T with the transposed matrix if N has fewer rows than B
// has columns.
//
// Sparse: computed by the host backend, whose elimination returns N (..) B directly.

#include "kernels/blas.hpp"
#include "kernels/parts.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/line_transfer.hpp"

#include <thrust/complex.h>

#include <algorithm>
#include <limits>
#include <vector>

namespace bromwich::cuda {

namespace {

using Number = thrust::complex<double>;

constexpr Index group_bytes = Index(1) << 30;  ///< factors and right-hand sides of one group
constexpr Index most_nodes = 4096;             ///< per group; the second grid dimension is limited to 65535
constexpr int threads = 128;

unsigned blocks(Index count) { return unsigned((count + threads - 1) / threads); }

cuDoubleComplex* plain(Number* values) { return reinterpret_cast<cuDoubleComplex*>(values); }
const Number* device_type(const Complex* values) { return reinterpret_cast<const Number*>(values); }

// e^z - 1 without cancellation for small z.
__device__ Number expm1(Number z) {
  double sine, cosine;
  sincos(z.imag(), &sine, &cosine);
  const double half = sin(0.5 * z.imag()), grown = ::expm1(z.real());
  return {grown * cosine - 2 * half * half, (grown + 1) * sine};
}

// asinh w for |w| < 0.06, where the logarithm loses digits; the next term of the series is below 1e-18.
__device__ Number small_asinh(Number w) {
  const double coefficients[] = {231. / 13312, -63. / 2816, 35. / 1152, -5. / 112, 3. / 40, -1. / 6, 1};
  const Number square = w * w;
  Number sum = 0;
  for (const double c : coefficients) sum = sum * square + c;
  return sum * w;
}

struct Line {
  int points;
  double scale;  ///< dx^2/c
};

class Green {
 public:
  __device__ Green(Line line, Number z) : line_(line) {
    const Number s = z * line.scale, root = thrust::sqrt(s * (1.0 + 0.25 * s)), grown = 1.0 + 0.5 * s;
    const Number plus = grown + root, minus = grown - root;
    rho_ = 1.0 / (thrust::norm(plus) >= thrust::norm(minus) ? plus : minus);
    if (thrust::norm(1.0 - rho_) < 0.01) {
      theta_ = 2.0 * small_asinh(0.5 * thrust::sqrt(s));
      if (theta_.real() < 0) theta_ = -theta_;
    } else {
      theta_ = -thrust::log(rho_);
    }
  }

  // i <= j, counted from 1.
  __device__ Number operator()(int i, int j) const {
    const Number far = j == i ? rho_ : thrust::exp(-double(1 + j - i) * theta_);
    const Number near = i == 1 ? Number(1) : decay(i) / decay(1);
    return line_.scale * far * near * decay(line_.points + 1 - j) / decay(line_.points + 1);
  }

 private:
  // 1 - rho^{2k}; the power is skipped if it is below rounding.
  __device__ Number decay(int k) const {
    const Number exponent = -2.0 * double(k) * theta_;
    return exponent.real() < -37 ? Number(1) : -expm1(exponent);
  }

  Line line_;
  Number rho_, theta_;
};

// One thread per mode and node. Nonzero entries of n and b: `seen` and `driven`, with positions from 1.
struct Entries {
  const int* place;
  const double* value;
  int count;
};

__global__ void line_transfers(Line line, Entries seen, Entries driven, const double* __restrict__ mu, int modes,
                               const Number* __restrict__ nodes, int first, int count, Number* __restrict__ out,
                               int* infinite) {
  const int l = blockIdx.x * threads + threadIdx.x, p = first + int(blockIdx.y);
  if (l >= modes) return;
  const Green green(line, nodes[p] - mu[l]);
  Number sum = 0;
  for (int a = 0; a < seen.count; ++a)
    for (int c = 0; c < driven.count; ++c) {
      const int i = seen.place[a], j = driven.place[c];
      sum += seen.value[a] * green(min(i, j), max(i, j)) * driven.value[c];
    }
  out[long(l) * count + p] = sum;
  if (!isfinite(sum.real() + sum.imag())) *infinite = p + 1;  // any of them
}

// z_p I - A, column-major.
__global__ void shift(const double* __restrict__ A, long m, const Number* __restrict__ nodes,
                      Number* __restrict__ out) {
  const long at = long(blockIdx.x) * threads + threadIdx.x;
  if (at >= m * m) return;
  out[blockIdx.y * m * m + at] = (at % (m + 1) == 0 ? nodes[blockIdx.y] : Number(0)) - A[at];
}

__global__ void repeat(const Number* __restrict__ from, long count, Number* __restrict__ out) {
  const long at = long(blockIdx.x) * threads + threadIdx.x;
  if (at < count) out[blockIdx.y * count + at] = from[at];
}

__global__ void point_at_blocks(Number* first, long size, int count, cuDoubleComplex** out) {
  const int p = blockIdx.x * threads + threadIdx.x;
  if (p < count) out[p] = reinterpret_cast<cuDoubleComplex*>(first + p * size);
}

Memory<Number> complex_on_device(const Device& device, const Matrix& matrix) {
  const ComplexMatrix values = matrix.cast<Complex>();
  Memory<Number> memory(device, std::size_t(values.size()));
  memory.put(device_type(values.data()));
  return memory;
}

template <class T>
Memory<T> list_on_device(const Device& device, const std::vector<T>& values) {
  Memory<T> memory(device, values.size());
  memory.put(values.data());
  return memory;
}

/// The nonzero entries of a vector.
struct EntryList {
  EntryList(const Device& device, const Vector& values) {
    std::vector<int> places;
    std::vector<double> found;
    for (Index i = 0; i < values.size(); ++i) {
      if (values[i] == 0) continue;
      places.push_back(int(i) + 1);
      found.push_back(values[i]);
    }
    place = list_on_device(device, places);
    value = list_on_device(device, found);
  }
  Entries view() const { return {place.data(), value.data(), int(place.size())}; }

  Memory<int> place;
  Memory<double> value;
};

/// Factors and solutions of as many nodes as fit.
class Group {
 public:
  Group(const Device& device, cublasHandle_t blas, const DenseDynamics& d, Index nodes)
      : device_(device),
        blas_(blas),
        m_(d.A.rows()),
        n_(d.N.rows()),
        k_(d.B.cols()),
        transposed_(n_ < k_),
        right_sides_(std::min(n_, k_)),
        size_(std::clamp<Index>(group_bytes / Index(sizeof(Number)) / (m_ * (m_ + right_sides_) + n_ * k_), 1,
                                std::min(nodes, most_nodes))),
        A_(on_device(device, d.A)),
        B_(complex_on_device(device, d.B)),
        N_(complex_on_device(device, transposed_ ? Matrix(d.N.transpose()) : d.N)),
        nodes_(device, std::size_t(size_)),
        factors_(device, std::size_t(size_ * m_ * m_)),
        solutions_(device, std::size_t(size_ * m_ * right_sides_)),
        results_(device, std::size_t(size_ * n_ * k_)),
        factor_of_(device, std::size_t(size_)),
        solution_of_(device, std::size_t(size_)),
        pivots_(device, std::size_t(size_ * m_)),
        singular_(device, std::size_t(size_)) {
    point_at_blocks<<<blocks(size_), threads, 0, device.stream()>>>(factors_.data(), m_ * m_, int(size_),
                                                                    factor_of_.data());
    point_at_blocks<<<blocks(size_), threads, 0, device.stream()>>>(solutions_.data(), m_ * right_sides_, int(size_),
                                                                    solution_of_.data());
  }

  Index size() const { return size_; }

  /// Rows of `out`: n x k values of each node, row by row. Returns a node at which zI - A is singular, or -1.
  Index run(const Complex* nodes, Index count, Complex* out) {
    check(cudaMemcpyAsync(nodes_.data(), nodes, sizeof(Complex) * std::size_t(count), cudaMemcpyHostToDevice,
                          device_.stream()),
          "copying to the device");
    const dim3 all(blocks(m_ * m_), unsigned(count)), right(blocks(m_ * right_sides_), unsigned(count));
    shift<<<all, threads, 0, device_.stream()>>>(A_.data(), m_, nodes_.data(), factors_.data());
    repeat<<<right, threads, 0, device_.stream()>>>((transposed_ ? N_ : B_).data(), m_ * right_sides_,
                                                    solutions_.data());
    check(cudaGetLastError(), "starting the shifted solves");
    factor_and_solve(int(count));
    multiply(int(count));
    check(cudaMemcpyAsync(out, results_.data(), sizeof(Complex) * std::size_t(count * n_ * k_), cudaMemcpyDeviceToHost,
                          device_.stream()),
          "copying from the device");
    std::vector<int> singular(singular_.size());
    singular_.get(singular.data());
    const auto first = std::find_if(singular.begin(), singular.begin() + count, [](int info) { return info != 0; });
    return first == singular.begin() + count ? -1 : Index(first - singular.begin());
  }

 private:
  void factor_and_solve(int count) {
    const int m = int(m_), sides = int(right_sides_);
    check(cublasZgetrfBatched(blas_, m, factor_of_.data(), m, pivots_.data(), singular_.data(), count),
          "factoring the shifted matrices");
    int refused = 0;  // set for invalid arguments, never by a singular matrix
    check(cublasZgetrsBatched(blas_, transposed_ ? CUBLAS_OP_T : CUBLAS_OP_N, m, sides, factor_of_.data(), m,
                              pivots_.data(), solution_of_.data(), m, &refused, count),
          "the shifted solves");
  }

  // Column-major, so the transpose (k x n) of each result is formed: B^T X or X^T N^T.
  void multiply(int count) {
    const int m = int(m_), n = int(n_), k = int(k_);
    const cuDoubleComplex one{1, 0}, zero{0, 0};
    const long long block = m_ * right_sides_;
    const auto *X = plain(solutions_.data()), *B = plain(B_.data()), *N = plain(N_.data());
    check(transposed_ ? cublasZgemmStridedBatched(blas_, CUBLAS_OP_T, CUBLAS_OP_N, k, n, m, &one, B, m, 0, X, m, block,
                                                  &zero, plain(results_.data()), k, n_ * k_, count)
                      : cublasZgemmStridedBatched(blas_, CUBLAS_OP_T, CUBLAS_OP_T, k, n, m, &one, X, m, block, N, n, 0,
                                                  &zero, plain(results_.data()), k, n_ * k_, count),
          "the product with the solutions");
  }

  const Device& device_;
  cublasHandle_t blas_;
  Index m_, n_, k_;
  bool transposed_;
  Index right_sides_, size_;
  Memory<double> A_;
  Memory<Number> B_, N_, nodes_, factors_, solutions_, results_;
  Memory<cuDoubleComplex*> factor_of_, solution_of_;
  Memory<int> pivots_, singular_;  ///< singular: index of the first zero pivot of each node, from 1, or 0
};

using NodeRows = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

void refuse_infinite(const NodeRows& R, const ComplexVector& nodes) {
  for (Index p = 0; p < nodes.size(); ++p)
    if (!R.row(p).allFinite()) throw eigenvalue_at(nodes[p]);
}

}  // namespace

ComplexMatrix Resolvent::operator()(const KroneckerDynamics& d, const ComplexVector& nodes) {
  const Vector mu = d.face_eigenvalues().array() - d.across.decay;
  const Index n = mu.size();
  const int count = int(nodes.size());
  ComplexMatrix R(nodes.size(), n);
  const Line line{int(d.across.points), d.across.spacing * d.across.spacing / d.across.diffusivity};
  const EntryList seen(device_, d.n), driven(device_, d.b);
  const Memory<double> modes = on_device(device_, mu);
  Memory<Number> shifts(device_, std::size_t(count)), values(device_, std::size_t(R.size()));
  Memory<int> infinite(device_, 1);
  infinite.clear();
  shifts.put(device_type(nodes.data()));
  for (int first = 0; first < count; first += int(most_nodes)) {
    const dim3 grid(blocks(n), unsigned(std::min(int(most_nodes), count - first)));
    line_transfers<<<grid, threads, 0, device_.stream()>>>(line, seen.view(), driven.view(), modes.data(), int(n),
                                                           shifts.data(), first, count, values.data(), infinite.data());
    check(cudaGetLastError(), "starting the shifted solves");
  }
  values.get(reinterpret_cast<Number*>(R.data()));
  int node = 0;
  infinite.get(&node);
  if (node > 0) throw eigenvalue_at(nodes[node - 1]);
  return R;
}

ComplexMatrix Resolvent::operator()(const DenseDynamics& d, const ComplexVector& nodes) {
  NodeRows R = NodeRows::Zero(nodes.size(), d.N.rows() * d.B.cols());
  if (R.size() == 0 || d.A.rows() == 0) return R;
  const std::shared_ptr<Blas> blas = shared_blas(device_);
  Group group(device_, blas->handle, d, nodes.size());
  for (Index first = 0; first < nodes.size(); first += group.size()) {
    const Index count = std::min(group.size(), nodes.size() - first);
    const Index singular = group.run(nodes.data() + first, count, R.row(first).data());
    if (singular >= 0) throw eigenvalue_at(nodes[first + singular]);
  }
  refuse_infinite(R, nodes);
  return R;
}

}  // namespace bromwich::cuda
