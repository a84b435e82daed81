#include "mechanics/uniqueness.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>

namespace bromwich {

namespace {

constexpr Index most_coordinates = 400;   ///< M is factored as a dense matrix
constexpr std::size_t most_contacts = 7;  ///< 5^7 determinants
constexpr double rounding = 1e-11;        ///< of a determinant, its rows and columns scaled to 1

class Choices {
 public:
  Choices(const Mechanism& m) : d_(m.coordinates()), mass_(Matrix(m.structure.M)) {
    for (const Contact& c : m.contacts) add(c);
  }

  Uniqueness result() {
    look(0);
    return least_ < -rounding  ? Uniqueness::none_known
           : least_ > rounding ? Uniqueness::unique
                               : Uniqueness::forces_open;
  }

 private:
  struct Rows {
    Vector normal;  ///< empty: none that is rigid
    Vector tangent;
    double mu = 0;
  };

  // A compliant normal force follows from the state; a spring in series with friction of such a force does not jump.
  void add(const Contact& c) {
    Rows r;
    if (c.normal.size() > 0 && c.kn == 0) r.normal = scaled(c.normal);
    const bool friction = c.tangent.rows() > 0 && (c.mu > 0 || c.bound);
    if (friction && (c.kt == 0 || r.normal.size() > 0)) {
      r.tangent = scaled(c.tangent.row(0).transpose());
      const double ratio = size(c.tangent.row(0).transpose()) / (r.normal.size() > 0 ? size(c.normal) : 1);
      r.mu = r.normal.size() > 0 ? c.mu * ratio : 0;
    }
    if (r.normal.size() > 0 || r.tangent.size() > 0) contacts_.push_back(r);
  }

  double size(const Vector& row) const { return std::sqrt(row.dot(mass_.solve(row))); }
  Vector scaled(const Vector& row) const { return row / size(row); }

  // All choices for contacts from `i` on, beside those in rows_ and forces_.
  void look(std::size_t i) {
    if (i == contacts_.size()) return take();
    look(i + 1);
    const Rows& c = contacts_[i];
    const bool normal = c.normal.size() > 0, tangent = c.tangent.size() > 0;
    if (tangent) with({c.tangent}, {c.tangent}, i);
    if (!normal) return;
    if (!tangent || c.mu == 0) return with({c.normal}, {c.normal}, i);
    for (const double sign : {-1.0, 1.0}) with({c.normal}, {Vector(c.normal + sign * c.mu * c.tangent)}, i);
    with({c.normal, c.tangent}, {c.normal, c.tangent}, i);
  }

  void with(const std::vector<Vector>& rows, const std::vector<Vector>& forces, std::size_t i) {
    rows_.insert(rows_.end(), rows.begin(), rows.end());
    forces_.insert(forces_.end(), forces.begin(), forces.end());
    look(i + 1);
    rows_.resize(rows_.size() - rows.size());
    forces_.resize(forces_.size() - forces.size());
  }

  void take() {
    const Index k = Index(rows_.size());
    if (k == 0 || least_ < -rounding) return;
    Matrix N(k, d_), B(d_, k);
    for (Index i = 0; i < k; ++i) {
      N.row(i) = rows_[std::size_t(i)].transpose();
      B.col(i) = forces_[std::size_t(i)];
    }
    Matrix W = N * mass_.solve(B);
    for (Index i = 0; i < k; ++i) W.row(i) /= std::max(W.row(i).norm(), 1e-290);
    least_ = std::min(least_, W.determinant());
  }

  Index d_;
  Eigen::LLT<Matrix> mass_;
  std::vector<Rows> contacts_;
  std::vector<Vector> rows_, forces_;
  double least_ = 1;
};

}  // namespace

Uniqueness uniqueness(const Mechanism& m) {
  const bool in_space =
      std::any_of(m.contacts.begin(), m.contacts.end(), [](const Contact& c) { return c.tangent.rows() == 2; });
  if (in_space || m.contacts.size() > most_contacts || m.coordinates() > most_coordinates) return Uniqueness::too_many;
  return Choices(m).result();
}

const char* to_string(Uniqueness u) {
  switch (u) {
    case Uniqueness::unique:
      return "unique";
    case Uniqueness::forces_open:
      return "unique-motion";
    case Uniqueness::none_known:
      return "unknown";
    case Uniqueness::too_many:
      break;
  }
  return "not-tested";
}

}  // namespace bromwich
