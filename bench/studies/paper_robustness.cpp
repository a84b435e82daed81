// Figure 4.4: steps at which the matrix M^h = M + h N (I - hA)^{-1} B of implicit Euler is not a Z-matrix although M
// is.

#include "app/commands.hpp"
#include "bench/studies/paper.hpp"

#include <fmt/format.h>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

namespace bromwich::app {

Scene unstable_dlcp_small(double T) {
  Scene scene = choose_scene("dlcp-small", {{"T", T}}).scene;
  const DenseDynamics d = get<DenseDynamics>(scene.dynamics);
  const Matrix M = to_dense(scene.M);
  scene.name = "dlcp-small, unstable variant";
  const auto stable = scene.exact;
  const auto cosine = [](double t) { return std::cos(3 * std::numbers::pi * t); };
  scene.exact = [stable, cosine](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    stable(t, x, y);
    y[3] = std::max(cosine(t), 0.) / 4;
  };
  // f = x' - A x - B y and g = w - N x - M y change according to y4 and w4.
  const auto change = [stable, cosine](double t) {
    Vector x(3), y(4);
    stable(t, x, y);
    return std::max(cosine(t), 0.) / 4 - y[3];
  };
  scene.f = [f = scene.f, change, B = d.B](double t, Eigen::Ref<Vector> out) {
    f(t, out);
    out -= B.col(3) * change(t);
  };
  scene.g = [g = scene.g, change, cosine, M](double t, Eigen::Ref<Vector> out) {
    g(t, out);
    out -= M.col(3) * change(t);
    out[3] += std::max(-cosine(t), 0.) - std::max(std::sin(3 * std::numbers::pi * t) + 0.3, 0.);
  };
  return scene;
}

namespace {

/// M^h of (1.4).
Matrix euler_matrix(const Scene& scene, double h) {
  const DenseDynamics d = to_dense(scene.dynamics);
  const Matrix I = Matrix::Identity(d.A.rows(), d.A.rows());
  return to_dense(scene.M) + h * d.N * (I - h * d.A).partialPivLu().solve(d.B);
}

double largest_offdiagonal(Matrix m) {
  m.diagonal().setConstant(-INFINITY);
  return m.maxCoeff();
}

/// The largest step at which M^h is a Z-matrix.
double critical_step(const Scene& scene) {
  double below = 0, above = 1;
  while (above - below > 1e-6) {
    const double h = 0.5 * (below + above);
    (largest_offdiagonal(euler_matrix(scene, h)) <= 0 ? below : above) = h;
  }
  return below;
}

/// Last time with a solution; NaN for an iteration that was stopped, whose iterates are not a solution anywhere.
double valid_until(const Result& r) {
  if (r.status == Status::solved) return r.t[r.steps];
  Index rows = 0;
  while (rows < r.y.rows() && r.y.row(rows).allFinite()) ++rows;
  return rows == 0 || rows == r.y.rows() ? NAN : r.t[rows - 1];
}

/// An error of y above this part of the largest y makes a result useless, with any status.
constexpr double useless = 0.1;

double largest_multiplier(const Scene& scene) {
  constexpr int samples = 1000;
  Vector x(scene.states()), y(scene.constraints());
  double largest = 0;
  for (int i = 0; i <= samples; ++i) {
    scene.exact(scene.T * i / samples, x, y);
    largest = std::max(largest, y.maxCoeff());
  }
  return largest;
}

Json robust_row(const Scene& scene, Backend& backend, Method method, Index steps, const Truth& truth) {
  const double h = scene.T / double(steps), offdiagonal = largest_offdiagonal(euler_matrix(scene, h));
  Options options;
  options.method = method;
  options.steps = steps;
  options.trace = true;
  const Result r = solve(scene, backend, options);
  const bool solved = r.status == Status::solved;
  const double error = solved ? truth.of(r).y.max : NAN;
  return {{"figure", "4.4"},
          {"scene", scene.name},
          {"T", scene.T},
          {"steps", steps},
          {"h", h},
          {"method", to_string(method)},
          {"largest_offdiagonal", offdiagonal},
          {"z_matrix", offdiagonal <= 0},
          {"status", to_string(r.status)},
          {"reason", r.reason},
          {"valid_until", valid_until(r)},
          {"useful", error <= useless * largest_multiplier(scene)},
          {"error_y", error},
          {"error_trace", solved ? truth.of(r).trace.max : NAN}};
}

std::string format_time(double t) { return std::isnan(t) ? "-" : fmt::format("{:.3f}", t); }

/// log2 of the steps of one method that `which` selects.
template <class Which>
std::string steps_where(const std::vector<Json>& rows, const char* method, const Which& which) {
  std::string text;
  for (const Json& row : rows)
    if (row["method"] == method && which(row))
      text += fmt::format("{}{:g}", text.empty() ? "" : ", ", std::log2(double(row["h"])));
  return text.empty() ? "none" : text;
}

void robustness_notes(const Scene& scene, const std::vector<Json>& rows, BenchReport& report) {
  const auto solved = [](const Json& row) { return row["status"] == "solved"; };
  const auto wrong = [&](const Json& row) { return solved(row) && !row["useful"]; };
  std::string text = fmt::format("Fig. 4.4, {}, T = {:g}, log2 h not solved:", scene.name, scene.T), bad;
  for (const char* method : {"euler", "contour", "march"}) {
    text += fmt::format(" {}: {};", method, steps_where(rows, method, std::not_fn(solved)));
    bad += fmt::format(" {}: {};", method, steps_where(rows, method, wrong));
  }
  Index outside = 0, inside = 0, outside_useful = 0, inside_useful = 0;
  for (const Json& row : rows) {
    if (row["method"] != "euler") continue;
    (row["z_matrix"] ? inside : outside) += 1;
    if (row["useful"]) (row["z_matrix"] ? inside_useful : outside_useful) += 1;
  }
  report.notes.push_back(text + fmt::format(" solved with an error of y above {:.0f} % of the largest y:{} Euler is "
                                            "right at {} of {} steps whose M^h is no Z-matrix and at {} of {} others",
                                            100 * useless, bad, outside_useful, outside, inside_useful, inside));
}

}  // namespace

void paper_robustness(bool quick, Backend& backend, BenchReport& report) {
  struct Case {
    Scene scene;
    Index first, last;
  };
  std::vector<Case> cases{{choose_scene("dlcp-small", {}).scene, 8, quick ? 128 : 2048},
                          {unstable_dlcp_small(1), 8, quick ? 128 : 2048}};
  if (!quick) cases.push_back({unstable_dlcp_small(0.125), 8, 2048});
  std::vector<std::vector<std::string>> lines{
      {"scene", "T", "h", "largest off M^h's diagonal", "method", "status", "valid until", "error y"}};
  for (const Case& one : cases) {
    const Truth truth(one.scene, backend, 0);
    std::vector<Json> rows;
    for (Index steps = one.first; steps <= one.last; steps *= 2)
      for (const Method method : {Method::euler, Method::contour, Method::march})
        rows.push_back(robust_row(one.scene, backend, method, steps, truth));
    for (const Json& row : rows) {
      lines.push_back({row["scene"], fmt::format("{:g}", double(row["T"])),
                       fmt::format("2^{:g}", std::log2(double(row["h"]))),
                       fmt::format("{:.4f}", double(row["largest_offdiagonal"])), row["method"], row["status"],
                       format_time(row["valid_until"]), scientific(row["error_y"])});
      report.rows.push_back(row);
    }
    robustness_notes(one.scene, rows, report);
  }
  const Scene& scene = cases.front().scene;
  const Matrix at6 = euler_matrix(scene, 0x1p-6), at7 = euler_matrix(scene, 0x1p-7);
  report.notes.push_back(
      fmt::format("Fig. 4.4: M^h is a Z-matrix up to h = {:.4f}. The entry (3,2) that the paper prints for h = 2^-6 is "
                  "0.0095: it is {:.4f} there and {:.4f} at h = 2^-7",
                  critical_step(scene), at6(2, 1), at7(2, 1)));
  print("Fig. 4.4: steps and classes\n" + table(lines) + "\n");
}

}  // namespace bromwich::app
