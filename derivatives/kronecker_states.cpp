#include "derivatives/kronecker_states.hpp"

#include "core/numerics/phi.hpp"

namespace bromwich {

KroneckerStates::KroneckerStates(const KroneckerDynamics& d, double h)
    : d_(d), face_(d.face_basis()), across_(d.across.modes()), n_(d.face_points()), K_(d.across.points), h_(h) {
  const Vector mu = d_.face_eigenvalues(), nu = d_.across.eigenvalues(), b = d_.across.in_modes(d_.b);
  for (RowMatrix* table : {&E_, &Lb_, &Rb_}) table->resize(K_, n_);
  for (Index k = 0; k < K_; ++k) {
    const ArrayPhi phi = array_phi(h * (mu.array() + nu[k]));
    E_.row(k) = phi.exponential;
    Lb_.row(k) = h * b[k] * (phi.phi1 - phi.phi2);
    Rb_.row(k) = h * b[k] * phi.phi2;
  }
}

// Face points are slowest in x.
RowMatrix KroneckerStates::modes_of(const Vector& x) const {
  return face_.to_modes(across_.transpose() * Eigen::Map<const RowMatrix>(x.data(), n_, K_).transpose());
}

Vector KroneckerStates::state_of(RowMatrix modes) const {
  face_.transform(Way::to_points, modes);
  Vector x(n_ * K_);
  Eigen::Map<RowMatrix>(x.data(), n_, K_).noalias() = modes.transpose() * across_.transpose();
  return x;
}

RowMatrix KroneckerStates::states(const RowMatrix& x0, const RowMatrix& u) const {
  RowMatrix x = x0.size() > 0 ? x0 : RowMatrix::Zero(K_, n_), all(u.rows(), n_ * K_);
  for (Index j = 0; j < u.rows(); ++j) {
    if (j > 0)
      x.array() = E_.array() * x.array() + Lb_.array().rowwise() * u.row(j - 1).array() +
                  Rb_.array().rowwise() * u.row(j).array();
    all.row(j) = state_of(x).transpose();
  }
  return all;
}

std::pair<RowMatrix, RowMatrix> KroneckerStates::transposed(const RowMatrix& of_x) const {
  const auto collect = [](const RowMatrix& weights, const RowMatrix& q) {
    return weights.cwiseProduct(q).colwise().sum().eval();
  };
  RowMatrix u = RowMatrix::Zero(of_x.rows(), n_), q = RowMatrix::Zero(K_, n_);
  for (Index j = of_x.rows() - 1; j >= 0; --j) {
    u.row(j) = collect(Lb_, q);
    q = q.cwiseProduct(E_) + modes_of(of_x.row(j).transpose());
    if (j > 0) u.row(j) += collect(Rb_, q);
  }
  return {std::move(u), std::move(q)};
}

// phi_k' = phi_k - k phi_{k+1}.
RowMatrix KroneckerStates::change(const KroneckerChange& c, const RowMatrix& x0, const RowMatrix& u,
                                  RowMatrix* states) const {
  double face_decay = 0;
  for (const SecondDifference& line : d_.face()) face_decay += line.decay;
  const Vector mu = d_.face_eigenvalues(), nu = d_.across.eigenvalues(), b = d_.across.in_modes(d_.b),
               seen = d_.across.in_modes(d_.n);
  RowMatrix dE(K_, n_), dL = c.input * Lb_, dR = c.input * Rb_;
  for (Index k = 0; k < K_; ++k)
    for (Index l = 0; l < n_; ++l) {
      const double z = h_ * (mu[l] + nu[k]),
                   dz = h_ * (c.face * (mu[l] + face_decay) + c.across * (nu[k] + d_.across.decay) - c.decay);
      const double p1 = phi1(z), p2 = phi2(z), p3 = phi(3, z);
      dE(k, l) = E_(k, l) * dz;
      dL(k, l) += h_ * b[k] * (p1 - 2 * p2 + 2 * p3) * dz;
      dR(k, l) += h_ * b[k] * (p2 - 2 * p3) * dz;
    }
  RowMatrix x = x0, dx = RowMatrix::Zero(K_, n_), rows(u.rows(), n_);
  if (states) states->resize(u.rows(), n_ * K_);
  for (Index j = 0; j < u.rows(); ++j) {
    if (j > 0) {
      const auto before = u.row(j - 1).array(), now = u.row(j).array();
      dx.array() =
          E_.array() * dx.array() + dE.array() * x.array() + dL.array().rowwise() * before + dR.array().rowwise() * now;
      x.array() = E_.array() * x.array() + Lb_.array().rowwise() * before + Rb_.array().rowwise() * now;
    }
    rows.row(j) = seen.transpose() * (dx + c.output * x);
    if (states) states->row(j) = state_of(dx).transpose();
  }
  return rows;
}

}  // namespace bromwich
