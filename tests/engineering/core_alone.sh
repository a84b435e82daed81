#!/usr/bin/env bash
# core_alone.sh SOURCE BUILD OUT [CMAKE_OPTION...]: core and the libraries beside it
# are built, installed and used without OpenMP, FFTW and CUDA.
#
# Compiling core a second time would take minutes and show nothing new, because
# 1. a build with BROMWICH_CPU=OFF, for which neither OpenMP nor FFTW can be found, configures;
# 2. its commands are, word for word, those that BUILD has run for these libraries: the same ones come out;
# 3. in both, omp.h, fftw3.h and cuda_runtime.h are headers that stop the compiler (core/CMakeLists.txt);
# 4. those libraries, installed from there, are found by a project of its own and linked whole: a name that any of
#    their objects missed would stop the linker.
set -euo pipefail
source=$1 build=$2 out=$3
shift 3
rm -rf "$out"
without=(-DCMAKE_DISABLE_FIND_PACKAGE_OpenMP=ON -DCMAKE_DISABLE_FIND_PACKAGE_FFTW3=ON)

cmake -S "$source" -B "$out/build" "$@" "${without[@]}" -DBROMWICH_CPU=OFF -DBROMWICH_CUDA=OFF \
  -DCMAKE_EXPORT_COMPILE_COMMANDS=ON

# core_commands BUILD: one line a file, without the name of the build directory.
of_core=' -o [^ ]*bromwich_(core|catalogue|derivatives|batch|nonlinear|ranks|complementarity|mechanics)\.dir/'
core_commands() { grep -E "\"command\": .*$of_core" "$1/compile_commands.json" | sed "s|$1|BUILD|g" | sort; }
core_commands "$build" >"$out/of_this_build"
core_commands "$out/build" >"$out/of_core_alone"
[[ -s $out/of_core_alone ]] || { echo "core_alone: no commands in compile_commands.json"; exit 1; }
diff "$out/of_this_build" "$out/of_core_alone" || { echo "core_alone: core is compiled otherwise when alone"; exit 1; }
if grep -vE "$of_core" "$out/build/compile_commands.json" | grep '"command"'; then
  echo "core_alone: more than core would be compiled"
  exit 1
fi
for header in omp.h fftw3.h cuda_runtime.h; do
  grep -q '^#error' "$build/core_alone/$header"
done

for name in core catalogue derivatives batch nonlinear ranks complementarity mechanics; do cp "$build/$name/libbromwich_$name.a" "$out/build/$name/"; done
cmake --install "$out/build" --prefix "$out/prefix"
cmake -S "$source/tests/engineering/core_alone" -B "$out/consumer" "$@" "${without[@]}" \
  -DCMAKE_PREFIX_PATH="$out/prefix"
cmake --build "$out/consumer"
"$out/consumer/core_alone"
if ldd "$out/consumer/core_alone" | grep -E 'omp|fftw|cuda'; then
  echo "core_alone: the program needs these"
  exit 1
fi
