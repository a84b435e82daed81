#!/usr/bin/env python3
"""Finite elements by scikit-fem: a heated body expands across a gap and is pressed against another one.

    python3 examples/two_bodies.py [--cells 8] [--degree 2] [--steps 200] [--compliance 0] [--out FOLDER] [--convergence]

Two blocks in plane strain, one above the other, with temperatures theta and displacements u (Kelvin and Voigt, inertia
neglected, displacements by elements of degree 1 or 2, temperatures by P1):

    C u'     = -K u + G theta + B p
    H theta' = -D theta + q phi(t),          0 <= p  complementary to  w = N u + M p + gap >= 0.

G theta is the force of thermal expansion, D has the conduction in both bodies and across the gap, whose conductance does not
depend on the pressure p. The upper block hangs from its upper side, where the heat q phi(t) enters; the lower one stands on
its lower side, which is kept at 0. N takes the vertical displacements of opposite points, w is their distance,
B = N^T diag(s) with the lengths s of the side that belong to a point, and M = compliance I: 0 is rigid contact.

Needs scikit-fem (PyPI). --out writes two_bodies.vtkhdf, the mesh with displacement, temperature, pressure and gap over
time, and two_bodies.png. --convergence solves on finer grids and meshes and prints errors and orders.
"""
import argparse
import math
import pathlib

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import ddot, div, dot, eye, grad, sym_grad, trace

import bromwich
from bracket import orders, write_mesh

LOWER, UPPER, GAP = ((0.0, 1.0), (-0.5, 0.0)), ((0.25, 0.75), (0.0, 0.5)), 0.01
LAME, VISCOSITY = (1.2, 0.8), (0.05, 0.1)  # lambda, mu; of volume and of shape
EXPANSION, CONDUCTIVITY, CONDUCTANCE, HEAT, T = 0.3, 0.1, 0.3, 0.25, 4.0


@skfem.BilinearForm
def stiffness(u, v, w):
    strain = sym_grad(u)
    return ddot(w.lame * eye(trace(strain), 2) + 2 * w.mu * strain, sym_grad(v))


@skfem.BilinearForm
def expansion(theta, v, w):
    return EXPANSION * theta * div(v)


@skfem.BilinearForm
def conduction(theta, v, w):
    return CONDUCTIVITY * dot(grad(theta), grad(v))


@skfem.BilinearForm
def product(theta, v, w):
    return theta * v


@skfem.LinearForm
def unit(v, w):
    return v


class Body:
    """Matrices of one block on a grid of squares, each cut in two triangles."""

    def __init__(self, place, cells, degree, held, contact):
        (x0, x1), (y0, y1) = place
        across, up = round((x1 - x0) * cells), round((y1 - y0) * cells)
        mesh = skfem.MeshTri.init_tensor(np.linspace(x0, x1, across + 1), np.linspace(y0, y1, up + 1))
        element = {1: skfem.ElementTriP1, 2: skfem.ElementTriP2}[degree]()
        side = lambda y: mesh.facets_satisfying(lambda p: np.abs(p[1] - y) < 1e-9, boundaries_only=True)
        moved = skfem.Basis(mesh, skfem.ElementVector(element), intorder=2 * degree)
        heated = skfem.Basis(mesh, skfem.ElementTriP1(), intorder=2 * degree)
        clamped = moved.get_dofs(side(held)).all()
        self.mesh, self.moved, self.heated = mesh, moved, heated
        self.free = np.setdiff1d(np.arange(moved.N), clamped)
        inside = lambda matrix: matrix.tocsr()[self.free][:, self.free]
        symmetric = lambda matrix: (matrix + matrix.T) / 2  # to the last digit
        form = lambda pair: symmetric(stiffness.assemble(moved, lame=pair[0], mu=pair[1]))
        self.K, self.C = inside(form(LAME)), inside(form(VISCOSITY))
        self.G = expansion.assemble(heated, moved).tocsr()[self.free]
        self.H, self.D = symmetric(product.assemble(heated)), symmetric(conduction.assemble(heated))
        # Vertical displacements on the side of the contact by x, and what the integral over it gives to each.
        edge = skfem.FacetBasis(mesh, element, facets=side(contact))
        points = edge.get_dofs(side(contact)).all()
        self.contact_x = edge.doflocs[0, points]
        order = np.argsort(self.contact_x)
        vertical = moved.get_dofs(side(contact)).all("u^2")
        vertical = vertical[np.argsort(moved.doflocs[0, vertical])]
        self.contact_x, self.lengths = self.contact_x[order], unit.assemble(edge)[points[order]]
        self.vertical = np.searchsorted(self.free, vertical)
        # Products of temperatures on both sides of the gap, and the heat that enters on the held side.
        self.edge = skfem.FacetBasis(mesh, skfem.ElementTriP1(), facets=side(contact))
        self.held = heated.get_dofs(side(held)).all()
        self.heat = unit.assemble(skfem.FacetBasis(mesh, skfem.ElementTriP1(), facets=side(held)))
        nodes = heated.get_dofs(side(contact)).all()
        self.nodes = nodes[np.argsort(heated.doflocs[0, nodes])]


