#!/usr/bin/python3
"""Implicit Euler by PETSc: TS with SNES VI on the matrices of a field.

field_petsc.py PROBLEM.npz RESULT.npz SECONDS

M = 0: a variational inequality in x, bounded below by -g at the contacts; y is what is left of the equations there.
M > 0: in (x, y), bounded below by 0 in y. SNESVINEWTONRSLS solves each step: Newton's method on the free unknowns, with a
sparse LU or Cholesky factorization of their block in every iteration. It stops after SECONDS of time stepping, and
prints {"setup", "loop", "steps", "newton", "solver", "peak_bytes"}.
"""
import glob
import json
import sys
import time

import numpy as np

sys.path[:0] = glob.glob("/usr/lib/petscdir/petsc3*/*-real/lib/python3/dist-packages")
import petsc4py  # noqa: E402
from memory import peak_bytes  # noqa: E402

petsc4py.init(["field_petsc"])
from petsc4py import PETSc  # noqa: E402


class OutOfTime(Exception):
    pass


def matrix(data, indices, starts, rows, columns):
    made = PETSc.Mat().createAIJ(size=(rows, columns), csr=(starts.astype(PETSc.IntType), indices.astype(PETSc.IntType), data))
    made.assemble()
    return made


class Stepper:
    """E x' = A x + ... as F(t, u, u') = 0 with u = x or (x, y), J the Jacobian of F for u' = shift u."""

    def __init__(self, problem):
        self.m, self.contacts, self.b = int(problem["m"]), problem["contacts"].astype(np.int64), float(problem["b"])
        self.g, self.T, self.compliance = problem["g"], float(problem["T"]), float(problem["compliance"])
        self.J, self.n = len(self.g) - 1, self.g.shape[1]
        self.h = self.T / self.J
        self.rigid = self.compliance == 0
        self.size = self.m if self.rigid else self.m + self.n
        self.K = self.stiffness(problem)
        self.jacobian = self.K.duplicate(copy=True)

    def stiffness(self, problem):
        """-A, or [-A, -B; N, M], by rows. The diagonal is stored."""
        rows = np.repeat(np.arange(self.m), np.diff(problem["starts"]))
        columns, values = problem["indices"].astype(np.int64), -problem["data"]
        if not self.rigid:
            y = self.m + np.arange(self.n)
            rows = np.concatenate([rows, self.contacts, y, y])
            columns = np.concatenate([columns, y, self.contacts, y])
            one = np.ones(self.n)
            values = np.concatenate([values, -self.b * one, one, self.compliance * one])
        order = np.lexsort((columns, rows))
        starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=self.size))])
        return matrix(values[order], columns[order], starts, self.size, self.size)

    def at(self, t):
        return self.g[min(self.J, max(0, round(t / self.h)))]

    def function(self, ts, t, u, rate, F):
        self.K.mult(u, F)
        values, rates = F.getArray(), rate.getArray(readonly=True)
        values[: self.m] += rates[: self.m]
        if not self.rigid:
            values[self.m :] += self.at(t)

    def set_jacobian(self, ts, t, u, rate, shift, J, P):
        self.K.copy(P, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        add = np.zeros(self.size)
        add[: self.m] = shift
        diagonal = P.createVecLeft()
        P.getDiagonal(diagonal)
        diagonal.getArray()[:] += add
        P.setDiagonal(diagonal)
        P.assemble()
        return True

    def bounds(self, ts):
        if self.rigid:
            self.low.getArray()[self.contacts] = -self.at(ts.getTime() + self.h)
        ts.getSNES().setVariableBounds(self.low, self.high)

    def solve(self, limit):
        begin = time.perf_counter()
        u = self.K.createVecRight()
        self.low, self.high = u.duplicate(), u.duplicate()
        self.low.set(PETSc.NINFINITY)
        self.high.set(PETSc.INFINITY)
        if not self.rigid:
            self.low.getArray()[self.m :] = 0
        y, w = np.zeros((self.J + 1, self.n)), np.zeros((self.J + 1, self.n))
        ts = PETSc.TS().create()
        ts.setProblemType(PETSc.TS.ProblemType.NONLINEAR)
        ts.setType(PETSc.TS.Type.BEULER)
        ts.setIFunction(self.function, u.duplicate())
        ts.setIJacobian(self.set_jacobian, self.jacobian)
        ts.setTimeStep(self.h)
        ts.setMaxSteps(self.J)
        ts.setMaxTime(self.T)
        ts.setExactFinalTime(PETSc.TS.ExactFinalTime.MATCHSTEP)
        ts.setPreStep(self.bounds)
        snes = ts.getSNES()
        snes.setType(PETSc.SNES.Type.VINEWTONRSLS)
        snes.setTolerances(rtol=1e-9, atol=1e-11, stol=0, max_it=50)
        pc = snes.getKSP().getPC()
        snes.getKSP().setType("preonly")
        pc.setType("cholesky" if self.rigid else "lu")
        package = "cholmod" if self.rigid else "umfpack"
        if not PETSc.Sys.hasExternalPackage("suitesparse"):
            package = "petsc"
        pc.setFactorSolverType(package)
        # Full steps: the norm that a line search wants to reduce grows where the set of free unknowns changes.
        PETSc.Options()["snes_linesearch_type"] = "basic"
        ts.setFromOptions()
        old = np.zeros(self.m)

        def monitor(ts, step, t, u):
            if step == 0:
                return
            values = u.getArray(readonly=True)
            x = values[: self.m]
            if self.rigid:
                residual = self.function_at(x, old)
                y[step] = np.maximum(residual[self.contacts] / self.b, 0)
            else:
                y[step] = values[self.m :]
            w[step] = x[self.contacts] + self.compliance * y[step] + self.g[step]
            old[:] = x
            self.steps = step
            if time.perf_counter() - start > limit:
                raise OutOfTime

        ts.setMonitor(monitor)
        self.steps = 0
        start = time.perf_counter()
        try:
            ts.solve(u)
        except OutOfTime:
            pass
        except PETSc.Error:
            if self.steps == 0 or time.perf_counter() - start <= limit:
                raise
        loop = time.perf_counter() - start
        answer = {"setup": start - begin, "loop": loop, "steps": self.steps, "newton": ts.getSNESIterations(), "solver": package}
        return y[: self.steps + 1], w[: self.steps + 1], answer

    def function_at(self, x, old):
        """(x - old)/h - A x."""
        u, F = self.K.createVecRight(), self.K.createVecLeft()
        u.getArray()[:] = x
        self.K.mult(u, F)
        return F.getArray() + (x - old) / self.h


def main(problem, result, limit):
    y, w, answer = Stepper(np.load(problem)).solve(float(limit))
    np.savez(result, y=y, w=w)
    answer["peak_bytes"] = peak_bytes()
    print("\n" + json.dumps(answer))


if __name__ == "__main__":
    main(*sys.argv[1:4])
