#include "core/kernel/shared_dynamics.hpp"

#include "core/lcp/lcp_class.hpp"
#include "core/lcp/same_matrix.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index largest_kept_step = 512;                    ///< states: three matrices of 2 MiB
constexpr double earlier_fit = 64;                          ///< six halvings; the number of rates hardly changes
constexpr double most_kept_bytes = double(Index(1) << 28);  ///< of shifted solves
constexpr std::size_t most_dynamics = 4;                    ///< a scene, and what three reductions make of it

PreparationCounts operator+(PreparationCounts a, const PreparationCounts& b) {
  a.exponentials += b.exponentials;
  a.doublings += b.doublings;
  a.factorizations += b.factorizations;
  a.spectra += b.spectra;
  a.fits += b.fits;
  a.initial_fits += b.initial_fits;
  a.shifted_solves += b.shifted_solves;
  a.classifications += b.classifications;
  return a;
}

}  // namespace

double KernelFit::error_from(double h) const {
  if (sum.rates.size() == 0) return sum.error;  // the kernel has decayed at t = h
  const auto size = [&](double t) {
    return (sum.coefficients.transpose() * (t * sum.rates.array()).exp().matrix()).cwiseAbs().maxCoeff();
  };
  const double of_fit = size(from), of_grid = size(h);
  return of_grid > 0 && of_grid < of_fit ? sum.error * of_fit / of_grid : sum.error;
}

SharedDynamics::SharedDynamics(Dynamics dynamics, bool many_grids)
    : dynamics_(std::move(dynamics)), many_grids_(many_grids) {}

PhiFamily& SharedDynamics::family() {
  if (!family_) family_.emplace(dynamics_->small_state() ? dynamics_->small_state()->A : dense().A);
  return *family_;
}

const DenseDynamics& SharedDynamics::dense() {
  const std::lock_guard lock(mutex_);
  if (const DenseDynamics* small = dynamics_->small_state()) return *small;
  if (!dense_) dense_ = to_dense(dynamics_);
  return *dense_;
}

std::shared_ptr<const StepOperators> SharedDynamics::step(Rule rule, double h, Index J) {
  const std::lock_guard lock(mutex_);
  const Matrix& A = dynamics_->small_state()->A;
  if (rule == Rule::exponential) {
    if (needs_precision(A, h, J)) {
      ++counts_.exponentials;
      return std::make_shared<const StepOperators>(step_operators(A, rule, h, J));
    }
    return std::make_shared<const StepOperators>(exponential_step(*family().phi(h), h));
  }
  if (const auto found = euler_.find(h); found != euler_.end()) return found->second;
  ++counts_.factorizations;
  auto made = std::make_shared<const StepOperators>(step_operators(A, rule, h, J));
  if (A.rows() <= largest_kept_step) euler_[h] = made;
  return made;
}

std::shared_ptr<const std::vector<Matrix>> SharedDynamics::phis(double h) {
  const std::lock_guard lock(mutex_);
  return family().phis(h);
}

Spectrum SharedDynamics::spectrum() {
  const std::lock_guard lock(mutex_);
  if (!spectrum_) {
    ++counts_.spectra;
    spectrum_ = dynamics_->spectrum();
  }
  return *spectrum_;
}

std::shared_ptr<KernelFit> SharedDynamics::fit(double h, double T) {
  const std::lock_guard lock(mutex_);
  for (const auto& kept : fits_)
    if (kept->T == T && (kept->from == h || (kept->from < h && kept->error_from(h) <= accepted_compression_error)))
      return kept;
  const auto made = std::make_shared<KernelFit>();
  made->T = T;
  for (const double earlier : {earlier_fit, 1.0}) {
    if (earlier > 1 && !many_grids_) continue;
    ++counts_.fits;
    made->from = h / earlier;
    made->sum = compress_line_kernel(*dynamics_->modes(), made->from, T);
    if (made->error_from(h) <= accepted_compression_error) break;
  }
  fits_.push_back(made);
  return made;
}

const InitialFit& SharedDynamics::initial_fit(Backend& backend, KernelFit& fit) {
  const std::lock_guard lock(mutex_);
  if (!fit.initial) {
    ++counts_.initial_fits;
    fit.initial = fit_initial_response(backend, *dynamics_->modes(), fit.sum, fit.from, fit.T);
  }
  return *fit.initial;
}

std::vector<LagWindow> SharedDynamics::windows(const ContourParameters& parameters, double h, Index J, double shift) {
  const std::lock_guard lock(mutex_);
  if (!many_grids_) return lag_windows(parameters, h, J, shift);
  if (first_step_ == 0) first_step_ = h;
  return shared_lag_windows(parameters, h, J, shift, first_step_);
}

ComplexMatrix SharedDynamics::resolvents(Backend& backend, const Dynamics& wide, const ComplexVector& nodes) {
  const std::lock_guard lock(mutex_);
  const SparseMatrix inputs = wide->inputs(), outputs = wide->outputs();
  const Index width = inputs.cols() * outputs.rows();
  if (!same(inputs, inputs_) || !same(outputs, outputs_)) {
    rows_.clear();
    inputs_ = inputs;
    outputs_ = outputs;
  }
  std::vector<Index> missing;
  const auto key = [&](Index p) { return std::pair(nodes[p].real(), nodes[p].imag()); };
  for (Index p = 0; p < nodes.size(); ++p)
    if (rows_.count(key(p)) == 0) missing.push_back(p);
  counts_.shifted_solves += Index(missing.size());
  if (Index(missing.size()) == nodes.size() && !many_grids_) return backend.resolvent(wide, nodes);
  ComplexMatrix R(nodes.size(), width);
  for (Index p = 0; p < nodes.size(); ++p)
    if (const auto found = rows_.find(key(p)); found != rows_.end()) R.row(p) = found->second.transpose();
  if (missing.empty()) return R;
  R(missing, Eigen::all) = backend.resolvent(wide, nodes(missing));
  const double bytes = double(rows_.size() + missing.size()) * double(width) * double(sizeof(Complex));
  if (bytes <= most_kept_bytes)
    for (const Index p : missing) rows_[key(p)] = R.row(p).transpose();
  return R;
}

PreparationCounts SharedDynamics::counts() const {
  const std::lock_guard lock(mutex_);
  PreparationCounts all = counts_;
  if (!family_) return all;
  all.exponentials += family_->counts().made;
  all.doublings += family_->counts().doubled;
  return all;
}

std::shared_ptr<SharedDynamics> GridFamily::of(const Dynamics& dynamics) {
  for (const auto& member : members_)
    if (&*member->dynamics() == &*dynamics) return member;
  if (members_.size() == most_dynamics) {
    of_others_ = of_others_ + members_.front()->counts();
    members_.erase(members_.begin());
  }
  members_.push_back(std::make_shared<SharedDynamics>(dynamics, many_grids_));
  return members_.back();
}

LcpClass GridFamily::lcp_class(const Scene& scene) {
  if (is_stated(scene.lcp_class)) return scene.lcp_class;
  if (!class_ || !same(class_->first, scene.M)) {
    ++of_others_.classifications;
    class_ = {scene.M, classify(scene.M)};
  }
  return class_->second;
}

PreparationCounts GridFamily::counts() const {
  PreparationCounts all = of_others_;
  for (const auto& member : members_) all = all + member->counts();
  return all;
}

}  // namespace bromwich
