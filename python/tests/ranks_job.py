"""Runs under mpirun with mpi4py: solves on ranks against those of one rank. Each rank prints a line at its end."""

import sys

import bromwich
import numpy as np
from mpi4py import MPI

comm = MPI.COMM_WORLD
SAME = 1e-12  # sums of carries round in another order; sweeps end at a change of 1e-14


def scene_of(**changes):
    rng = np.random.default_rng(3)
    m, n = 6, 2
    A = rng.normal(size=(m, m)) / m - 2 * np.eye(m)
    given = dict(A=A, B=rng.normal(size=(m, n)), N=rng.normal(size=(n, m)), M=4 * np.eye(n), x0=rng.normal(size=m), T=4.0)
    return bromwich.Scene(**{**given, **changes}, g=lambda t: np.sin([2 * t, 3 * t]))


def near(found, expected):
    assert np.abs(found - expected).max() <= SAME * max(1, np.abs(expected).max()), np.abs(found - expected).max()


def divided():
    options = dict(steps=1024, iteration_tol=1e-14)
    field, contact = bromwich.scene("signorini", Q=15), bromwich.scene("contact", Q=7)
    for scene, method in ((scene_of(), "contour"), (scene_of(), "multigrid"), (field, "multigrid"), (contact, "dual")):
        alone = bromwich.solve(scene, method=method, threads=1, **options)
        together = bromwich.solve(scene, method=method, ranks=comm, threads=1, **options)
        again = bromwich.solve(scene, method=method, ranks=comm, threads=1, **options)
        assert together.ok and (together.y == again.y).all()
        near(together.y, alone.y)
        near(together.x, alone.x)
    if comm.rank == 0:  # what is asked later needs no other rank
        near(together.at([0.5]).y, alone.at([0.5]).y)
    solver = bromwich.Solver(scene_of(), method="contour", ranks=comm, threads=1, **options)
    for value in (0.5, -0.5):
        solver.set_x0(np.full(6, value))
        near(solver.solve().y, bromwich.solve(scene_of(x0=np.full(6, value)), method="contour", threads=1, **options).y)


def dealt():
    one = dict(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], T=2.0, steps=64)
    x0 = np.linspace(-1, 1, 11).reshape(11, 1)
    x0[4] = np.nan
    alone = bromwich.solve_batch(**one, g="-sin(3*t)", x0=x0, check=False)
    found = bromwich.solve_batch(**one, g="-sin(3*t)", x0=x0, check=False, ranks=comm)
    assert found.status == alone.status and found.reason == alone.reason and list(found.ok).count(False) == 1
    for name in ("t", "y", "w", "x", "residual"):
        values = getattr(alone, name)
        assert getattr(found, name).shape == values.shape
        np.testing.assert_allclose(getattr(found, name), values, rtol=0, atol=SAME)
    scenes = [bromwich.Scene(**one, x0=[v]) for v in np.linspace(-1, 1, 5)]
    np.testing.assert_allclose(bromwich.solve_batch(scenes, ranks=comm).y, bromwich.solve_batch(scenes).y, rtol=0, atol=SAME)
    for work in (lambda: found.derivative(), lambda: bromwich.solve_batch(scenes[:1], ranks=comm)):
        refused(work, "ranks")


def refused(work, *words):
    try:
        work()
    except bromwich.Error as error:
        assert all(word in str(error) for word in words), error
    else:
        raise AssertionError(f"not refused: {words}")


def refusals():
    scene = scene_of()
    refused(lambda: bromwich.solve(scene, steps=256, ranks=comm), "method", "auto", "multigrid, contour or dual")
    if not bromwich.backends()["cuda"].available:
        refused(lambda: bromwich.solve(scene, steps=256, method="contour", ranks=comm, backend="cuda"), "cuda")
    refused(lambda: bromwich.solve(scene, steps=256, method="contour", ranks=comm, stop=lambda: False), "stop")
    refused(lambda: bromwich.solve(scene, steps=1, method="contour", ranks=comm), "ranks", "1 steps")
    refused(lambda: bromwich.solve(scene, ranks=3), "ranks", "int", "mpi4py")
    for other in (dict(x0=np.full(6, comm.rank)), dict(A=-(1.0 + comm.rank) * np.eye(6)), dict(M=(4.0 + comm.rank) * np.eye(2))):
        refused(lambda: bromwich.solve(scene_of(**other), steps=256, method="contour", ranks=comm), "rank 1 differ")
    refused(lambda: bromwich.solve(scene, steps=256 + comm.rank, method="contour", ranks=comm), "rank 1 differ")


def devices(plugin):
    """Each rank takes the device of its number: of two, the third rank the first one. With three threads a device says its number."""
    bromwich._core.set_cuda_plugin(plugin)
    one = dict(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], T=2.0, steps=64, x0=np.linspace(-1, 1, 11).reshape(11, 1))
    dealt = dict(ranks=comm, backend="cuda", threads=3)
    refused(lambda: bromwich.solve_batch(**one, **dealt), f"device: {comm.rank % 2} is at work")
    refused(lambda: bromwich.solve_batch(**one, **dealt, device=1), "device: 1 is at work")
    options = dict(steps=256, iteration_tol=1e-14)
    refused(lambda: bromwich.solve(scene_of(), method="contour", ranks=comm, device=0, **options), "device: is given on")
    refused(lambda: bromwich.solve(scene_of(), method="contour", **dealt, **options), f"device: {comm.rank % 2} is at work")
    lacking = "device: found 2" if comm.rank == 2 else "which another rank does not have"
    refused(lambda: bromwich.solve(scene_of(), method="contour", ranks=comm, backend="cuda", threads=1, device=comm.rank, **options), lacking)
    field, contact = bromwich.scene("signorini", Q=7), bromwich.scene("contact", Q=7)
    for scene, method in ((scene_of(), "contour"), (field, "multigrid"), (contact, "dual")):
        alone = bromwich.solve(scene, method=method, threads=1, backend="cpu", **options)
        for threads in (1, 4):  # arrays of the host, and arrays that are not in its reach
            together = bromwich.solve(scene, method=method, ranks=comm, backend="cuda", threads=threads, **options)
            near(together.y, alone.y)
            near(together.x, alone.x)
    solver = bromwich.Solver(scene_of(), method="contour", ranks=comm, backend="cuda", threads=4, **options)
    near(solver.solve().y, bromwich.solve(scene_of(), method="contour", threads=1, backend="cpu", **options).y)


def lost():
    """The last rank raises; mpi4py ends the job."""
    if comm.rank == comm.size - 1:
        raise RuntimeError("lost on purpose")
    bromwich.solve(scene_of(), steps=1024, method="contour", ranks=comm)


{"solves": lambda: (divided(), dealt(), refusals()), "lost": lost, "devices": lambda: devices(sys.argv[2])}[sys.argv[1]]()
sys.stdout.write(f"rank {comm.rank} of {comm.size}: done\n")
