#include "batch/active_set_table.hpp"

#include "core/host/set_map.hpp"
#include "core/lcp/other_solutions.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

ActiveSetTable::ActiveSetTable(const Matrix& M, const Matrix* least_of)
    : M_(M),
      judged_(least_of != nullptr),
      least_of_(least_of ? RowMatrix(*least_of) : RowMatrix()),
      scale_(equilibrate(M)),
      scaled_(scaled(M, scale_)),
      entries_(std::size_t(1) << M.rows()),
      ready_(std::size_t(1) << M.rows()) {}

const ActiveSetTable::Entry& ActiveSetTable::at(unsigned set) const {
  if (const Entry* made = ready_[set].load(std::memory_order_acquire)) return *made;
  const std::lock_guard lock(mutex_);
  std::unique_ptr<Entry>& entry = entries_[set];
  if (!entry) {
    entry = std::make_unique<Entry>();
    make(set, *entry);
    ready_[set].store(entry.get(), std::memory_order_release);
  }
  return *entry;
}

void ActiveSetTable::make(unsigned set, Entry& entry) const {
  if (judged_ && !scene_steps::set_has_positive_pivots(size(), set, least_of_.data())) return;
  entry.usable = scene_steps::map_of_set(size(), set, scaled_.data(), scale_.rows.data(),
                                         [&](Index k) -> double& { return entry.V[std::size_t(k)]; });
}

bool ActiveSetTable::solve(const double* q, unsigned& set, double* value) const {
  const Index n = size();
  double largest = 0;
  for (Index i = 0; i < n; ++i) largest = std::max(largest, std::abs(scale_.rows[i] * q[i]));
  if (!std::isfinite(largest)) return false;
  const double rounding = 16 * epsilon * largest;
  std::array<unsigned, 32> visited{};
  const std::size_t most = std::size_t(12 + n);
  for (std::size_t sweep = 0; sweep < most; ++sweep) {
    const Entry& entry = at(set);
    if (!entry.usable) return false;
    unsigned flips = 0;
    for (Index i = 0; i < n; ++i) {
      double sum = 0, terms = 0;
      for (Index j = 0; j < n; ++j) {
        const double term = entry.V[std::size_t(i * n + j)] * q[j];
        sum += term;
        terms += std::abs(term);
      }
      value[i] = sum;
      if (sum < -rounding && sum < -16 * epsilon * terms) flips |= 1u << i;
    }
    if (flips == 0) return true;
    visited[sweep] = set;
    set ^= flips;
    if (std::find(visited.begin(), visited.begin() + std::ptrdiff_t(sweep) + 1, set) !=
        visited.begin() + std::ptrdiff_t(sweep) + 1)
      return false;
  }
  return false;
}

OtherSolutions::OtherSolutions(const Matrix& M) : M_(M), size_of_M_(M.cwiseAbs()) {
  const Index n = M.rows();
  for (unsigned set = 0; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    Matrix inverse = Matrix::Zero(n, n);
    if (!S.empty()) {
      const Eigen::PartialPivLU<Matrix> lu(M(S, S));
      if (!(lu.rcond() > 1e-12)) {  // as in another_solution
        singular_ = true;
        inverses_.emplace_back();
        continue;
      }
      inverse(S, S) = Matrix(lu.inverse());
    }
    inverses_.push_back(std::move(inverse));
  }
}

// A clear case is decided here; another_solution decides the others.
bool OtherSolutions::any(const Vector& q, const Vector& y) const {
  constexpr double loose = 1e-8, strict = 1e-11, distinct = 1e-6;
  const Index n = q.size();
  bool doubtful = singular_ && std::any_of(inverses_.begin(), inverses_.end(), [&](const Matrix& inverse) {
                    const auto set = std::size_t(&inverse - inverses_.data());
                    if (inverse.size() > 0) return false;
                    for (Index i = 0; i < n; ++i)
                      if (((set >> i) & 1) != (y[i] > 0 ? 1u : 0u)) return false;
                    return true;
                  });
  using Short = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, largest_tabulated, 1>;  // not on the heap
  Short other(n), w(n), terms(n);
  for (std::size_t set = 0; set < inverses_.size(); ++set) {
    if (inverses_[set].size() == 0) continue;
    other = -inverses_[set].lazyProduct(q);
    const double size = other.cwiseAbs().maxCoeff();
    bool may = true, does = true;
    const auto look = [&](double least, double of) {
      may = may && least >= -loose * of;
      does = does && least >= -strict * of;
    };
    for (Index i = 0; i < n && may; ++i)
      if ((set >> i) & 1) look(other[i], size);
    if (!may) continue;
    w = M_.lazyProduct(other) + q;
    terms = size_of_M_.lazyProduct(other.cwiseAbs()) + q.cwiseAbs();
    for (Index i = 0; i < n && may; ++i)
      if (!((set >> i) & 1)) look(w[i], std::max(terms[i], 1e-300));
    if (!may) continue;
    const double apart = (other - y).cwiseAbs().maxCoeff(), scale = std::max(size, y.cwiseAbs().maxCoeff());
    if (does && apart > 2 * distinct * scale) return true;
    if (apart > 0.5 * distinct * scale) doubtful = true;
  }
  return doubtful && another_solution(M_, q, y).has_value();
}

}  // namespace bromwich
