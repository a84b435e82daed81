"""Contact problems with friction on circles, and files of FCLib."""

import bromwich
import numpy as np
import pytest

h5py = pytest.importorskip("h5py")
pytest.importorskip("scipy")


def write_matrix(group, A, storage):
    rows, columns = np.nonzero(A) if storage != "columns" else np.nonzero(A.T)[::-1]
    values = A[rows, columns]
    m, n = A.shape
    begin = lambda index, count: np.concatenate([[0], np.cumsum(np.bincount(index, minlength=count))])
    i, p, nz = {
        "triplets": (rows, columns, values.size),
        "rows": (columns, begin(rows, m), -2),
        "columns": (rows, begin(columns, n), -1),
    }[storage]
    for key, value in (("m", [m]), ("n", [n]), ("nz", [nz]), ("nzmax", [values.size]), ("i", i), ("p", p)):
        group[key] = np.asarray(value, dtype=np.int32)
    group["x"] = values


def write(path, matrices, vectors, kind, storage, spacedim=3):
    with h5py.File(path, "w") as file:
        group = file.create_group(kind)
        group["spacedim"] = np.array([spacedim], dtype=np.int32)
        for key, A in matrices.items():
            write_matrix(group.create_group(key), A, storage)
        for key, v in vectors.items():
            group[f"vectors/{key}"] = v


def drawn(contacts, freedoms):
    rng = np.random.default_rng(contacts)
    H, m = rng.normal(size=(freedoms, 3 * contacts)), rng.uniform(1, 3, freedoms)
    return np.diag(m), H, rng.normal(size=freedoms), 0.1 * rng.normal(size=3 * contacts), rng.uniform(0.1, 0.9, contacts)


def expect_law(W, q, mu, r):
    u, force, speed = W @ r.r + q, 1e-8 * np.abs(r.r).max(), 1e-8 * np.abs(q).max()
    n, t = r.r[::3], r.r.reshape(-1, 3)[:, 1:]
    assert r.ok and (n >= 0).all() and (u[::3] >= -speed).all() and np.minimum(n / force, u[::3] / speed).max() <= 1
    assert (np.linalg.norm(t, axis=1) <= mu * n + force).all()
    sliding = np.linalg.norm(u.reshape(-1, 3)[:, 1:], axis=1)
    assert np.allclose((t * u.reshape(-1, 3)[:, 1:]).sum(axis=1), -mu * n * sliding, atol=10 * force * np.abs(u).max())


@pytest.mark.parametrize("storage", ["triplets", "rows", "columns"])
def test_files_of_fclib(tmp_path, storage):
    M, H, f, w, mu = drawn(5, 20)
    W, q = H.T @ np.linalg.solve(M, H), H.T @ np.linalg.solve(M, f) + w
    write(tmp_path / "local.hdf5", {"W": W}, {"q": q, "mu": mu}, "fclib_local", storage)
    write(tmp_path / "global.hdf5", {"M": M, "H": H}, {"f": f, "w": w, "mu": mu}, "fclib_global", storage)
    for name in ("local.hdf5", "global.hdf5"):
        problem = bromwich.load_friction(tmp_path / name)
        np.testing.assert_allclose(problem.W, W, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(problem.q, q, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(problem.mu, mu)
        assert problem.r is None
        expect_law(W, q, mu, bromwich.solve_friction(problem.W, problem.q, problem.mu))


def test_other_files(tmp_path):
    path = tmp_path / "plane.hdf5"
    write(path, {"W": np.eye(2)}, {"q": np.ones(2), "mu": np.ones(1)}, "fclib_local", "rows", spacedim=2)
    with pytest.raises(bromwich.Error, match="in the plane"):
        bromwich.load_friction(path)
    with h5py.File(path, "w"):
        pass
    with pytest.raises(bromwich.Error, match="no group fclib_local"):
        bromwich.load_friction(path)
    with pytest.raises(bromwich.Error, match="is no file"):
        bromwich.load_friction(tmp_path / "none.hdf5")


def test_statuses():
    one = bromwich.solve_friction(np.eye(3), [-1.0, 3.0, 0.0], 0.5)
    np.testing.assert_allclose(one.r, [1, -0.5, 0], atol=1e-15)
    with pytest.warns(bromwich.NotSolvedWarning):
        assert bromwich.solve_friction(np.zeros((3, 3)), [-1.0, 0, 0], 0.5, max_sweeps=50).status == "unsolved"
    with pytest.raises(bromwich.NotSolved):
        bromwich.solve_friction(np.zeros((3, 3)), [-1.0, 0, 0], 0.5, max_sweeps=50, check=True)
    for arguments in ((np.eye(3), [1.0, 2.0], 0.5), (np.eye(2), [1.0, 2, 3], 0.5), (np.eye(3), [1.0, 2, 3], [0.5, 0.5])):
        with pytest.raises(bromwich.Error):
            bromwich.solve_friction(*arguments)


def test_circle_of_a_contact():
    plane = bromwich.Contact(tangent=np.eye(2), bound="0.2*(9.81 + 4*cos(7*t))")
    mass = bromwich.Structure(
        M=np.eye(2), K=np.diag([4.0, 9.0]), f=["1.5*sin(3*t) + 0.5", "1.2*cos(2*t)"], contacts=plane, q0=[0.5, 0.8], v0=[2, 0]
    )
    r = bromwich.solve(mass.scene(T=4), steps=2000, states="all")
    assert r.ok and r.method == "march"
    np.testing.assert_allclose(r.x[-1, :2], [0.0290263945, 0.097645178], atol=4e-6)
    assert r.contacts.phases[-1].state == "stick"
    assert r.contacts.friction["c0"].shape == (2001, 2)
