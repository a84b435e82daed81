#include "derivatives/parameter_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/scene/breakpoints.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr double same_row = 1e-12;     ///< of T
constexpr double interpolated = 1e-7;  ///< error of changes of f and g, linear between times, relative
constexpr Index most_divided = 256;    ///< parts of a step
constexpr Index most_fine_times = 1 << 16;

Vector merged_times(const Vector& t, const std::vector<double>& also) {
  std::vector<double> all(t.begin(), t.end());
  const double T = t[t.size() - 1];
  for (const double more : also)
    if (more >= 0 && more <= T) all.push_back(more);
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end(), [T](double a, double b) { return b - a <= same_row * T; }), all.end());
  all.back() = T;
  return Eigen::Map<const Vector>(all.data(), Index(all.size()));
}

// All times, and the middles of the intervals between them.
Vector with_middles(const Vector& t) {
  const Index J = t.size() - 1;
  Vector all(2 * J + 1);
  all(Eigen::seqN(0, J + 1, 2)) = t;
  all(Eigen::seqN(1, J, 2)) = (t.head(J) + t.tail(J)) / 2;
  return all;
}

// The largest distance of the middles from the lines between their neighbours, relative. Intervals with a kink are left
// out: their error is of higher order in the step.
double bend_of(const RowMatrix& table, const Vector& t, const std::vector<double>& kinks) {
  if (table.size() == 0) return 0;
  const double size = table.cwiseAbs().maxCoeff();
  double most = 0;
  for (Index j = 1; j + 1 < table.rows(); j += 2) {
    const auto in_here = [&](double k) { return k >= t[j - 1] && k <= t[j + 1]; };
    if (std::any_of(kinks.begin(), kinks.end(), in_here)) continue;
    most = std::max(most, (table.row(j) - (table.row(j - 1) + table.row(j + 1)) / 2).cwiseAbs().maxCoeff());
  }
  return size > 0 ? most / size : 0;
}

// Times beside the breakpoints and the ends, so that lines end and begin with the limits there: a source may have a
// value of its own at 0 and T. SwitchedDerivative takes the times at a breakpoint, or an end, for one.
Vector with_limits(const Vector& times, const Scene& scene) {
  const double beside = 0.4 * same_row * scene.T;
  std::vector<double> all(times.begin(), times.end());
  all.insert(all.end(), {beside, scene.T - beside});
  const bool known = scene.breakpoints_are_all || !(scene.f || scene.g);
  for (const double at : known ? scene.breakpoints : find_breakpoints(scene))
    if (at > 2 * beside && at < scene.T - 2 * beside) all.insert(all.end(), {at - beside, at + beside});
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return Eigen::Map<const Vector>(all.data(), Index(all.size()));
}

// Where to look for values at these times: at a breakpoint, which may be known to a few digits less than times, on
// either side of it.
Vector sampled_at(const Vector& times, double T) {
  constexpr double beside = 1e-9;
  Vector at = times;
  const Index last = times.size() - 1;
  for (Index j = 1; j < last; ++j) {
    const bool left = times[j + 1] - times[j] <= same_row * T, right = times[j] - times[j - 1] <= same_row * T;
    if (left && !right) at[j] -= beside * T;
    if (right && !left) at[j] += beside * T;
  }
  return at;
}

// Times at which lines between the rows of the changes of f and g are these changes.
Vector fine_times(const Vector& rows, const std::vector<ParameterNeighbours>& neighbours, const Scene& scene) {
  double bend = 0, moved = 0;
  const Vector all = with_middles(rows);
  std::vector<double> kinks = scene.breakpoints;
  for (const ParameterNeighbours& n : neighbours) {
    kinks.insert(kinks.end(), n.moving.begin(), n.moving.end());
    moved = std::max(moved, n.moved);
  }
  std::vector<double> more;
  for (const ParameterNeighbours& n : neighbours) {
    const ParameterChange change = parameter_change(n, scene, all, true, each_mode(scene));
    const auto look = [&](const DataChange& c) {
      bend = std::max({bend, bend_of(c.f, all, kinks), bend_of(c.g, all, kinks)});
    };
    look(change.data);
    for (const auto& [modes, c] : change.in_modes) look(c);
    for (const double at : n.moving) {  // the change has other limits on both sides
      const double beside = 2 * n.moved + 1e-9 * scene.T;
      more.push_back(at - beside), more.push_back(at + beside);
    }
  }
  const Index J = rows.size() - 1;
  const Index parts = std::clamp<Index>(Index(std::ceil(std::sqrt(bend / interpolated))), 1,
                                        std::clamp<Index>(most_fine_times / J, 1, most_divided));
  for (Index j = 0; j < J; ++j)
    for (Index k = 1; k < parts; ++k) more.push_back(rows[j] + (rows[j + 1] - rows[j]) * double(k) / double(parts));
  return with_limits(merged_times(rows, more), scene);
}

