/* bromwich in C99: linear complementarity systems
 *
 *     E x' = A x + B y + f(t),   0 <= y  ⊥  w = N x + M y + g(t) >= 0,   x(0) = x0,   0 <= t <= T.
 *
 * symbol  shape    name in bromwich_scene_set
 * A, E    m x m    "A", "E" (none: the identity)
 * B, N    m x n, n x m   "B", "N"
 * M       n x n    "M"
 * x0      m        "x0"
 *
 * Every function that can fail returns a code; bromwich_error has one line about the last failure of this thread: which
 * argument, what was found, what to do. After a failure the arguments that are pointers to results are unchanged. A
 * solve that does not succeed is no failure: its status says so. Handles are freed by the function of their name; NULL
 * is allowed there. One handle is used by one thread at a time, different handles by several.
 */
#ifndef BROMWICH_H
#define BROMWICH_H

#include <bromwich/version.h>

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32) && defined(BROMWICH_BUILDING)
#define BROMWICH_API __declspec(dllexport)
#elif defined(_WIN32)
#define BROMWICH_API __declspec(dllimport)
#elif defined(__GNUC__)
#define BROMWICH_API __attribute__((visibility("default")))
#else
#define BROMWICH_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Codes of functions. */
enum {
  BROMWICH_OK = 0,
  BROMWICH_BAD_INPUT = 1,    /* change the input */
  BROMWICH_DOES_NOT_FIT = 2, /* memory or work exceeds a limit */
  BROMWICH_DEVICE = 3,       /* a device or a library failed */
  BROMWICH_INTERNAL = 4,     /* a defect of this library */
  BROMWICH_STOPPED = 5       /* a function of the caller did not return 0 */
};

/* Status of a solve. */
enum {
  BROMWICH_SOLVED = 0,
  BROMWICH_TOLERANCE_NOT_MET = 1,
  BROMWICH_INFEASIBLE = 2,
  BROMWICH_UNSUPPORTED = 3,
  BROMWICH_NONFINITE = 4,
  BROMWICH_INTERRUPTED = 5
};

/* Status of a complementarity problem. */
enum { BROMWICH_LCP_SOLVED = 0, BROMWICH_LCP_INFEASIBLE = 1, BROMWICH_LCP_UNSOLVED = 2, BROMWICH_LCP_NONFINITE = 3 };

/* Order of the entries of a matrix. */
enum {
  BROMWICH_ROWS = 0,   /* row after row, as in C */
  BROMWICH_COLUMNS = 1 /* column after column, as in Fortran, Julia and MATLAB */
};

typedef struct bromwich_scene bromwich_scene;
typedef struct bromwich_result bromwich_result;
typedef struct bromwich_solver bromwich_solver;
typedef struct bromwich_batch bromwich_batch;

/* "0.2.0", of the library that is loaded; BROMWICH_VERSION is that of this header. */
BROMWICH_API const char* bromwich_version(void);
/* One line about the last failure of this thread; "" before the first one. Valid until the next failure. */
BROMWICH_API const char* bromwich_error(void);

/* ---- Scenes ---------------------------------------------------------------------------------------------------- */

/* A scene of m states and n constraints on [0, T], with A, B, N, M, x0, f and g zero. */
BROMWICH_API int bromwich_scene_new(int64_t states, int64_t constraints, double T, bromwich_scene** scene);
/* A file .toml, a netlist (.cir, .net, .sp, .ckt, .spice) or the name of a built-in scene. `settings`: parameters,
 * "R=500 C=1e-6", or NULL. */
BROMWICH_API int bromwich_scene_read(const char* name, const char* settings, bromwich_scene** scene);
/* The same from text; `language`: "toml" or "netlist". Files that it names are relative to the current folder. */
BROMWICH_API int bromwich_scene_parse(const char* text, const char* language, const char* settings,
                                      bromwich_scene** scene);
/* A scene that shares the matrices: scenes of a batch are such copies with an x0, an f or a g of their own. */
BROMWICH_API int bromwich_scene_copy(const bromwich_scene* scene, bromwich_scene** copy);
BROMWICH_API void bromwich_scene_free(bromwich_scene* scene);

/* m and n; NULL where one is not wanted. */
BROMWICH_API int bromwich_scene_sizes(const bromwich_scene* scene, int64_t* states, int64_t* constraints);

/* Copies a matrix or vector into the scene: A, B, N, M, E, x0; E0, ET (m x m) and b (m) of E0 x(0) + ET x(T) = b
 * instead of x0; F (m x k), with which f has k values and enters as F f(t); restitution (n); breakpoints (times at
 * which f or g may jump or have a kink, increasing). `order`: BROMWICH_ROWS or BROMWICH_COLUMNS. Vectors are rows x 1.
 */
BROMWICH_API int bromwich_scene_set(bromwich_scene* scene, const char* name, const double* values, int64_t rows,
                                    int64_t columns, int order);
