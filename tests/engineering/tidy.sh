#!/usr/bin/env bash
# tidy.sh SOURCE BUILD OUT [all]: clang-tidy 14 on what BUILD's compile_commands.json says, a finding is a failure.
# Exit code 77: no clang-tidy 14 here.
#
# Eigen makes a source cost 7 to 40 s, most of it in the static analyzer and in templates that are not ours. Without
# `all`, as the tests run it, one unit with every header of core, of the folders beside it, cpu and files is checked, by all of .clang-tidy but
# the analyzer. With `all`, every source by everything.
set -euo pipefail
mkdir -p "$3"
build=$(realpath "$2") out=$(realpath "$3")
cd "$1"

tool=$(command -v clang-tidy-14 || command -v clang-tidy || true)
if [[ -z $tool || $("$tool" --version) != *"version 14."* ]]; then
  echo "tidy: skipped, no clang-tidy 14 (Debian 12: clang-tidy)"
  exit 77
fi

# A check that accepts this one would accept anything.
echo 'struct Bad { int* p = 0; };' >"$out/bad.cpp"
if "$tool" --quiet --config-file=.clang-tidy --warnings-as-errors='*' "$out/bad.cpp" -- -std=c++20 >/dev/null 2>&1; then
  echo "tidy: 'int* p = 0;' was accepted"
  exit 1
fi

export tool build out
if [[ ${4-} != all ]]; then
  # Of omp.h the headers need one function; GCC's is not for clang, and clang's is one more package.
  mkdir -p "$out/openmp"
  echo 'extern "C" int omp_get_thread_num();' >"$out/openmp/omp.h"
  flags=(-std=c++20 -Iinclude -I. -isystem /usr/include/eigen3 -isystem "$out/openmp" -fopenmp
         -DEIGEN_DONT_PARALLELIZE -Wno-everything)
  find include core catalogue derivatives batch nonlinear ranks complementarity mechanics cpu files -name '*.hpp' | sort | sed 's/.*/#include "&"/' >"$out/headers.cpp"
  "$tool" --quiet --config-file=.clang-tidy --checks='-clang-analyzer-*' --header-filter='/(include|core|catalogue|derivatives|batch|nonlinear|ranks|complementarity|mechanics|cpu|files)/' \
    --warnings-as-errors='*' "$out/headers.cpp" -- "${flags[@]}"
  echo "tidy: $(grep -c . "$out/headers.cpp") headers"
  exit
fi

# check_source PATH: its findings to a file; those in headers come from several sources, and once out of sort -u.
check_source() { "$tool" --quiet -p "$build" "$1" >"$out/${1//\//_}.txt" 2>/dev/null || echo "$1" >>"$out/failed"; }
export -f check_source
rm -f "$out"/*.txt "$out/failed"
grep -o '"file": ".*"' "$build/compile_commands.json" | cut -d'"' -f4 | grep "^$PWD/" | grep -v "^$build/" |
  sed "s|^$PWD/||" | sort -u | xargs -P "$(nproc)" -I {} bash -c 'check_source {}'
cat "$out"/*.txt | grep -E '(warning|error):' | sort -u | tee "$out/findings"
if [[ -s $out/findings || -e $out/failed ]]; then
  echo "tidy: $(grep -c . "$out/findings") findings; in full in $out/*.txt"
  exit 1
fi
