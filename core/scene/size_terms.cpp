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
constexpr double strong_pair = -0.87;                             ///< decimal logarithm, not that of a simple number

double weight_of(double size) {
  return size > -rounding ? 1 : size > small_term - rounding ? weight_below : weight_of_small;
}

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

template <typename Terms>
Vector weighted(const Terms& terms, const Vector& weights, const Vector& start) {
  const Index count = start.size();
  Vector known = Vector::Zero(count);
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < count; ++i) entries.emplace_back(i, i, least);
  for (Index k = 0; k < weights.size(); ++k) {
    const auto& [size, of, in, mean] = terms[std::size_t(k)];
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

}  // namespace

void SizeTerms::add(double size, Index of, Index in) { add_of_pair(size, NAN, of, in); }

void SizeTerms::add_of_pair(double size, double mean, Index of, Index in) {
  if (std::isfinite(size) && of != in) terms_.push_back({size, of, in, mean});
}

// Balances are exact along a tree of pairs; sweeps of Gauss and Seidel then divide what pairs disagree about.
SizeTerms::Groups SizeTerms::joined(Index count) const {
  constexpr int sweeps = 20;
  std::vector<std::vector<std::size_t>> into;  // terms of strong pairs by their row
  into.resize(std::size_t(count));
  for (std::size_t k = 0; k < terms_.size(); ++k)
    if (const Term& t = terms_[k]; t.mean > strong_pair) into[std::size_t(t.in)].push_back(k);
  // size + u_of - u_in of both terms of a pair is its mean.
  const auto balanced = [&](std::size_t k, const Vector& u) {
    return u[terms_[k].of] + terms_[k].size - terms_[k].mean;
  };
  Groups g{std::vector<Index>(std::size_t(count), -1), Vector::Zero(count), 0};
  for (Index root = 0; root < count; ++root) {
    if (g.of[std::size_t(root)] >= 0) continue;
    std::vector<Index> members{root};
    g.of[std::size_t(root)] = g.count;
    for (std::size_t next = 0; next < members.size(); ++next)
      for (const std::size_t k : into[std::size_t(members[next])]) {
        const Index found = terms_[k].of;
        if (g.of[std::size_t(found)] >= 0) continue;
        g.of[std::size_t(found)] = g.count;
        g.shape[found] = g.shape[members[next]] - terms_[k].size + terms_[k].mean;
        members.push_back(found);
      }
    double mean = 0;
    for (int sweep = 0; sweep < sweeps && members.size() > 2; ++sweep)
      for (const Index i : members) {
        double sum = 0, weights = 0;
        for (const std::size_t k : into[std::size_t(i)]) {
          const double weight = weight_of(terms_[k].mean);
          sum += weight * balanced(k, g.shape), weights += weight;
        }
        g.shape[i] = sum / weights;
      }
    for (const Index i : members) mean += g.shape[i] / double(members.size());
    for (const Index i : members) g.shape[i] -= mean;
    ++g.count;
  }
  return g;
}

// The terms that are left, with the groups as variables.
std::vector<SizeTerms::Term> SizeTerms::between(const Groups& g) const {
  std::vector<Term> terms;
  for (Term t : terms_) {
    t.size = t.of_sizes(g.shape) + t.size;
    if (t.of >= 0) t.of = g.of[std::size_t(t.of)];
    if (t.in >= 0) t.in = g.of[std::size_t(t.in)];
    if (t.of != t.in) terms.push_back(t);
  }
  return terms;
}

Vector SizeTerms::solve(Index count) const {
  constexpr int most_rounds = 16;
  const Groups groups = joined(count);
  const std::vector<Term> terms = between(groups);
  Vector weights = Vector::Ones(Index(terms.size())), u = Vector::Zero(groups.count);
  for (Index k = 0; k < weights.size(); ++k)
    if (const double mean = terms[std::size_t(k)].mean; !std::isnan(mean)) weights[k] = weight_of(mean);
  for (int round = 0; round < most_rounds; ++round) {
    u = weighted(terms, weights, u);
    if (u.size() == 0) return u;
    const Vector before = weights;
    for (Index k = 0; k < weights.size(); ++k)
      if (const Term& t = terms[std::size_t(k)]; std::isnan(t.mean)) weights[k] = weight_of(t.size + t.of_sizes(u));
    if (weights == before) break;
  }
  return u(groups.of) + groups.shape;
}

}  // namespace bromwich
