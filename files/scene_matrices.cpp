#include "files/scene_matrices.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace bromwich {

namespace {

constexpr Index smallest_sparse = 257;   ///< states from which a sparse A is kept sparse
constexpr double largest_density = 0.1;  ///< of a sparse A

bool stays_sparse(const MatrixValue& A) {
  const auto* sparse = std::get_if<SparseMatrix>(&A);
  return sparse && sparse->rows() >= smallest_sparse &&
         double(sparse->nonZeros()) < largest_density * double(sparse->rows()) * double(sparse->cols());
}

bool is_tridiagonal(const SparseMatrix& M) {
  for (Index j = 0; j < M.outerSize(); ++j)
    for (SparseMatrix::InnerIterator entry(M, j); entry; ++entry)
      if (entry.value() != 0 && std::abs(entry.row() - j) > 1) return false;
  return true;
}

constexpr double most_points = 1 << 16;  ///< of a direction

/// `entries` of the file, followed by zeros.
Vector of_line(const Section& section, const char* key, Index length) {
  const Vector entries = section.vector(key);
  if (entries.size() > length)
    throw Error(section.where(key), fmt::format("has {} entries", entries.size()),
                fmt::format("give at most {}, the points of a line", length));
  Vector whole = Vector::Zero(length);
  whole.head(entries.size()) = entries;
  return whole;
}

}  // namespace

SparseMatrix sparse_value(const MatrixValue& value) {
  if (const auto* sparse = std::get_if<SparseMatrix>(&value)) return *sparse;
  return std::get<Matrix>(value).sparseView();
}

Matrix dense_value(const MatrixValue& value, const std::string& where) {
  if (const auto* dense = std::get_if<Matrix>(&value)) return *dense;
  if (double(rows(value)) * double(columns(value)) > double(largest_dense * largest_dense))
    throw Error(where, fmt::format("is {} x {} and would be kept densely", rows(value), columns(value)),
                "use a sparse A (coordinate .mtx) with few constraints, or fewer states");
  return Matrix(std::get<SparseMatrix>(value));
}

LcpMatrix lcp_matrix(const MatrixValue& value, const std::string& where, Index smallest) {
  const SparseMatrix M = sparse_value(value);
  const Index n = M.rows();
  if (n < smallest || M.cols() != n || !is_tridiagonal(M)) {
    if (M.cols() == n && stays_sparse(value)) return SparseLcpMatrix(M);
    return dense_value(value, where);
  }
  Tridiagonal t{Vector::Zero(n), Vector::Zero(n), Vector::Zero(n)};
  for (Index i = 0; i < n; ++i) {
    if (i > 0) t.lower[i] = M.coeff(i, i - 1);
    t.diagonal[i] = M.coeff(i, i);
    if (i + 1 < n) t.upper[i] = M.coeff(i, i + 1);
  }
  return t;
}