bool at_moving_jump(const std::vector<ParameterNeighbours>& neighbours, double t, double T) {
  return std::any_of(neighbours.begin(), neighbours.end(), [&](const ParameterNeighbours& n) {
    return std::any_of(n.jumps.begin(), n.jumps.end(),
                       [&](const MovingJump& jump) { return std::abs(jump.t - t) <= 1e-9 * T; });
  });
}

std::vector<Index> places_of(const Vector& rows, const Vector& times) {
  std::vector<Index> places;
  Index at = 0;
  for (const double t : rows) {
    while (at + 1 < times.size() && std::abs(times[at + 1] - t) <= std::abs(times[at] - t)) ++at;
    places.push_back(at);
  }
  return places;
}

bool is_written_out(const Scene& scene) { return scene.states() <= ResultDerivative::largest_written_out; }

ResultDerivative of_result(const Scene& scene, const Result& result, Backend& backend, std::optional<bool> located,
                           const Vector& rows, const std::vector<ParameterNeighbours>& neighbours) {
  const bool may_be = ResultDerivative::may_be_located(scene);
  for (const ParameterNeighbours& n : neighbours) {
    if (n.jumps.empty() || scene.boundary) continue;  // method galerkin divides its intervals at jumps
    if (!may_be || !located.value_or(true))
      throw Error("derivative", text("by %s: a jump of f or g at t = %.6g moves with it", n.name.c_str(), n.jumps[0].t),
                  may_be ? "take the derivative with located switches" : "state a steep slope in place of the jump");
    located = true;
  }
  return ResultDerivative(scene, result, backend,
                          {.located = located, .times = may_be ? fine_times(rows, neighbours, scene) : Vector()});
}

// Whether the gradient has all members that change.
bool has_gradient(const DataChange& gradient, const DataChange& change) {
  const auto has = [&](auto member) { return (change.*member).size() == 0 || (gradient.*member).size() > 0; };
  return has(&DataChange::x0) && has(&DataChange::f) && has(&DataChange::g) && has(&DataChange::A) &&
         has(&DataChange::B) && has(&DataChange::N) && has(&DataChange::M) && has(&DataChange::E) &&
         has(&DataChange::b) && has(&DataChange::E0) && has(&DataChange::ET) && has(&DataChange::restitution);
}

// sum + c value, of tables that may be empty.
template <class Table>
void add_multiple(Table& sum, double c, const Table& value) {
  if (value.size() == 0 || c == 0) return;
  if (sum.size() == 0)
    sum = c * value;
  else
    sum += c * value;
}

void add_multiple(DataChange& sum, double c, const DataChange& value) {
  add_multiple(sum.x0, c, value.x0), add_multiple(sum.b, c, value.b);
  add_multiple(sum.f, c, value.f), add_multiple(sum.g, c, value.g);
  add_multiple(sum.restitution, c, value.restitution);
  for (const auto member : {&DataChange::A, &DataChange::B, &DataChange::N, &DataChange::M, &DataChange::E,
                            &DataChange::E0, &DataChange::ET})
    add_multiple(sum.*member, c, value.*member);
}

}  // namespace

std::vector<ParameterNeighbours> neighbours_of_all(const std::vector<VariedParameter>& parameters, const Scene& scene,
                                                   const Result& result) {
  if (result.status != Status::solved || result.t.size() < 2)
    throw Error("derivative", text("the result is not solved (%s)", to_string(result.status)),
                "differentiate a result with status solved");
  if (parameters.empty()) throw Error("parameters", "is empty", "name one or more");
  std::vector<ParameterNeighbours> all;
  for (const VariedParameter& p : parameters) all.push_back(neighbours_of(p, scene, result.t, is_written_out(scene)));
  return all;
}

ParameterDerivative::ParameterDerivative(const Scene& scene, const Result& result, Backend& backend,
                                         const std::vector<VariedParameter>& parameters, std::optional<bool> located,
                                         const std::vector<double>& also)
    : ParameterDerivative(neighbours_of_all(parameters, scene, result), scene, result, backend, parameters, located,
                          also) {
  quantity_ = parameters.front().scene_of(parameters.front().value).quantity;
}

