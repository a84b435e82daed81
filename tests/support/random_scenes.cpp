#include "tests/support/random_scenes.hpp"

#include "tests/support/oracle.hpp"
#include "tests/support/random_draws.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <utility>

namespace bromwich::oracle {
namespace {

Matrix dominant(Draw& draw, Index n) {
  Matrix M = draw.matrix(n, n);
  M.diagonal().setZero();
  M.diagonal() = M.cwiseAbs().rowwise().sum() + draw.positive(n, 0.3, 1.5);
  return M;
}

Matrix definite(Draw& draw, Index n) {
  const Matrix L = draw.matrix(n, n), K = draw.matrix(n, n);
  return L * L.transpose() + 0.5 * Matrix::Identity(n, n) + 0.5 * (K - K.transpose());
}

Matrix general_p(Draw& draw, Index n) {
  for (int attempt = 0; attempt < 2000; ++attempt) {
    Matrix M = draw.matrix(n, n);
    M.diagonal() = draw.positive(n, 0.1, 1);
    if (smallest_principal_minor(M) > 1e-2) return M;
  }
  return dominant(draw, n);
}

Matrix m_matrix(Draw& draw, Index n) {
  Matrix M = dominant(draw, n);
  const Vector diagonal = M.diagonal();
  M = -M.cwiseAbs();
  M.diagonal() = diagonal;
  return M;
}

Matrix low_rank(Draw& draw, Index n) {
  const Index rank = draw.index(0, n - 1);
  const Matrix L = draw.matrix(n, rank), K = draw.matrix(n, n);
  const double skew = draw.chance(0.5) ? 1 : 0;
  return L * L.transpose() + skew * (K - K.transpose());
}

// Constraint i copies owner[i]: the same rows and columns of M, N and B.
std::vector<Index> owners(Draw& draw, Index n) {
  std::vector<Index> owner;
  for (Index i = 0; i < n; ++i) owner.push_back(i > 0 && (i == n - 1 || draw.chance(0.4)) ? draw.index(0, i - 1) : i);
  return owner;
}

}  // namespace

Matrix complementarity_matrix(Draw& draw, Family family, Index n) {
  switch (family) {
    case Family::dominant:
      return dominant(draw, n);
    case Family::definite:
    case Family::duplicated:
      return definite(draw, n);
    case Family::h_plus: {
      const Vector rows = draw.positive(n, 0.1, 10), columns = draw.positive(n, 0.1, 10);
      return rows.asDiagonal() * dominant(draw, n) * columns.asDiagonal();
    }
    case Family::general_p:
      return general_p(draw, n);
    case Family::m_matrix:
      return m_matrix(draw, n);
    case Family::fold: {
      const double shift = draw.uniform(0.2, 1.5);
      return m_matrix(draw, n) - shift * Matrix::Identity(n, n);
    }
    case Family::low_rank:
      return low_rank(draw, n);
    case Family::skew: {
      const Matrix K = draw.matrix(n, n);
      return K - K.transpose();
    }
    case Family::zero:
      return Matrix::Zero(n, n);
    case Family::indefinite:
      return draw.matrix(n, n);
  }
  return {};
}

namespace {

Matrix oscillators(Draw& draw, Index m, double most_damping) {
  Matrix D = Matrix::Zero(m, m);
  for (Index i = 0; i + 1 < m; i += 2) {
    const double omega = draw.uniform(0.5, 6), damping = omega * most_damping * draw.uniform(0.3, 1);
    D.block(i, i, 2, 2) << -damping, omega, -omega, -damping;
  }
  if (m % 2 == 1) D(m - 1, m - 1) = -most_damping;
  return D;
}

}  // namespace

Matrix state_matrix(Draw& draw, Spectrum spectrum, Index m) {
  const Matrix V = Matrix::Identity(m, m) + 0.8 / double(m) * draw.matrix(m, m);  // ||V - I||_inf < 1
  const auto similar = [&](const Matrix& D) { return Matrix(V * D * V.inverse()); };
  const auto real = [&](double least, double most) { return Matrix((-draw.positive(m, least, most)).asDiagonal()); };
  Matrix D;
  switch (spectrum) {
    case Spectrum::real:
      return similar(real(0.1, 20));
    case Spectrum::sector:
      return similar(oscillators(draw, m, 3));
    case Spectrum::imaginary:
      return similar(oscillators(draw, m, 0));
    case Spectrum::unstable:
      D = oscillators(draw, m, 0);
      D.diagonal().array() += draw.uniform(-1, 3);
      D(0, 0) += draw.uniform(0, 1);
      return similar(D);
    case Spectrum::stiff:
      D = real(0.1, 20);
      for (Index i = 0; i < m; i += 2) D(i, i) *= std::pow(10, draw.uniform(2, 4.7));
      return similar(D);
    case Spectrum::non_normal:
      D = real(0.5, 3);
      D.triangularView<Eigen::StrictlyUpper>() = 10 * draw.matrix(m, m);
      return D;
    case Spectrum::singular:
      D = real(0.1, 5);
      D(0, 0) = 0;
      return similar(D);
    case Spectrum::zero:
      return Matrix::Zero(m, m);
    case Spectrum::nilpotent:
      D = Matrix::Zero(m, m);
      D.triangularView<Eigen::StrictlyUpper>() = draw.matrix(m, m);
      return D;
  }
  return {};
}

namespace {

// Sines; `edged`: their signs, so that the source jumps.
TimeFunction source(Draw& draw, Index size, double amplitude, double T, bool edged) {
  const Vector a = amplitude * draw.vector(size), omega = 8 / T * draw.vector(size), phase = 3 * draw.vector(size);
  return [=](double t, Eigen::Ref<Vector> v) {
    v = (omega.array() * t + phase.array()).sin();
    if (edged) v = v.array().sign();
    v.array() *= a.array();
  };
}

TimeFunction scaled(const TimeFunction& function, double factor, double time) {
  if (!function) return {};
  return [=](double t, Eigen::Ref<Vector> v) {
    function(t / time, v);
    v *= factor;
  };
}

double unit(Draw& draw) {
  if (!draw.chance(0.12)) return 1;
  const double sign = draw.chance(0.5) ? 1 : -1;
  return std::pow(10, sign * draw.uniform(3, 6));
}

// Changes the units of y, of the state, of all data, and of time.
void change_units(Draw& draw, Scene& scene, DenseDynamics& d, Matrix& M) {
  const double y = unit(draw), x = unit(draw), data = unit(draw), time = unit(draw);
  d = {d.A / time, x / (y * time) * d.B, 1 / x * d.N};
  M /= y;
  const bool drives = scene.f_entry == SourceEntry::through_B;
  scene.f = scaled(scene.f, drives ? data * y : data * x / time, time);
  scene.g = scaled(scene.g, data, time);
  scene.x0 *= data * x;
  scene.T *= time;
}

void add_sources(Draw& draw, Scene& scene, Index m, Index n) {
  const bool edged = draw.chance(0.15);
  const Index entry = draw.index(0, 9);
  if (entry == 0) return;
  scene.f_entry = entry < 3 ? SourceEntry::through_B : entry < 5 ? SourceEntry::through_F : SourceEntry::state;
  if (scene.f_entry == SourceEntry::through_F) scene.F = draw.matrix(m, 2).sparseView();
  const Index size = scene.f_entry == SourceEntry::through_B ? n : scene.f_entry == SourceEntry::through_F ? 2 : m;
  scene.f = source(draw, size, 2, scene.T, edged);
}

}  // namespace

const char* to_string(Family family) {
  static constexpr std::array<const char*, families> names{
      "P, dominant",   "P, definite", "P, H+",      "P, general",      "Z, M-matrix", "Z, not P",
      "PSD, low rank", "PSD, skew",   "PSD, M = 0", "PSD, duplicated", "unknown"};
  return names[std::size_t(family)];
}

RandomScene any_scene(std::uint32_t seed) {
  Draw draw(seed);
  RandomScene made;
  made.family = Family(seed % families);
  made.spectrum = Spectrum(draw.index(0, spectra - 1));
  const Index m = draw.index(1, 6);
  Index n = draw.index(made.family == Family::duplicated ? 2 : 1, made.family == Family::general_p ? 4 : 6);
  if (made.family == Family::zero && draw.chance(0.8)) n = std::min(n, m);  // so that N B is definite
  Scene& scene = made.scene;
  scene.name = "random-" + std::to_string(seed);
  scene.T = draw.uniform(0.3, 1.5);
  if (draw.chance(0.2)) scene.T *= 4;
  Matrix M = complementarity_matrix(draw, made.family, n);
  DenseDynamics d{state_matrix(draw, made.spectrum, m), draw.matrix(m, n), draw.matrix(n, m)};
  if (draw.chance(made.family == Family::zero ? 0.85 : 0.4)) d.N = d.B.transpose();
  if (made.family == Family::duplicated) {
    const std::vector<Index> owner = owners(draw, n);
    M = M(owner, owner).eval();
    d.B = d.B(Eigen::all, owner).eval();
    d.N = d.N(owner, Eigen::all).eval();
  }
  scene.lcp_class = made.family == Family::m_matrix || made.family == Family::fold ? LcpClass::Z : LcpClass::automatic;
  add_sources(draw, scene, m, n);
  if (draw.chance(0.9)) scene.g = source(draw, n, draw.uniform(0.5, 3), scene.T, false);
  scene.x0 = draw.vector(m);
  change_units(draw, scene, d, M);
  scene.M = M;
  scene.dynamics = d;
  if (draw.chance(0.1)) scene.dynamics = SparseDynamics{d.A.sparseView(), d.B.sparseView(), d.N.sparseView()};
  made.steps = draw.index(4, 32);
  return made;
}

}  // namespace bromwich::oracle
