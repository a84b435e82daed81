// The sparse implicit Euler of bench/studies/sparse_euler.hpp on the arrays of a field, for scripts/bench_fields_peers.
//
//     bromwich_field_euler PROBLEM RESULT
//
// PROBLEM: see field_problem.hpp. RESULT: y, then w, (J+1) x n each. Prints seconds as JSON.

#include "bench/peers/field_problem.hpp"
#include "bench/studies/sparse_euler.hpp"

#include <cstdio>
#include <exception>
#include <fstream>

namespace {

using namespace bromwich;

void write(const char* path, const RowMatrix& y, const RowMatrix& w) {
  std::ofstream file(path, std::ios::binary);
  for (const RowMatrix* values : {&y, &w})
    file.write(reinterpret_cast<const char*>(values->data()),
               std::streamsize(std::size_t(values->size()) * sizeof(double)));
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: bromwich_field_euler PROBLEM RESULT\n");
    return 2;
  }
  try {
    const app::FieldProblem problem = app::read_field(arguments[1]);
    const app::SparseEuler found = app::solve_by_sparse_euler(problem.scene, problem.steps);
    write(arguments[2], found.y, found.w);
    std::printf("{\"solved\": %s, \"setup\": %.9g, \"loop\": %.9g, \"entries\": %td, \"bytes\": %zu}\n",
                found.solved ? "true" : "false", found.setup, found.solve, found.factor_entries, found.bytes);
    return found.solved ? 0 : 3;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bromwich_field_euler: %s\n", error.what());
    return 2;
  }
}
