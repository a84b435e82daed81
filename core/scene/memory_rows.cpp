#include "core/scene/memory_rows.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

using Condition = Memory::Condition;

Matrix grown(const Matrix& a, Index rows, Index columns) {
  Matrix larger = Matrix::Zero(rows, columns);
  larger.topLeftCorner(a.rows(), a.cols()) = a;
  return larger;
}

// The same `width` values of `all`, zeros behind them.
TimeFunction widened(const TimeFunction& function, Index width, Index all) {
  return sum_of({{Matrix::Identity(all, width), function}});
}

}  // namespace

Scene in_modes(const Scene& scene, const std::vector<Index>& modes) {
  Scene made = scene;
  made.memories.clear();
  DenseDynamics d = *scene.dynamics->small_state();
  Matrix M = to_dense(scene.M);
  const Matrix of_f = Matrix::Identity(scene.states(), scene.states()),
               of_g = Matrix::Identity(scene.constraints(), scene.constraints());
  std::vector<SourceTerm> f{{source_matrix(scene, d), scene.f}}, g{{of_g, scene.g}};
  made.f_entry = SourceEntry::state;
  made.F = {};
  for (std::size_t k = 0; k < modes.size(); ++k) {
    const Memory::Mode& mode = scene.memories[k].modes[std::size_t(modes[k])];
    for (const auto& [all, more] : {std::pair(&d.A, &mode.A), {&d.B, &mode.B}, {&d.N, &mode.N}, {&M, &mode.M}})
      if (more->size() > 0) *all += *more;
    if (mode.M.size() > 0) made.lcp_class = LcpClass::automatic;
    f.push_back({of_f, mode.f});
    g.push_back({of_g, mode.g});
  }
  made.f = sum_of(f);
  made.g = sum_of(g);
  made.dynamics = std::move(d);
  made.M = std::move(M);
  return made;
}

const Scene& ScenesInModes::at_row(const RowMatrix& modes, Index row) {
  if (scene_.memories.empty() || modes.cols() != Index(scene_.memories.size()) || row >= modes.rows()) return scene_;
  std::vector<Index> now;
  for (const double mode : modes.row(row)) now.push_back(Index(mode));
  if (now.front() < 0) return scene_;
  const auto known = made_.find(now);
  return known != made_.end() ? known->second : made_.emplace(now, in_modes(scene_, now)).first->second;
}

namespace {

// Rows -x . x(t) - y . y(t) - time(t) behind those of the scene: of each mode of one memory up to
// `count` from `first` on.
struct Guards {
  Index n, states, rows, first, count;

  void watch(Memory::Mode& mode) const {
    Index next = first;
    mode.N = grown(mode.N, rows, states);
    mode.M = grown(mode.M, rows, rows);
    std::vector<SourceTerm> g{{Matrix::Identity(rows, n), mode.g}};
    for (Memory::Leave& leave : mode.leave)
      for (Condition& c : leave.when) {
        if (c.x.size() > 0) mode.N.row(next).head(c.x.size()) = -c.x.transpose();
        if (c.y.size() > 0) mode.M.row(next).head(n) = -c.y.transpose();
        g.push_back({-Vector::Unit(rows, next), c.time});
        c = {.guard = next++};
      }
    // Behind the conditions of the mode guards are far from 0.
    if (const Index others = first + count - next; others > 0) {
      Vector far = Vector::Zero(rows);
      far.segment(next, others).setOnes();
      g.push_back({far, one_at_all_times()});
    }
    mode.g = sum_of(g);
  }
};

// The most that one of its modes has.
Index conditions_of(const Memory& memory) {
  Index most = 0;
  for (const Memory::Mode& mode : memory.modes) {
    Index count = 0;
    for (const Memory::Leave& leave : mode.leave) count += Index(leave.when.size());
    most = std::max(most, count);
  }
  return most;
}

// The modes start as the scene says. With the condition x(0) = x(T) they are the same at both ends.
void add_boundary(Scene& scene, Index states, const std::vector<Index>& start) {
  BoundaryCondition& c = *scene.boundary;
  const Index m = c.b.size(), memories = states - m;
  const bool periodic = c.E0 == -c.ET;
  c.E0 = grown(c.E0, states, states);
  c.ET = grown(c.ET, states, states);
  c.E0.bottomRightCorner(memories, memories).setIdentity();
  if (periodic) c.ET.bottomRightCorner(memories, memories) = -Matrix::Identity(memories, memories);
  c.b.conservativeResize(states);
  for (Index k = 0; k < memories; ++k) c.b[m + k] = periodic ? 0 : double(start[std::size_t(k)]);
}

}  // namespace

Scene with_memory_rows(const Scene& given) {
  Scene scene = given;
  const Index m = given.states(), n = given.constraints(), states = m + Index(given.memories.size());
  Index rows = n;
  for (const Memory& memory : given.memories) rows += conditions_of(memory);
  const DenseDynamics& d = *given.dynamics->small_state();
  DenseDynamics larger{grown(d.A, states, states), grown(d.B, states, rows), grown(d.N, rows, states), d.E};
  if (d.E.size() > 0) {
    larger.E = Matrix::Identity(states, states);
    larger.E.topLeftCorner(m, m) = d.E;
  }
  scene.dynamics = std::move(larger);
  Matrix M = Matrix::Identity(rows, rows);
  M.topLeftCorner(n, n) = to_dense(given.M);
  scene.M = std::move(M);
  if (scene.f_entry == SourceEntry::through_F)
    scene.F.conservativeResize(states, scene.F.cols());
  else
    scene.f = widened(given.f, given.sources(), scene.f_entry == SourceEntry::through_B ? rows : states);
  scene.g = widened(given.g, n, rows);
  if (scene.restitution.size() > 0) scene.restitution = grown(given.restitution, rows, 1);
  Index guard = n;
  for (std::size_t k = 0; k < scene.memories.size(); ++k) {
    Memory& memory = scene.memories[k];
    memory.state = m + Index(k);
    const Index count = conditions_of(memory);
    const Guards guards{n, states, rows, guard, count};
    for (Memory::Mode& mode : memory.modes) {
      mode.f = widened(mode.f, m, states);
      if (mode.A.size() > 0) mode.A = grown(mode.A, states, states);
      if (mode.B.size() > 0) mode.B = grown(mode.B, states, rows);
      if (count > 0) guards.watch(mode);
    }
    guard += count;
  }
  const std::vector<Index> start = modes_at_start(given);
  if (scene.boundary)
    add_boundary(scene, states, start);
  else {
    scene.x0.conservativeResize(states);
    for (std::size_t k = 0; k < start.size(); ++k) scene.x0[m + Index(k)] = double(start[k]);
  }
  scene.names = {}, scene.units = {}, scene.exact = {}, scene.port = {};
  return scene;
}

std::vector<Index> modes_at(const Scene& scene, const Vector& x) {
  std::vector<Index> modes;
  for (const Memory& memory : scene.memories)
    modes.push_back(std::clamp<Index>(std::lround(x[memory.state]), 0, Index(memory.modes.size()) - 1));
  return modes;
}

}  // namespace bromwich
