#!/usr/bin/env python3
"""Finite elements: a bracket with a hole is pressed against a curved foundation.

    python3 examples/bracket.py [--cells 8] [--steps 200] [--compliance 0] [--out FOLDER] [--convergence]

Plane strain, P1 triangles, a viscoelastic solid (Kelvin and Voigt), inertia neglected. With the displacement u at the nodes,
stiffness K(lambda, mu) and viscosity C = K(eta lambda_v, eta mu_v),

    C u' = -K u + B p + F phi(t),     0 <= p  complementary to  w = N u + M p + gap >= 0,

p is the contact pressure at the nodes of the lower side, w their distance to the foundation. N takes the vertical
displacement there, B = N^T diag(s) with the lengths s that belong to the nodes, M = compliance I: 0 is a rigid foundation.
The left side is clamped, the traction phi(t) acts downwards on the upper side.

The matrices are assembled with NumPy and SciPy here. Those of any other finite-element code are handed over in the same way.
--out writes bracket.vtkhdf, the mesh with displacement, pressure and gap over time for ParaView, and bracket.png.
--convergence solves on finer grids and meshes and prints errors and orders.
"""
import argparse
import math
import pathlib

import numpy as np
import scipy.sparse as sp

import bromwich

LAME = (1.2, 0.8)  # lambda, mu
VISCOSITY = (0.05, 0.2)  # of volume and of shape
HOLE, TRACTION, T = 0.25, 0.12, 1.0


def mesh(cells):
    """Points (count x 2) and counterclockwise triangles (count x 3) of [0, 2] x [0, 1] with a round hole around (1.5, 0.5).

    A grid of `cells` x `cells` squares, and rings between the hole and the square [1, 2] x [0, 1].
    """
    side = np.arange(cells) / cells
    square = np.concatenate(
        [np.c_[1 + side, 0 * side], np.c_[2 + 0 * side, side], np.c_[2 - side, 1 + 0 * side], np.c_[1 + 0 * side, 1 - side]]
    )
    centre = np.array([1.5, 0.5])
    outward = square - centre
    circle = centre + HOLE * outward / np.linalg.norm(outward, axis=1)[:, None]
    rings = max(2, cells // 2)
    layers = [(1 - k / rings) * square + k / rings * circle for k in range(rings + 1)]
    points, quads, known = [], [], {}

    def number(point):
        key = (round(point[0] * 1e9), round(point[1] * 1e9))
        if key not in known:
            known[key] = len(points)
            points.append(point)
        return known[key]

    at = lambda i, k: number(np.array([i / cells, k / cells]))
    for i in range(cells):
        for k in range(cells):
            quads.append((at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)))
    around = 4 * cells
    for outer, inner in zip(layers, layers[1:]):
        for i in range(around):
            j = (i + 1) % around
            quads.append((number(outer[i]), number(outer[j]), number(inner[j]), number(inner[i])))
    points = np.array(points)
    triangles = []
    for a, b, c, d in quads:  # along the shorter diagonal
        if np.linalg.norm(points[a] - points[c]) <= np.linalg.norm(points[b] - points[d]):
            triangles += [(a, b, c), (a, c, d)]
        else:
            triangles += [(a, b, d), (b, c, d)]
    return points, np.array(triangles)


