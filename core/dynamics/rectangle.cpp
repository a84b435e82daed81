// Rectangles and boxes of grid points, as a Kronecker sum in modes or written out.
//
// A point beyond the end has the value of the last point times the reflection q: 0 (Dirichlet), or
// (1 - a dx/2)/(1 + a dx/2) (Robin, from u and du/dn halfway between the two points).

#include "core/dynamics/rectangle.hpp"

#include "core/base/require.hpp"
#include "core/dynamics/grid_system.hpp"
#include "core/dynamics/kronecker.hpp"
#include "core/dynamics/sparse.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr Index largest_dense =
    512;  ///< sparse scenes of up to so many states are written out (core/solve/reductions.cpp)
constexpr Index most_products = 4096;  ///< points of a direction with a matrix of modes, which takes 128 MiB then
constexpr double most_oblique = 1e3;   ///< of the factors of a symmetric form: three of sixteen digits

double reflection(EndCondition end, double spacing) {
  return end ? (1 - *end * spacing / 2) / (1 + *end * spacing / 2) : 0;
}

void validate_end(const std::string& member, EndCondition end) {
  if (end && !(*end >= 0 && std::isfinite(*end)))
    throw Error(member, "is " + text("%g", *end), "give a Robin coefficient of at least 0 (0: Neumann)");
}

void validate_line(const std::string& member, const GridLine& line) {
  require_some(member + ".points", line.points, "points");
  require_positive(member + ".spacing", line.spacing);
  require_positive(member + ".diffusivity", line.diffusivity);
  validate_end(member + ".first", line.first);
  validate_end(member + ".last", line.last);
  const double most = 2 * line.diffusivity / line.spacing;
  if (!(std::abs(line.advection) < most))
    throw Error(member + ".advection",
                "is " + text("%g", line.advection) + ", and central differences oscillate from " + text("%.3g", most),
                "make the spacing smaller than 2 diffusivity / |advection|, or the advection slower");
}

void validate_side(const std::string& member, const Vector& found, Index points) {
  require_length(member, found, points, "one per point of a line (across.points)");
  require_finite(member, found);
}

// One of the two parts of B or N: `values` from the first point on, or from the last one.
void add_side(std::vector<Eigen::Triplet<double>>& entries, const Rectangle& r, const Vector& values, bool far) {
  const Index lines = r.lines(), points = r.across.points;
  for (Index l = 0; l < lines; ++l)
    for (Index k = 0; k < values.size(); ++k)
      if (values[k] != 0)
        entries.emplace_back(l * points + (far ? points - 1 - k : k), (far ? lines : 0) + l, values[k]);
}

SparseMatrix of_sides(const Rectangle& r, const Vector& near, const Vector& far) {
  std::vector<Eigen::Triplet<double>> entries;
  add_side(entries, r, near, false);
  add_side(entries, r, far, true);
  SparseMatrix found(r.states(), r.sides() * r.lines());
  found.setFromTriplets(entries.begin(), entries.end());
  return found;
}

// The Kronecker sum of all directions.
SparseMatrix sum_of(const Rectangle& r, const std::vector<SparseMatrix>& directions) {
  const Index m = r.states();
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(directions.size() * 3 * std::size_t(m));
  Index stride = m;
  for (const SparseMatrix& direction : directions) {
    stride /= direction.rows();
    for (Index column = 0; column < m; ++column) {
      const Index k = column / stride % direction.rows();
      for (SparseMatrix::InnerIterator e(direction, k); e; ++e)
        entries.emplace_back(column + (e.row() - k) * stride, column, e.value());
    }
  }
  for (Index i = 0; r.reaction != 0 && i < m; ++i) entries.emplace_back(i, i, -r.reaction);
  SparseMatrix A(m, m);
  A.setFromTriplets(entries.begin(), entries.end());
  return A;
}

SecondDifference difference(const GridLine& line) {
  return {line.points, line.spacing, line.diffusivity, reflection(line.first, line.spacing),
          reflection(line.last, line.spacing)};
}

// T = D S D^{-1}, S symmetric: D_i/D_{i-1} = sqrt(T_{i,i-1}/T_{i-1,i}), and the mean of log D is 0.
struct SymmetricLine {
  SecondDifference difference;  ///< S
  Vector factors;               ///< D
};

SymmetricLine symmetric_line(const GridLine& line) {
  SecondDifference s = difference(line);
  const double second = line.diffusivity / (line.spacing * line.spacing), half = line.advection / (2 * line.spacing);
  const double off = std::sqrt((second - half) * (second + half)), ratio = std::sqrt((second + half) / (second - half));
  s.diffusivity = off * line.spacing * line.spacing;
  s.decay = 2 * (second - off);
  s.first *= ratio;
  s.last /= ratio;
  const double middle = double(line.points - 1) / 2;
  return {s, Vector::NullaryExpr(line.points, [&](Index i) { return std::pow(ratio, double(i) - middle); })};
}

bool advects(const GridLine& line) { return line.advection != 0; }

// Whether a line and its constraints are the same from both ends.
bool sides_are_alike(const Rectangle& r) {
  return r.far_b == r.b && r.far_n == r.n && r.across.first == r.across.last && !advects(r.across);
}

// The slowest first.
std::vector<GridLine> directions(const Rectangle& r) {
  std::vector<GridLine> all{r.along};
  all.insert(all.end(), r.beside.begin(), r.beside.end());
  all.push_back(r.across);
  return all;
}

template <class Which>
bool any(const std::vector<GridLine>& lines, Which which) {
  return std::any_of(lines.begin(), lines.end(), which);
}

