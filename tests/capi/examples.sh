#!/usr/bin/env bash
# examples.sh LANGUAGE SOURCE BUILD LIBRARY OUT: compiles and runs the example of the C interface in a language. Exit
# code 77: its tools are not installed.
set -euo pipefail
language=$1 source=$2 build=$3 library=$4 out=$5
examples=$source/examples/$language
folder=$(dirname "$library")
flags=(-I"$source/include" -I"$build/generated" -L"$folder" -lbromwich "-Wl,-rpath,$folder")

need() {
  command -v "$1" >/dev/null && return
  echo "capi.example_$language: skipped, no $1"
  exit 77
}

rm -rf "$out"
mkdir -p "$out"
cd "$out"
case $language in
  c)
    need cc
    need c++
    cc -std=c99 -Wall -Wextra -Werror "$examples/diode.c" -o diode "${flags[@]}"
    ./diode
    # The header is one of C++ too.
    c++ -std=c++17 -Wall -Wextra -Werror -x c++ -fsyntax-only -include bromwich/bromwich.h /dev/null "${flags[@]:0:2}"
    ;;
  fortran)
    need gfortran
    gfortran -std=f2018 -Wall -Wno-unused-dummy-argument "$examples/bromwich.f90" "$examples/rebound.f90" -o rebound "${flags[@]}"
    ./rebound
    ;;
  octave)
    need mkoctfile
    need octave-cli
    mkoctfile --mex "$examples/bromwich_solve.c" -o bromwich_solve.mex "${flags[@]}"
    octave-cli --no-init-file --quiet --eval \
      "addpath('$out'); netlist = '$source/examples/circuits/buck.cir'; run('$examples/example.m')"
    ;;
  julia)
    need julia
    BROMWICH_LIBRARY=$library julia --startup-file=no "$examples/example.jl"
    ;;
esac