def stiffness(points, triangles, lame, mu):
    """The matrix of  lambda div u div v + 2 mu e(u) : e(v), unknowns (x, y) node by node."""
    p = points[triangles]  # triangles x 3 x 2
    edges = np.stack([p[:, 2] - p[:, 1], p[:, 0] - p[:, 2], p[:, 1] - p[:, 0]], axis=1)
    area = 0.5 * (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    gradient = np.stack([-edges[:, :, 1], edges[:, :, 0]], axis=2) / (2 * area[:, None, None])
    strain = np.zeros((len(triangles), 3, 6))  # xx, yy, 2 xy
    strain[:, 0, 0::2], strain[:, 1, 1::2] = gradient[:, :, 0], gradient[:, :, 1]
    strain[:, 2, 0::2], strain[:, 2, 1::2] = gradient[:, :, 1], gradient[:, :, 0]
    D = np.array([[lame + 2 * mu, lame, 0], [lame, lame + 2 * mu, 0], [0, 0, mu]])
    local = np.einsum("t,tia,ij,tjb->tab", area, strain, D, strain)
    unknown = (2 * triangles[:, :, None] + np.arange(2)).reshape(len(triangles), 6)
    rows, columns = np.repeat(unknown, 6, axis=1).ravel(), np.tile(unknown, (1, 6)).ravel()
    K = sp.coo_array((local.ravel(), (rows, columns)), shape=(2 * len(points),) * 2).tocsr()
    return (K + K.T) / 2  # symmetric to the last digit


def side_lengths(points, nodes):
    """Half of the edges on both sides of the nodes of a side y = constant, sorted by x."""
    x = points[nodes, 0]
    half = np.diff(x) / 2
    return np.r_[half, 0] + np.r_[0, half]


def bracket(cells, compliance=0.0):
    """The scene's arguments for bromwich.solve, and what belongs to the mesh."""
    points, triangles = mesh(cells)
    free = np.flatnonzero(points[:, 0] > 1e-9)
    unknown = (2 * free[:, None] + np.arange(2)).ravel()
    place = np.full(2 * len(points), -1)
    place[unknown] = np.arange(len(unknown))
    sides = []
    for height in (0, 1):
        nodes = free[np.abs(points[free, 1] - height) < 1e-9]
        sides.append(nodes[np.argsort(points[nodes, 0])])
    below, above = sides
    n, m = len(below), len(unknown)
    inside = lambda K: K[unknown][:, unknown].tocsr()
    K, C = (inside(stiffness(points, triangles, *moduli)) for moduli in (LAME, VISCOSITY))
    N = sp.csr_array((np.ones(n), (np.arange(n), place[2 * below + 1])), shape=(n, m))
    lengths = side_lengths(points, below)
    F = sp.csr_array((-side_lengths(points, above), (place[2 * above + 1], np.zeros(len(above), int))), shape=(m, 1))
    gap = 0.02 * (0.2 + (points[below, 0] - 1.4) ** 2)
    scene = dict(
        E=C, A=-K, B=(N.T @ sp.diags_array(lengths)).tocsr(), N=N, M=compliance * np.eye(n), F=F,
        f=lambda t: TRACTION * np.sin(math.pi * t / T) ** 2, g=lambda t: gap, x0=np.zeros(m), T=T,
    )  # fmt: skip
    return scene, dict(points=points, triangles=triangles, unknown=unknown, below=below, lengths=lengths, gap=gap)


def solve(cells, steps, compliance=0.0, states="none"):
    scene, about = bracket(cells, compliance)
    result = bromwich.solve(**scene, method="march", steps=steps, states=states, check=True)
    return result, about


def displacements(result, about):
    """Times x nodes x 2 from the states of a result."""
    u = np.zeros((len(result.t), 2 * len(about["points"])))
    u[:, about["unknown"]] = result.x
    return u.reshape(len(result.t), -1, 2)


def on_nodes(values, about):
    """Values at the contact nodes as values at all nodes, 0 elsewhere."""
    all_nodes = np.zeros((len(values), len(about["points"])))
    all_nodes[:, about["below"]] = values
    return all_nodes


def write_mesh(path, times, points, triangles, data):
    """An unstructured mesh that stays, and point data over time (VTKHDF 2.0): times x points, or times x points x 2."""
    import h5py

    steps = len(times)
    spatial = lambda u: np.concatenate([u, np.zeros(u.shape[:-1] + (1,))], axis=-1)
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        root.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
        for name, value in [("NumberOfPoints", len(points)), ("NumberOfCells", len(triangles)), ("NumberOfConnectivityIds", triangles.size)]:
            root[name] = np.array([value])
        root["Points"] = spatial(points)
        root["Connectivity"] = triangles.ravel()
        root["Offsets"] = 3 * np.arange(len(triangles) + 1)
        root["Types"] = np.full(len(triangles), 5, np.uint8)
        time = root.create_group("Steps")
        time.attrs["NSteps"] = steps
        time["Values"] = times
        time["NumberOfParts"] = np.ones(steps, int)
        for name in ("PartOffsets", "PointOffsets"):
            time[name] = np.zeros(steps, int)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            time[name] = np.zeros((steps, 1), int)
        for name, values in data.items():
            root[f"PointData/{name}"] = spatial(values).reshape(-1, 3) if values.ndim == 3 else values.ravel()
            time[f"PointDataOffsets/{name}"] = np.arange(steps) * len(points)


def write_vtkhdf(path, result, about):
    data = {
        "displacement": displacements(result, about),
        "pressure": on_nodes(result.y, about),
        "gap": on_nodes(result.w, about),
    }
    write_mesh(path, result.t, about["points"], about["triangles"], data)


def draw(path, result, about):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    u = displacements(result, about)
    j = int(np.argmax(result.y @ about["lengths"]))
    x = about["points"][about["below"], 0]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6))
    deformed = about["points"] + u[j]
    size = np.linalg.norm(u[j], axis=1)
    drawn = left.tripcolor(*deformed.T, about["triangles"], size, shading="gouraud", cmap="cividis")
    left.triplot(*deformed.T, about["triangles"], color="k", linewidth=0.2)
    left.plot(x, -about["gap"], color="tab:red", label="foundation")
    left.set(aspect="equal", xlabel="x", ylabel="y", ylim=(-0.1, 1.4), title=f"The bracket at t = {result.t[j]:.3g}")
    left.legend(loc="upper left")
    figure.colorbar(drawn, ax=left, label="displacement", shrink=0.7)
    for part, line in ((0.25, "b--s"), (0.5, "k-o"), (0.75, "r:^")):  # different in print without colours as well
        k = round(part * (len(result.t) - 1))
        right.plot(x, result.y[k], line, ms=4, label=f"t = {result.t[k]:.3g}")
    right.set(xlabel="x", ylabel="contact pressure", title="Pressure on the foundation")
    right.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def force(result, about):
    """The resultant of the contact pressure at all time points."""
    return result.y @ about["lengths"]


