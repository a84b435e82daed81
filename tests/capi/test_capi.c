/* The C interface, from C99: closed forms, an implicit Euler method of its own, and what it refuses. */

#include <bromwich/bromwich.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failures = 0;

#define CHECK(condition)                                                            \
  do {                                                                              \
    if (!(condition)) {                                                             \
      printf("%s:%d: %s (%s)\n", __FILE__, __LINE__, #condition, bromwich_error()); \
      ++failures;                                                                   \
    }                                                                               \
  } while (0)
#define OK(call) CHECK((call) == BROMWICH_OK)

static bromwich_summary summary_of(const bromwich_result* result) {
  bromwich_summary summary;
  memset(&summary, 0, sizeof summary);
  summary.size = sizeof summary;
  OK(bromwich_result_summary(result, &summary));
  return summary;
}

static double last(bromwich_result* result, const char* name, int64_t column) {
  const double* values = NULL;
  int64_t rows = 0, columns = 0;
  OK(bromwich_result_array(result, name, &values, &rows, &columns));
  return values != NULL && column < columns ? values[(rows - 1) * columns + column] : NAN;
}

/* x' = -x + y, 0 <= y ⊥ x + y - 1 >= 0, x(0) = 0: x = (1 - e^{-2t})/2 and y = 1 - x. */
static bromwich_scene* pushed(double T) {
  const double minus = -1, one = 1, zero = 0;
  bromwich_scene* scene = NULL;
  const char* g[] = {"-1"};
  OK(bromwich_scene_new(1, 1, T, &scene));
  OK(bromwich_scene_set(scene, "A", &minus, 1, 1, BROMWICH_ROWS));
  OK(bromwich_scene_set(scene, "B", &one, 1, 1, BROMWICH_ROWS));
  OK(bromwich_scene_set(scene, "N", &one, 1, 1, BROMWICH_ROWS));
  OK(bromwich_scene_set(scene, "M", &one, 1, 1, BROMWICH_ROWS));
  OK(bromwich_scene_set(scene, "x0", &zero, 1, 1, BROMWICH_ROWS));
  OK(bromwich_scene_set_expressions(scene, "g", g, 1));
  return scene;
}

static double pushed_x(double t) { return (1 - exp(-2 * t)) / 2; }

/* Steps are exact for y that is linear in time: second order, error below h^2 max|y''|/8 T with |y''| <= 2. */
static void test_closed_form(void) {
  const double T = 1, h = T / 1000, bound = 2 * h * h / 8 * T * 2;
  bromwich_scene* scene = pushed(T);
  bromwich_result *result = NULL, *at = NULL;
  const double times[] = {0.25, 1};
  int64_t states = 0, constraints = 0;
  OK(bromwich_scene_sizes(scene, &states, &constraints));
  CHECK(states == 1 && constraints == 1);
  OK(bromwich_solve(scene, "method=march steps=1000 states=all", NULL, &result));
  CHECK(summary_of(result).status == BROMWICH_SOLVED && summary_of(result).rows == 1001);
  CHECK(strcmp(bromwich_result_text(result, "status"), "solved") == 0);
  CHECK(strcmp(bromwich_result_text(result, "method"), "march") == 0 && bromwich_result_text(result, "none") == NULL);
  CHECK(fabs(last(result, "x", 0) - pushed_x(T)) < bound && fabs(last(result, "y", 0) - (1 - pushed_x(T))) < bound);
  CHECK(fabs(last(result, "w", 0)) < 1e-12); /* complementary to y > 0: zero to rounding */
  /* The integral of y: t - (t - x)/2, from x' = 1 - 2x. */
  CHECK(fabs(last(result, "integral", 0) - (T - (T - pushed_x(T)) / 2)) < bound);
  OK(bromwich_result_at(result, times, 2, &at));
  CHECK(summary_of(at).rows == 2 && fabs(last(at, "x", 0) - pushed_x(T)) < bound);
  CHECK(bromwich_result_state(result, 0) == 0 && bromwich_result_state(result, 1) == -1);
  bromwich_result_free(at);
  bromwich_result_free(result);
  bromwich_scene_free(scene);
}

/* A rod of m points whose end meets a stop: u' = u_xx by differences, u = 0 at the left end, a force y >= 0 of the stop
 * at the right end and a gap that closes, 0 <= y ⊥ w = u_m + y/1000 + 1/2 - t >= 0. */
enum { rod_points = 20 };
static const double rod_spacing = 1.0 / rod_points, rod_compliance = 1e-3;

static bromwich_scene* rod(void) {
  int64_t starts[rod_points + 1], row[3 * rod_points], k = 0;
  double values[3 * rod_points];
  const double c = 1 / (rod_spacing * rod_spacing), force = 1 / rod_spacing, one = 1, knots[] = {0, 1},
               gap[] = {0.5, -0.5};
  const int64_t end = rod_points - 1, n_starts[rod_points + 1] = {0};
  int64_t of_n[rod_points + 1], zero = 0, b_starts[] = {0, 1};
  bromwich_scene* scene = NULL;
  for (int64_t j = 0; j < rod_points; ++j) {
    starts[j] = k;
    if (j > 0) row[k] = j - 1, values[k++] = c;
    row[k] = j, values[k++] = j == end ? -c : -2 * c;
    if (j < end) row[k] = j + 1, values[k++] = c;
  }
  starts[rod_points] = k;
  memcpy(of_n, n_starts, sizeof of_n);
  of_n[rod_points] = 1;
  OK(bromwich_scene_new(rod_points, 1, 1, &scene));
  OK(bromwich_scene_set_sparse(scene, "A", rod_points, rod_points, starts, row, values));
  OK(bromwich_scene_set_sparse(scene, "B", rod_points, 1, b_starts, &end, &force));
  OK(bromwich_scene_set_sparse(scene, "N", 1, rod_points, of_n, &zero, &one));
  OK(bromwich_scene_set(scene, "M", &rod_compliance, 1, 1, BROMWICH_COLUMNS));
  OK(bromwich_scene_set_class(scene, "P"));
  OK(bromwich_scene_set_table(scene, "g", knots, 2, gap, 1, BROMWICH_ROWS));
  return scene;
}

/* Solves (I - h A) z = r by elimination from the left; r is replaced. */
static void implicit(double h, double* r) {
  const double c = h / (rod_spacing * rod_spacing);
  double pivot[rod_points];
  for (int i = 0; i < rod_points; ++i) {
    pivot[i] = 1 + (i == rod_points - 1 ? c : 2 * c);
    if (i > 0) pivot[i] -= c * c / pivot[i - 1], r[i] += c / pivot[i - 1] * r[i - 1];
  }
  for (int i = rod_points - 1; i >= 0; --i) r[i] = (r[i] + (i < rod_points - 1 ? c * r[i + 1] : 0)) / pivot[i];
}

/* u at the end of the rod and the force, by implicit Euler: one unknown force a step. */
static void euler(int steps, double* u_end, double* force) {
  const double h = 1.0 / steps;
  double u[rod_points] = {0}, response[rod_points] = {0}, y = 0;
  response[rod_points - 1] = h / rod_spacing;
  implicit(h, response);
  for (int j = 1; j <= steps; ++j) {
    implicit(h, u);
    y = (j * h - 0.5 - u[rod_points - 1]) / (response[rod_points - 1] + rod_compliance);
    if (y < 0) y = 0;
    for (int i = 0; i < rod_points; ++i) u[i] += y * response[i];
  }
  *u_end = u[rod_points - 1];
  *force = y;
}

/* The extrapolated Euler values are off by a part of the difference of the two runs, and the solve by its tolerance. */
static void test_signorini(void) {
  double u1, y1, u2, y2;
  bromwich_scene *scene = rod(), *built_in = NULL;
  bromwich_result *result = NULL, *other = NULL;
  euler(4000, &u1, &y1);
  euler(8000, &u2, &y2);
  OK(bromwich_solve(scene, "tol=1e-6", NULL, &result));
  CHECK(summary_of(result).status == BROMWICH_SOLVED);
  CHECK(fabs(last(result, "x", rod_points - 1) - (2 * u2 - u1)) < 0.1 * fabs(u2 - u1) + 1e-6 * fabs(u2));
  CHECK(fabs(last(result, "y", 0) - (2 * y2 - y1)) < 0.1 * fabs(y2 - y1) + 1e-6 * fabs(y2));
  bromwich_result_free(result);

  /* The built-in problem on a square: two methods, one discrete solution. */
  OK(bromwich_scene_read("signorini", "Q=15", &built_in));
  OK(bromwich_solve(built_in, "method=march steps=200 states=none", NULL, &result));
  OK(bromwich_solve(built_in, "method=contour steps=200 states=none", NULL, &other));
  CHECK(fabs(last(result, "y", 7) - last(other, "y", 7)) < 1e-8 && last(result, "y", 7) != 0);
  bromwich_result_free(other);
  bromwich_result_free(result);
  bromwich_scene_free(built_in);
  bromwich_scene_free(scene);
}

/* 1 mA into 1 uF up to 5 V, where an ideal diode holds the voltage: V(out) = min(1000 t, 5). */
static void test_circuit(void) {
  const char* netlist =
      "a clamp\nI1 0 out 1m\nC1 out 0 {C} IC=0\nD1 out top ideal\n.model ideal D(Ron=0 Vfwd=0)\nV1 top 0 5\n.param "
      "C=2u\n.tran 0.1m 10m uic\n.end\n";
  bromwich_scene* scene = NULL;
  bromwich_result* result = NULL;
  const double *t = NULL, *outputs = NULL, *switches = NULL;
  int64_t rows = 0, columns = 0, out = -1, count = 0;
  double worst = 0;
  OK(bromwich_scene_parse(netlist, "netlist", "C=0.5e-6*2", &scene));
  OK(bromwich_solve(scene, NULL, NULL, &result));
  CHECK(summary_of(result).status == BROMWICH_SOLVED);
  OK(bromwich_result_array(result, "t", &t, NULL, NULL));
  OK(bromwich_result_array(result, "outputs", &outputs, &rows, &columns));
  for (int64_t k = 0; k < columns; ++k)
    if (strcmp(bromwich_result_name(result, "outputs", k), "V(out)") == 0) out = k;
  CHECK(out >= 0);
  for (int64_t j = 0; j < rows && out >= 0; ++j)
    worst = fmax(worst, fabs(outputs[j * columns + out] - fmin(1000 * t[j], 5)));
  CHECK(worst < 1e-4 * 5); /* the tolerance of netlists */
  OK(bromwich_result_array(result, "switches", &switches, &count, &columns));
  CHECK(count == 1 && columns == 4 && fabs(switches[0] - 5e-3) <= switches[3] + 1e-9 && switches[2] == 1);
  bromwich_result_free(result);
  bromwich_scene_free(scene);
}

static int fails_after_half(double t, double* values, void* user) {
  values[0] = -1;
  return t > 0.5 ? *(int*)user : 0;
}

struct heard {
  int lines, calls, limit;
};
static int interrupts(void* user) {
  struct heard* heard = user;
  return ++heard->calls > heard->limit;
}
static void hears(int level, const char* text, void* user) {
  struct heard* heard = user;
  if (level >= 0 && text[0] != '\0') ++heard->lines;
}

static void test_functions(void) {
  int code = 0;
  struct heard heard = {0, 0, 1000000};
  bromwich_hooks hooks = {sizeof hooks, &heard, interrupts, NULL, hears};
  bromwich_scene* scene = pushed(1);
  bromwich_result *result = NULL, *same = NULL;
  OK(bromwich_solve(scene, "steps=100 method=march", NULL, &same));
  OK(bromwich_scene_set_function(scene, "g", fails_after_half, &code));
  OK(bromwich_solve(scene, "steps=100 method=march", NULL, &result));
  CHECK(fabs(last(result, "y", 0) - last(same, "y", 0)) < 1e-14);
  bromwich_result_free(same);
  bromwich_result_free(result);
  code = 7;
  result = NULL;
  CHECK(bromwich_solve(scene, "steps=100", NULL, &result) == BROMWICH_STOPPED && result == NULL);
  CHECK(strstr(bromwich_error(), "g: the function returned 7 at t = ") != NULL);
  code = 0;
  OK(bromwich_solve(scene, "tol=1e-4 method=march", &hooks, &result));
  CHECK(heard.lines > 0 && heard.calls > 0);
  bromwich_result_free(result);
  heard.calls = 0;
  heard.limit = 3;
  OK(bromwich_solve(scene, "tol=1e-4 method=march", &hooks, &result));
  CHECK(summary_of(result).status == BROMWICH_INTERRUPTED);
  bromwich_result_free(result);
  bromwich_scene_free(scene);
}

static void test_many(void) {
  bromwich_scene *scene = pushed(1), *scenes[5];
  bromwich_solver* solver = NULL;
  bromwich_batch* batch = NULL;
  const char* options = "method=march steps=64";
  const double *y = NULL, *t = NULL;
  int64_t rows = 0, columns = 0;
  OK(bromwich_solver_new(scene, options, NULL, &solver));
  for (int k = 0; k < 5; ++k) {
    const double x0 = 0.3 * k;
    OK(bromwich_scene_copy(scene, &scenes[k]));
    OK(bromwich_scene_set(scenes[k], "x0", &x0, 1, 1, BROMWICH_ROWS));
  }
  OK(bromwich_solve_batch((const bromwich_scene* const*)scenes, 5, NULL, 0, options, NULL, &batch));
  OK(bromwich_batch_array(batch, "y", &y, &rows, &columns));
  OK(bromwich_batch_array(batch, "t", &t, NULL, NULL));
  CHECK(rows == 5 * 65 && columns == 1 && t[64] == 1);
  for (int k = 0; k < 5; ++k) {
    bromwich_result *alone = NULL, *again = NULL;
    const double x0 = 0.3 * k;
    OK(bromwich_solve(scenes[k], options, NULL, &alone));
    OK(bromwich_solver_set_x0(solver, &x0, 1));
    OK(bromwich_solver_set_sources(solver, scenes[k]));
    OK(bromwich_solver_solve(solver, &again));
    CHECK(bromwich_batch_status(batch, k) == BROMWICH_SOLVED &&
          strcmp(bromwich_batch_text(batch, k, "reason"), "") == 0);
    CHECK(fabs(y[k * 65 + 64] - last(alone, "y", 0)) < 1e-13); /* the same steps: rounding of 64 of them */
    CHECK(fabs(last(again, "y", 0) - last(alone, "y", 0)) < 1e-13);
    bromwich_result_free(again);
    bromwich_result_free(alone);
    bromwich_scene_free(scenes[k]);
  }
  CHECK(bromwich_batch_status(batch, 5) == -1 && bromwich_batch_text(batch, 0, "none") == NULL);
  bromwich_batch_free(batch);
  bromwich_solver_free(solver);
  bromwich_scene_free(scene);
}

/* F(s) = (1/(s + 1), 1/s^2): f = (e^{-t}, t). */
static int two_transforms(int64_t count, const double* s, double* values, void* user) {
  (void)user;
  for (int64_t k = 0; k < count; ++k) {
    const double a = s[2 * k], b = s[2 * k + 1], d = (a + 1) * (a + 1) + b * b, e = a * a + b * b;
    values[4 * k] = (a + 1) / d;
    values[4 * k + 1] = -b / d;
    values[4 * k + 2] = (a * a - b * b) / (e * e);
    values[4 * k + 3] = -2 * a * b / (e * e);
  }
  return 0;
}

static void test_problems(void) {
  /* By hand: q >= 0 gives y = 0; q = (-3, 0): y = (3/2, 0) with w = (0, 3/2 - ...) for M = [[2, 0], [1, 2]]. */
  const double M[] = {2, 0, 1, 2}, q[] = {1, 2, -3, 0, -2, -3}, zero = 0, minus = -1, t[] = {0.01, 1, 30};
  double y[6], w[6], residual[3], f[6], error[6];
  int32_t status[3];
  OK(bromwich_lcp(2, 3, M, 1, BROMWICH_ROWS, NULL, q, y, w, status, residual));
  CHECK(status[0] == BROMWICH_LCP_SOLVED && y[0] == 0 && y[1] == 0 && w[0] == 1 && w[1] == 2);
  CHECK(fabs(y[2] - 1.5) < 1e-15 && y[3] == 0 && fabs(w[3] - 1.5) < 1e-15 && residual[1] < 1e-15);
  CHECK(fabs(y[4] - 1) < 1e-15 && fabs(y[5] - 1) < 1e-15);
  OK(bromwich_lcp(2, 3, M, 1, BROMWICH_COLUMNS, NULL, q, y, NULL, NULL, NULL));
  CHECK(fabs(y[4] - 0.25) < 1e-15 && fabs(y[5] - 1.5) < 1e-15); /* M^T: 2 y0 + y1 = 2, 2 y1 = 3 */
  OK(bromwich_lcp(1, 1, &zero, 1, BROMWICH_ROWS, NULL, &minus, y, NULL, status, NULL));
  CHECK(status[0] == BROMWICH_LCP_INFEASIBLE && isnan(y[0]));
  OK(bromwich_invert(two_transforms, NULL, 2, t, 3, NULL, 0, 0, f, error));
  for (int k = 0; k < 3; ++k)
    CHECK(fabs(f[2 * k] - exp(-t[k])) <= error[2 * k] && fabs(f[2 * k + 1] - t[k]) <= error[2 * k + 1] &&
          error[2 * k] < 1e-9);
}

static void refused(int code, const char* words) {
  CHECK(code == BROMWICH_BAD_INPUT);
  if (strstr(bromwich_error(), words) == NULL) {
    printf("'%s' does not say '%s'\n", bromwich_error(), words);
    ++failures;
  }
}

static void test_refusals(void) {
  bromwich_scene *scene = pushed(1), *other = NULL;
  bromwich_result* result = NULL;
  bromwich_summary summary;
  double two[2] = {1, 2};
  const double* values = NULL;
  const char* bad[] = {"sinn(t)"};
  refused(bromwich_scene_new(1, 1, 1, NULL), "scene: is NULL");
  refused(bromwich_scene_new(-1, 1, 1, &other), "states: found -1");
  refused(bromwich_scene_new(1, 1, 0, &other), "T: found 0");
  refused(bromwich_scene_set(scene, "A", two, 1, 2, BROMWICH_ROWS), "A: is 1 x 2; give 1 x 1");
  refused(bromwich_scene_set(scene, "x", two, 1, 1, BROMWICH_ROWS), "name: found 'x'");
  refused(bromwich_scene_set(scene, "A", two, 1, 1, 2), "order: found 2");
  refused(bromwich_scene_set_expressions(scene, "g", bad, 1), "g");
  refused(bromwich_scene_set_expressions(scene, "g", bad, 2), "g: has 2 expressions; give 1");
  refused(bromwich_scene_set_class(scene, "Q"), "class: found 'Q'");
  refused(bromwich_scene_read("no such scene", NULL, &other), "no such scene");
  refused(bromwich_scene_parse("[time]\nT = \"a\"\n", "toml", NULL, &other), "text:");
  refused(bromwich_solve(scene, "step=4", NULL, &result), "options: found 'step' (did you mean 'steps'?)");
  refused(bromwich_solve(scene, "steps=4 steps=5", NULL, &result), "steps is given twice");
  refused(bromwich_solve(scene, "steps=many", NULL, &result), "options: steps: found 'many'");
  refused(bromwich_solve(scene, "method=best", NULL, &result), "best");
  refused(bromwich_solve(scene, "backend=gpu", NULL, &result), "backend");
  CHECK(result == NULL && other == NULL);
  OK(bromwich_solve(scene, "steps=4", NULL, &result));
  refused(bromwich_result_array(result, "z", &values, NULL, NULL), "name: found 'z'");
  refused(bromwich_result_array(result, "outputs", &values, NULL, NULL), "no netlist");
  summary.size = 0;
  refused(bromwich_result_summary(result, &summary), "summary.size: found 0");
  /* A program of an older version has a shorter struct: nothing behind it is written. */
  summary.size = offsetof(bromwich_summary, rows);
  summary.rows = -5;
  OK(bromwich_result_summary(result, &summary));
  CHECK(summary.rows == -5 && summary.status == BROMWICH_SOLVED);
  bromwich_result_free(result);
  bromwich_scene_free(scene);
  bromwich_scene_free(NULL);
  bromwich_result_free(NULL);
  bromwich_solver_free(NULL);
  bromwich_batch_free(NULL);
}

int main(void) {
  CHECK(strcmp(bromwich_version(), BROMWICH_VERSION) == 0 && strcmp(bromwich_error(), "") == 0);
  test_closed_form();
  test_signorini();
  test_circuit();
  test_functions();
  test_many();
  test_problems();
  test_refusals();
  printf("%d failures\n", failures);
  return failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
