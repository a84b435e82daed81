#include "mechanics/uniqueness.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

constexpr Index most_coordinates = 400;   ///< M is factored as a dense matrix
constexpr std::size_t most_contacts = 8;  ///< 6^8 determinants
constexpr double rounding = 1e-11;        ///< of a pivot, beside 1

// Determinants as products of pivots: G is what elimination of the rows that were chosen leaves of W for the contacts
// behind them.
class Choices {
 public:
  explicit Choices(const Mechanism& m) : mass_(Matrix(m.structure.M)) {
    for (const Contact& c : m.contacts) add(c);
    Matrix rows(m.coordinates(), Index(rows_.size()));
    for (std::size_t i = 0; i < rows_.size(); ++i) rows.col(Index(i)) = rows_[i];
    W_ = rows.transpose() * mass_.solve(rows);
  }

  Uniqueness result() {
    look(0, W_);
    return several_ ? Uniqueness::none_known : vanishes_ ? Uniqueness::forces_open : Uniqueness::unique;
  }

 private:
  struct Choice {
    bool normal, tangent;
    double mu;
  };

  // A compliant normal force follows from the state; a spring in series with friction of such a force does not jump.
  void add(const Contact& c) {
    Choice r{c.normal.size() > 0 && c.kn == 0, false, 0};
    const bool friction = c.tangent.rows() > 0 && (c.mu > 0 || c.bound);
    r.tangent = friction && (c.kt == 0 || r.normal);
    const Vector tangent = r.tangent ? Vector(c.tangent.row(0).transpose()) : Vector();
    if (r.tangent && r.normal) r.mu = c.mu * size(tangent) / size(c.normal);
    if (r.normal) rows_.push_back(c.normal / size(c.normal));
    if (r.tangent) rows_.push_back(tangent / size(tangent));
    if (r.normal || r.tangent) contacts_.push_back(r);
  }

  double size(const Vector& row) const { return std::sqrt(row.dot(mass_.solve(row))); }

  // All choices for contacts from `i` on, whose rows G has.
  void look(std::size_t i, const Matrix& G) {
    if (several_ || i == contacts_.size()) return;
    const auto& [normal, tangent, mu] = contacts_[i];
    const Index own = Index(normal) + Index(tangent), left = G.rows() - own;
    const auto behind = [&](const Matrix& eliminated) { look(i + 1, eliminated.bottomRightCorner(left, left)); };
    behind(G);
    if (!normal || !tangent) return behind(without(0, G, G.col(0)));
    behind(without(1, G, G.col(1)));
    for (const double slip : {-mu, mu}) behind(without(0, G, G.col(0) + slip * G.col(1)));
    const Matrix held = without(0, G, G.col(0));
    behind(without(1, held, held.col(1)));
  }

  // The row eliminated by a force along `column`.
  Matrix without(Index row, const Matrix& G, const Vector& column) {
    double pivot = column[row];
    several_ = several_ || pivot < -rounding;
    if (std::abs(pivot) <= rounding) vanishes_ = true, pivot = rounding;
    return G - column * G.row(row) / pivot;
  }

  Eigen::LLT<Matrix> mass_;
  std::vector<Choice> contacts_;
  std::vector<Vector> rows_;
  Matrix W_;
  bool several_ = false, vanishes_ = false;
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
