"""examples/bracket.py on coarse meshes: its matrices, its solution beside an implicit Euler, its files."""
import importlib.util
import pathlib

import numpy as np
import pytest

pytest.importorskip("scipy.sparse")
place = pathlib.Path(__file__).resolve().parents[2] / "examples" / "bracket.py"
if not place.exists():
    pytest.skip("the examples are not here", allow_module_level=True)
spec = importlib.util.spec_from_file_location("bracket", place)
bracket = importlib.util.module_from_spec(spec)
spec.loader.exec_module(bracket)


def test_elements_are_exact_for_linear_displacements():
    points, triangles = bracket.mesh(4)
    p = points[triangles]
    edge, other = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    area = 0.5 * (edge[:, 0] * other[:, 1] - edge[:, 1] * other[:, 0])
    assert (area > 0).all()
    corners = 16  # of the polygon in place of the hole
    assert len(set(map(tuple, points.round(9)))) == len(points)
    assert area.sum() == pytest.approx(2 - corners / 2 * np.mean(np.sin(polygon_angles(points))) * bracket.HOLE**2)
    K = bracket.stiffness(points, triangles, 1.2, 0.8)
    G = np.array([[0.3, -0.2], [0.5, 0.1]])
    strain = (G + G.T) / 2
    energy = area.sum() * (1.2 * np.trace(strain) ** 2 + 1.6 * (strain**2).sum())
    u = (points @ G.T).ravel()
    assert u @ K @ u == pytest.approx(energy)
    turned = np.c_[-points[:, 1], points[:, 0]].ravel()
    assert np.abs(K @ turned).max() < 1e-13


def polygon_angles(points):
    """Between neighbours on the hole."""
    from_centre = points - [1.5, 0.5]
    on_hole = from_centre[np.abs(np.linalg.norm(from_centre, axis=1) - bracket.HOLE) < 1e-9]
    angles = np.sort(np.arctan2(on_hole[:, 1], on_hole[:, 0]))
    return np.diff(np.r_[angles, angles[0] + 2 * np.pi])


def euler_force(cells, steps, compliance):
    """The contact force by implicit Euler with projected Gauss and Seidel sweeps."""
    scene, about = bracket.bracket(cells, compliance)
    C, A, B, N = (scene[name].toarray() for name in ("E", "A", "B", "N"))
    F = scene["F"].toarray()[:, 0]
    h = scene["T"] / steps
    inverse = np.linalg.inv(C / h - A)
    W = N @ inverse @ B + scene["M"]
    x, y, force = scene["x0"], np.zeros(len(N)), [0.0]
    for j in range(1, steps + 1):
        free = inverse @ (C @ x / h + F * scene["f"](j * h))
        q = N @ free + about["gap"]
        for _ in range(2000):
            before = y.copy()
            for i in range(len(y)):
                y[i] = max(0.0, y[i] - (W[i] @ y + q[i]) / W[i, i])
            if np.abs(y - before).max() < 1e-13:
                break
        x = free + inverse @ (B @ y)
        force.append(y @ about["lengths"])
    return np.array(force)


@pytest.mark.parametrize("compliance", [0.0, 1e-2])
def test_the_force_is_that_of_implicit_euler(compliance):
    result, about = bracket.solve(3, 96, compliance)
    assert result.status == "solved"
    y, w = result.y[1:], result.w[1:]
    assert y.min() >= 0 and w.min() > -1e-12 and np.abs(np.minimum(y, w)).max() < 1e-10
    assert (y > 0).any() and (w > 1e-3).any()
    coarse, fine = euler_force(3, 96, compliance), euler_force(3, 192, compliance)[::2]
    # Means over time. Order one: what is left at 192 steps is about the difference from 96. The force jumps where a node
    # lands, by at most what one step changes, and there both may be off by the part of a step.
    found = bracket.force(result, about)
    allowed = np.abs(fine - coarse).mean() + 2 * np.abs(np.diff(found)).max() / 96
    assert np.abs(found - fine).mean() <= allowed
    assert allowed < 0.02 * found.max()


def test_meshes_converge():
    of_force, of_gap, of_length = bracket.mesh_errors([4, 8], 16, 50)
    assert of_force[1] < of_force[0] / 2 and of_gap[1] < of_gap[0] / 2
    assert of_length[1] < of_length[0]


def test_steps_converge():
    errors, of_set = bracket.time_errors(4, [20, 40, 80], 640, 1e-2)
    assert errors[1] < errors[0] / 1.4 and errors[2] < errors[1] / 1.4
    # A node begins and ends contact within a step of each grid: of two of them, one time in 80 and one in 640 of T, over the
    # part of T that a node in contact has.
    assert of_set[2] < of_set[0]


def test_the_file_has_the_mesh(tmp_path):
    h5py = pytest.importorskip("h5py")
    result, about = bracket.solve(3, 20, states="all")
    bracket.write_vtkhdf(tmp_path / "b.vtkhdf", result, about)
    with h5py.File(tmp_path / "b.vtkhdf") as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"UnstructuredGrid"
        count, steps = int(root["NumberOfPoints"][0]), int(root["Steps"].attrs["NSteps"])
        assert (count, steps) == (len(about["points"]), 21)
        assert root["Connectivity"][...].max() == count - 1
        assert root["Offsets"][-1] == len(root["Connectivity"]) == int(root["NumberOfConnectivityIds"][0])
        assert len(root["Types"]) == int(root["NumberOfCells"][0])
        for name in ("displacement", "pressure", "gap"):
            assert len(root["PointData"][name]) == count * steps
            assert list(root["Steps/PointDataOffsets"][name]) == [count * j for j in range(steps)]
        start = int(root["Steps/PointDataOffsets/pressure"][10])
        pressure = root["PointData/pressure"][start : start + count]
        assert np.array_equal(pressure[about["below"]], result.y[10])
        # The gap is the one of the displacement.
        moved = root["PointData/displacement"][start : start + count][about["below"], 1]
        assert np.allclose(moved + about["gap"], result.w[10], atol=1e-12)


def test_the_picture_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    result, about = bracket.solve(3, 20, states="all")
    bracket.draw(tmp_path / "b.png", result, about)
    assert (tmp_path / "b.png").stat().st_size > 10_000
