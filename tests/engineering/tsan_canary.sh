#!/usr/bin/env bash
# tsan_canary.sh ARCHER OUT: the thread sanitizer as scripts/check uses it finds a race in an OpenMP loop, and takes no
# barrier for one.
set -euo pipefail
for race in 0 1; do
  clang++-14 -DRACE=$race -fopenmp -fsanitize=thread -g1 -O1 -x c++ - -o "$2/canary" <<'PROGRAM'
int main() {
  static int sum[2], parts[8];
#pragma omp parallel num_threads(4)
  {
#pragma omp for
    for (int i = 0; i < 8; ++i) parts[i] = i;
#pragma omp for
    for (int i = 0; i < 8; ++i)
      if (RACE) sum[i % 2] += parts[7 - i];
      else parts[i] += parts[i] + 1;
#pragma omp single
    for (int i = 0; i < 8; ++i) sum[0] += parts[i];
  }
  return sum[0] < 0;
}
PROGRAM
  found=0
  OMP_TOOL_LIBRARIES=$1 TSAN_OPTIONS="ignore_noninstrumented_modules=1 exitcode=66" "$2/canary" 2>/dev/null || found=$?
  if ((found != (race ? 66 : 0))); then
    echo "tsan: the program with RACE=$race ended with $found"
    exit 1
  fi
done
echo "tsan: finds a race that is there, and none at barriers"
