#!/usr/bin/env python3
"""ranks.py BROMWICH MPIRUN [FLAG...]: the command on several ranks, held against one rank.

Same y on 1, 2 and 3 ranks, and from run to run; one line for what does not go; the end of all ranks with one of them, and what --restart makes
of the rest. Standard library; files of HDF5 are looked into where h5py is installed.
"""

import csv
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

try:
    import h5py
except ImportError:
    h5py = None

BROMWICH, *MPIRUN = sys.argv[1:]
ENVIRONMENT = dict(os.environ, OMP_NUM_THREADS="1", OMPI_MCA_btl_vader_single_copy_mechanism="none")
SWEEP = """
name = "diode"
[parameters]
R = 1
a = 1
[dynamics]
A = [[-1]]
B = [[1]]
f = ["a*sin(3*t)"]
x0 = ["0.2 + 0/(a - 2)"]
[complementarity]
N = [[1]]
M = [["R"]]
g = ["0.3*cos(5*t)"]
[time]
T = 6
steps = STEPS
[sweep]
R = {from = 0.5, to = 8, points = 40}
a = [1, 2, 1.1, "1/2", 0.7, 1.5, 3, 4, 5, 6]
"""
SOLVES = [("signorini", "Q=15", "1024", "multigrid"), ("signorini", "Q=15", "512", "contour"),
          ("signorini3d", "Q=7", "512", "multigrid"), ("dlcp-small", None, "512", "multigrid"),
          ("contact", "Q=7", "512", "dual")]


def on(ranks, *words):
    job = [*MPIRUN, "-n", str(ranks)] if ranks > 1 else []
    return subprocess.run([*job, BROMWICH, *words], env=ENVIRONMENT, capture_output=True, text=True, timeout=1800)


def words_of(scene, parameter, steps, method):
    return ["solve", scene, *(["--set", parameter] if parameter else []), "--steps", steps, "--method", method]


def table(path):
    with open(path) as file:
        return [[float(value) for value in row] for row in list(csv.reader(file))[1:]]


def same_solution(folder):
    for case in SOLVES:
        tables = []
        for ranks in (1, 2, 3):
            out = folder / f"{ranks}.csv"
            done = on(ranks, *words_of(*case), "--out", str(out))
            assert done.returncode == 0, done.stderr
            assert done.stdout.count("residual") == (1 if "residual" in done.stdout else 0), "one rank prints"
            tables.append(table(out))
        size = max(1, max(abs(value) for row in tables[0] for value in row))
        for other in tables[1:]:
            assert len(other) == len(tables[0])
            worst = max(abs(a - b) for one, two in zip(tables[0], other) for a, b in zip(one, two))
            assert worst <= 1e-12 * size, f"{case}: {worst}"
        again = folder / "again.csv"
        assert on(3, *words_of(*case), "--out", str(again)).returncode == 0
        assert again.read_bytes() == (folder / "3.csv").read_bytes(), f"{case}: another result in another run"


def refusals():
    for words, line in [
            (words_of("dlcp-small", None, "256", "march"), "bromwich: method: found march on 2 ranks, and it does not split "
             "over time; choose multigrid, contour or dual, or run it on one rank"),
            (words_of("dlcp-small", None, "1", "contour"), "bromwich: ranks: found 2 for 1 steps; use fewer ranks, or more steps"),
            ([*words_of("dlcp-small", None, "256", "auto"), "--checkpoint", "none.h5"], "bromwich: --checkpoint: method auto is no "
             "run from the start to the end; use --method contour or multigrid"),
            ([*words_of("dlcp-small", None, "256", "march"), "--checkpoint", "none.h5"], "bromwich: method: found march on 2 ranks"),
            (["solve", "signorin"], "bromwich: SCENE: found")]:
        refused = on(2, *words)
        own = [text for text in refused.stderr.splitlines() if text.startswith("bromwich")]
        assert refused.returncode == 2 and len(own) == 1 and own[0].startswith(line), refused.stderr


# The same program with another commit in it.
def other_build(folder):
    words = subprocess.run([BROMWICH, "info"], capture_output=True, text=True, check=True).stdout
    commit = re.search(r"commit (\w+)", words).group(1).encode()
    built = Path(BROMWICH).read_bytes()
    assert commit in built
    other = folder / "bromwich"
    other.write_bytes(built.replace(commit, commit[::-1]))
    other.chmod(0o755)
    for part in Path(BROMWICH).resolve().parent.glob("bromwich_*.so"):
        (folder / part.name).symlink_to(part)
    solve = ["solve", "dlcp-small", "--method", "contour"]
    job = [*MPIRUN, "-n", "1", BROMWICH, *solve, ":", "-n", "1", str(other), *solve]
    refused = subprocess.run(job, env=ENVIRONMENT, capture_output=True, text=True, timeout=1800)
    line = "bromwich: mpirun: rank 1 runs another build than rank 0; start the same program everywhere"
    assert refused.returncode == 2 and refused.stderr.splitlines().count(line) == 1, refused.stderr


def rows_of(path):
    with open(path) as file:
        return list(csv.DictReader(file))


