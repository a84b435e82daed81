#include "batch/active_set_table.hpp"

#include "batch/short_inverse.hpp"
#include "core/lcp/other_solutions.hpp"
#include "core/lcp/pivots.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double least_condition = 1e-7;  ///< reciprocal, of scaled blocks: y keeps nine digits beyond it
constexpr double most_inverse = 1e3;      ///< entries of V in scaled units, as those that ActiveSetLcp does not refine

}  // namespace

ActiveSetTable::ActiveSetTable(const Matrix& M, const Matrix* least_of)
    : M_(M),
      judged_(least_of != nullptr),
      least_of_(least_of ? *least_of : Matrix()),
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
  const Index n = size();
  const unsigned rest = ~set & ((1u << n) - 1);
  ShortMatrix V = ShortMatrix::Zero(n, n), inverse;
  if (set != 0) {
    if (!(invert(short_block(scaled_, set, set), inverse) > least_condition)) return;
    if (judged_ && !has_positive_pivots(Matrix(short_block(least_of_, set, set)))) return;
  }
  const ShortMatrix of_rest =
      set != 0 && rest != 0 ? ShortMatrix(short_block(scaled_, rest, set).lazyProduct(inverse)) : ShortMatrix();
  for (Index i = 0, s = 0, r = 0; i < n; ++i) {
    const bool active = set >> i & 1u;
    for (Index j = 0, c = 0; j < n; ++j)
      if (set >> j & 1u) V(i, j) = active ? -inverse(s, c++) : -of_rest(r, c++);
    if (!active) V(i, i) = 1;
    ++(active ? s : r);
  }
  if (!V.allFinite() || V.cwiseAbs().maxCoeff() > most_inverse) return;
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) entry.V[std::size_t(i * n + j)] = V(i, j) * scale_.rows[j];
  entry.usable = true;
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
