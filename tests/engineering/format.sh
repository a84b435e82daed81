#!/usr/bin/env bash
# format.sh SOURCE: every C++ and CUDA file is as clang-format 14 writes it. Exit code 77: no clang-format 14 here
# (other versions write other files).
set -euo pipefail
cd "$1"

tool=$(command -v clang-format-14 || command -v clang-format || true)
if [[ -z $tool || $("$tool" --version) != *"version 14."* ]]; then
  echo "format: skipped, no clang-format 14 (Debian 12: clang-format)"
  exit 77
fi
# A check that accepts this one would accept anything.
if echo 'int  bad( ) ;' | "$tool" --dry-run -Werror 2>/dev/null; then
  echo "format: $tool finds nothing to change in 'int  bad( ) ;'"
  exit 1
fi

mapfile -d '' files < <(find . \( -name 'build*' -o -name third_party -o -name '.*' ! -name . \) -prune -o \
  -type f \( -name '*.cpp' -o -name '*.hpp' -o -name '*.cu' -o -name '*.cuh' -o -name '*.h' -o -name '*.c' \) -print0 | sort -z)
((${#files[@]} > 100)) || { echo "format: only ${#files[@]} files found in $PWD"; exit 1; }
"$tool" --dry-run -Werror "${files[@]}"
echo "format: ${#files[@]} files"