namespace {

Dynamics dynamics_of_matrices(const Sections& s) {
  const MatrixValue& A = s.dynamics.matrix("A");
  const Index m = rows(A);
  const MatrixValue none = Matrix(m, 0), seen_by_none = Matrix(0, m);
  const MatrixValue& B = without_pairs(s) ? none : s.dynamics.matrix("B");
  const MatrixValue& N = without_pairs(s) ? seen_by_none : s.complementarity.matrix("N", columns(B), m);
  const bool mass = s.dynamics.has("E");
  const MatrixValue E = mass ? s.dynamics.matrix("E", m, m) : MatrixValue(Matrix());
  if (stays_sparse(A))
    return SparseDynamics{sparse_value(A), sparse_value(B), sparse_value(N), mass ? sparse_value(E) : SparseMatrix()};
  return DenseDynamics{dense_value(A, s.dynamics.where("A")), dense_value(B, s.dynamics.where("B")),
                       dense_value(N, s.complementarity.where("N")),
                       mass ? dense_value(E, s.dynamics.where("E")) : Matrix()};
}

Index points_of(const Section& section, double count) {
  if (count != std::floor(count) || count < 1 || count > most_points)
    throw Error(section.where("points"), fmt::format("found {}", count),
                fmt::format("give whole numbers from 1 to {}", most_points));
  return Index(count);
}

/// "dirichlet", "neumann", or a number, the coefficient of a Robin condition.
std::array<EndCondition, 2> ends_of(const Section& section, const char* key) {
  std::array<EndCondition, 2> ends{};
  const auto found = section.two_words_or_numbers(key, {"dirichlet", "neumann"});
  for (std::size_t i = 0; i < 2; ++i)
    if (const double* robin = std::get_if<double>(&found[i]))
      ends[i] = *robin;
    else
      ends[i] = std::get<std::string>(found[i]) == "neumann" ? neumann : dirichlet;
  return ends;
}

/// Values of the directions: across alone (a line), along and across, or along, beside and across (a box).
Vector of_directions(const Section& section, const char* key, Index dimensions) {
  return dimensions == 1 ? Vector::Constant(1, section.number(key)) : section.one_or_each(key, dimensions);
}

/// The lines of all directions, in this order.
std::vector<GridLine*> directions_of(Rectangle& r, Index dimensions) {
  if (dimensions == 1) return {&r.across};
  if (dimensions == 2) return {&r.along, &r.across};
  r.beside.resize(1);
  return {&r.along, &r.beside[0], &r.across};
}

void read_ends(const Section& section, const char* key, GridLine& line) {
  const auto ends = ends_of(section, key);
  line.first = ends[0], line.last = ends[1];
}

Vector spacings(const Section& section, const std::vector<GridLine*>& lines) {
  const Index dimensions = Index(lines.size());
  if (!section.has("length")) return of_directions(section, "spacing", dimensions);
  if (section.has("spacing")) throw Error(section.where("length"), "is given with spacing", "give one of the two");
  Vector found = of_directions(section, "length", dimensions);
  for (Index i = 0; i < dimensions; ++i) {
    const GridLine& line = *lines[std::size_t(i)];
    found[i] = GridLine::spacing_of(line.points, found[i], line.first, line.last);
  }
  return found;
}

void require_positive_in(const Section& section, const char* key, const Vector& values) {
  for (const double value : values)
    if (!(value > 0)) throw Error(section.where(key), fmt::format("found {}", value), "give positive numbers");
}

void read_lines(const Section& section, Index dimensions, Rectangle& r) {
  const std::vector<GridLine*> lines = directions_of(r, dimensions);
  const auto each = [&](const Vector& values, const auto& take) {
    for (std::size_t i = 0; i < lines.size(); ++i) take(*lines[i], values[Index(i)]);
  };
  each(of_directions(section, "points", dimensions),
       [&](GridLine& line, double count) { line.points = points_of(section, count); });
  read_ends(section, "across", r.across);
  if (dimensions == 1) r.along = {.points = 1, .first = neumann, .last = neumann};
  if (dimensions > 1) read_ends(section, "along", r.along);
  if (dimensions > 2) read_ends(section, "beside", r.beside[0]);
  const Vector spacing = spacings(section, lines), diffusivity = of_directions(section, "diffusivity", dimensions);
  require_positive_in(section, section.has("length") ? "length" : "spacing", spacing);
  require_positive_in(section, "diffusivity", diffusivity);
  each(spacing, [](GridLine& line, double value) { line.spacing = value; });
  each(diffusivity, [](GridLine& line, double value) { line.diffusivity = value; });
  if (dimensions == 1) r.along.spacing = r.across.spacing, r.along.diffusivity = r.across.diffusivity;
  if (!section.has("advection")) return;
  each(of_directions(section, "advection", dimensions), [](GridLine& line, double value) { line.advection = value; });
}

/// Errors name the key of the file.
void validate(const Section& section, const Rectangle& r) {
  try {
    r.validate();
  } catch (const Error& error) {
    const std::string& member = error.argument();
    const std::size_t dot = member.find('.');
    std::string key = dot == std::string::npos ? member : member.substr(dot + 1);
    if (key == "first" || key == "last") key = member.substr(0, std::min(dot, member.find('[')));
    throw Error(section.where(key), error.found(), error.remedy(), error.kind());
  }
}

Index dimensions_of(const Section& section) {
  const Index dimensions = section.positive_integer("dimensions", 2);
  if (dimensions > 3)
    throw Error(section.where("dimensions"), fmt::format("found {}", dimensions),
                "give 1 (a line), 2 (a rectangle) or 3 (a box)");
  if (dimensions == 1 && section.has("along"))
    throw Error(section.where("along"), "is given with dimensions = 1", "leave it out: a line has the ends `across`");
  if (dimensions < 3 && section.has("beside"))
    throw Error(section.where("beside"), fmt::format("is given with dimensions = {}", dimensions),
                "leave it out, or give dimensions = 3");
  return dimensions;
}

Rectangle rectangle_of(const Sections& s) {
  for (const auto& [section, key] :
       {std::pair(&s.dynamics, "A"), {&s.dynamics, "B"}, {&s.dynamics, "E"}, {&s.complementarity, "N"}})
    if (section->has(key))
      throw Error(section->where(key), "is given with a section [kronecker]", "leave it out: [kronecker] says it");
  const Section& section = s.kronecker;
  Rectangle r;
  read_lines(section, dimensions_of(section), r);
  r.reaction = section.optional_number("reaction").value_or(0);
  r.b = of_line(section, "b", r.across.points);
  r.n = of_line(section, "n", r.across.points);
  if (section.has("far_b") || section.has("far_n")) {
    r.far_b = of_line(section, "far_b", r.across.points);
    r.far_n = of_line(section, "far_n", r.across.points);
  }
  r.written_out = s.dynamics.has("F");
  validate(section, r);
  return r;
}

}  // namespace

bool without_pairs(const Sections& s) { return !s.complementarity.given() && !s.dynamics.has("B"); }

const Rectangle& read_rectangle(const Sections& s) {
  return s.kronecker.kept("the rectangle", {}, [&] { return rectangle_of(s); });
}

const Dynamics& read_dynamics(const Sections& s) {
  return s.dynamics.kept("x' = A x + B y", {}, [&]() -> Dynamics {
    if (s.kronecker.given()) return read_rectangle(s);
    return dynamics_of_matrices(s);
  });
}

MatrixValue of_each_side(MatrixValue M, const Rectangle& r, const std::string& where) {
  const Index n = r.lines();
  if (r.sides() == 1 || rows(M) == 2 * n) return M;
  if (rows(M) != n || columns(M) != n)
    throw Error(where, fmt::format("is {} x {}", rows(M), columns(M)),
                fmt::format("make it {} x {} for each of the two sides, or {} x {}", n, n, 2 * n, 2 * n));
  const SparseMatrix one = sparse_value(M);
  std::vector<Eigen::Triplet<double>> entries;
  for (Index j = 0; j < n; ++j)
    for (SparseMatrix::InnerIterator e(one, j); e; ++e)
      for (const Index side : {Index(0), n}) entries.emplace_back(side + e.row(), side + j, e.value());
  SparseMatrix both(2 * n, 2 * n);
  both.setFromTriplets(entries.begin(), entries.end());
  return both;
}

}  // namespace bromwich
