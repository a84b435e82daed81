#!/usr/bin/env bash
# headers.sh SOURCE OUT COMPILER [FLAG...]: every header of core, of the folders beside it, cpu and files compiles alone, and twice in one unit.
#
# Most headers include core/base/types.hpp, by themselves or through others, and Eigen with it: a second each. These are
# compiled on a precompiled core/base/types.hpp, which hides nothing, since a header's includes come before its text. A
# header that only works after somebody else has included core/base/types.hpp does not include it, and is compiled without.
set -euo pipefail
cd "$1"
out=$2
shift 2
export out compile="$* -Iinclude -I. -fsyntax-only -Werror"
mkdir -p "$out"

echo '#include "core/base/types.hpp"' >"$out/types_first.hpp"
$* -Iinclude -I. -x c++-header "$out/types_first.hpp" -o "$out/types_first.hpp.gch"

# check_header PATH: prints the compiler's words and fails where the header does not compile.
check_header() {
  local unit=$out/${1//\//_}.cpp first=()
  printf '#include "%s"\n' "$1" "$1" >"$unit"
  # What the header includes, with everything outside of the project left out.
  if $compile -MM -MG -nostdinc -x c++ "$unit" 2>/dev/null | tr ' ' '\n' | xargs -r realpath -m --relative-to=. |
    grep -qx core/base/types.hpp && [[ $1 != core/base/types.hpp ]]; then
    first=(-include "$out/types_first.hpp")
  fi
  $compile -Winvalid-pch "${first[@]}" "$unit" 2>"$unit.log" || {
    echo "headers: $1 does not compile alone"
    cat "$unit.log"
    return 1
  }
}
export -f check_header

# A check that accepts these would accept anything.
mkdir -p "$out/bare"
echo 'inline Vector zero();' >"$out/bare/missing_include.hpp"
echo 'struct Twice {};' >"$out/bare/missing_guard.hpp"
for bare in missing_include missing_guard; do
  if check_header "$out/bare/$bare.hpp" >/dev/null; then
    echo "headers: $bare.hpp was accepted"
    exit 1
  fi
done

mapfile -t headers < <(find include core catalogue derivatives batch nonlinear ranks complementarity mechanics cpu files -name '*.hpp' | sort)
((${#headers[@]} > 40)) || { echo "headers: only ${#headers[@]} found in $PWD"; exit 1; }
printf '%s\n' "${headers[@]}" | xargs -P "$(nproc)" -I {} bash -c 'check_header {}'
echo "headers: ${#headers[@]} compile alone"
