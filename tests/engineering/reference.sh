#!/usr/bin/env bash
# reference.sh SOURCE OUT: the API reference of docs/Doxyfile builds into OUT/html without a warning. Exit code 77:
# no doxygen here.
set -euo pipefail
source=$(realpath "$1")
mkdir -p "$2"
out=$(realpath "$2")
cd "$source"

if ! command -v doxygen >/dev/null; then
  echo "reference: skipped, no doxygen (Debian 12: doxygen)"
  exit 77
fi

# build_reference OUT [SETTING...]: docs/Doxyfile with these settings in place of its own.
build_reference() {
  { cat docs/Doxyfile; printf '%s\n' "OUTPUT_DIRECTORY = \"$1\"" "${@:2}"; } | doxygen -
}

# A check that accepts this one would accept anything.
mkdir -p "$out/bad"
printf '#pragma once\n/// \\param missing is no parameter.\nvoid documented(int present);\n' >"$out/bad/bad.hpp"
if build_reference "$out/bad" "INPUT = \"$out/bad/bad.hpp\"" "USE_MDFILE_AS_MAINPAGE =" >/dev/null 2>&1; then
  echo "reference: a parameter that is not there was documented, and accepted"
  exit 1
fi

rm -rf "$out/html"
build_reference "$out"
[[ -s $out/html/index.html ]] || { echo "reference: no pages were written"; exit 1; }
echo "reference: $out/html/index.html"
