/* A circuit from C: an inductor drives a current through an ideal diode into a resistor.
 *
 *     L i' = -R i + y + v(t),  0 <= y ⊥ i >= 0     i: current, y: voltage that the diode blocks, v = sin(2 pi t)
 *
 *     cc diode.c $(pkg-config --cflags --libs bromwich_c) */

#include <bromwich/bromwich.h>

#include <stdio.h>
#include <stdlib.h>

static void need(int code) {
  if (code == BROMWICH_OK) return;
  fprintf(stderr, "%s\n", bromwich_error());
  exit(1);
}

int main(void) {
  const double L = 0.1, R = 1, A = -R / L, B = 1 / L, N = 1;
  const char* f[] = {"10*sin(2*pi*t)"};
  const double *switches, *t, *x;
  int64_t count, rows;
  bromwich_scene* scene;
  bromwich_result* result;

  need(bromwich_scene_new(1, 1, 2, &scene));
  need(bromwich_scene_set(scene, "A", &A, 1, 1, BROMWICH_ROWS));
  need(bromwich_scene_set(scene, "B", &B, 1, 1, BROMWICH_ROWS));
  need(bromwich_scene_set(scene, "N", &N, 1, 1, BROMWICH_ROWS));
  need(bromwich_scene_set_expressions(scene, "f", f, 1));
  need(bromwich_solve(scene, "tol=1e-6", NULL, &result));
  printf("%s by %s\n", bromwich_result_text(result, "status"), bromwich_result_text(result, "method"));

  need(bromwich_result_array(result, "switches", &switches, &count, NULL));
  for (int64_t k = 0; k < count; ++k)
    printf("the diode %s at t = %.6f\n", switches[4 * k + 2] > 0 ? "blocks" : "conducts", switches[4 * k]);
  need(bromwich_result_array(result, "t", &t, &rows, NULL));
  need(bromwich_result_array(result, "x", &x, NULL, NULL));
  printf("i(%g) = %.6f\n", t[rows - 1], x[rows - 1]);

  bromwich_result_free(result);
  bromwich_scene_free(scene);
  return 0;
}