ParameterDerivative::ParameterDerivative(std::vector<ParameterNeighbours> neighbours, const Scene& scene,
                                         const Result& result, Backend& backend,
                                         const std::vector<VariedParameter>& parameters, std::optional<bool> located,
                                         const std::vector<double>& also)
    : neighbours_(std::move(neighbours)),
      t_(merged_times(result.t, also)),
      of_data_(of_result(scene, result, backend, located, t_, neighbours_)) {
  if (of_data_.located())
    rows_ = places_of(t_, of_data_.times());
  else
    t_ = of_data_.times();
  if (const SwitchedDerivative* switched = of_data_.switched())
    for (Index j = 0; j < t_.size(); ++j)
      if (std::binary_search(switched->one_sided().begin(), switched->one_sided().end(), rows_[std::size_t(j)]) ||
          at_moving_jump(neighbours_, t_[j], scene.T))
        one_sided_.push_back(j);
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    names_.push_back(parameters[i].name);
    const ParameterNeighbours& n = neighbours_[i];
    const bool in_modes = of_data_.switched() && !scene.memories.empty();
    changes_.push_back(parameter_change(n, scene, sampled_at(of_data_.times(), scene.T), is_written_out(scene),
                                        in_modes ? of_data_.switched()->modes() : std::vector<std::vector<Index>>()));
    if (const GalerkinDerivative* galerkin = of_data_.of_boundary_values())
      of_problem_.push_back(galerkin->change({&n.at[0].scene, &n.at[1].scene, &n.at[2].scene, &n.at[3].scene}, n.step));
    const double size = parameters[i].value != 0 ? std::abs(parameters[i].value) : 1;
    distance_ = std::max(distance_, 2 * neighbours_[i].step / size);
  }
}

std::string ParameterDerivative::in_words() const {
  const DerivativeForm form = of_data_.form();
  const char* before = of_data_.located()                  ? "with "
                       : form == DerivativeForm::modes     ? "in "
                       : form == DerivativeForm::all_times ? ""
                       : form == DerivativeForm::boundary  ? "of "
                                                           : "of the ";
  return text("derivative %s%s, data of the scene by central differences within %.0e of the parameters", before,
              to_string(form), distance_);
}

ParameterChange ParameterDerivative::combined(const Vector& by) const {
  if (by.size() != parameters() || !by.allFinite())
    throw Error("parameters", text("a change of %ld numbers", long(by.size())),
                text("give %ld finite ones", long(parameters())));
  ParameterChange sum;
  for (Index i = 0; i < parameters(); ++i) {
    const ParameterChange& one = changes_[std::size_t(i)];
    add_multiple(sum.data, by[i], one.data);
    for (const auto& [modes, c] : one.in_modes) add_multiple(sum.in_modes[modes], by[i], c);
    for (const auto member : {&KroneckerChange::face, &KroneckerChange::across, &KroneckerChange::decay,
                              &KroneckerChange::input, &KroneckerChange::output})
      sum.sum.*member += by[i] * one.sum.*member;
    sum.of_sum = sum.of_sum || (one.of_sum && by[i] != 0);
    for (const MovingJump& jump : one.jumps) sum.jumps.push_back({jump.t, by[i] * jump.change});
  }
  return sum;
}

SolutionChange ParameterDerivative::jvp(Index parameter, bool states) const {
  Vector by = Vector::Zero(parameters());
  by[parameter] = 1;
  return jvp(by, states);
}

SolutionChange ParameterDerivative::jvp(const Vector& by, bool states) const { return at_rows(along(by, states)); }

// At the times of of_data_.
SolutionChange ParameterDerivative::along(const Vector& by, bool states) const {
  const ParameterChange change = combined(by);
  if (const GalerkinDerivative* galerkin = of_data_.of_boundary_values()) {
    GalerkinChange sum = of_problem_.front();
    for (const auto member : {&GalerkinChange::F, &GalerkinChange::q, &GalerkinChange::direct}) {
      (sum.*member) *= by[0];
      for (std::size_t i = 1; i < of_problem_.size(); ++i) sum.*member += by[Index(i)] * of_problem_[i].*member;
    }
    sum.b *= by[0];
    for (std::size_t i = 1; i < of_problem_.size(); ++i) sum.b += by[Index(i)] * of_problem_[i].b;
    return galerkin->jvp(sum);
  }
  if (!change.in_modes.empty()) return of_data_.switched()->jvp(change.in_modes, change.jumps);
  if (!change.jumps.empty()) return of_data_.switched()->jvp(change.data, change.jumps);
  SolutionChange out = of_data_.jvp(change.data, states);
  if (change.of_sum) {
    const SolutionChange more = of_data_.of_sum().jvp(change.sum, states);
    for (const auto member : {&SolutionChange::y, &SolutionChange::x, &SolutionChange::w, &SolutionChange::integral})
      if ((more.*member).size() > 0) out.*member += more.*member;
  }
  return out;
}

Vector ParameterDerivative::vjp(const SolutionChange& given) const {
  for (const Index j : one_sided_)
    for (const RowMatrix* table : {&given.y, &given.x, &given.w})
      if (table->rows() == t_.size() && (table->row(j).array() != 0).any())
        throw Error("derivative", text("not differentiable here: t = %.6g is at a switch", t_[j]),
                    "ask for other times");
  return gradient(from_rows(given));
}