def between(lower, upper):
    """The conductance of the gap: +h on both sides, -h between opposite nodes, for P1 temperatures."""
    x = lower.heated.doflocs[0, lower.nodes]
    same = [int(np.argmin(np.abs(x - at))) for at in upper.heated.doflocs[0, upper.nodes]]
    edge = CONDUCTANCE * product.assemble(upper.edge).tocsr()[upper.nodes][:, upper.nodes].toarray()
    sizes = lower.heated.N, upper.heated.N
    place = [sp.csr_array((np.ones(len(nodes)), (nodes, np.arange(len(nodes)))), shape=(size, len(nodes)))
             for nodes, size in ((lower.nodes[same], sizes[0]), (upper.nodes, sizes[1]))]  # fmt: skip
    difference = sp.vstack([-place[0], place[1]])
    return difference @ sp.csr_array(edge) @ difference.T


def two_bodies(cells, degree=2, compliance=0.0):
    """The scene's arguments for bromwich.solve, and what belongs to the mesh."""
    bodies = lower, upper = (
        Body(LOWER, cells, degree, held=LOWER[1][0], contact=LOWER[1][1]),
        Body(UPPER, cells, degree, held=UPPER[1][1], contact=UPPER[1][0]),
    )
    block = lambda name: sp.block_diag([getattr(body, name) for body in bodies], format="csr")
    warm = np.concatenate([np.setdiff1d(np.arange(lower.heated.N), lower.held), lower.heated.N + np.arange(upper.heated.N)])
    H, D = block("H")[warm][:, warm], (block("D") + between(lower, upper))[warm][:, warm]
    displaced, thermal = block("K").shape[0], len(warm)
    E = sp.block_diag([block("C"), H], format="csr")
    A = sp.block_array([[-block("K"), block("G")[:, warm]], [None, -D]], format="csr")
    # Opposite points: those of the upper block.
    same = [int(np.argmin(np.abs(lower.contact_x - x))) for x in upper.contact_x]
    n = len(same)
    above, below = len(lower.free) + upper.vertical, lower.vertical[same]
    rows = np.arange(n)
    N = sp.csr_array((np.r_[np.ones(n), -np.ones(n)], (np.r_[rows, rows], np.r_[above, below])), shape=(n, displaced + thermal))
    heat = np.concatenate([np.zeros(displaced + lower.heated.N - len(lower.held)), HEAT * upper.heat])
    scene = dict(
        E=E, A=A, B=(N.T @ sp.diags_array(upper.lengths)).tocsr(), N=N, M=compliance * np.eye(n),
        F=sp.csr_array(heat[:, None]), f=lambda t: math.sin(math.pi * t / T) ** 2, g=lambda t: np.full(n, GAP),
        x0=np.zeros(displaced + thermal), T=T,
    )  # fmt: skip
    return scene, dict(bodies=bodies, warm=warm, x=upper.contact_x, lengths=upper.lengths, displaced=displaced)


def solve(cells, steps, degree=2, compliance=0.0, states="none"):
    scene, about = two_bodies(cells, degree, compliance)
    return bromwich.solve(**scene, method="march", steps=steps, states=states, check=True), about


