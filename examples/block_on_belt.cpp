// A block on a moving belt, with friction and impacts: a structure with a contact.
//
//     M q'' + C q' + K q = f(t) + Hn^T ln + Ht^T lt,  q = (along the belt, above it)
//     0 <= ln ⊥ q_1 >= 0,  |lt| <= 0.4 ln against q_0' - 0.4,  restitution 0.5

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>

#include <cmath>
#include <cstdio>

int main() {
  using namespace bromwich;
  const Matrix K{{2, -0.6}, {-0.6, 1.5}}, I = Matrix::Identity(2, 2);

  Structure structure;
  structure.M = I.sparseView();
  structure.K = K.sparseView();
  structure.C = Matrix(0.04 * I + 0.01 * K).sparseView();
  structure.f = [](double t, Eigen::Ref<Vector> f) { f << 0.3 * std::sin(2.1 * t), -1 + 1.3 * std::cos(2.1 * t); };
  structure.T = 10;
  structure.breakpoints_are_all = true;  // the sources are smooth

  Contact belt;
  belt.normal = Vector{{0, 1}};
  belt.tangent = Matrix{{1, 0}};
  belt.velocity = [](double, Eigen::Ref<Vector> V) { V[0] = 0.4; };
  belt.mu = 0.4;
  belt.restitution = 0.5;

  const Mechanism block = make_mechanism(structure, {belt});
  const auto backend = make_cpu_backend();
  const Result r = solve(block.scene, *backend, {.tolerance = 1e-6, .states = StateSelection::all});

  const Index last = r.x.rows() - 1;
  std::printf("%s by %s\n", to_string(r.status), to_string(r.method));
  std::printf("at t = %g: q = (%.8f, %.8f), q' = (%.8f, %.8f)\n", r.t[last], r.x(last, 0), r.x(last, 1), r.x(last, 2),
              r.x(last, 3));
  std::printf("largest normal force %.4f, largest friction %.4f\n", block.normal_forces(r.y).maxCoeff(),
              block.friction_forces(r.t, r.x, r.y).cwiseAbs().maxCoeff());
  return r.status == Status::solved ? 0 : 1;
}
