"""examples/two_bodies.py on coarse meshes: its matrices, its solution beside an implicit Euler, its files."""
import importlib.util
import pathlib
import sys

import numpy as np
import pytest

pytest.importorskip("skfem")
examples = pathlib.Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def bodies():
    sys.path.insert(0, str(examples))
    spec = importlib.util.spec_from_file_location("two_bodies", examples / "two_bodies.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    sys.path.remove(str(examples))


@pytest.mark.parametrize("degree", [1, 2])
def test_the_matrices(bodies, degree):
    scene, about = bodies.two_bodies(4, degree)
    lower, upper = about["bodies"]
    assert about["lengths"].sum() == pytest.approx(0.5)  # of the common side
    # A shift of a body as a whole, seen by the free points that no clamped point neighbours, is no strain.
    for body in about["bodies"]:
        shift = np.zeros(body.moved.N)
        shift[body.moved.nodal_dofs[0]] = 1
        if degree == 2:
            shift[body.moved.facet_dofs[0]] = 1
        far = np.abs(body.moved.doflocs[1, body.free]) < 1e-9  # the side of the contact
        assert np.abs((body.K @ shift[body.free])[far]).max() < 1e-13 * np.abs(body.K).max()
        # Constant temperatures flow nowhere; the mass is the area.
        assert np.abs(body.D @ np.ones(body.heated.N)).max() < 1e-14
    assert upper.H.sum() == pytest.approx(0.25) and lower.H.sum() == pytest.approx(0.5)
    assert bodies.HEAT * upper.heat.sum() == pytest.approx(bodies.HEAT * 0.5)
    # Across the gap: equal temperatures exchange nothing, a difference of 1 the conductance times the length.
    across = bodies.between(lower, upper)
    theta = np.zeros(across.shape[0])
    theta[lower.heated.N :] = 1
    assert theta @ across @ theta == pytest.approx(bodies.CONDUCTANCE * 0.5)
    assert np.abs(across @ np.ones(len(theta))).max() < 1e-15


def euler(bodies, cells, degree, steps, compliance):
    """y by implicit Euler with projected Gauss and Seidel sweeps."""
    scene, about = bodies.two_bodies(cells, degree, compliance)
    E, A, B, N, F = (scene[name].toarray() for name in ("E", "A", "B", "N", "F"))
    h = scene["T"] / steps
    inverse = np.linalg.inv(E / h - A)
    W, x, y, found = N @ inverse @ B + scene["M"], scene["x0"], np.zeros(len(N)), [np.zeros(len(N))]
    for j in range(1, steps + 1):
        free = inverse @ (E @ x / h + F[:, 0] * scene["f"](j * h))
        q = N @ free + bodies.GAP
        for _ in range(4000):
            before = y.copy()
            for i in range(len(y)):
                y[i] = max(0.0, y[i] - (W[i] @ y + q[i]) / W[i, i])
            if np.abs(y - before).max() < 1e-13:
                break
        x = free + inverse @ (B @ y)
        found.append(y.copy())
    return np.array(found), about


@pytest.mark.parametrize("degree, compliance", [(1, 0.0), (2, 1e-2)])
def test_the_force_is_that_of_implicit_euler(bodies, degree, compliance):
    result, about = bodies.solve(4, 96, degree, compliance)
    assert result.status == "solved"
    y, w = result.y[1:], result.w[1:]
    assert y.min() >= 0 and w.min() > -1e-12 and np.abs(np.minimum(y, w)).max() < 1e-10
    assert (y > 0).any() and (w > 1e-3).any()
    coarse, fine = (euler(bodies, 4, degree, J, compliance)[0] @ about["lengths"] for J in (96, 192))
    # Means over time; order one: what is left at 192 steps is about the difference from 96. The force jumps where the
    # bodies meet, by at most what one step changes, and both may be off by a part of a step there.
    found = bodies.force(result, about)
    allowed = np.abs(fine[::2] - coarse).mean() + 2 * np.abs(np.diff(found)).max() / 96
    assert np.abs(found - fine[::2]).mean() <= allowed < 0.03 * found.max()


def test_meshes_converge(bodies):
    for degree in (1, 2):
        errors = bodies.mesh_errors([4, 8], 16, 40, degree)
        assert errors[1] < errors[0] / 1.7  # order one at the corners of the upper body, where the pressure is unbounded


def test_the_files(bodies, tmp_path):
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("matplotlib")
    result, about = bodies.solve(4, 20, states="all")
    bodies.write_vtkhdf(tmp_path / "b.vtkhdf", result, about)
    with h5py.File(tmp_path / "b.vtkhdf") as file:
        root = file["VTKHDF"]
        count = int(root["NumberOfPoints"][0])
        lower, upper = about["bodies"]
        assert count == lower.mesh.p.shape[1] + upper.mesh.p.shape[1]
        assert root["Connectivity"][...].max() == count - 1
        points = root["Points"][...]
        j = 15
        moved = root["PointData/displacement"][j * count : (j + 1) * count]
        gap = root["PointData/gap"][j * count : (j + 1) * count]
        # Opposite corners: their distance is the gap.
        place = points + moved
        on_upper = [i for i in range(lower.mesh.p.shape[1], count) if abs(points[i, 1] - bodies.GAP) < 1e-12]
        assert len(on_upper) == 3
        for i in on_upper:
            below = [k for k in range(lower.mesh.p.shape[1]) if abs(points[k, 1]) < 1e-12 and abs(points[k, 0] - points[i, 0]) < 1e-12]
            assert place[i, 1] - place[below[0], 1] == pytest.approx(gap[i], abs=1e-12)
        assert root["PointData/temperature"][j * count : (j + 1) * count].max() > 0.1
    bodies.draw(tmp_path / "b.png", result, about)
    assert (tmp_path / "b.png").stat().st_size > 10_000