def on_mesh(result, about):
    """Points, triangles, and displacement, temperature, pressure and gap at the points over time, both bodies together."""
    lower, upper = about["bodies"]
    points = np.concatenate([lower.mesh.p.T, upper.mesh.p.T + [0, GAP]])
    triangles = np.concatenate([lower.mesh.t.T, len(lower.mesh.p.T) + upper.mesh.t.T])
    steps = len(result.t)
    theta = np.zeros((steps, lower.heated.N + upper.heated.N))
    theta[:, about["warm"]] = result.x[:, about["displaced"] :]
    moved, start = [], 0
    for body in about["bodies"]:
        u = np.zeros((steps, body.moved.N))
        u[:, body.free] = result.x[:, start : start + len(body.free)]
        start += len(body.free)
        moved.append(np.stack([u[:, body.moved.nodal_dofs[k]] for k in (0, 1)], axis=2))
    corners = np.concatenate([lower.heated.nodal_dofs[0], lower.heated.N + upper.heated.nodal_dofs[0]])
    data = {"displacement": np.concatenate(moved, axis=1), "temperature": theta[:, corners]}
    # Values of the contacts that are corners of the mesh.
    at = [int(np.argmin(np.abs(about["x"] - x))) for x in upper.mesh.p[0]]
    touching = np.flatnonzero(np.abs(upper.mesh.p[1] - UPPER[1][0]) < 1e-9)
    for name, values in (("pressure", result.y), ("gap", result.w)):
        data[name] = np.zeros((steps, len(points)))
        data[name][:, len(lower.mesh.p.T) + touching] = values[:, np.array(at)[touching]]
    return points, triangles, data


def force(result, about):
    return result.y @ about["lengths"]


def write_vtkhdf(path, result, about):
    points, triangles, data = on_mesh(result, about)
    write_mesh(path, result.t, points, triangles, data)


def draw(path, result, about):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    points, triangles, data = on_mesh(result, about)
    j = int(np.argmax(force(result, about)))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6))
    deformed = points + data["displacement"][j]
    drawn = left.tripcolor(*deformed.T, triangles, data["temperature"][j], shading="gouraud", cmap="inferno")
    left.triplot(*deformed.T, triangles, color="w", linewidth=0.2)
    left.set(aspect="equal", xlabel="x", ylabel="y", title=f"Temperature at t = {result.t[j]:.3g}")
    figure.colorbar(drawn, ax=left, label="temperature", shrink=0.8)
    first = int(np.argmax(force(result, about) > 0))
    times = first + (j - first) // 4, j, min(len(result.t) - 1, (j + len(result.t)) // 2)
    for k, line in zip(times, ("b--s", "k-o", "r:^")):  # different in print without colours as well
        right.plot(about["x"], result.y[k], line, ms=4, label=f"t = {result.t[k]:.3g}")
    right.set(xlabel="x", ylabel="contact pressure", ylim=(0, None), title="Pressure between the bodies")
    right.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def time_errors(cells, steps, finest, degree=2, compliance=0.0):
    """Mean error in time of the contact force, relative to its mean, for grids that divide the finest."""
    exact = force(*solve(cells, finest, degree, compliance))
    errors = []
    for J in steps:
        found, reference = force(*solve(cells, J, degree, compliance))[1:], exact[:: finest // J][1:]
        errors.append(np.abs(found - reference).sum() / reference.sum())
    return errors


def mesh_errors(cells, finest, steps, degree=2, compliance=0.0):
    """Largest error of the contact force over time, relative, against a fine mesh."""
    exact = force(*solve(finest, steps, degree, compliance))
    return [np.abs(force(*solve(Q, steps, degree, compliance)) - exact).max() / exact.max() for Q in cells]


def print_convergence():
    numbers = lambda values: "  ".join(f"{v:.2e}" for v in values)
    for compliance in (0.0, 1e-2):
        print(f"compliance {compliance:g}")
        steps, cells = [25, 50, 100, 200], [4, 8, 16]
        errors = time_errors(8, steps, 1600, 2, compliance)
        print(f"  P2, steps {steps}: force {numbers(errors)}, orders {numbers(orders(steps, errors))}")
        for degree in (1, 2):
            errors = mesh_errors(cells, 32, 100, degree, compliance)
            print(f"  P{degree}, cells {cells}: force {numbers(errors)}, orders {numbers(orders(cells, errors))}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=8, help="along a length of 1, a multiple of 4")
    parser.add_argument("--degree", type=int, default=2, choices=(1, 2))
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--compliance", type=float, default=0.0)
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--convergence", action="store_true")
    given = parser.parse_args()
    if given.convergence:
        return print_convergence()
    result, about = solve(given.cells, given.steps, given.degree, given.compliance, "all" if given.out else "none")
    total, touching = force(result, about), (result.y[1:] > 0).any(axis=1)
    print(f"{about['displaced'] + len(about['warm'])} unknowns, {result.y.shape[1]} contacts, {given.steps} steps: {result.status}")
    print(f"contact from t = {result.t[1:][touching].min():.3f}, largest force {total.max():.6f} at t = {result.t[np.argmax(total)]:.3f}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        write_vtkhdf(given.out / "two_bodies.vtkhdf", result, about)
        draw(given.out / "two_bodies.png", result, about)


if __name__ == "__main__":
    main()