/* A, B, N, M, E or F as compressed sparse columns: entries starts[j] ... starts[j + 1] - 1 of column j, in the rows
 * row[...], all from 0. If one of A, B, N and E is sparse, the dynamics are. */
BROMWICH_API int bromwich_scene_set_sparse(bromwich_scene* scene, const char* name, int64_t rows, int64_t columns,
                                           const int64_t* starts, const int64_t* row, const double* values);
/* The class of M, "P", "Z", "PSD" or "unknown"; not set: it is tested. */
BROMWICH_API int bromwich_scene_set_class(bromwich_scene* scene, const char* name);
/* Rows i with w_i = 0 and y_i of either sign, increasing, from 0. */
BROMWICH_API int bromwich_scene_set_free_rows(bromwich_scene* scene, const int64_t* rows, int64_t count);

/* Writes the values of f or g at t. Returns 0, or another number to end the solve with BROMWICH_STOPPED. It may be
 * called from several threads where scenes of a batch are solved side by side. */
typedef int (*bromwich_function)(double t, double* values, void* user);

/* `name`: "f" or "g". */
BROMWICH_API int bromwich_scene_set_function(bromwich_scene* scene, const char* name, bromwich_function function,
                                             void* user);
/* One expression of t for each component: "-sin(2*pi*t)". Kinks and jumps are found in the text. */
BROMWICH_API int bromwich_scene_set_expressions(bromwich_scene* scene, const char* name, const char* const* texts,
                                                int64_t count);
/* Rows of values at times, linear between them; a time that is given twice is a jump. The times cover 0 to T. */
BROMWICH_API int bromwich_scene_set_table(bromwich_scene* scene, const char* name, const double* times, int64_t rows,
                                          const double* values, int64_t columns, int order);

/* ---- Solving --------------------------------------------------------------------------------------------------- */

/* Options are words key=value between blanks, "method=march steps=400 states=all", with the names of the command:
 *
 *   method        auto, multigrid, dual, contour, march, euler, events, shooting, galerkin, ...
 *   steps         J; with a tolerance, of the first grid
 *   tol, tol-x, tol-y   relative error of y and of the states, of the states alone, of y alone
 *   atol          absolute error, added to the relative one
 *   max-steps, max-seconds   where a tolerance ends refining
 *   iteration-tol, max-iterations   where sweeps end
 *   states        all, none, or components 0,3 or names; default: all, where there are at most 1000
 *   backend       auto, cpu or cuda
 *   device        number of the CUDA device
 *   threads       of the host; 0: all
 *   memory-limit  bytes
 *   event-location, confirm   0 or 1
 *
 * NULL or "": the defaults, those of the scene or a tolerance of 1e-3. */

/* Functions that a solve calls, from the thread that called it. Set `size` to sizeof(bromwich_hooks) and what is not
 * wanted to NULL. */
typedef struct bromwich_hooks {
  size_t size;
  void* user;
  int (*interrupted)(void* user); /* asked now and then: not 0 ends the solve with BROMWICH_INTERRUPTED */
  void (*progress)(int64_t done, int64_t total, double change, void* user); /* steps, or sweeps with total = 0 */
  void (*log)(int level, const char* text, void* user);                     /* 0 debug, 1 info, 2 warning; one line */
} bromwich_hooks;

/* `options` and `hooks` may be NULL. */
BROMWICH_API int bromwich_solve(const bromwich_scene* scene, const char* options, const bromwich_hooks* hooks,
                                bromwich_result** result);

/* A solver keeps factorizations, plans and arrays for many solves of one scene. It copies the scene; the hooks have to
 * stay valid until it is freed. */
BROMWICH_API int bromwich_solver_new(const bromwich_scene* scene, const char* options, const bromwich_hooks* hooks,
                                     bromwich_solver** solver);
BROMWICH_API int bromwich_solver_set_x0(bromwich_solver* solver, const double* x0, int64_t states);
/* f, g and breakpoints of another scene of the same sizes. */
BROMWICH_API int bromwich_solver_set_sources(bromwich_solver* solver, const bromwich_scene* scene);
BROMWICH_API int bromwich_solver_solve(bromwich_solver* solver, bromwich_result** result);
BROMWICH_API void bromwich_solver_free(bromwich_solver* solver);

/* Numbers about a result. Set `size` to sizeof(bromwich_summary). Later versions append members; those of an older
 * caller are written alone. A number that is not known is NaN. */
