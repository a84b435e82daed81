// Scenes: put together piece by piece by the Python layer, read from files, or built in.

#include "app/result_output.hpp"
#include "arrays.hpp"
#include "core/base/error.hpp"
#include "core/dynamics/rectangle.hpp"
#include "core/scene/relay.hpp"
#include "dynamics.hpp"
#include "files/scene_file.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/complex.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

namespace bromwich::python {
namespace {

using Sparse = std::tuple<Index, Index, Array1, Indices, Indices>;  // rows, columns, values, row of each, starts

/// points, spacing, diffusivity, advection, and the two ends of a line of grid points.
using Line = std::tuple<Index, double, double, double, std::optional<double>, std::optional<double>>;

/// points, spacing, diffusivity, the reflections of both ends and the decay of a second difference.
using Difference = std::tuple<Index, double, double, double, double, double>;

SparseMatrix matrix(const Sparse& s) {
  return std::apply([](Index rows, Index cols, const auto&... parts) { return as_sparse(rows, cols, parts...); }, s);
}

SparseMatrix matrix_or_empty(const std::optional<Sparse>& s) { return s ? matrix(*s) : SparseMatrix(); }

LcpClass lcp_class(const std::string& word) {
  if (const auto named = lcp_class_named(word)) return *named;
  std::string names;
  for (const std::string& name : lcp_class_names()) names += (names.empty() ? "use one of " : ", ") + name;
  throw Error("lcp_class", "found '" + word + "'", names);
}

SourceEntry source_entry(const std::string& word) {
  if (word == "B") return SourceEntry::through_B;
  return word == "F" ? SourceEntry::through_F : SourceEntry::state;
}

void keep(Model& model, const std::vector<Kept>& callables) {
  model.callables.insert(model.callables.end(), callables.begin(), callables.end());
}

void set_sources(Model& model, const Source* f, const Source* g, const std::vector<double>& declared) {
  static const Source none{{}, 0, {}, true};
  const Source &given_f = f ? *f : none, &given_g = g ? *g : none;
  for (const Source* given : {&given_f, &given_g}) {
    keep(model, given->callables);
    if (given->forget) model.forget.push_back(given->forget);
  }
  model.f = f ? std::make_shared<const Source>(*f) : nullptr;
  model.g = g ? std::make_shared<const Source>(*g) : nullptr;
  model.declared = declared;
  Scene& scene = model.scene;
  scene.f = given_f.function;
  scene.g = given_g.function;
  scene.breakpoints = merged(merged(given_f.breakpoints, given_g.breakpoints), declared);
  scene.breakpoints_are_all = given_f.breakpoints_are_all && given_g.breakpoints_are_all;
}

nb::object reference_of(const std::optional<Reference>& r) {
  if (!r) return nb::none();
  nb::dict d;
  d["t"] = r->t;
  d["x"] = r->x;
  d["y"] = r->y;
  d["tolerance"] = r->tolerance;
  d["status"] = r->status;
  d["infeasible_at"] = r->infeasible_at;
  d["source"] = r->source;
  return d;
}

nb::dict labels(const Labels& given) {
  nb::dict d;
  d["x"] = given.x;
  d["y"] = given.y;
  d["w"] = given.w;
  return d;
}

nb::tuple read_scene(const std::string& file, const ParameterValues& settings) {
  SceneFile read = [&] {
    const nb::gil_scoped_release unlocked;
    return read_scene_file(std::filesystem::path(file), settings);
  }();
  const auto model = std::make_shared<Model>(std::move(read.scene), read.quantity);
  model->rectangle = std::move(read.rectangle);
  nb::dict facts;
  facts["description"] = read.description;
  facts["parameters"] = read.parameters;
  facts["states"] = read.states;
  facts["reference"] = reference_of(read.reference);
  facts["warning"] = read.warning;
  return nb::make_tuple(model, facts);
}

nb::list catalogue() {
  nb::list all;
  for (const SceneRecipe& recipe : scene_catalogue()) {
    nb::dict parameters;
    for (const SceneParameter& p : recipe.parameters) parameters[p.name.c_str()] = nb::make_tuple(p.value, p.meaning);
    all.append(nb::make_tuple(recipe.name, recipe.summary, parameters));
  }
  return all;
}

std::optional<std::pair<View, View>> exact(const Scene& scene, double t) {
  if (!scene.exact) return std::nullopt;
  auto* values = new std::pair<Vector, Vector>(Vector::Zero(scene.states()), Vector::Zero(scene.constraints()));
  const nb::capsule owner(values, [](void* p) noexcept { delete static_cast<std::pair<Vector, Vector>*>(p); });
  scene.exact(t, values->first, values->second);
  return std::pair(view(values->first, owner), view(values->second, owner));
}

int visit_callables(PyObject* self, visitproc visit, void* arg) {
  Py_VISIT(Py_TYPE(self));
  if (!nb::inst_ready(self)) return 0;
  for (const Kept& callable : nb::inst_ptr<Model>(self)->callables) Py_VISIT(callable.held());
  return 0;
}

int let_go_of_callables(PyObject* self) {
  for (Kept& callable : nb::inst_ptr<Model>(self)->callables) callable.let_go();
  return 0;
}

PyType_Slot cycle_slots[] = {{Py_tp_traverse, reinterpret_cast<void*>(visit_callables)},
                             {Py_tp_clear, reinterpret_cast<void*>(let_go_of_callables)},
                             {0, nullptr}};

const char* form(const Scene& scene) {
  const LinearSystem& dynamics = *scene.dynamics;
  return dynamics.small_state() ? "dense"
         : dynamics.modes()     ? "kronecker"
         : dynamics.matrices()  ? "sparse"
                                : "supplied";
}

using Bound = nb::class_<Model>;

void bind_dynamics(Bound& model) {
  model
      .def(
          "set_dense",
          [](Model& s, const Array2& A, const Array2& B, const Array2& N, const std::optional<Array2>& E) {
            s.scene.dynamics =
                DenseDynamics{as_matrix(A), as_matrix(B), as_matrix(N), E ? Matrix(as_matrix(*E)) : Matrix()};
          },
          nb::arg("A"), nb::arg("B"), nb::arg("N"), nb::arg("E").none())
      .def(
          "set_sparse",
          [](Model& s, const Sparse& A, const Sparse& B, const Sparse& N, const std::optional<Sparse>& E) {
            s.scene.dynamics = SparseDynamics{matrix(A), matrix(B), matrix(N), matrix_or_empty(E)};
          },
          nb::arg("A"), nb::arg("B"), nb::arg("N"), nb::arg("E").none())
      .def_prop_ro("grid",
                   [](const Model& s) -> nb::object {
                     const auto g = app::field_grid(s.scene, s.rectangle);
                     if (!g) return nb::none();
                     return nb::make_tuple(g->along, g->across, g->along_spacing, g->across_spacing, g->along_first,
                                           g->across_first);
                   })
      .def(
          "set_kronecker",
          [](Model& s, const Difference& along, const Difference& across, const Array1& b, const Array1& n,
             const std::vector<Difference>& beside, bool both_faces) {
            const auto difference = [](const auto& d) { return std::make_from_tuple<SecondDifference>(d); };
            KroneckerDynamics sum{difference(along), difference(across), as_vector(b), as_vector(n)};
            for (const auto& direction : beside) sum.beside.push_back(difference(direction));
            sum.both_faces = both_faces;
            s.scene.dynamics = std::move(sum);
          },
          nb::arg("along"), nb::arg("across"), nb::arg("b"), nb::arg("n"), nb::arg("beside"),
          nb::arg("both_faces") = false)
      .def(
          "set_rectangle",
          [](Model& s, const Line& along, const Line& across, double reaction, const Array1& b, const Array1& n,
             const Array1& far_b, const Array1& far_n, const std::vector<Line>& beside, bool written_out) {
            Rectangle rectangle{
                .along = std::make_from_tuple<GridLine>(along),
                .across = std::make_from_tuple<GridLine>(across),
                .reaction = reaction,
                .b = as_vector(b),
                .n = as_vector(n),
                .far_b = as_vector(far_b),
                .far_n = as_vector(far_n),
                .written_out = written_out,
            };
            for (const Line& line : beside) rectangle.beside.push_back(std::make_from_tuple<GridLine>(line));
            s.scene.dynamics = rectangle;
            s.rectangle = std::move(rectangle);
          },
          nb::arg("along"), nb::arg("across"), nb::arg("reaction"), nb::arg("b"), nb::arg("n"), nb::arg("far_b"),
          nb::arg("far_n"), nb::arg("beside"), nb::arg("written_out"))
      .def(
          "set_supplied",
          [](Model& s, Index states, const Sparse& B, const Sparse& N, nb::object shifted, nb::object mass,
             std::optional<std::pair<double, double>> bound) {
            const auto spectral = bound ? std::optional(SpectralBound{bound->first, bound->second}) : std::nullopt;
            const Kept prepares(std::move(shifted)), multiplies = mass.is_none() ? Kept() : Kept(std::move(mass));
            keep(s, {prepares, multiplies});
            s.shifted = prepares, s.mass = multiplies;
            s.scene.dynamics = supplied_dynamics(states, matrix(B), matrix(N), prepares, multiplies, spectral);
          },
          nb::arg("states"), nb::arg("B"), nb::arg("N"), nb::arg("shifted"), nb::arg("mass").none(),
          nb::arg("bound").none());
}

void bind_data(Bound& model) {
  model
      .def(
          "set_M", [](Model& s, const Array2& M) { s.scene.M = Matrix(as_matrix(M)); }, nb::arg("M"))
      .def(
          "set_M_sparse", [](Model& s, const Sparse& M) { s.scene.M = SparseLcpMatrix(matrix(M)); }, nb::arg("M"))
      .def(
          "set_M_tridiagonal",
          [](Model& s, const Array1& lower, const Array1& diagonal, const Array1& upper) {
            s.scene.M = Tridiagonal{as_vector(lower), as_vector(diagonal), as_vector(upper)};
          },
          nb::arg("lower"), nb::arg("diagonal"), nb::arg("upper"))
      .def(
          "set_sources",
          [](Model& s, const Source* f, const Source* g, const std::vector<double>& breakpoints) {
            set_sources(s, f, g, breakpoints);
          },
          nb::arg("f").none(), nb::arg("g").none(), nb::arg("breakpoints"))
      .def(
          "set_f_entry",
          [](Model& s, const std::string& word, const std::optional<Sparse>& F) {
            s.scene.f_entry = source_entry(word);
            s.scene.F = matrix_or_empty(F);
          },
          nb::arg("word"), nb::arg("F").none())
      .def(
          "set_x0", [](Model& s, const Array1& x0) { s.scene.x0 = as_vector(x0); }, nb::arg("x0"))
      .def(
          "set_boundary",
          [](Model& s, const Array2& E0, const Array2& ET, const Array1& b) {
            s.scene.boundary = BoundaryCondition{as_matrix(E0), as_matrix(ET), as_vector(b)};
          },
          nb::arg("E0"), nb::arg("ET"), nb::arg("b"))
      .def(
          "set_lcp_class", [](Model& s, const std::string& word) { s.scene.lcp_class = lcp_class(word); },
          nb::arg("word"));
}

/// A row for each of the times `t`; zeros where the source is empty.
RowMatrix values_at(const TimeFunction& source, const Array1& t, Index width) {
  RowMatrix values = RowMatrix::Zero(Index(t.shape(0)), width);
  Vector value(width);
  for (Index i = 0; source && i < values.rows(); ++i) {
    source(t.data()[i], value);
    values.row(i) = value;
  }
  return values;
}

void bind_facts(Bound& model) {
  model.def("validate", [](const Model& s) { s.scene.validate(); })
      .def_prop_rw(
          "name", [](const Model& s) { return s.scene.name; },
          [](Model& s, std::string v) { s.scene.name = std::move(v); })
      .def_prop_rw(
          "T", [](const Model& s) { return s.scene.T; }, [](Model& s, double v) { s.scene.T = v; })
      .def_prop_rw(
          "steps", [](const Model& s) { return s.scene.default_steps; },
          [](Model& s, Index v) { s.scene.default_steps = v; })
      .def_prop_rw(
          "tolerance", [](const Model& s) { return s.scene.default_tolerance; },
          [](Model& s, double v) { s.scene.default_tolerance = v; })
      .def_prop_rw(
          "restitution", [](const Model& s) { return s.scene.restitution; },
          [](Model& s, const Array1& v) { s.scene.restitution = as_vector(v); })
      .def_prop_rw(
          "free_rows", [](const Model& s) { return s.scene.free_rows; },
          [](Model& s, std::vector<Index> v) { s.scene.free_rows = std::move(v); })
      .def_prop_ro("states", [](const Model& s) { return s.scene.states(); })
      .def_prop_ro("constraints", [](const Model& s) { return s.scene.constraints(); })
      .def_prop_ro("sources", [](const Model& s) { return s.scene.sources(); })
      .def_prop_ro("breakpoints", [](const Model& s) { return s.scene.breakpoints; })
      .def_prop_ro("names", [](const Model& s) { return labels(s.scene.names); })
      .def_prop_ro("units", [](const Model& s) { return labels(s.scene.units); })
      .def_prop_ro("time_unit", [](const Model& s) { return s.scene.time_unit; })
      .def_prop_ro("form", [](const Model& s) { return form(s.scene); })
      .def_prop_ro("has_boundary", [](const Model& s) { return s.scene.boundary.has_value(); })
      .def("x0", [](const Model& s) { return std::vector<double>(s.scene.x0.begin(), s.scene.x0.end()); })
      .def(
          "f_at", [](const Model& s, const Array1& t) { return values_at(s.scene.f, t, s.scene.sources()); },
          nb::arg("t"))
      .def(
          "g_at", [](const Model& s, const Array1& t) { return values_at(s.scene.g, t, s.scene.constraints()); },
          nb::arg("t"))
      .def(
          "exact", [](const Model& s, double t) { return exact(s.scene, t); }, nb::arg("t"));
}

}  // namespace

void bind_scenes(nb::module_& m) {
  Bound bound(m, "Model", nb::type_slots(cycle_slots),
              "What is solved. Pieces are set one by one; `validate` looks at all of them.");
  bound.def_static("empty", [] { return std::make_shared<Model>(); });
  bind_dynamics(bound);
  bind_data(bound);
  bind_facts(bound);
  m.def(
      "relay",
      [](const Array2& A, const Array2& B, const Array2& C, const Array1& x0, const Array2& N, const Array2& M,
         const Source* f, const Source* e, const Source* limit, const Source* g) {
        const auto function = [](const Source* s) { return s ? s->function : TimeFunction(); };
        const Index n = Index(N.shape(0));
        const Matrix all = as_matrix(B);
        if (n > all.cols())
          throw Error("B", "has " + std::to_string(all.cols()) + " columns",
                      "give one for each relay and each row of N");
        Scene scene = relay_scene(as_matrix(A), all.leftCols(all.cols() - n), as_matrix(C), function(f), as_vector(x0),
                                  function(e), function(limit));
        if (n > 0) scene = with_pairs(std::move(scene), all.rightCols(n), as_matrix(N), as_matrix(M), function(g));
        auto model = std::make_shared<Model>(std::move(scene));
        model->scene.breakpoints_are_all = true;
        for (const Source* source : {f, e, limit, g}) {
          if (!source) continue;
          model->scene.breakpoints = merged(model->scene.breakpoints, source->breakpoints);
          model->scene.breakpoints_are_all = model->scene.breakpoints_are_all && source->breakpoints_are_all;
          keep(*model, source->callables);
          if (source->forget) model->forget.push_back(source->forget);
        }
        return model;
      },
      nb::arg("A"), nb::arg("B"), nb::arg("C"), nb::arg("x0"), nb::arg("N"), nb::arg("M"), nb::arg("f").none(),
      nb::arg("e").none(), nb::arg("bound").none(), nb::arg("g").none());
  m.def("read_scene", &read_scene, nb::arg("file"), nb::arg("settings"));
  m.def(
      "build_scene",
      [](const std::string& name, const ParameterValues& values) {
        return std::make_shared<Model>(make_scene(name, values));
      },
      nb::arg("name"), nb::arg("values"));
  m.def("catalogue", &catalogue, "Name, summary and parameters (default, meaning) of the built-in scenes.");
}

}  // namespace bromwich::python