// Of weights at the times of of_data_.
Vector ParameterDerivative::gradient(const SolutionChange& of) const {
  Vector by(parameters());
  if (const GalerkinDerivative* galerkin = of_data_.of_boundary_values()) {
    const GalerkinChange bar = galerkin->adjoint(of);
    for (Index i = 0; i < parameters(); ++i) by[i] = bromwich::product(bar, of_problem_[std::size_t(i)]);
    return by;
  }
  const SwitchedDerivative* switched = of_data_.switched();
  const auto by_tangent = [&](Index i) {  // along it there may be a derivative where there is no gradient
    const SolutionChange change = along(Vector::Unit(parameters(), i), false);
    double sum = 0;
    for (const auto member : {&SolutionChange::y, &SolutionChange::x, &SolutionChange::w, &SolutionChange::integral})
      if ((of.*member).size() > 0) sum += (of.*member).cwiseProduct(change.*member).sum();
    return sum;
  };
  const bool jumps = std::any_of(changes_.begin(), changes_.end(),
                                 [](const auto& c) { return !c.jumps.empty() || !c.in_modes.empty(); });
  if (jumps || (switched && !switched->only_along().empty())) {
    for (Index i = 0; i < parameters(); ++i) by[i] = by_tangent(i);
    return by;
  }
  const bool by_x0 = std::any_of(changes_.begin(), changes_.end(), [](const auto& c) { return c.data.x0.size() > 0; });
  const DataChange bar = of_data_.vjp(of, by_x0);
  for (Index i = 0; i < parameters(); ++i) {
    const ParameterChange& c = changes_[std::size_t(i)];
    by[i] = switched && !has_gradient(bar, c.data) ? by_tangent(i) : product(bar, c.data);
    if (c.of_sum) by[i] += of_data_.of_sum().along(c.sum, of, bar);
  }
  return by;
}

double ParameterDerivative::product(const DataChange& gradient, const DataChange& change) const {
  double sum = 0;
  const auto add = [&](const char* name, auto member) {
    const auto &bar = gradient.*member, &by = change.*member;
    if (by.size() == 0) return;
    if (bar.size() == 0)
      throw Error("derivative", text("%s depends on the parameters, and has no gradient here", name),
                  "use jvp, or leave these parameters out");
    sum += bar.cwiseProduct(by).sum();
  };
  add("x0", &DataChange::x0), add("b", &DataChange::b), add("f", &DataChange::f), add("g", &DataChange::g);
  add("A", &DataChange::A), add("B", &DataChange::B), add("N", &DataChange::N), add("M", &DataChange::M);
  add("E", &DataChange::E), add("E0", &DataChange::E0), add("ET", &DataChange::ET);
  add("restitution", &DataChange::restitution);
  return sum;
}

// From the times of the derivative to those of the rows.
SolutionChange ParameterDerivative::at_rows(SolutionChange c) const {
  if (rows_.empty()) return c;
  for (RowMatrix* table : {&c.y, &c.x, &c.w, &c.integral})
    if (table->size() > 0) *table = RowMatrix((*table)(rows_, Eigen::all));
  return c;
}

// Weights: the other way.
SolutionChange ParameterDerivative::from_rows(const SolutionChange& given) const {
  if (rows_.empty()) return given;
  SolutionChange of;
  for (const auto member : {&SolutionChange::y, &SolutionChange::x, &SolutionChange::w, &SolutionChange::integral}) {
    const RowMatrix& weights = given.*member;
    if (weights.size() == 0) continue;
    if (weights.rows() != t_.size())
      throw Error("weights", text("have %ld rows", long(weights.rows())), text("give %ld", long(t_.size())));
    RowMatrix& all = of.*member = RowMatrix::Zero(of_data_.times().size(), weights.cols());
    all(rows_, Eigen::all) = weights;
  }
  return of;
}

QuantityByParameters ParameterDerivative::with_gradient(QuantityChange found) const {
  QuantityByParameters q{found.value, gradient(found.weights)};
  return q;
}

QuantityByParameters ParameterDerivative::quantity(const QuantityOfInterest& quantity) const {
  return with_gradient(of_data_.quantity(quantity));
}

QuantityByParameters ParameterDerivative::quantity() const {
  if (!quantity_) throw Error("quantity", "the scene states none", "add a section [quantity] to its file");
  QuantityByParameters q = quantity(*quantity_);
  for (Index i = 0; i < parameters(); ++i) {  // the quantity itself changes, with the states held
    const ParameterNeighbours& n = neighbours_[std::size_t(i)];
    const auto value = [&](std::size_t at) { return of_data_.quantity(*n.at[at].quantity).value; };
    q.gradient[i] += (8 * (value(2) - value(1)) - (value(3) - value(0))) / (12 * n.step);
  }
  return q;
}

}  // namespace bromwich
