#!/usr/bin/python3
"""siconos_loop.cpp as users of Siconos write it in Python: dense matrices, implicit Euler, everything left as it comes.

siconos_loop.py PROBLEM RESULT: the same files and the same line of output.
"""
import json
import sys
import time

import numpy as np
import siconos.kernel as kernel


class Reader:
    """Reads the doubles of a file in order."""

    def __init__(self, path):
        self.values, self.next = np.fromfile(path), 0

    def take(self, *shape):
        size = int(np.prod(shape))
        self.next += size
        return self.values[self.next - size : self.next].reshape(shape)


def read_problem(path):
    file = Reader(path)
    m, n, nonzeros, J, observed = (int(value) for value in file.take(5))
    h = float(file.take(1)[0])
    A, entries = np.zeros((m, m)), file.take(nonzeros, 3)
    A[entries[:, 0].astype(int), entries[:, 1].astype(int)] = entries[:, 2]
    B, N, M, x0, _ = file.take(m, n), file.take(n, m), file.take(n, n), file.take(m), file.take(m)
    components = file.take(observed).astype(int)
    return h, A, B, N, M, x0, components, file.take(J, m), file.take(J, n)


def main(problem, result):
    h, A, B, N, M, x0, components, f, g = read_problem(problem)
    J = len(f)

    start = time.perf_counter()
    system = kernel.FirstOrderLinearTIDS(x0, A, f[0])
    relation = kernel.FirstOrderLinearTIR(N, B)
    relation.setDPtr(M)
    relation.setePtr(g[0])
    interaction = kernel.Interaction(kernel.ComplementarityConditionNSL(len(M)), relation)
    model = kernel.NonSmoothDynamicalSystem(0, J * h)
    model.insertDynamicalSystem(system)
    model.link(interaction, system)
    simulation = kernel.TimeStepping(
        model, kernel.TimeDiscretisation(0, h), kernel.EulerMoreauOSI(1.0), kernel.LCP()
    )
    b, e = system.b(), relation.e()  # views of Siconos' own vectors
    setup = time.perf_counter() - start

    rows = np.empty((J, len(M) + len(components)))
    start = time.perf_counter()
    for j in range(J):
        b[:], e[:] = f[j], g[j]
        simulation.computeOneStep()
        rows[j, : len(M)] = interaction.lambda_(0)
        rows[j, len(M) :] = system.x()[components]
        simulation.nextStep()
    loop = time.perf_counter() - start

    rows.tofile(result)
    print("\n" + json.dumps({"setup": setup, "loop": loop, "failures": 0}))


if __name__ == "__main__":
    main(*sys.argv[1:3])
