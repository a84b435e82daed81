#include "batch/batch_groups.hpp"

#include <algorithm>
#include <functional>
#include <map>
#include <utility>

namespace bromwich {

namespace {

bool same_matrix(const LcpMatrix& a, const LcpMatrix& b) {
  if (a.index() != b.index()) return false;
  const auto *p = std::get_if<Matrix>(&a), *q = std::get_if<Matrix>(&b);
  return p && q && p->rows() == q->rows() && p->cols() == q->cols() && *p == *q;
}

bool same_values(const Matrix& a, const Matrix& b) { return a.rows() == b.rows() && a.cols() == b.cols() && a == b; }

bool same_dynamics(const Dynamics& a, const Dynamics& b) {
  if (&*a == &*b) return true;
  const auto *p = a->small_state(), *q = b->small_state();
  return p && q && same_values(p->A, q->A) && same_values(p->B, q->B) && same_values(p->N, q->N) &&
         same_values(p->E, q->E);
}

// Equal for dense dynamics with equal values; others are told apart by their place.
std::size_t hash_of(const Dynamics& dynamics) {
  const DenseDynamics* dense = dynamics->small_state();
  if (!dense) return std::hash<const void*>()(&*dynamics);
  std::size_t hash = 0;
  for (const Matrix* matrix : {&dense->A, &dense->B, &dense->N, &dense->E})
    for (Index k = 0; k < matrix->size(); ++k) hash = hash * 1099511628211u + std::hash<double>()(matrix->data()[k]);
  return hash;
}

// Scenes that differ in x0, f and g at most.
bool share_preparation(const Scene& a, const Scene& b) {
  return same_dynamics(a.dynamics, b.dynamics) && a.lcp_class == b.lcp_class && a.T == b.T &&
         a.default_steps == b.default_steps && a.f_entry == b.f_entry && bool(a.f) == bool(b.f) &&
         a.free_rows == b.free_rows && !a.boundary && !b.boundary && !a.port && !b.port &&
         (a.F.size() == 0
              ? b.F.size() == 0
              : a.F.rows() == b.F.rows() && a.F.cols() == b.F.cols() && SparseMatrix(a.F - b.F).norm() == 0) &&
         same_matrix(a.M, b.M);
}

}  // namespace

bool own_matrices(const Batch& b) {
  return !b.A.empty() || !b.B.empty() || !b.N.empty() || !b.M.empty() || !b.E.empty();
}
bool own_sources(const Batch& b) {
  if (b.own.empty()) return !b.f.empty() || !b.g.empty() || !b.breakpoints.empty();
  if (b.same_sources && std::all_of(b.own.begin(), b.own.end(), [&](const Scene& s) { return s.T == b.own[0].T; }))
    return false;
  return std::any_of(b.own.begin(), b.own.end(), [](const Scene& s) { return s.f || s.g; });
}

std::vector<std::vector<Index>> groups_of(const Batch& b) {
  std::vector<std::vector<Index>> groups;
  if (b.own.empty() && !own_matrices(b)) {
    groups.emplace_back();
    for (Index k = 0; k < b.scenes; ++k) groups[0].push_back(k);
    return groups;
  }
  if (b.own.empty()) {
    for (Index k = 0; k < b.scenes; ++k) groups.push_back({k});
    return groups;
  }
  std::map<std::pair<std::size_t, double>, std::vector<std::size_t>> known;  // groups with these dynamics and T
  for (Index k = 0; k < b.scenes; ++k) {
    const Scene& scene = b.own[std::size_t(k)];
    std::vector<std::size_t>& same = known[{hash_of(scene.dynamics), scene.T}];
    const auto found = std::find_if(same.begin(), same.end(), [&](std::size_t g) {
      return share_preparation(b.own[std::size_t(groups[g].front())], scene);
    });
    if (found != same.end()) {
      groups[*found].push_back(k);
    } else {
      same.push_back(groups.size());
      groups.push_back({k});
    }
  }
  return groups;
}

}  // namespace bromwich