typedef struct bromwich_summary {
  size_t size;
  int32_t status;           /* BROMWICH_SOLVED, ... */
  int32_t well_posed;       /* 0: a problem of a step is not known to determine y */
  int64_t rows;             /* time points */
  int64_t steps;            /* time steps that were taken; 0 where the method has no grid */
  int64_t iterations;       /* sweeps or steps */
  double residual;          /* max |min(y, w)|, relative */
  double error_estimate;    /* relative, with a tolerance */
  double boundary_residual; /* of E0 x(0) + ET x(T) = b */
  double kernel_error;      /* of the weights, relative */
  double infeasible_at;     /* the first time without a solution */
  double seconds;           /* wall clock */
} bromwich_summary;

BROMWICH_API int bromwich_result_summary(const bromwich_result* result, bromwich_summary* summary);
/* "status", "method", "reason" (where the status is not solved), "warning", "backend" or "kernel"; NULL for another
 * name. Valid as long as the result. */
BROMWICH_API const char* bromwich_result_text(const bromwich_result* result, const char* name);
/* An array of a result, row after row:
 *
 *   t         rows x 1
 *   y, w      rows x n; NaN where there is no value
 *   x         rows x recorded states
 *   integral  rows x n, the integral of y over [0, t]
 *   switches  k x 4: t, component of y from 0, 1 (becomes positive) or 0, estimated error of t
 *   outputs   of a netlist: rows x outputs, voltages of the nodes and currents of the elements
 *
 * The array belongs to the result. `rows` and `columns` may be NULL. */
BROMWICH_API int bromwich_result_array(bromwich_result* result, const char* name, const double** values, int64_t* rows,
                                       int64_t* columns);
/* The state that a column of x has, from 0; -1 where there is no such column. */
BROMWICH_API int64_t bromwich_result_state(const bromwich_result* result, int64_t column);
/* The name of a column: of "x", "y" and "w" as the scene gives them, of "outputs" such as "V(out)"; "" where it has
 * none. */
BROMWICH_API const char* bromwich_result_name(const bromwich_result* result, const char* array, int64_t column);
/* The result at these times in [0, T], with the order of the method. */
BROMWICH_API int bromwich_result_at(const bromwich_result* result, const double* times, int64_t count,
                                    bromwich_result** rows);
BROMWICH_API void bromwich_result_free(bromwich_result* result);

/* ---- Many scenes ----------------------------------------------------------------------------------------------- */

/* Scenes of equal m and n with the same options, side by side. Copies of one scene share their preparation. With a
 * tolerance `times` are needed, the times of the rows, from 0 to T of the first scene; otherwise NULL. */
BROMWICH_API int bromwich_solve_batch(const bromwich_scene* const* scenes, int64_t count, const double* times,
                                      int64_t time_count, const char* options, const bromwich_hooks* hooks,
                                      bromwich_batch** batch);
/* BROMWICH_SOLVED, ... of scene k; -1 where there is no such scene. */
BROMWICH_API int bromwich_batch_status(const bromwich_batch* batch, int64_t k);
/* "status", "method", "reason" or "warning" of scene k; NULL for another name or scene. */
BROMWICH_API const char* bromwich_batch_text(const bromwich_batch* batch, int64_t k, const char* name);
/* "t" (rows x 1), "y", "w" (count rows x n) and "x", scene after scene; "residual" and "infeasible_at" (count x 1). */
BROMWICH_API int bromwich_batch_array(const bromwich_batch* batch, const char* name, const double** values,
                                      int64_t* rows, int64_t* columns);
BROMWICH_API void bromwich_batch_free(bromwich_batch* batch);

/* ---- Complementarity problems and Laplace inversion ------------------------------------------------------------ */

/* 0 <= y_k  ⊥  w_k = M_k y_k + q_k >= 0 for k = 0 ... count - 1, n rows each. `matrices`: 1 (M is shared) or `count`,
 * one after the other in `order`. `name`: the class of M, or NULL. q, y and w: count x n, row after row. y, w, status
 * (BROMWICH_LCP_SOLVED, ...) and residual (count each) are written; NULL where one is not wanted. */
BROMWICH_API int bromwich_lcp(int64_t n, int64_t count, const double* M, int64_t matrices, int order, const char* name,
                              const double* q, double* y, double* w, int32_t* status, double* residual);

/* Writes F(s): `count` points s (real and imaginary part of each), count x components values (both parts of each, row
 * after row). Returns 0, or another number to end with BROMWICH_STOPPED. */
typedef int (*bromwich_transform)(int64_t count, const double* s, double* values, void* user);

/* The inverse Laplace transform of F, real for real times: f and its estimated error, both count x components, at times
 * t > 0. `singularities`: F is continued analytically to the plane without the half-lines from these points to the
 * left; real and imaginary part of each, NULL and 0: the negative real axis. `accuracy` of F, relative; 0: rounding.
 * `error` may be NULL. */
BROMWICH_API int bromwich_invert(bromwich_transform F, void* user, int64_t components, const double* t, int64_t count,
                                 const double* singularities, int64_t singularity_count, double accuracy, double* f,
                                 double* error);

#ifdef __cplusplus
}
#endif

#endif