def same_sweep(expected, found):
    assert len(expected) == len(found) == 400
    for one, other in zip(expected, found):
        assert one.keys() == other.keys() and one["status"] == other["status"] and one["scene"] == other["scene"]
        for key in [key for key in one if "(T)" in key or "max" in key]:
            assert one[key] == other[key] or abs(float(one[key]) - float(other[key])) <= 1e-12, (one, other)
    assert sum(row["status"] != "solved" for row in found) == 40, "a = 2 fails alone"


def sweeps(folder):
    scene = folder / "sweep.toml"
    scene.write_text(SWEEP.replace("STEPS", "20000"))
    alone, out = folder / "alone.csv", folder / "sweep.csv"
    assert on(1, "solve", str(scene), "--out", str(alone)).returncode == 3
    expected = rows_of(alone)
    assert on(3, "solve", str(scene), "--out", str(out)).returncode == 3
    same_sweep(expected, rows_of(out))
    parts = Path(f"{out}.parts")
    assert not parts.exists()

    out.unlink()
    job = start(2, "solve", str(scene), "--out", str(out))
    wait_until(lambda: len(list(parts.glob("*.block"))) > 2 and len(children(job.pid)) == 2)
    os.kill(children(job.pid)[1], signal.SIGKILL)
    job.communicate(timeout=1800)
    assert job.returncode != 0 and not out.exists() and len(list(parts.glob("*.block"))) > 2
    other = on(2, "solve", str(scene), "--steps", "100", "--out", str(out), "--restart", str(parts))
    assert "is of another sweep" in other.stderr and other.returncode == 2, other.stderr
    other = on(2, "solve", str(scene), "--columns", "y0,w0", "--out", str(out), "--restart", str(parts))
    assert "is of another sweep" in other.stderr and other.returncode == 2, other.stderr
    assert on(3, "solve", str(scene), "--out", str(out), "--restart", str(parts)).returncode == 3
    same_sweep(expected, rows_of(out))


def start(ranks, *words):
    return subprocess.Popen([*MPIRUN, "-n", str(ranks), BROMWICH, *words], env=ENVIRONMENT, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True)


def wait_until(holds):
    deadline = time.monotonic() + 1800
    while not holds():
        assert time.monotonic() < deadline, "what is waited for does not happen"
        time.sleep(0.01)


def children(pid):
    return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def killed_rank(folder):
    out = folder / "killed.csv"
    job = start(2, *words_of("signorini", "Q=255", "65536", "contour"), "--out", str(out))
    wait_until(lambda: len(children(job.pid)) == 2)
    time.sleep(1)
    victims = children(job.pid)
    assert job.poll() is None and len(victims) == 2, "the job was too short to kill a rank of it"
    os.kill(victims[1], signal.SIGKILL)
    _, errors = job.communicate(timeout=1800)
    assert job.returncode != 0 and "signal 9" in errors, errors
    assert not out.exists(), "a table is written whole or not at all"


def rows_of_file(path):
    with h5py.File(path) as file:
        return str(file.attrs["status"]), file["t"][:], file["y"][:]


# Parts carry x over: a few roundings of each, far below 1e-10; a row that is missing or of another part is off by 1e-3.
def same_rows(whole, found):
    rows = len(found[1])
    assert (found[1] == whole[1][:rows]).all() and abs(found[2] - whole[2][:rows]).max() <= 1e-10


def checkpoints(folder):
    case, out, saved = words_of("signorini", "Q=15", "65536", "contour"), folder / "long.h5", folder / "c.h5"
    files = ["--out", str(out), "--checkpoint", str(saved), "--checkpoint-every", "0.02"]
    job = start(2, *case, *files)
    wait_until(lambda: saved.exists() and len(children(job.pid)) == 2)
    assert job.poll() is None, "the job was too short to kill a rank of it"
    os.kill(children(job.pid)[1], signal.SIGKILL)
    _, errors = job.communicate(timeout=1800)
    assert job.returncode != 0 and "signal 9" in errors, errors
    if h5py:
        assert on(1, *case, "--out", str(folder / "whole.h5")).returncode == 0
        whole, partial = rows_of_file(folder / "whole.h5"), rows_of_file(out)
        assert partial[0] in ("running", "failed") and 512 < len(partial[1]) < 65537, partial[0]
        same_rows(whole, partial)
    other = on(2, *words_of("signorini", "Q=15", "65536", "multigrid"), "--restart", str(saved))
    assert other.returncode == 2 and "the checkpoint is of signorini with Q = 15" in other.stderr, other.stderr
    done = on(3, *case, *files, "--restart", str(saved))
    assert done.returncode == 0, done.stderr
    if h5py:
        complete = rows_of_file(out)
        assert complete[0] == "solved" and len(complete[1]) == 65537
        same_rows(whole, complete)
    ended = on(2, *case, "--restart", str(saved))
    assert ended.returncode == 2 and "reached its end" in ended.stderr, ended.stderr


with tempfile.TemporaryDirectory() as name:
    same_solution(Path(name))
    refusals()
    other_build(Path(name))
    killed_rank(Path(name))
    checkpoints(Path(name))
    sweeps(Path(name))
print("ranks: the same solutions, refusals and ends" + ("" if h5py else "; without h5py, no look into files of HDF5"))
