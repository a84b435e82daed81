#!/usr/bin/env bash
# coverage.sh SOURCE BUILD OUT.json: line coverage a folder, from the counters that the tests in BUILD have left, and the
# longest runs of lines that no test reaches.
set -euo pipefail
source=$(realpath "$1") build=$(realpath "$2") out=$(realpath -m "$3")
cd "$source"
commit=${BROMWICH_COMMIT:-$(git rev-parse --verify HEAD 2>/dev/null || echo unknown)}
compiler=$(sed -n 's/.*compiler = "\(.*\)";/\1/p' "$build/generated/core/build_info.hpp")

gcovr --root "$source" --object-directory "$build" --filter '(core|catalogue|derivatives|batch|nonlinear|ranks|complementarity|mechanics|cpu|files|app)/' --gcov-ignore-parse-errors \
  --exclude-unreachable-branches --json "$build/lines.json"

python3 - "$build/lines.json" "$out" "$commit" "$compiler" <<'PROGRAM'
import datetime
import json
import sys

lines, out, commit, compiler = sys.argv[1:]
folders, gaps = {}, []
for file in json.load(open(lines))["files"]:
    folder = folders.setdefault(file["file"].split("/")[0], {"lines": 0, "covered": 0})
    run = []
    for line in sorted((l for l in file["lines"] if not l["gcovr/noncode"]), key=lambda l: l["line_number"]):
        folder["lines"] += 1
        folder["covered"] += line["count"] > 0
        if line["count"] == 0:
            run.append(line["line_number"])
        else:
            gaps.append((len(run), file["file"], run))
            run = []
    gaps.append((len(run), file["file"], run))
if not any(f["covered"] for f in folders.values()):
    sys.exit("coverage: no line was reached; were the tests run?")
folders = dict(sorted(folders.items()))
report = {"schema": "bromwich-coverage/1", "commit": commit, "compiler": compiler, "flags": "-O1 --coverage"}
report |= {"date": datetime.date.today().isoformat(), "folders": folders}
with open(out, "w") as file:
    file.write(json.dumps(report, indent=2) + "\n")
for name, f in folders.items():
    print(f"{name:6} {f['covered']:5} of {f['lines']:5} lines, {100 * f['covered'] / f['lines']:.1f} %")
print("longest runs that no test reaches:")
for length, name, run in sorted(gaps, key=lambda gap: -gap[0])[:15]:
    if length > 1:
        print(f"  {name}:{run[0]}-{run[-1]}, {length} lines")
PROGRAM
