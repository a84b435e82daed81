// March over impacts: structures with rigid contacts, friction and restitution, against reference digits, closed forms
// and located events.

#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <random>

namespace bromwich {
namespace {

struct Drawn {
  Structure structure;
  std::vector<Contact> contacts;
};

// Planar structures that rest, strike, stick and slip.
Drawn random_structure(std::uint32_t seed, Index contacts) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto pick = [&](const std::vector<double>& values) { return values[random() % values.size()]; };
  const auto draw = [&](Index rows, Index cols) {
    Matrix m(rows, cols);
    for (double& value : m.reshaped()) value = normal(random);
    return m;
  };
  const Index d = 2 * contacts + Index(random() % 2);
  Drawn drawn;
  Structure& s = drawn.structure;
  const Matrix R = draw(d, d), S = draw(d, d), I = Matrix::Identity(d, d);
  s.M = sparse(random() % 2 ? I : Matrix(I + 0.3 * R * R.transpose() / double(d)));
  s.K = sparse(Matrix(S * S.transpose() / double(d) + I));
  s.C = sparse(Matrix(0.05 * I + 0.02 * Matrix(s.K)));
  const Vector a = draw(d, 1), b = 0.7 * draw(d, 1), phase = 3 * draw(d, 1);
  const double rate = 1 + double(random() % 300) / 100;
  s.f = forces([=](double t) { return Vector(a.array() * (rate * t + phase.array()).sin() + b.array()); });
  s.T = 4;
  s.breakpoints_are_all = true;
  for (Index i = 0; i < contacts; ++i) {
    Contact c;
    const bool along = random() % 2;
    c.normal = along ? Vector(Vector::Unit(d, 2 * i + 1)) : Vector(draw(d, 1).normalized());
    c.mu = pick({0, 0.1, 0.3, 0.6, 1});
    if (c.mu > 0) {
      c.tangent = along ? Matrix(Vector::Unit(d, 2 * i).transpose()) : Matrix(draw(1, d).normalized());
      c.velocity = always(pick({0, 0.4, -0.7}));
    }
    c.gap = always(pick({0, 0.05, 0.3}));
    c.restitution = pick({0, 0, 0.3, 0.6, 0.9});
    drawn.contacts.push_back(c);
  }
  return drawn;
}

Result stepped(const Scene& scene, Index steps) {
  Options options = marched(steps);
  options.confirm = false;
  return run(scene, options);
}

TEST(Study, DISABLED_Block) {
  for (const double e : {0.0, 0.5}) {
    const Vector q = e == 0 ? Vector{{-0.2276458679, 0.0644897728, -0.2264338204, -0.5182400725}}
                            : Vector{{-0.2024374329, 0.0637274032, -0.2157451367, -0.5111438908}};
    for (const Index steps : {250, 1000, 4000}) {
      const Result r = stepped(make_mechanism(block(1.3, 10), {belt(e)}).scene, steps);
      std::printf("e %.1f steps %ld %s %s q %.2e x %.2e residual %.1e total %.1f ms; %s\n", e, long(steps),
                  to_string(r.status), r.reason.c_str(), (last_state(r) - q).head(2).cwiseAbs().maxCoeff(),
                  (last_state(r) - q).cwiseAbs().maxCoeff(), r.residual, 1e3 * r.seconds.total, r.kernel.c_str());
    }
  }
}

TEST(Study, DISABLED_Random) {
  int bad = 0, all = 0;
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    const Drawn drawn = random_structure(seed, 1 + Index(seed % 4));
    const Mechanism m = make_mechanism(drawn.structure, drawn.contacts);
    Options options = options_for(Method::events);
    options.states = StateSelection::all;
    const Result exact = run(m.scene, options);
    if (exact.status != Status::solved) continue;
    const Index d = m.coordinates();
    std::string line;
    char word[64];
    std::vector<double> errors;
    for (const Index steps : {100, 200, 400, 800, 1600, 3200, 6400}) {
      const Result r = stepped(m.scene, steps);
      double error = NAN;
      if (r.status == Status::solved) error = (last_state(r) - last_state(exact)).head(d).cwiseAbs().maxCoeff();
      errors.push_back(error);
      std::snprintf(word, sizeof word, " %.1e", error);
      line += word;
      if (r.status != Status::solved) line += r.reason;
    }
    const double order = std::log2(errors[1] / errors[6]) / 5;
    ++all;
    if (!(order > 1.7)) ++bad;
    std::printf("%u: %ld contacts, order %.2f%s, impacts %s\n", seed, long(m.contacts.size()), order, line.c_str(),
                stepped(m.scene, 1600).kernel.substr(54).c_str());
  }
  std::printf("%d of %d below\n", bad, all);
}

