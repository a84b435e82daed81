// Matrices and vectors of a scene.

#include "capi/arrays.hpp"
#include "capi/failures.hpp"
#include "capi/handles.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <climits>
#include <string_view>
#include <utility>

namespace bromwich::capi {

namespace {

void check_shape(const std::string& name, Index rows, Index columns, Index wanted_rows, Index wanted_columns) {
  if (rows != wanted_rows || columns != wanted_columns)
    throw Error(name, fmt::format("is {} x {}", rows, columns),
                fmt::format("give {} x {}", wanted_rows, wanted_columns));
}

void require_own(const bromwich_scene& s, const std::string& name) {
  if (!s.own) throw Error(name, "is set in a scene that was read", "write it in the text, or use bromwich_scene_new");
}

/// A, B, N or E with the shape that it has to have; null for another name.
GivenMatrix* matrix_of_dynamics(bromwich_scene& s, std::string_view name, Index rows, Index columns) {
  const Index m = s.scene.states(), n = s.scene.constraints();
  const auto found = [&](GivenMatrix& matrix, Index wanted_rows, Index wanted_columns) {
    require_own(s, std::string(name));
    check_shape(std::string(name), rows, columns, wanted_rows, wanted_columns);
    s.stale = true;
    return &matrix;
  };
  if (name == "A") return found(s.A, m, m);
  if (name == "B") return found(s.B, m, n);
  if (name == "N") return found(s.N, n, m);
  if (name == "E") return found(s.E, m, m);
  return nullptr;
}

BoundaryCondition& boundary_of(Scene& scene) {
  const Index m = scene.states();
  if (!scene.boundary) scene.boundary = BoundaryCondition{Matrix::Zero(m, m), Matrix::Zero(m, m), Vector::Zero(m)};
  scene.x0.resize(0);
  return *scene.boundary;
}

void set_source_matrix(bromwich_scene& s, SparseMatrix F) {
  if (s.scene.f) throw Error("F", "is set behind f", "set F first");
  s.scene.F = std::move(F);
  s.scene.f_entry = SourceEntry::through_F;
}

void set_vector(bromwich_scene& s, std::string_view name, const Matrix& values) {
  Scene& scene = s.scene;
  const auto vector_of = [&](Index length) {
    check_shape(std::string(name), values.rows(), values.cols(), length, 1);
    return Vector(values.col(0));
  };
  const Index m = scene.states();
  if (name == "x0") {
    scene.x0 = vector_of(m);
    scene.boundary.reset();
  } else if (name == "b") {
    boundary_of(scene).b = vector_of(m);
  } else if (name == "restitution") {
    scene.restitution = vector_of(scene.constraints());
  } else if (name == "breakpoints") {
    const Vector times = vector_of(values.rows());
    s.kinks.assign(times.begin(), times.end());
    merge_kinks(s);
  } else {
    const std::vector<std::string> known{"A",  "B",  "N", "M", "E",           "x0",
                                         "E0", "ET", "b", "F", "restitution", "breakpoints"};
    throw Error("name", fmt::format("found '{}'", name) + suggestion(std::string(name), known), "use " + join(known));
  }
}

void set_values(bromwich_scene& s, const std::string& name, const Matrix& values) {
  const Index m = s.scene.states(), n = s.scene.constraints(), rows = values.rows(), columns = values.cols();
  if (GivenMatrix* matrix = matrix_of_dynamics(s, name, rows, columns)) {
    *matrix = {values, {}};
  } else if (name == "M") {
    check_shape(name, rows, columns, n, n);
    s.scene.M = values;
  } else if (name == "E0" || name == "ET") {
    check_shape(name, rows, columns, m, m);
    (name == "E0" ? boundary_of(s.scene).E0 : boundary_of(s.scene).ET) = values;
  } else if (name == "F") {
    check_shape(name, rows, columns, m, columns);
    set_source_matrix(s, values.sparseView());
  } else {
    set_vector(s, name, values);
  }
}

SparseMatrix sparse_from(const std::string& name, Index rows, Index columns, const int64_t* starts, const int64_t* row,
                         const double* values) {
  if (rows < 0 || columns < 0) throw Error(name, fmt::format("is {} x {}", rows, columns), "give 0 rows or more");
  given(starts, "starts");
  std::vector<Eigen::Triplet<double>> entries;
  for (Index j = 0; j < columns; ++j) {
    if (starts[j] < 0 || starts[j + 1] < starts[j])
      throw Error(name, fmt::format("column {} goes from {} to {}", j, starts[j], starts[j + 1]),
                  "give increasing starts");
    for (int64_t k = starts[j]; k < starts[j + 1]; ++k) {
      const int64_t i = given_array(row, starts[j + 1], "row")[k];
      if (i < 0 || i >= rows)
        throw Error(name, fmt::format("has an entry in row {}", i), fmt::format("count from 0 to {}", rows - 1));
      entries.emplace_back(int(i), int(j), given_array(values, starts[j + 1], "values")[k]);
    }
  }
  SparseMatrix made(rows, columns);
  made.setFromTriplets(entries.begin(), entries.end());
  return made;
}

void set_sparse(bromwich_scene& s, const std::string& name, SparseMatrix values) {
  if (GivenMatrix* matrix = matrix_of_dynamics(s, name, values.rows(), values.cols())) {
    *matrix = {{}, std::move(values)};
  } else if (name == "M") {
    check_shape(name, values.rows(), values.cols(), s.scene.constraints(), s.scene.constraints());
    s.scene.M = SparseLcpMatrix(std::move(values));
  } else if (name == "F") {
    check_shape(name, values.rows(), values.cols(), s.scene.states(), values.cols());
    set_source_matrix(s, std::move(values));
  } else {
    throw Error("name", fmt::format("found '{}'", name), "use A, B, N, M, E or F; other arrays are dense");
  }
}

SparseMatrix as_sparse(const GivenMatrix& matrix) {
  return matrix.sparse ? *matrix.sparse : SparseMatrix(matrix.dense.sparseView());
}

LcpClass class_named(const std::string& name) {
  const std::vector<std::pair<std::string, LcpClass>> known{
      {"P", LcpClass::P}, {"Z", LcpClass::Z}, {"PSD", LcpClass::PSD}, {"unknown", LcpClass::unknown}};
  for (const auto& [word, value] : known)
    if (word == name) return value;
  throw Error("class", fmt::format("found '{}'", name), "use P, Z, PSD or unknown");
}

}  // namespace

Matrix matrix_from(const double* values, Index rows, Index columns, int order, const std::string& name) {
  if (order != BROMWICH_ROWS && order != BROMWICH_COLUMNS)
    throw Error("order", fmt::format("found {}", order), "give BROMWICH_ROWS or BROMWICH_COLUMNS");
  if (rows < 0 || columns < 0) throw Error(name, fmt::format("is {} x {}", rows, columns), "give 0 rows or more");
  given_array(values, rows * columns, name.c_str());
  if (order == BROMWICH_COLUMNS) return Eigen::Map<const Matrix>(values, rows, columns);
  return Eigen::Map<const RowMatrix>(values, rows, columns);
}

LcpClass class_of(const char* name) { return name ? class_named(name) : LcpClass::automatic; }

/// Those of the scene as it was read, of f and of g.
void merge_kinks(bromwich_scene& s) {
  std::vector<double> all = s.kinks;
  for (const GivenSource* source : {&s.f, &s.g}) all.insert(all.end(), source->kinks.begin(), source->kinks.end());
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  s.scene.breakpoints = std::move(all);
  s.scene.breakpoints_are_all = s.kinks_are_all && s.f.all && s.g.all;
}

void hand_over(const HandedOver& array, const double** values, int64_t* rows, int64_t* columns) {
  given(values, "values") = array.values;
  if (rows) *rows = array.rows;
  if (columns) *columns = array.columns;
}

}  // namespace bromwich::capi

