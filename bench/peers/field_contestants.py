"""The contestants of scripts/bench_fields_peers: run(steps) returns y and w at steps 0, ..., J and a row's facts, with
"seconds" as {"total", "setup"} of its own clock."""
import json
import os
import pathlib
import subprocess
import sys

import numpy as np

here = pathlib.Path(__file__).resolve().parent
one_thread = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")


class March:
    name, scheme = "bromwich march", "Radau IIA or linear y"

    def __init__(self, field, folder, threads):
        self.field, self.folder, self.threads = field, pathlib.Path(folder), threads

    def run(self, steps):
        problem, result = self.folder / "march.npz", self.folder / "march-result.npz"
        write_arrays(self.field, steps, problem)
        program = [sys.executable, str(here / "field_march.py")]
        answer = last_line([*program, str(problem), str(result), str(self.threads)], os.environ)
        found = np.load(result)
        return found["y"], found["w"], answer


class SparseEuler:
    """Our own: one factorization, contacts last (bench/studies/sparse_euler.hpp)."""

    name, scheme, threads = "sparse Euler", "implicit Euler", 1

    def __init__(self, field, folder, program):
        self.field, self.folder, self.program = field, pathlib.Path(folder), program

    def run(self, steps):
        problem, result, n = self.folder / "euler.problem", self.folder / "euler.result", len(self.field.contacts)
        write_problem(self.field, steps, problem)
        answer = last_line([str(self.program), str(problem), str(result)])
        y, w = np.fromfile(result).reshape(2, steps + 1, n)
        facts = {
            "status": "solved" if answer["solved"] else "failed",
            "factor_entries": answer["entries"],
            "bytes": answer["bytes"],
            "seconds": {"total": answer["setup"] + answer["loop"], "setup": answer["setup"]},
        }
        return y, w, facts


class Petsc:
    """Stops after `limit` seconds of time stepping; its time is then that of all steps, at the pace of those done."""

    name, scheme, threads = "PETSc TS, SNES VI", "implicit Euler", 1

    def __init__(self, field, folder, limit):
        self.field, self.folder, self.limit = field, pathlib.Path(folder), limit

    def run(self, steps):
        problem, result = self.folder / "petsc.npz", self.folder / "petsc-result.npz"
        write_arrays(self.field, steps, problem)
        answer = last_line(["/usr/bin/python3", str(here / "field_petsc.py"), str(problem), str(result), str(self.limit)])
        found, done = np.load(result), answer["steps"]
        facts = {
            "status": "solved" if done == steps else f"stopped after {done} steps",
            "steps_done": done,
            "newton_iterations": answer["newton"],
            "solver": answer["solver"],
            "peak_bytes": answer["peak_bytes"],
            "seconds": {"total": answer["setup"] + answer["loop"] * steps / done, "setup": answer["setup"]},
            "seconds_measured": answer["setup"] + answer["loop"],
        }
        return found["y"], found["w"], facts


class Siconos:
    """EulerMoreauOSI, theta = 1, sparse storage, factorised once, Lemke's method for the LCP of a step
    (bench/peers/siconos_loop.cpp). Dense storage is slower: 4.2 s a step at 10^4 states. The file has f at all steps and
    states, so that a large field is stepped through the first `most` / m steps alone. The time is that of all steps, at the
    pace of those done. The first step has the factorization and the matrix of the LCP, and counts as set-up."""

    name, scheme, threads = "Siconos", "implicit Euler", 1
    most = 40_000_000  # values of f
    largest = 100  # cells of a side

    def __init__(self, field, folder, program, limit):
        self.field, self.folder, self.program, self.limit = field, pathlib.Path(folder), program, limit

    def run(self, steps):
        problem, result = self.folder / "siconos.problem", self.folder / "siconos.result"
        n, given = self.field.cells, min(steps, max(20, self.most // self.field.A.shape[0]))
        self.write(steps, given, problem)
        answer = last_line([str(self.program), str(problem), str(result), "sparse", "once", "1", str(self.limit)])
        done, setup = answer["steps"], answer["setup"] + answer["first"]
        y, contacts = np.fromfile(result).reshape(-1, 2, n).swapaxes(0, 1)
        y, contacts = (np.vstack([np.zeros(n), values]) for values in (y, contacts))
        facts = {
            "status": "failed" if answer["failures"] else "solved" if done == steps else f"stopped after {done} steps",
            "steps_done": done,
            "seconds": {"total": setup + (answer["loop"] - answer["first"]) * (steps - 1) / max(done - 1, 1), "setup": setup},
            "seconds_measured": answer["setup"] + answer["loop"],
        }
        return y, contacts + self.field.compliance * y + self.field.g(steps)[: done + 1], facts

    def write(self, steps, given, path):
        """As siconos_loop.cpp reads it."""
        f, A, m, n = self.field, self.field.A.tocoo(), self.field.A.shape[0], self.field.cells
        sizes, entries = [m, n, A.nnz, given, n, f.T / steps], np.stack([A.row, A.col, A.data], axis=1)
        matrices = [f.B.toarray(), f.N.toarray(), f.M.toarray()]
        sources = [np.zeros(given * m), f.g(steps)[1 : given + 1]]
        with open(path, "wb") as file:
            for part in [sizes, entries, *matrices, np.zeros(2 * m), f.contacts, *sources]:
                np.ravel(part).astype(float).tofile(file)


def write_arrays(f, steps, path):
    """As field_march.py and field_petsc.py read it."""
    A = f.A.tocsr()
    np.savez(
        path, m=A.shape[0], data=A.data, indices=A.indices, starts=A.indptr, contacts=f.contacts, b=f.b, g=f.g(steps), T=f.T,
        compliance=f.compliance,
    )  # fmt: skip


def write_problem(f, steps, path):
    """As bench/peers/field_problem.hpp reads it."""
    A = f.A
    sizes = [A.shape[0], len(f.contacts), steps, f.T, f.compliance, f.b, A.nnz]
    parts = [sizes, f.contacts, A.indptr, A.indices, A.data, f.g(steps)]
    np.concatenate([np.ravel(part).astype(float) for part in parts]).tofile(path)


def factors(field, folder, program, repeats):
    """Seconds of factorizations (bench/peers/field_factors.cpp): medians of runs."""
    problem = pathlib.Path(folder) / "factors.problem"
    write_problem(field, 1000, problem)
    runs = [last_line([str(program), str(problem)]) for _ in range(repeats)]
    medians = {}
    for key, value in runs[0].items():
        if isinstance(value, dict):
            medians[key] = {name: float(np.median([run[key][name] for run in runs])) for name in value}
        else:
            medians[key] = value
    return medians


def last_line(command, environment=one_thread):
    run = subprocess.run(command, capture_output=True, text=True, env=environment)
    lines = run.stdout.strip().splitlines()
    if run.returncode != 0 or not lines:
        raise SystemExit(f"bench_fields_peers: {command[0]}: {run.stderr.strip() or run.returncode}")
    return json.loads(lines[-1])