// Blocks with springs between them, each on a belt of its own.
Mechanism chain(Index blocks, double restitution) {
  const Index d = 2 * blocks;
  Matrix K = Matrix::Zero(d, d);
  std::vector<Contact> contacts;
  for (Index i = 0; i < blocks; ++i) {
    const Index x = 2 * i, z = x + 1;
    K(x, x) += 2, K(z, z) += 1.5, K(x, z) -= 0.6, K(z, x) -= 0.6;
    if (i + 1 < blocks) K(x, x) += 1, K(x + 2, x + 2) += 1, K(x, x + 2) -= 1, K(x + 2, x) -= 1;
    Contact c = belt(restitution);
    c.normal = Vector::Unit(d, z);
    c.tangent = Vector::Unit(d, x).transpose();
    contacts.push_back(c);
  }
  Structure s;
  s.M = sparse(Matrix::Identity(d, d)), s.K = sparse(K);
  s.C = sparse(Matrix(0.04 * Matrix::Identity(d, d) + 0.01 * K));
  s.f = forces([d](double t) {
    Vector f(d);
    for (Index i = 0; i < d / 2; ++i) {
      f[2 * i] = 0.3 * std::sin(2.1 * t + double(i));
      f[2 * i + 1] = -1 + 1.3 * std::cos(2.1 * t + 0.7 * double(i));
    }
    return f;
  });
  s.T = 4;
  s.breakpoints_are_all = true;
  return make_mechanism(s, contacts);
}

TEST(Study, DISABLED_Chain) {
  for (const Index blocks : {1, 4, 16, 64})
    for (const double e : {0.0, 0.5}) {
      const Mechanism m = chain(blocks, e);
      const Index d = m.coordinates();
      const Vector fine = last_state(stepped(m.scene, 6400)).head(d);
      for (const Index steps : {100, 200, 400}) {
        const Result r = stepped(m.scene, steps);
        Options whole = marched(steps);
        const Result c = run(m.scene, whole);
        std::printf("%ld e %.1f steps %ld %s q %.2e total %.1f ms (setup %.1f, lcp %.1f), certified %s %.1f ms; %s; %s %s %d\n",
                    long(blocks), e, long(steps), r.reason.c_str(),
                    (last_state(r).head(d) - fine).cwiseAbs().maxCoeff(), 1e3 * r.seconds.total,
                    1e3 * r.seconds.setup, 1e3 * r.seconds.lcp, to_string(c.status), 1e3 * c.seconds.total,
                    r.kernel.substr(40).c_str(), c.reason.c_str(), c.warning.c_str(), r.well_posed);
      }
    }
}

TEST(Study, DISABLED_Where) {
  const std::uint32_t seed = std::uint32_t(std::atoi(std::getenv("SEED")));
  const Index steps = std::atoi(std::getenv("STEPS"));
  const Drawn drawn = random_structure(seed, 1 + Index(seed % 4));
  const Mechanism m = seed == 1000 ? chain(1, 0) : make_mechanism(drawn.structure, drawn.contacts);
  for (const Contact& c : m.contacts) {
    if (!c.gap) continue;
    Vector g(1);
    c.gap(0, g);
    std::printf("mu %g e %g gap %g\n", c.mu, c.restitution, g[0]);
  }
  Options options = options_for(Method::events, steps);
  options.states = StateSelection::all;
  options.trace = true;
  const Result exact = run(m.scene, options), r = stepped(m.scene, steps);
  const Index d = m.coordinates();
  double before = 0;
  for (Index j = 0; j <= steps; ++j) {
    const double error = (r.x.row(j) - exact.x.row(j)).head(d).cwiseAbs().maxCoeff(),
                 of_v = (r.x.row(j) - exact.x.row(j)).tail(d).cwiseAbs().maxCoeff();
    if (error > 1.3 * before + 1e-9 || j % 400 == 0) {
      std::printf("%ld t %.5f q %.2e v %.2e\n  y", long(j), r.t[j], error, of_v);
      for (Index i = 0; i < r.y.cols(); ++i) std::printf(" %.3e", r.y(j, i));
      std::printf("\n  Y");
      for (Index i = 0; i < r.y.cols(); ++i) std::printf(" %.3e", exact.y(j, i));
      std::printf("\n  w");
      for (Index i = 0; i < r.y.cols(); ++i) std::printf(" %.3e", r.trace(j, i));
      std::printf("\n  W");
      for (Index i = 0; i < r.y.cols(); ++i) std::printf(" %.3e", exact.trace(j, i));
      std::printf("\n");
      before = error;
    }
  }
}

}  // namespace
}  // namespace bromwich
