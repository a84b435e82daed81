#!/usr/bin/env bash
# package.sh PYTHON SOURCE BUILD: makes a wheel of what BUILD has compiled, installs it with NumPy alone into an empty
# environment and runs the tests there. PYTHON is that of scripts/python-env. Exit code 77: it lacks something.
set -euo pipefail
python=$1 source=$2 build=$3
out=$build/python/package
tools=$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')

for module in scikit_build_core numpy scipy pytest auditwheel; do
  "$python" -c "import $module" 2>/dev/null || {
    echo "python.package: skipped, $python has no $module (scripts/python-env installs it)"
    exit 77
  }
done
wheels=$(dirname "$(dirname "$python")")/wheels
[[ -d $wheels ]] || { echo "python.package: skipped, no $wheels (scripts/python-env makes it)"; exit 77; }

rm -rf "$out"
mkdir -p "$out"
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INDEX=1 PIP_QUIET=1
"$python" -m pip wheel "$source/python" --no-deps --no-build-isolation --wheel-dir "$out" \
  --config-settings=cmake.source-dir=prebuilt --config-settings=cmake.define.BROMWICH_BUILD="$build" \
  --config-settings=build.targets=all --config-settings=build-dir="$out/cmake"

# The sdist has every file that CMake reads, and every source.
mkdir "$out/sdist"
(cd "$source/python" && "$python" -c "import build_backend; build_backend.build_sdist('$out/sdist')" >/dev/null)
tar -xf "$out"/sdist/bromwich-*.tar.gz -C "$out/sdist" --strip-components 1
cmake -S "$out/sdist/engine" -B "$out/sdist/build" -DSKBUILD=2 -DBROMWICH_PYTHON=ON -DBROMWICH_TRANSFORM=POCKETFFT \
  -DBROMWICH_CUDA=OFF -DBUILD_TESTING=OFF -DPython_EXECUTABLE="$python" >"$out/sdist/configure.log" 2>&1 || {
  cat "$out/sdist/configure.log"
  exit 1
}

# The libraries of this system go into the wheel, save those that every Linux has.
PATH=$(dirname "$python"):$PATH "$python" -m auditwheel repair --exclude libgomp.so.1 --wheel-dir "$out/repaired" "$out"/bromwich-*.whl
"$python" -m venv "$out/env"
"$out/env/bin/python" -m pip install --find-links "$wheels" "$out"/repaired/bromwich-*.whl
"$python" "$source/python/tests/self_contained.py" "$("$out/env/bin/python" -I -c 'import bromwich; print(bromwich.__path__[0])')"
cd "$out"
ls -l repaired
echo "With NumPy alone:"
env/bin/python - <<'END'
import bromwich
print(bromwich.backends())
print(bromwich.__version__, bromwich.solve(A=-1, B=1, N=1, M=1, g=lambda t: -t, x0=0, T=1, check=True))
END
env/bin/python -m bromwich info
env/bin/bromwich --version

# The other packages of the tests from where they are.
echo "$tools" >"$(env/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/tools.pth"
BROMWICH_COMMAND=$build/bromwich MPLBACKEND=Agg MPLCONFIGDIR=$out/matplotlib env/bin/python -m pytest -q -p no:cacheprovider "$source/python/tests" \
  --rootdir "$source/python"
