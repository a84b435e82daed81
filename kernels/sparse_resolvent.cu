// N (z_p E - A)^{-1} B for sparse A and E by cuDSS (kernels/cudss.hpp), one factorization a node.
//
// Of the bordered matrix, t = (z E - A) u with u = ±1,
//
//     [ z E - A   B   t ]
//     [   -N      0   0 ]
//
// the rows and columns of z E - A are eliminated. What is left in the last block, the Schur complement, is
// N (z E - A)^{-1} [B, t]: no solve follows, and no solution of m numbers for each column is stored. Its last column is
// known, N u: a node that misses it, also where cuDSS had to replace a pivot, is solved by the host. Zeros make the
// border square.
//
// All nodes have one pattern: it is ordered once, and kept for the next call with the same pattern. Several nodes are
// factorized side by side, since one does not fill a device.

#include "kernels/cudss.hpp"
#include "kernels/parts.hpp"

#include "core/base/error.hpp"

#include <library_types.h>
#include <thrust/complex.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich::cuda {

namespace {

using Number = thrust::complex<double>;
using RowSparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;

constexpr Index most_side_by_side = 4;
constexpr double accepted_miss = 1e-8;  ///< of the known column: as core/dynamics/sparse_solves.cpp
constexpr int allocation_failed = 2;    ///< a status of cuDSS

struct DoesNotFit {};

void require(int status, const char* what) {
  if (status == allocation_failed) throw DoesNotFit();
  if (status != 0)
    throw Error("cuDSS", std::string(what) + " failed with status " + std::to_string(status),
                "report it, and keep cuDSS from the loader's paths or use the cpu backend", ErrorKind::device);
}

/// The bordered matrix by rows, its values z e - a.
struct Bordered {
  Bordered(const SparseDynamics& d, const Vector& u)
      : states(d.A.rows()), border(std::max(d.N.rows(), d.B.cols() + 1)) {
    const RowSparse A = d.A, E = d.E, B = d.B, N = d.N;
    const Vector Au = d.A * u, Eu = d.E.rows() > 0 ? Vector(d.E * u) : u;
    for (Index i = 0; i < states; ++i) {
      add_row(A, E, i);
      for (RowSparse::InnerIterator b(B, i); b; ++b) add(states + b.col(), -b.value(), 0);
      add(states + B.cols(), Au[i], Eu[i]);
      begin.push_back(int(columns.size()));
    }
    for (Index i = 0; i < border; ++i) {
      if (i < N.rows())
        for (RowSparse::InnerIterator n(N, i); n; ++n) add(n.col(), n.value(), 0);
      add(states + i, 0, 0);
      begin.push_back(int(columns.size()));
    }
  }

  Index rows() const { return states + border; }
  bool same_pattern(const Bordered& other) const {
    return states == other.states && begin == other.begin && columns == other.columns;
  }

  Index states, border;
  std::vector<int> begin{0}, columns;
  std::vector<double> a, e;

 private:
  void add(Index column, double of_a, double of_e) {
    columns.push_back(int(column));
    a.push_back(of_a);
    e.push_back(of_e);
  }

  // The union of both patterns and the diagonal.
  void add_row(const RowSparse& A, const RowSparse& E, Index i) {
    const bool mass = E.rows() > 0;
    RowSparse::InnerIterator of_a(A, i), of_e(mass ? E : A, i);
    bool diagonal = false;
    for (;;) {
      const Index from_a = of_a ? of_a.col() : states, from_e = mass && of_e ? of_e.col() : states;
      const Index column = std::min({from_a, from_e, diagonal ? states : i});
      if (column == states) return;
      diagonal = diagonal || column == i;
      add(column, column == from_a ? of_a.value() : 0, mass ? (column == from_e ? of_e.value() : 0) : column == i);
      if (column == from_a) ++of_a;
      if (mass && column == from_e) ++of_e;
    }
  }
};

__global__ void shift(const double* __restrict__ a, const double* __restrict__ e, long count, Number z,
                      Number* __restrict__ out) {
  const long at = long(blockIdx.x) * blockDim.x + threadIdx.x;
  if (at < count) out[at] = e[at] * z - a[at];
}

/// An order of elimination as cuDSS has found it.
struct Order {
  int levels = 0;
  std::vector<int> order, tree;
};

/// Factorizes one node after the other.
class Factors {
 public:
  Factors(const Cudss& c, const Device& device, const Memory<int>& begin, const Memory<int>& columns, Index rows,
          Index border)
      : c_(c),
        border_(border),
        values_(device, columns.size()),
        schur_(device, std::size_t(border * border)),
        unused_(device, std::size_t(rows)) {
    device.wait();
    try {
      make(device, begin, columns, rows);
    } catch (...) {
      end();
      throw;
    }
  }
  ~Factors() { end(); }
  Factors(const Factors&) = delete;
  Factors& operator=(const Factors&) = delete;

