"""The contestants of scripts/bench_peers: a solver with its options on one scene and one number of steps.

solve()  runs it once, untimed, and returns y and the observed components of x at steps 1, ..., J and a status
time()   runs it once more and returns the seconds of its own clock: {"total": ..., "setup": ...}
long_runs(limit)  those of solve() as a list, where they are more than limit; else nothing
"""
import json
import os
import pathlib
import subprocess

import numpy as np

here = pathlib.Path(__file__).resolve().parent
one_thread = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
compiler_flags = ["-std=c++17", "-O3"]
solved_below = 1e-9


def compile_siconos_loop(folder):
    """The C++ program against the headers and libraries of the Debian package."""
    program = pathlib.Path(folder) / "siconos_loop"
    include = pathlib.Path("/usr/include/siconos")
    paths = [f"-I{path}" for path in (include, include / "kernel", include / "numerics")]
    libraries = ["-lsiconos_kernel", "-lsiconos_numerics"]
    source = str(here / "siconos_loop.cpp")
    subprocess.run(["g++", *compiler_flags, *paths, source, "-o", str(program), *libraries], check=True)
    return program


class Bromwich:
    def __init__(self, command, folder, scene, method, steps, threads):
        self.command, self.folder, self.scene, self.steps, self.threads = command, folder, scene, steps, threads
        self.name = f"bromwich {method}"
        self.method = method
        self.details = {}

    def long_runs(self, _):
        return []

    def arguments(self, *more):
        options = ["--method", self.method, "--steps", str(self.steps), "--threads", str(self.threads), "--json"]
        return [str(self.command), "solve", *self.scene.command, *options, *more]

    def solve(self):
        table = pathlib.Path(self.folder) / "bromwich.csv"
        table.unlink(missing_ok=True)
        states = ",".join(str(index) for index in self.scene.observed)
        run = subprocess.run(self.arguments("--states", states, "--out", str(table)), capture_output=True, text=True)
        if not run.stdout.startswith("{"):
            raise SystemExit(f"bromwich: {run.stderr.strip()}; {' '.join(self.arguments())}")
        answer = json.loads(run.stdout)
        self.details = {"kernel": answer["kernel"]}
        if answer["status"] != "solved":
            return None, None, answer["status"]
        n = len(self.scene.y0)
        values = np.loadtxt(table, delimiter=",", skiprows=1)[1:]
        return values[:, 1 : 1 + n], values[:, 1 + n :], "solved"

    def time(self):
        run = subprocess.run(self.arguments("--states", "none"), capture_output=True, text=True, check=True)
        seconds = json.loads(run.stdout)["seconds"]
        return {"total": seconds["total"], "setup": seconds["setup"]}


class Siconos:
    """language: C++ or Python; storage: dense or sparse; matrices: "step" or "once" (see siconos_loop.cpp)."""

    threads = 1

    def __init__(self, program, folder, scene, language, storage, matrices, theta, steps):
        self.folder, self.scene, self.theta, self.steps = pathlib.Path(folder), scene, theta, steps
        once = ", factorised once" if matrices == "once" else ""
        self.name = f"Siconos {language}, {storage}{once}"
        self.method = "implicit Euler" if theta == 1 else f"theta = gamma = {theta:g}"
        self.details = {"storage": storage, "factorised": "once" if matrices == "once" else "every step"}
        run = ["/usr/bin/python3", str(here / "siconos_loop.py")] if language == "Python" else [str(program)]
        place = [str(self.problem_file()), str(self.folder / "siconos.result")]
        self.first = None
        self.arguments = run + place + ([] if language == "Python" else [storage, matrices, str(theta)])

    def problem_file(self):
        label = "".join(c if c.isalnum() else "-" for c in self.scene.label)
        return self.folder / f"{label}-{self.steps}-{self.theta}.problem"

    def write_problem(self):
        """A step uses theta (new value) + (1 - theta) (old value) of f, and the new value of g."""
        scene, theta, J = self.scene, self.theta, self.steps
        t = scene.T * np.arange(J + 1) / J
        f, g = scene.f(t), scene.g(t)
        sizes = [len(scene.x0), len(scene.y0), len(scene.A[0]), J, len(scene.observed), scene.T / J]
        matrices = [np.stack(scene.A, axis=1), scene.B, scene.N, scene.M, scene.x0, scene.B @ scene.y0, scene.observed]
        sources = [theta * f[1:] + (1 - theta) * f[:-1], g[1:]]
        np.concatenate([np.ravel(part) for part in [sizes, *matrices, *sources]]).astype(float).tofile(
            self.problem_file()
        )

    def run(self):
        run = subprocess.run(self.arguments, capture_output=True, text=True, env=one_thread)
        lines = run.stdout.strip().splitlines()
        return json.loads(lines[-1]) if run.returncode == 0 and lines else None

    def long_runs(self, limit):
        return [self.first] if self.first and self.first["total"] > limit else []

    def solve(self):
        if not self.problem_file().exists():
            self.write_problem()
        answer = self.run()
        if answer is None:
            return None, None, "failed"
        self.first = self.seconds(answer)
        n = len(self.scene.y0)
        values = np.fromfile(self.folder / "siconos.result").reshape(self.steps, -1)
        y, x = values[:, :n], values[:, n:]
        t = self.scene.T * np.arange(1, self.steps + 1) / self.steps
        good = answer["failures"] == 0 and self.scene.residual(t, y, x) <= solved_below
        return y, x, "solved" if good else "tolerance_not_met"

    def time(self):
        return self.seconds(self.run())

    @staticmethod
    def seconds(answer):
        return {"total": answer["setup"] + answer["loop"], "setup": answer["setup"]}
