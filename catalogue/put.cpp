// American puts, on one asset and on the lower of two, in the time to expiry t. With X = ln S plus the sum of ln(1 - d)
// of the dividends that are still to be paid, the value V(t, X) of the option is continuous where a share d of the
// price is paid, and only the payoff jumps:
//
//     V' = L V + y,   0 <= y  ⊥  w = V - (K - e^X (1 - d)^k)+ >= 0,
//     L V = sigma^2/2 V_XX + (r - q - sigma^2/2) V_X - r V,
//
// k(t) dividends are paid between now and expiry at the most; at the time t before expiry those of the last t years are
// behind the holder's decision. Today, at t = T, X = ln S.
//
// symbol  here             meaning
// V       state            values at the points of a graded mesh, the spot and the strike among them
// B, N    B, N             I: every state is constrained, M = 0
// g       g                -(K - e^X (1 - d)^k)+, which jumps at the dates of the dividends
// f       f                constant: the payoff beyond the ends of the mesh
//
// Two assets: X_i = ln S_i with the correlation rho are X_1 = ln S_1 + sigma_1 z_1, X_2 = ln S_2 + sigma_2 (rho z_1 +
// (1 - rho^2)^{1/2} z_2); z_1 and z_2 are independent, and L has no mixed derivative.

#include "catalogue/recipes.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