  /// Orders the rows, by several threads of the host, and returns the order.
  Order analyse(const std::string& layer, int threads) {
    if (!layer.empty() && threads > 1 && c_.SetThreadingLayer(handle_, layer.c_str()) == 0)
      require(c_.ConfigSet(config_, Cudss::config_host_threads, &threads, sizeof threads), "giving it threads");
    execute(Cudss::analyse, "the analysis");
    Order order;
    std::size_t written = 0;
    require(c_.ConfigGet(config_, Cudss::config_levels, &order.levels, sizeof order.levels, &written), "asking it");
    order.order.resize(unused_.size());
    order.tree.resize((std::size_t(1) << order.levels) - 1);
    get(Cudss::data_order, order.order);
    get(Cudss::data_tree, order.tree);
    return order;
  }
  void analyse(const Order& order) {
    require(c_.ConfigSet(config_, Cudss::config_levels, &order.levels, sizeof order.levels), "giving it an order");
    set(Cudss::data_user_order, order.order);
    set(Cudss::data_user_tree, order.tree);
    execute(Cudss::analyse, "the analysis");
  }

  /// The Schur complement at z, column by column.
  void run(const Memory<double>& a, const Memory<double>& e, Complex z, ComplexMatrix& out) {
    constexpr unsigned threads = 256;
    const long count = long(values_.size());
    shift<<<unsigned((count + threads - 1) / threads), threads, 0, stream_>>>(
        a.data(), e.data(), count, Number(z.real(), z.imag()), values_.data());
    check(cudaGetLastError(), "starting the shifted solves");
    execute(factorized_ ? Cudss::factorize_again : Cudss::factorize, "the factorization");
    factorized_ = true;
    std::size_t written = 0;
    require(c_.DataGet(handle_, data_, Cudss::data_schur_matrix, &dense_, sizeof dense_, &written),
            "the factorization");
    out.resize(border_, border_);
    check(cudaMemcpyAsync(out.data(), schur_.data(), schur_.bytes(), cudaMemcpyDeviceToHost, stream_),
          "copying from the device");
    check(cudaStreamSynchronize(stream_), "waiting for the device");
  }

 private:
  void make(const Device& device, const Memory<int>& begin, const Memory<int>& columns, Index rows) {
    device.stream();  // makes this its thread's device
    check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
    require(c_.Create(&handle_), "starting it");
    require(c_.SetStream(handle_, stream_), "giving it a stream");
    require(c_.ConfigCreate(&config_), "starting it");
    require(c_.DataCreate(handle_, &data_), "starting it");
    const int off = 0, on = 1;
    require(c_.ConfigSet(config_, Cudss::config_matching, &off, sizeof off), "choosing no matching");
    require(c_.ConfigSet(config_, Cudss::config_schur, &on, sizeof on), "choosing a Schur complement");
    std::vector<int> kept(std::size_t(rows), 0);
    std::fill(kept.end() - border_, kept.end(), 1);
    set(Cudss::data_schur_rows, kept);
    require(c_.MatrixCreateCsr(&matrix_, rows, rows, std::int64_t(columns.size()), begin.data(), nullptr,
                               columns.data(), values_.data(), CUDA_R_32I, CUDA_R_32I, CUDA_C_64F, Cudss::general,
                               Cudss::full, Cudss::from_zero),
            "describing the matrix");
    require(c_.MatrixCreateDn(&vector_, rows, 1, rows, unused_.data(), CUDA_C_64F, Cudss::column_major),
            "describing a vector");
    require(c_.MatrixCreateDn(&dense_, border_, border_, border_, schur_.data(), CUDA_C_64F, Cudss::column_major),
            "describing the Schur complement");
  }

  void end() {
    if (stream_) cudaStreamSynchronize(stream_);
    for (void* made : {matrix_, vector_, dense_})
      if (made) c_.MatrixDestroy(made);
    if (data_) c_.DataDestroy(handle_, data_);
    if (config_) c_.ConfigDestroy(config_);
    if (handle_) c_.Destroy(handle_);
    if (stream_) cudaStreamDestroy(stream_);
  }

  void execute(int phase, const char* what) {
    require(c_.Execute(handle_, phase, config_, data_, matrix_, vector_, vector_), what);
  }
  void set(int which, const std::vector<int>& values) {
    require(c_.DataSet(handle_, data_, which, values.data(), sizeof(int) * values.size()), "giving it data");
  }
  void get(int which, std::vector<int>& values) {
    std::size_t written = 0;
    require(c_.DataGet(handle_, data_, which, values.data(), sizeof(int) * values.size(), &written), "asking it");
  }

