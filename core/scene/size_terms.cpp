#include "core/scene/size_terms.hpp"

#include <Eigen/Cholesky>

#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_factorized = 100;  ///< variables; above, conjugate gradients
constexpr double small_term = -3;       ///< decimal logarithm: such a term says nothing about the sizes of others
constexpr double weight_below = 1. / 16, weight_of_small = 1e-4;  ///< of terms below 1, and of small ones
constexpr double least = 1e-9 * weight_of_small;                  ///< weight of u = 0 for a variable without terms
constexpr double rounding = 1e-6;                                 ///< of a term of size 1

// Conjugate gradients with the diagonal as preconditioner. Empty if they take too long.
Vector solve_by_gradients(const SparseMatrix& L, const Vector& known, Vector u) {
  constexpr int most_steps = 400;
  constexpr double accuracy = 1e-10;
  const Vector diagonal = L.diagonal();
  Vector r = known - L * u, z = r.cwiseQuotient(diagonal), p = z;
  double rz = r.dot(z);
  for (int step = 0; step < most_steps; ++step) {
    if (z.cwiseAbs().maxCoeff() <= accuracy) return u;
    const Vector Lp = L * p;
    const double alpha = rz / p.dot(Lp);
    u += alpha * p;
    r -= alpha * Lp;
    z = r.cwiseQuotient(diagonal);
    const double next = r.dot(z);
    p = z + next / rz * p;
    rz = next;
  }
  return {};
}

}  // namespace

void SizeTerms::add(double size, Index of, Index in) {
  if (std::isfinite(size) && of != in) terms_.push_back({size, of, in});
}

Vector SizeTerms::solve(Index count) const {
  constexpr int most_rounds = 16;
  Vector weights = Vector::Ones(Index(terms_.size())), u = Vector::Zero(count);
  for (int round = 0; round < most_rounds; ++round) {
    u = weighted(weights, u);
    if (u.size() == 0) return u;
    const Vector before = weights;
    for (Index k = 0; k < weights.size(); ++k) {
      const Term& t = terms_[std::size_t(k)];
      const double r = t.size + t.of_sizes(u);
      weights[k] = r > -rounding ? 1 : r > small_term ? weight_below : weight_of_small;
    }
    if (weights == before) break;
  }
  return u;
}

Vector SizeTerms::weighted(const Vector& weights, const Vector& start) const {
  const Index count = start.size();
  Vector known = Vector::Zero(count);
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < count; ++i) entries.emplace_back(i, i, least);
  for (Index k = 0; k < weights.size(); ++k) {
    const auto& [size, of, in] = terms_[std::size_t(k)];
    const double weight = weights[k];
    if (of >= 0) known[of] -= weight * size, entries.emplace_back(of, of, weight);
    if (in >= 0) known[in] += weight * size, entries.emplace_back(in, in, weight);
    if (of < 0 || in < 0) continue;
    entries.emplace_back(of, in, -weight);
    entries.emplace_back(in, of, -weight);
  }
  SparseMatrix L(count, count);
  L.setFromTriplets(entries.begin(), entries.end());
  return count > most_factorized ? solve_by_gradients(L, known, start) : Vector(Matrix(L).ldlt().solve(known));
}

}  // namespace bromwich
