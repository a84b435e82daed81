#include "core/dynamics/sparse_shifts.hpp"

#include "core/base/interruption.hpp"
#include "core/dynamics/front_factors.hpp"

#include <algorithm>
#include <atomic>
#include <memory>
#include <vector>

namespace bromwich {

namespace multifrontal {

namespace {

constexpr double accepted_of_known = 1e-8;  ///< of the largest entry of a known solution: as in sparse_solves.cpp

Entry lanes_of(const ComplexVector& nodes, Index group) {
  Entry z;
  for (Index lane = 0; lane < lanes; ++lane) {
    const Complex node = nodes[std::min(group * lanes + lane, nodes.size() - 1)];
    z.re[lane] = node.real();
    z.im[lane] = node.imag();
  }
  return z;
}

Index used_lanes(const ComplexVector& nodes, Index group) { return std::min(lanes, nodes.size() - group * lanes); }

class AllFactors final : public SparseShifts::Factors {
 public:
  AllFactors(const System& system, const ComplexVector& nodes, const HostThreads& threads)
      : s_(system), nodes_(nodes), groups_(std::size_t(blocks(nodes.size()))) {
    std::atomic<bool> stopped = false;  // the user is asked by the calling thread alone
    share_each(threads, Index(groups_.size()), [&](Index g) {
      if (stopped) return;
      try {
        check_interruption();
      } catch (...) {
        stopped = true;
        throw;
      }
      groups_[std::size_t(g)] = std::make_unique<FrontFactors>(s_, lanes_of(nodes_, g));
    });
  }

  std::size_t bytes() const override {
    std::size_t sum = 0;
    for (const auto& group : groups_) sum += group->bytes();
    return sum;
  }

  ComplexMatrix solve(const ComplexMatrix& right, bool transposed, const HostThreads& threads) const override {
    const Index m = right.rows();
    ComplexMatrix found(m, right.cols());
    share_each(threads, Index(groups_.size()), [&](Index g) {
      const Index used = used_lanes(nodes_, g), first = g * lanes;
      std::vector<Entry> x(std::size_t(m), Entry{all(0), all(0)});
      for (Index at = 0; at < m; ++at)
        for (Index lane = 0; lane < used; ++lane) {
          const Complex value = right(s_.plan.order[std::size_t(at)], first + lane);
          x[std::size_t(at)].re[lane] = value.real();
          x[std::size_t(at)].im[lane] = value.imag();
        }
      const FrontFactors& factors = *groups_[std::size_t(g)];
      transposed ? factors.solve_transposed(x.data()) : factors.solve(x.data());
      for (Index at = 0; at < m; ++at)
        for (Index lane = 0; lane < used; ++lane)
          found(s_.plan.order[std::size_t(at)], first + lane) =
              Complex(x[std::size_t(at)].re[lane], x[std::size_t(at)].im[lane]);
    });
    return found;
  }

  // Whether u = ±1 is found from (zE - A) u.
  bool finds_known(const HostThreads& threads) const {
    ComplexMatrix right(s_.u.size(), nodes_.size());
    for (Index p = 0; p < nodes_.size(); ++p) right.col(p) = nodes_[p] * s_.Eu.cast<Complex>() - s_.Au.cast<Complex>();
    const ComplexMatrix found = solve(right, false, threads);
    return found.allFinite() && (found.colwise() - s_.u.cast<Complex>()).cwiseAbs().maxCoeff() <= accepted_of_known;
  }

 private:
  const System& s_;
  const ComplexVector nodes_;
  std::vector<std::unique_ptr<FrontFactors>> groups_;
};

}  // namespace

}  // namespace multifrontal

struct SparseShifts::Impl {
  explicit Impl(const SparseDynamics& d) : N(0, d.A.cols()), system(d.A, d.E, SparseMatrix(d.A.rows(), 0), N) {}

  const SparseMatrix N;  ///< none
  const multifrontal::System system;
};

SparseShifts::SparseShifts(const SparseDynamics& d) : impl_(std::make_unique<const Impl>(d)) {}
SparseShifts::~SparseShifts() = default;

std::shared_ptr<const SparseShifts::Factors> SparseShifts::factorize(const ComplexVector& nodes,
                                                                     const HostThreads& threads) const {
  auto made = std::make_shared<const multifrontal::AllFactors>(impl_->system, nodes, threads);
  return made->finds_known(threads) ? made : nullptr;
}

}  // namespace bromwich