def orders(sizes, errors):
    return [math.log(a / b) / math.log(q / p) for p, q, a, b in zip(sizes, sizes[1:], errors, errors[1:])]


def contact(values, about):
    """The length in contact, at each time."""
    return (values > 0) @ about["lengths"]


def time_errors(cells, steps, finest, compliance=0.0):
    """For grids that divide the finest: the mean error in time of the pressure, relative to its mean, and that of the contact
    set, by the time that each node is in contact, relative too."""
    fine, about = solve(cells, finest, compliance)
    touching = (fine.y[1:] > 0).mean(axis=0)
    of_pressure, of_set = [], []
    for J in steps:
        y = solve(cells, J, compliance)[0].y[1:]
        exact = fine.y[:: finest // J][1:]
        of_pressure.append(np.abs(y - exact).sum() / np.abs(exact).sum())
        missed = np.abs((y > 0).mean(axis=0) - touching)
        of_set.append(missed @ about["lengths"] / (touching @ about["lengths"]))
    return of_pressure, of_set


def mesh_errors(cells, finest, steps, compliance=0.0):
    """Against a fine mesh, relative: the largest error over time of the contact force, the mean errors of the gap and of the
    length in contact."""
    fine, about = solve(finest, steps, compliance)
    exact, x = force(fine, about), about["points"][about["below"], 0]
    length = contact(fine.y, about)
    of_force, of_gap, of_length = [], [], []
    for Q in cells:
        result, coarse = solve(Q, steps, compliance)
        of_force.append(np.abs(force(result, coarse) - exact).max() / exact.max())
        same = [int(np.argmin(np.abs(x - at))) for at in coarse["points"][coarse["below"], 0]]
        of_gap.append(np.abs(result.w - fine.w[:, same]).mean() / np.abs(fine.w).mean())
        of_length.append(np.abs(contact(result.y, coarse) - length).mean() / length.mean())
    return of_force, of_gap, of_length


def convergence():
    """Rows of errors and orders."""
    rows = []
    for compliance in (0.0, 1e-2):
        steps, cells = [25, 50, 100, 200], [4, 8, 16]
        in_time = zip(("pressure", "contact set"), time_errors(8, steps, 1600, compliance))
        in_mesh = zip(("force", "gap", "length in contact"), mesh_errors(cells, 32, 200, compliance))
        for sizes, of, found in ((steps, "steps", in_time), (cells, "cells", in_mesh)):
            for name, errors in found:
                rows.append(dict(compliance=compliance, of=of, sizes=sizes, name=name, errors=errors, orders=orders(sizes, errors)))
    return rows


def print_convergence():
    numbers = lambda values: "  ".join(f"{v:.2e}" for v in values)
    for row in convergence():
        print(f"compliance {row['compliance']:g}, {row['of']} {row['sizes']}: {row['name']} {numbers(row['errors'])}, orders {numbers(row['orders'])}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=8)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--compliance", type=float, default=0.0)
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--convergence", action="store_true")
    given = parser.parse_args()
    if given.convergence:
        return print_convergence()
    result, about = solve(given.cells, given.steps, given.compliance, states="all" if given.out else "none")
    total = force(result, about)
    print(f"{2 * len(about['points'])} unknowns, {result.y.shape[1]} contacts, {given.steps} steps: {result.status}")
    print(f"largest contact force {total.max():.6f}, pressure {result.y.max():.6f}, gap {result.w.min():.1e} to {result.w.max():.4f}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        write_vtkhdf(given.out / "bracket.vtkhdf", result, about)
        draw(given.out / "bracket.png", result, about)


if __name__ == "__main__":
    main()