  const Cudss& c_;
  Index border_;
  Memory<Number> values_, schur_, unused_;
  cudaStream_t stream_ = nullptr;
  void *handle_ = nullptr, *config_ = nullptr, *data_ = nullptr, *matrix_ = nullptr, *vector_ = nullptr,
       *dense_ = nullptr;
  bool factorized_ = false;
};

/// Factors of several nodes side by side, of one pattern.
class Pattern {
 public:
  Pattern(const LoadedCudss& library, const Device& device, const HostThreads& host, Bordered bordered)
      : library_(library),
        device_(device),
        of_(std::move(bordered)),
        begin_(device, of_.begin.size()),
        columns_(device, of_.columns.size()),
        a_(device, of_.a.size()),
        e_(device, of_.e.size()) {
    begin_.put(of_.begin.data());
    columns_.put(of_.columns.data());
    all_.push_back(factors());
    order_ = all_.front()->analyse(library.threads, host.threads());
  }

  bool fits(const Bordered& other) const { return of_.same_pattern(other); }

  /// For so many nodes at a time, with these values.
  void prepare(const Bordered& values, Index count) {
    a_.put(values.a.data());
    e_.put(values.e.data());
    while (Index(all_.size()) < std::min(count, most_side_by_side)) {
      all_.push_back(factors());
      all_.back()->analyse(order_);
    }
  }

  /// use(node, Schur complement) by several threads.
  template <class Use>
  void run(const HostThreads& host, const ComplexVector& nodes, const Use& use) {
    const Index count = Index(all_.size());
    share_each(host, count, [&](Index f) {
      device_.stream();  // makes this its thread's device
      ComplexMatrix S;
      for (Index p = f; p < nodes.size(); p += count) {
        all_[std::size_t(f)]->run(a_, e_, nodes[p], S);
        use(p, S);
      }
    });
  }

 private:
  std::unique_ptr<Factors> factors() const {
    return std::make_unique<Factors>(*library_.functions, device_, begin_, columns_, of_.rows(), of_.border);
  }

  const LoadedCudss& library_;
  const Device& device_;
  Bordered of_;
  Memory<int> begin_, columns_;
  Memory<double> a_, e_;
  Order order_;
  std::vector<std::unique_ptr<Factors>> all_;
};

Vector signs(Index count) {
  Vector u(count);
  unsigned long long random = 1;
  for (double& value : u) {
    random = random * 6364136223846793005ULL + 1442695040888963407ULL;
    value = random >> 63 ? 1 : -1;
  }
  return u;
}

// Largest deviation of column k of S from N u, relative to the sums of |N|.
double miss(const ComplexMatrix& S, Index k, const Vector& Nu, const Vector& sizes) {
  double worst = 0;
  for (Index i = 0; i < Nu.size(); ++i) {
    const double deviation = std::abs(S(i, k) - Nu[i]);
    if (!std::isfinite(deviation)) return INFINITY;
    if (sizes[i] > 0) worst = std::max(worst, deviation / sizes[i]);
  }
  return worst;
}

}  // namespace

ComplexMatrix sparse_resolvent(const Device& device, Backend& host, const Dynamics& dynamics,
                               const ComplexVector& nodes) {
  const LoadedCudss& library = cudss();
  const SparseDynamics& d = *dynamics->matrices();
  const Index n = d.N.rows(), k = d.B.cols();
  if (!library.functions || n * k == 0 || nodes.size() == 0) return host.resolvent(dynamics, nodes);
  const Vector u = signs(d.A.rows()), Nu = d.N * u, sizes = d.N.cwiseAbs() * Vector::Ones(d.N.cols());
  ComplexMatrix R(nodes.size(), n * k);
  std::vector<char> missed(std::size_t(nodes.size()), 0);
  try {
    Bordered bordered(d, u);
    const auto pattern =
        device.shared<Pattern>([&](const Pattern& kept) { return kept.fits(bordered); },
                               [&] { return std::make_shared<Pattern>(library, device, host, bordered); });
    pattern->prepare(bordered, nodes.size());
    pattern->run(host, nodes, [&](Index p, const ComplexMatrix& S) {
      for (Index i = 0; i < n; ++i)
        for (Index c = 0; c < k; ++c) R(p, i * k + c) = S(i, c);
      missed[std::size_t(p)] = !(miss(S, k, Nu, sizes) <= accepted_miss) || !R.row(p).allFinite();
    });
  } catch (const DoesNotFit&) {
    return host.resolvent(dynamics, nodes);
  }
  std::vector<Index> again;
  for (Index p = 0; p < nodes.size(); ++p)
    if (missed[std::size_t(p)]) again.push_back(p);
  if (!again.empty()) R(again, Eigen::all) = host.resolvent(dynamics, nodes(again));
  return R;
}

}  // namespace bromwich::cuda