// Moves a part of the rates from the face to the lines, so that both decay: fits of the kernel of a line need it.
void balance(KroneckerDynamics& d) {
  const double of_face = d.face_eigenvalues().maxCoeff(), of_line = d.across.eigenvalues()[0];
  const double moved = of_line - (of_face + of_line) / 2;
  d.across.decay += moved;
  d.along.decay -= moved;
}

// With a line that decays, or nothing where the sum does not decay or the modes of the face are too large.
std::optional<KroneckerDynamics> decaying(KroneckerDynamics d) {
  for (const SecondDifference& direction : d.face())
    if (!direction.has_sine_modes() && direction.points > most_products) return std::nullopt;
  const double of_face = d.face_eigenvalues().maxCoeff(), of_line = d.across.eigenvalues()[0];
  if (!(of_face + of_line < 0)) return std::nullopt;
  if (of_line > (of_face + of_line) / 4) balance(d);
  return d;
}

}  // namespace

double GridLine::spacing_of(Index points, double length, EndCondition first, EndCondition last) {
  return length / (double(points + 1) - 0.5 * double(first.has_value()) - 0.5 * double(last.has_value()));
}

SparseMatrix GridLine::matrix() const {
  const double second = diffusivity / (spacing * spacing), half = advection / (2 * spacing);
  const double before = second + half, after = second - half;  // the entries of the points on either side
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < points; ++i) {
    double diagonal = -2 * second;
    if (i > 0)
      entries.emplace_back(i, i - 1, before);
    else
      diagonal += before * reflection(first, spacing);
    if (i + 1 < points)
      entries.emplace_back(i, i + 1, after);
    else
      diagonal += after * reflection(last, spacing);
    entries.emplace_back(i, i, diagonal);
  }
  SparseMatrix found(points, points);
  found.setFromTriplets(entries.begin(), entries.end());
  return found;
}

Index Rectangle::lines() const {
  Index count = along.points;
  for (const GridLine& line : beside) count *= line.points;
  return count;
}

std::optional<KroneckerDynamics> Rectangle::in_modes() const {
  const std::vector<GridLine> all = directions(*this);
  const bool two = sides() == 2;
  if ((two && !sides_are_alike(*this)) || any(all, advects)) return std::nullopt;
  const bool plain = reaction == 0 && !two && !any(all, [](const GridLine& line) { return line.first || line.last; });
  if (!plain && states() <= largest_dense) return std::nullopt;
  KroneckerDynamics d{difference(along), difference(across), b, n};
  for (const GridLine& line : beside) d.beside.push_back(difference(line));
  d.both_faces = two;
  if (plain) return d;
  d.across.decay = reaction;
  return decaying(std::move(d));
}

std::optional<SymmetricForm> Rectangle::symmetric_form() const {
  const std::vector<GridLine> all = directions(*this);
  const bool two = sides() == 2;
  if ((two && !sides_are_alike(*this)) || states() <= largest_dense || !any(all, advects)) return std::nullopt;
  std::vector<SecondDifference> differences;
  Vector x = Vector::Ones(1), y;
  for (const GridLine& line : all) {
    const auto [symmetric, factors] = symmetric_line(line);
    if (!(std::max(symmetric.first, symmetric.last) <= 1 && std::min(symmetric.first, symmetric.last) > -1))
      return std::nullopt;
    differences.push_back(symmetric);
    y = x;
    x = Vector((factors * y.transpose()).reshaped());
  }
  if (!(x.maxCoeff() <= most_oblique * x.minCoeff())) return std::nullopt;
  const Vector factors = symmetric_line(across).factors;
  KroneckerDynamics d{differences.front(), differences.back(), b.cwiseQuotient(factors), n.cwiseProduct(factors)};
  d.beside.assign(differences.begin() + 1, differences.end() - 1);
  d.across.decay += reaction;
  d.both_faces = two;
  if (two) y = y.replicate(2, 1).eval();
  auto modes = decaying(std::move(d));
  return modes ? std::optional(SymmetricForm{std::move(*modes), x, y}) : std::nullopt;
}

void Rectangle::validate() const {
  validate_line("along", along);
  for (std::size_t i = 0; i < beside.size(); ++i) validate_line("beside[" + std::to_string(i) + "]", beside[i]);
  validate_line("across", across);
  if (!std::isfinite(reaction)) throw Error("reaction", "is " + text("%g", reaction), "give a finite number");
  validate_side("b", b, across.points);
  validate_side("n", n, across.points);
  if (far_b.size() == 0 && far_n.size() == 0) return;
  validate_side("far_b", far_b, across.points);
  validate_side("far_n", far_n, across.points);
}

std::shared_ptr<LinearSystem> linear_system(Rectangle r) {
  r.validate();
  if (!r.written_out)
    if (auto modes = r.in_modes()) return linear_system(std::move(*modes));
  std::vector<SparseMatrix> matrices;
  for (const GridLine& line : directions(r)) matrices.push_back(line.matrix());
  SparseDynamics d{sum_of(r, matrices), of_sides(r, r.b, r.far_b), SparseMatrix(of_sides(r, r.n, r.far_n).transpose()),
                   SparseMatrix()};
  auto modes = GridModes::of(matrices, r.reaction);
  auto form = r.written_out ? std::nullopt : r.symmetric_form();
  if (!modes && !form) return linear_system(std::move(d));
  return std::make_shared<GridSystem>(std::move(d), std::move(modes), Vector(),
                                      form ? std::make_shared<const SymmetricForm>(std::move(*form)) : nullptr);
}

}  // namespace bromwich
