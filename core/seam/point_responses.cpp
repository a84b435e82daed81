#include "core/seam/point_responses.hpp"

#include "core/base/denormals.hpp"
#include "core/numerics/phi.hpp"
#include "core/seam/backend.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr Index rows_together = 128;  ///< of u in one product
constexpr double shared_work = 1e5;   ///< multiplications of a thread; below, waking it takes as long

PointFactor factor_of(Complex z, Complex c, double h, Index j) {
  const Complex x = h * z, p1 = phi1(x), p2 = phi2(x), ch = c * h;
  const double lasting = x.real() < 0 ? std::ceil(std::log(forgotten) / x.real()) : INFINITY;
  return {std::exp(x), ch * std::exp(double(j - 1) * x) * (p1 - p2), ch * p1 * p1, ch * p2,
          Index(std::min(double(j - 1), lasting))};
}

class HostPointResponses final : public PointResponses {
 public:
  HostPointResponses(Backend& backend, const PointResponseProblem& problem) : backend_(backend), p_(problem) {}

  void add(const PointContours& contours, ComplexMatrix R) override {
    groups_.push_back({contours.first, contours.begin, point_factors(backend_, p_.h, contours), std::move(R)});
  }

  void apply(const Array& u, Array& v) override {
    RowMatrix in, out;
    if (!u.host_values()) backend_.download(u, in);
    if (!v.host_values()) out.resize(v.rows(), v.cols());
    const Eigen::Map<const RowMatrix> from(u.host_values() ? u.host_values() : in.data(), u.rows(), u.cols());
    Eigen::Map<RowMatrix> to(v.host_values() ? v.host_values() : out.data(), v.rows(), v.cols());
    to.row(0).setZero();
    for (const Group& group : groups_) {
      const double products = double(group.factors.size()) * double(group.last()) * double(p_.inputs);
      const Index together = Index(std::ceil(double(group.points()) * std::min(1.0, shared_work / (1 + products))));
      share(backend_, group.points(), together, [&](Index first, Index last) {
        const FlushDenormals flush;
        Work work;
        // From the last point down: later points take longer, and the threads share the short ones in the end.
        for (Index i = first; i < last; ++i) respond(group, group.points() - 1 - i, from, to, work);
      });
    }
    if (!v.host_values()) backend_.upload(out, v);
  }

  std::size_t bytes() const override {
    std::size_t sum = 0;
    for (const Group& group : groups_)
      sum += sizeof(Complex) * std::size_t(group.R.size()) + sizeof(PointFactor) * group.factors.size();
    return sum;
  }

 private:
  struct Group {
    Index first;
    std::vector<Index> begin;
    std::vector<PointFactor> factors;
    ComplexMatrix R;

    Index points() const { return Index(begin.size()) - 1; }
    Index last() const { return first + points() - 1; }
  };
  /// Of one thread. Complex numbers are pairs of real rows, so that products with u are real.
  struct Work {
    ComplexMatrix powers, integrals;
    Eigen::ArrayXcd power, step;
    Matrix product;
  };
  using Rows = Eigen::Map<const RowMatrix>;

  void respond(const Group& group, Index point, const Rows& u, Eigen::Map<RowMatrix>& v, Work& work) const {
    const Index begin = group.begin[std::size_t(point)], count = group.begin[std::size_t(point + 1)] - begin;
    const Index j = group.first + point;
    integrate(group.factors.data() + begin, count, j, u, work);
    const auto R = group.R.middleRows(begin, count);
    if (p_.modal) {
      v.row(j) = R.cwiseProduct(work.integrals).colwise().sum().real();
      return;
    }
    for (Index i = 0; i < p_.outputs; ++i)
      v(j, i) = R.middleCols(i * p_.inputs, p_.inputs).cwiseProduct(work.integrals).sum().real();
  }

  // integrals: count x k, c_p included.
  void integrate(const PointFactor* factors, Index count, Index j, const Rows& u, Work& work) const {
    work.integrals.setZero(count, u.cols());
    work.power.setOnes(count);
    work.step.resize(count);
    for (Index p = 0; p < count; ++p) work.step[p] = factors[p].step;
    for (Index lag = 0, active = count; lag < j - 1 && active > 0; lag += rows_together) {
      while (active > 0 && factors[active - 1].terms <= lag) --active;
      if (active == 0) break;
      const Index rows = std::min(rows_together, j - 1 - lag);
      work.powers.resize(active, rows);
      for (Index l = rows; l-- > 0; work.power.head(active) *= work.step.head(active))
        work.powers.col(l) = work.power.head(active);
      const Eigen::Map<const Matrix> pairs(reinterpret_cast<const double*>(work.powers.data()), 2 * active, rows);
      work.product.noalias() = pairs * u.middleRows(j - lag - rows, rows);
      Eigen::Map<Matrix, 0, Eigen::OuterStride<>>(reinterpret_cast<double*>(work.integrals.data()), 2 * active,
                                                  u.cols(), Eigen::OuterStride<>(2 * count)) += work.product;
    }
    for (Index k = 0; k < u.cols(); ++k)
      for (Index p = 0; p < count; ++p)
        work.integrals(p, k) =
            factors[p].inner * work.integrals(p, k) + factors[p].last * u(j, k) + factors[p].first * u(0, k);
  }

  Backend& backend_;
  PointResponseProblem p_;
  std::vector<Group> groups_;
};

}  // namespace

std::unique_ptr<PointResponses> make_point_responses(Backend& backend, const PointResponseProblem& problem) {
  if (auto* responder = dynamic_cast<PointResponder*>(&backend)) return responder->point_responses(problem);
  return std::make_unique<HostPointResponses>(backend, problem);
}

std::vector<PointFactor> point_factors(const HostThreads& threads, double h, const PointContours& contours) {
  constexpr Index together = 64;  // time points
  std::vector<PointFactor> factors(std::size_t(contours.nodes.size()));
  threads.each_range(contours.points(), together, [&](Index first, Index last) {
    for (Index i = first; i < last; ++i)
      for (Index p = contours.begin[std::size_t(i)]; p < contours.begin[std::size_t(i + 1)]; ++p)
        factors[std::size_t(p)] = factor_of(contours.nodes[p], contours.weights[p], h, contours.first + i);
  });
  return factors;
}

}  // namespace bromwich
