/* bromwich_solve for MATLAB and Octave, a function of the C interface:
 *
 *     r = bromwich_solve(scene, options)
 *
 * scene: a name (a file .toml or .cir, or a built-in scene), or a struct with A, B, N, M, T and any of x0, E, f, g; f
 * and g are cell arrays of expressions of t, or columns of constants. options: 'tol=1e-6 states=all'. r has status,
 * method, warning, t, y, w, x, switches, and of a netlist outputs and names.
 *
 *     mkoctfile --mex bromwich_solve.c $(pkg-config --cflags --libs bromwich_c)     % Octave
 *     mex bromwich_solve.c -I... -L... -lbromwich                                   % MATLAB */

#include "mex.h"

#include <bromwich/bromwich.h>

#include <string.h>

static bromwich_scene* scene = NULL;
static bromwich_result* result = NULL;

static void forget(void) {
  bromwich_result_free(result);
  bromwich_scene_free(scene);
  result = NULL;
  scene = NULL;
}

static void need(int code) {
  if (code == BROMWICH_OK) return;
  forget();
  mexErrMsgIdAndTxt("bromwich:refused", "%s", bromwich_error());
}

static void set_array(const mxArray* given, const char* name) {
  const mxArray* field = mxGetField(given, 0, name);
  if (field == NULL) return;
  if (!mxIsDouble(field) || mxIsComplex(field) || mxIsSparse(field)) {
    forget();
    mexErrMsgIdAndTxt("bromwich:refused", "%s: is no full matrix of real numbers; give one", name);
  }
  if (mxGetNumberOfElements(field) > 0)
    need(bromwich_scene_set(scene, name, mxGetPr(field), (int64_t)mxGetM(field), (int64_t)mxGetN(field),
                            BROMWICH_COLUMNS));
}

/* A cell array of expressions, or a column of constants. */
static void set_source(const mxArray* given, const char* name) {
  const mxArray* field = mxGetField(given, 0, name);
  if (field == NULL) return;
  const mwSize count = mxGetNumberOfElements(field);
  if (mxIsDouble(field)) {
    const mxArray* end = mxGetField(given, 0, "T");
    const double times[] = {0, mxGetScalar(end)};
    double* twice = mxMalloc(2 * count * sizeof *twice);
    for (mwSize i = 0; i < count; ++i) twice[i] = twice[count + i] = mxGetPr(field)[i];
    need(bromwich_scene_set_table(scene, name, times, 2, twice, (int64_t)count, BROMWICH_ROWS));
    mxFree(twice);
    return;
  }
  if (!mxIsCell(field)) {
    forget();
    mexErrMsgIdAndTxt("bromwich:refused", "%s: give a cell array of expressions of t, or numbers", name);
  }
  const char** texts = mxMalloc(count * sizeof *texts);
  for (mwSize i = 0; i < count; ++i) texts[i] = mxArrayToString(mxGetCell(field, i));
  need(bromwich_scene_set_expressions(scene, name, texts, (int64_t)count));
}

static void from_struct(const mxArray* given) {
  const mxArray *A = mxGetField(given, 0, "A"), *M = mxGetField(given, 0, "M"), *T = mxGetField(given, 0, "T");
  if (A == NULL || M == NULL || T == NULL)
    mexErrMsgIdAndTxt("bromwich:refused", "scene: has no A, M or T; give A, B, N, M and T");
  need(bromwich_scene_new((int64_t)mxGetM(A), (int64_t)mxGetM(M), mxGetScalar(T), &scene));
  const char* arrays[] = {"A", "B", "N", "M", "E", "x0", "E0", "ET", "b"};
  for (int i = 0; i < 9; ++i) set_array(given, arrays[i]);
  set_source(given, "f");
  set_source(given, "g");
}

/* Arrays of the library lie row after row, those of MATLAB column after column. */
static mxArray* array(const char* name) {
  const double* values = NULL;
  int64_t rows = 0, columns = 0;
  need(bromwich_result_array(result, name, &values, &rows, &columns));
  mxArray* made = mxCreateDoubleMatrix((mwSize)rows, (mwSize)columns, mxREAL);
  for (int64_t i = 0; i < rows; ++i)
    for (int64_t k = 0; k < columns; ++k) mxGetPr(made)[k * rows + i] = values[i * columns + k];
  return made;
}

static void add(mxArray* to, const char* name, mxArray* value) { mxSetField(to, 0, name, value); }

static mxArray* output_names(mwSize count) {
  mxArray* names = mxCreateCellMatrix(1, count);
  for (mwSize k = 0; k < count; ++k)
    mxSetCell(names, k, mxCreateString(bromwich_result_name(result, "outputs", (int64_t)k)));
  return names;
}

void mexFunction(int count_out, mxArray* out[], int count_in, const mxArray* in[]) {
  const char* fields[] = {"status", "method", "warning", "t", "y", "w", "x", "switches", "outputs", "names"};
  const double* values;
  if (count_in < 1 || count_in > 2 || count_out > 1)
    mexErrMsgIdAndTxt("bromwich:refused",
                      "bromwich_solve: found %d arguments; write r = bromwich_solve(scene, options)", count_in);
  if (mxIsStruct(in[0]))
    from_struct(in[0]);
  else
    need(bromwich_scene_read(mxArrayToString(in[0]), NULL, &scene));
  need(bromwich_solve(scene, count_in == 2 ? mxArrayToString(in[1]) : NULL, NULL, &result));
  out[0] = mxCreateStructMatrix(1, 1, 10, fields);
  for (int i = 0; i < 3; ++i) add(out[0], fields[i], mxCreateString(bromwich_result_text(result, fields[i])));
  for (int i = 3; i < 8; ++i) add(out[0], fields[i], array(fields[i]));
  if (bromwich_result_array(result, "outputs", &values, NULL, NULL) == BROMWICH_OK) {
    mxArray* outputs = array("outputs");
    add(out[0], "outputs", outputs);
    add(out[0], "names", output_names(mxGetN(outputs)));
  }
  forget();
}