namespace bromwich {
namespace {

constexpr double half_width = 6;    ///< of the mesh, in standard deviations at T
constexpr double fine_part = 0.35;  ///< of the mesh: where its spacing is nearly constant, in standard deviations
constexpr double most_put_points = 20000, most_put_points_a_side = 600;

double at_least_zero(const ParameterValues& values, const std::string& key) {
  const double value = values.at(key);
  if (!(value >= 0)) throw Error(key, "found " + number_text(value), "give a number that is not negative");
  return value;
}

Index count_of(const ParameterValues& values, const std::string& key, double least, double most) {
  const double value = values.at(key);
  if (!(value >= least && value <= most) || value != std::floor(value))
    throw Error(key, "found " + number_text(value),
                "give an integer from " + number_text(least) + " to " + number_text(most));
  return Index(value);
}

/// Points x, and second order differences at those inside, which are the unknowns.
struct GradedMesh {
  Vector x;
  Index spot = 0;  ///< among the unknowns
  Index unknowns() const { return x.size() - 2; }
};

/// x = middle + width sinh(k step) with `middle` and `spot` among the points; about `points` of them.
GradedMesh graded_mesh(double middle, double spot, double deviation, Index points) {
  const double width = fine_part * deviation;
  const auto inverse = [&](double x) { return std::asinh((x - middle) / width); };
  const double low = std::min(middle, spot) - half_width * deviation,
               high = std::max(middle, spot) + half_width * deviation;
  double step = (inverse(high) - inverse(low)) / double(points + 1);
  if (std::abs(inverse(spot)) < 0.5 * step) middle = spot;
  const Index cells = middle == spot ? 0 : std::max(Index(1), Index(std::round(std::abs(inverse(spot)) / step)));
  if (cells > 0) step = std::abs(inverse(spot)) / double(cells);
  const Index first = Index(std::floor(inverse(low) / step)), last = Index(std::ceil(inverse(high) / step));
  GradedMesh mesh;
  mesh.x.resize(last - first + 1);
  for (Index k = first; k <= last; ++k) mesh.x[k - first] = middle + width * std::sinh(double(k) * step);
  mesh.spot = (spot < middle ? -cells : cells) - first - 1;
  return mesh;
}

/// D u'' + c u' at the points inside: coefficients of the three points.
struct ThreePoints {
  double before, here, after;
};

ThreePoints three_points(const Vector& x, Index i, double D, double c) {
  const double a = x[i] - x[i - 1], b = x[i + 1] - x[i];
  return {(2 * D - c * b) / (a * (a + b)), (c * (b - a) - 2 * D) / (a * b), (2 * D + c * a) / (b * (a + b))};
}

SparseMatrix diagonal_of_ones(Index n) {
  SparseMatrix I(n, n);
  I.setIdentity();
  return I;
}

/// Dividends: the share d of the price at each of `count` dates, in the middles of as many parts of the life.
struct Dividends {
  double share;
  Index count;
  double T;
  double date(Index i) const { return T * (double(i) + 0.5) / double(count); }  ///< in the time to expiry
};

Dividends dividends_of(const ParameterValues& values) {
  const double share = values.at("dividend");
  if (!(share >= 0 && share < 1))
    throw Error("dividend", "found " + number_text(share), "give a share from 0 to below 1");
  const Index count = count_of(values, "dividends", 1, 366);
  return {share, share > 0 ? count : 0, positive_parameter(values, "T")};
}

using Payoff = std::function<double(Index point, double paid)>;  ///< at prices times `paid`

/// x0, g and its breakpoints.
void set_payoff(const Payoff& payoff, Index n, const Dividends& d, Scene& scene) {
  Matrix shapes(n, d.count + 1);  // column i: i dates are behind
  for (Index i = 0; i <= d.count; ++i)
    for (Index k = 0; k < n; ++k) shapes(k, i) = -payoff(k, std::pow(1 - d.share, double(d.count - i)));
  scene.x0 = -shapes.col(0);
  scene.g = SeparableSource{shapes, [d](double t, Eigen::Ref<Vector> a) {
                              Index behind = 0;
                              while (behind < d.count && t >= d.date(behind)) ++behind;
                              a.setZero();
                              a[behind] = 1;
                            }};
  for (Index i = 0; i < d.count; ++i) scene.breakpoints.push_back(d.date(i));
  scene.breakpoints_are_all = true;
  scene.T = d.T;
}

/// The parts of a scene that both puts have.
Scene scene_of_states(SparseMatrix A, const Vector& f, Index spot) {
  const Index n = A.rows();
  Scene scene;
  scene.dynamics = SparseDynamics{std::move(A), diagonal_of_ones(n), diagonal_of_ones(n)};
  scene.M = Tridiagonal{Vector::Zero(n), Vector::Zero(n), Vector::Zero(n)};
  scene.lcp_class = LcpClass::PSD;
  scene.f = [](double, Eigen::Ref<Vector> phi) { phi[0] = 1; };
  scene.f_entry = SourceEntry::through_F;
  scene.F = Matrix(f).sparseView();
  for (Index i = 0; i < n; ++i) scene.names.x.push_back("x" + std::to_string(i));
  scene.names.x[std::size_t(spot)] = "spot";
  return scene;
}

Scene build_put(const ParameterValues& values) {
  const double S = positive_parameter(values, "S"), K = positive_parameter(values, "K"),
               sigma = positive_parameter(values, "sigma"), r = at_least_zero(values, "r"), q = values.at("q");
  const Dividends d = dividends_of(values);
  const double deviation = sigma * std::sqrt(d.T), left = std::pow(1 - d.share, double(d.count));
  const GradedMesh mesh =
      graded_mesh(std::log(K / left), std::log(S), deviation, count_of(values, "points", 20, most_put_points));
  const Index n = mesh.unknowns();
  const double D = 0.5 * sigma * sigma;
  std::vector<Eigen::Triplet<double>> entries;
  Vector f = Vector::Zero(n);
  for (Index i = 0; i < n; ++i) {
    const ThreePoints c = three_points(mesh.x, i + 1, D, r - q - D);
    entries.emplace_back(i, i, c.here - r);
    if (i > 0) entries.emplace_back(i, i - 1, c.before);
    if (i + 1 < n) entries.emplace_back(i, i + 1, c.after);
    if (i == 0) f[i] = c.before * (K - std::exp(mesh.x[0]));
  }
  SparseMatrix A(n, n);
  A.setFromTriplets(entries.begin(), entries.end());
  Scene scene = scene_of_states(std::move(A), f, mesh.spot);
  const auto payoff = [&](Index k, double paid) { return std::max(K - paid * std::exp(mesh.x[k + 1]), 0.0); };
  set_payoff(payoff, n, d, scene);
  scene.default_steps = 2000;
  return scene;
}

Scene build_put_on_two(const ParameterValues& values) {
  const double S1 = positive_parameter(values, "S1"), S2 = positive_parameter(values, "S2"),
               K = positive_parameter(values, "K"), s1 = positive_parameter(values, "sigma1"),
               s2 = positive_parameter(values, "sigma2"), r = at_least_zero(values, "r"), rho = values.at("rho");
  if (!(rho > -1 && rho < 1)) throw Error("rho", "found " + number_text(rho), "give a correlation between -1 and 1");
  const double weight = values.at("basket");
  if (!(weight >= 0 && weight <= 1))
    throw Error("basket", "found " + number_text(weight),
                "give the weight of the first price from 0 to 1, or 0 for the lower of both");
  const Dividends d = dividends_of(values);
  const double rest = std::sqrt(1 - rho * rho), c1 = (r - values.at("q1") - 0.5 * s1 * s1) / s1,
               c2 = ((r - values.at("q2") - 0.5 * s2 * s2) / s2 - rho * c1) / rest;
  const GradedMesh mesh = graded_mesh(0, 0, std::sqrt(d.T), count_of(values, "points", 4, most_put_points_a_side));
  const Index Q = mesh.unknowns(), n = Q * Q;
  const auto payoff_at = [&](Index i, Index k, double paid) {  // points of the whole mesh
    const double first = S1 * std::exp(s1 * mesh.x[i]),
                 second = S2 * std::exp(s2 * (rho * mesh.x[i] + rest * mesh.x[k]));
    const double price = weight > 0 ? weight * first + (1 - weight) * second : std::min(first, second);
    return std::max(K - paid * price, 0.0);
  };
  std::vector<Eigen::Triplet<double>> entries;
  Vector f = Vector::Zero(n);
  const auto couple = [&](Index row, Index i, Index k, double coefficient) {
    if (i >= 1 && i <= Q && k >= 1 && k <= Q)
      entries.emplace_back(row, (i - 1) * Q + k - 1, coefficient);
    else
      f[row] += coefficient * payoff_at(i, k, 1);
  };
  for (Index i = 1; i <= Q; ++i)
    for (Index k = 1; k <= Q; ++k) {
      const ThreePoints first = three_points(mesh.x, i, 0.5, c1), second = three_points(mesh.x, k, 0.5, c2);
      const Index row = (i - 1) * Q + k - 1;
      couple(row, i, k, first.here + second.here - r);
      couple(row, i - 1, k, first.before), couple(row, i + 1, k, first.after);
      couple(row, i, k - 1, second.before), couple(row, i, k + 1, second.after);
    }
  SparseMatrix A(n, n);
  A.setFromTriplets(entries.begin(), entries.end());
  Scene scene = scene_of_states(std::move(A), f, mesh.spot * Q + mesh.spot);
  set_payoff([&](Index k, double paid) { return payoff_at(k / Q + 1, k % Q + 1, paid); }, n, d, scene);
  scene.default_steps = 64;
  return scene;
}

}  // namespace

SceneRecipe put_recipe() {
  return {"put",
          "American put in the time to expiry, its value today in the state 'spot'",
          {{"S", 100, "spot, the price of the share today"},
           {"K", 100, "strike"},
           {"r", 0.05, "interest"},
           {"q", 0, "continuous dividend yield"},
           {"sigma", 0.2, "volatility"},
           {"T", 1, "years to expiry"},
           {"dividend", 0, "share of the price that each discrete dividend pays, at T/(2k), 3T/(2k), ..."},
           {"dividends", 1, "their number k"},
           {"points", 2000, "of the mesh, 20 to 20000"}},
          build_put};
}

SceneRecipe put_on_two_recipe() {
  return {"put-on-two",
          "American put on the lower of two prices or on a basket, its value today in the state 'spot'",
          {{"S1", 100, "price of the first share today"},
           {"S2", 100, "of the second"},
           {"K", 100, "strike"},
           {"r", 0.05, "interest"},
           {"q1", 0, "continuous dividend yield of the first"},
           {"q2", 0, "of the second"},
           {"sigma1", 0.2, "volatility of the first"},
           {"sigma2", 0.3, "of the second"},
           {"rho", 0.5, "correlation"},
           {"basket", 0, "weight of the first price in the basket; 0: the lower of both"},
           {"T", 1, "years to expiry"},
           {"dividend", 0, "share of both prices that each discrete dividend pays, at T/(2k), 3T/(2k), ..."},
           {"dividends", 1, "their number k"},
           {"points", 60, "of the mesh in each direction, 4 to 600"}},
          build_put_on_two};
}

}  // namespace bromwich