using namespace bromwich;
using namespace bromwich::capi;

const Scene& bromwich_scene::complete() const {
  if (!stale) return scene;
  const bool sparse = A.sparse || B.sparse || N.sparse || E.sparse;
  const bool mass = E.sparse || E.dense.size() > 0;
  if (sparse)
    scene.dynamics = SparseDynamics{as_sparse(A), as_sparse(B), as_sparse(N), mass ? as_sparse(E) : SparseMatrix()};
  else
    scene.dynamics = DenseDynamics{A.dense, B.dense, N.dense, E.dense};
  stale = false;
  return scene;
}

int bromwich_scene_set(bromwich_scene* scene, const char* name, const double* values, int64_t rows, int64_t columns,
                       int order) {
  return guarded([&] {
    const std::string named = &given(name, "name");
    set_values(given(scene, "scene"), named, matrix_from(values, rows, columns, order, named));
  });
}

int bromwich_scene_set_sparse(bromwich_scene* scene, const char* name, int64_t rows, int64_t columns,
                              const int64_t* starts, const int64_t* row, const double* values) {
  return guarded([&] {
    const std::string named = &given(name, "name");
    set_sparse(given(scene, "scene"), named, sparse_from(named, rows, columns, starts, row, values));
  });
}

int bromwich_scene_set_class(bromwich_scene* scene, const char* name) {
  return guarded([&] { given(scene, "scene").scene.lcp_class = class_of(&given(name, "name")); });
}

int bromwich_scene_set_free_rows(bromwich_scene* scene, const int64_t* rows, int64_t count) {
  return guarded([&] {
    Scene& changed = given(scene, "scene").scene;
    given_array(rows, count, "rows");
    changed.free_rows.assign(rows, rows + count);
  });
}
