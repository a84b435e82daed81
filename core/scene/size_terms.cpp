#include "core/scene/size_terms.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_factorized = 100;  ///< variables; above, conjugate gradients
constexpr double small_term = -3;       ///< decimal logarithm: such a term says nothing about the sizes of others
constexpr double weight_below = 1. / 16, weight_of_small = 1e-4;  ///< of terms below 1, and of small ones
constexpr double least = 1e-9 * weight_of_small;                  ///< weight of u = 0 for a variable without terms
constexpr double rounding = 1e-6;                                 ///< of a term of size 1
constexpr double strong_pair = -0.87;                             ///< decimal logarithm, not that of a simple number

double weight_of(double size) { return size > -rounding ? 1 : size > small_term ? weight_below : weight_of_small; }

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

// Weights and sizes alternately.
template <typename Terms>
Vector reweighted(const Terms& terms, Index count) {
  constexpr int most_rounds = 16;
  Vector weights = Vector::Ones(Index(terms.size())), u = Vector::Zero(count);
  for (int round = 0; round < most_rounds; ++round) {
    u = weighted(terms, weights, u);
    if (u.size() == 0) return u;
    const Vector before = weights;
    for (Index k = 0; k < weights.size(); ++k)
      weights[k] = weight_of(terms[std::size_t(k)].size + terms[std::size_t(k)].of_sizes(u));
    if (weights == before) break;
  }
  return u;
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

// Groups whose members have sizes u far from what balances their pairs, and farther apart than that; all other
// variables are alone.
SizeTerms::Groups SizeTerms::unbalanced(const Groups& all, const Vector& u) {
  constexpr double most_apart = 4;  // decades
  const auto spread = [&all](const Vector& sizes) -> Vector {
    Vector least = Vector::Constant(all.count, INFINITY), most = -least;
    for (Index i = 0; i < sizes.size(); ++i) {
      const Index g = all.of[std::size_t(i)];
      least[g] = std::min(least[g], sizes[i]), most[g] = std::max(most[g], sizes[i]);
    }
    return most - least;
  };
  const Vector apart = spread(u - all.shape), of_u = spread(u), of_shape = spread(all.shape);
  std::vector<Index> kept(std::size_t(all.count), -1);
  Groups some{all.of, Vector::Zero(u.size()), 0};
  for (Index i = 0; i < u.size(); ++i) {
    const Index g = all.of[std::size_t(i)];
    const bool joins = apart[g] > most_apart && of_shape[g] < of_u[g];
    if (joins) some.shape[i] = all.shape[i];
    Index& of = joins ? kept[std::size_t(g)] : some.of[std::size_t(i)];
    if (!joins || of < 0) of = some.count++;
    some.of[std::size_t(i)] = of;
  }
  return some;
}

// The terms between groups, with these as variables.
std::vector<SizeTerms::Term> SizeTerms::between(const Groups& g) const {
  std::vector<Term> terms;
  for (Term t : terms_) {
    t.size += t.of_sizes(g.shape);
    if (t.of >= 0) t.of = g.of[std::size_t(t.of)];
    if (t.in >= 0) t.in = g.of[std::size_t(t.in)];
    if (t.of != t.in) terms.push_back(t);
  }
  return terms;
}

Vector SizeTerms::solve(Index count) const {
  const Vector u = reweighted(terms_, count);
  if (u.size() == 0) return u;
  const Groups groups = unbalanced(joined(count), u);
  if (groups.count == count) return u;
  const Vector of_groups = reweighted(between(groups), groups.count);
  return of_groups.size() == 0 ? of_groups : Vector(of_groups(groups.of) + groups.shape);
}

}  // namespace bromwich
