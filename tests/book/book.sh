#!/usr/bin/env bash
# book.sh PYTHON SOURCE BUILD: builds the book of docs/ into BUILD/book/html, warnings are errors, with the reference of
# C++ by Doxygen in its folder cpp. PYTHON is that of scripts/python-env. Exit code 77: it has no Sphinx, or
# BUILD no Python package.
set -euo pipefail
python=$1 source=$(realpath "$2") build=$(realpath "$3")
out=$build/book
if ! "$python" -c 'import sphinx, myst_parser, furo, sphinx_copybutton' 2>/dev/null; then
  echo "book: skipped, $python has no Sphinx with MyST (scripts/python-env installs docs/requirements.txt)"
  exit 77
fi
if ! compgen -G "$build/python/bromwich/_core*.so" >/dev/null; then
  echo "book: skipped, this build has no Python package"
  exit 77
fi
mkdir -p "$out"
cd "$source"

# sphinx SOURCE OUT CONF: everything anew, since a page that is not read again cannot warn.
sphinx() {
  BROMWICH_PYTHON_PACKAGE=$build/python "$python" -m sphinx -E -W --keep-going -q -c "$3" -d "$2.doctrees" "$1" "$2"
}

# A check that accepts a link to nowhere would accept anything.
rm -rf "$out/bad" "$out/html"
mkdir -p "$out/bad/docs"
printf '# Page\n\n[nowhere](nowhere.md)\n' >"$out/bad/docs/index.md"
if sphinx "$out/bad" "$out/bad/html" docs >/dev/null 2>&1; then
  echo "book: a link to a page that is not there was accepted"
  exit 1
fi

sphinx . "$out/html" docs
# Without their modules the pages of Python would be empty, and still build.
for name in solve Scene.from_toml Result.switches Solver.set_x0 NotSolved; do
  grep -q "id=\"bromwich.$name\"" "$out/html/docs/python-reference.html" || {
    echo "book: the reference of Python has no bromwich.$name"
    exit 1
  }
done
printf '<!doctype html><meta http-equiv="refresh" content="0; url=docs/index.html">\n' >"$out/html/index.html"
reference=$build/engineering/reference/html
if [[ -d $reference ]]; then cp -r "$reference" "$out/html/cpp"; fi
echo "book: $out/html/index.html"
