"""Arrays of other libraries, and SciPy's sparse matrices in all formats."""

import bromwich
import numpy as np
import pytest


class OfAnotherLibrary:
    """What DLPack asks of an array, and nothing else; ``device`` is a lie about where it lies."""

    def __init__(self, values, device=1):
        self.values, self.device = np.asarray(values), device

    def __dlpack__(self, **options):
        return self.values.__dlpack__(**options)

    def __dlpack_device__(self):
        return (self.device, 0)


def two():
    table = -np.sin(np.linspace(0, 6, 101))[:, None] * [1.0, 0.5]
    return dict(A=-np.eye(2), B=np.eye(2), N=np.eye(2), M=np.eye(2), x0=np.array([0.1, 0.2]), g=table, f=table, T=2.0)


def test_dlpack_in():
    expected = bromwich.solve(**two())
    given = {k: OfAnotherLibrary(v) if isinstance(v, np.ndarray) else v for k, v in two().items()}
    r = bromwich.solve(**given)
    assert r.steps == 100
    np.testing.assert_array_equal(r.y, expected.y)
    single = bromwich.solve(**{**two(), "x0": OfAnotherLibrary(np.array([0.5, 0.25], dtype=np.float32))})
    np.testing.assert_array_equal(single.x[0], [0.5, 0.25])
    solver = bromwich.Solver(bromwich.Scene(**two()))
    solver.set_x0(OfAnotherLibrary(two()["x0"]))
    np.testing.assert_array_equal(solver.solve().y, expected.y)


def test_dlpack_out():
    r = bromwich.solve(**two())
    for name in ("t", "y", "x", "w"):
        array = getattr(r, name)
        assert np.shares_memory(np.from_dlpack(array), array)


@pytest.mark.parametrize("name", ["A", "B", "N", "M", "x0", "f", "g"])
def test_arrays_of_devices_are_refused(name):
    given = {**two(), name: OfAnotherLibrary(two()[name], device=2)}
    with pytest.raises(bromwich.Error, match="on a device") as caught:
        bromwich.solve(**given)
    assert caught.value.argument == name


def test_arrays_that_are_kept_are_refused():
    class Kept(OfAnotherLibrary):
        def __dlpack__(self, **options):
            raise BufferError("requires grad")

    with pytest.raises(bromwich.Error, match="requires grad"):
        bromwich.solve(**{**two(), "x0": Kept([0.0, 0.0])})


def test_torch():
    torch = pytest.importorskip("torch")
    given = {k: torch.asarray(v) if isinstance(v, np.ndarray) else v for k, v in two().items()}
    np.testing.assert_array_equal(bromwich.solve(**given).y, bromwich.solve(**two()).y)
    with pytest.raises(bromwich.Error, match="x0"):
        bromwich.solve(**{**two(), "x0": torch.zeros(2, requires_grad=True)})


FORMATS = [f"{form}_{kind}" for form in ("bsr", "coo", "csc", "csr", "dia", "dok", "lil") for kind in ("array", "matrix")]


@pytest.mark.parametrize("form", FORMATS)
def test_sparse_formats(form):
    """A, B, N, M, E and F in every format of SciPy; A with entries in two parts and out of order where it can be."""
    sparse = pytest.importorskip("scipy.sparse")
    made, m = getattr(sparse, form), 30
    A = -2 * np.eye(m) + np.eye(m, k=1) + 0.5 * np.eye(m, k=-1)
    B, N, E = np.eye(m)[:, :2], np.eye(m)[[0, 3]], np.diag(np.linspace(1, 2, m))
    dense = dict(A=A, B=B, N=N, M=0.1 * np.eye(2), E=E, F=B[:, 1:], f=-0.3)
    given = {k: made(v) if np.ndim(v) else v for k, v in dense.items()}
    if form.startswith("coo"):
        entries = given["A"]
        parts = np.concatenate([entries.data / 2, entries.data[::-1] / 2])
        given["A"] = made((parts, [np.concatenate([i, i[::-1]]) for i in (entries.row, entries.col)]), shape=A.shape)
    rest = dict(g=["-0.2", "-sin(3*t)"], x0=np.linspace(0, 1, m), T=1.0, steps=20)
    r = bromwich.solve(**given, **rest)
    assert r.scene._model.form == "sparse"
    # One computation: a scene of few states is made a dense one.
    np.testing.assert_allclose(r.y, bromwich.solve(**dense, **rest).y, atol=1e-12)
    assert np.max(r.y) > 0.01


@pytest.mark.parametrize("form", FORMATS)
def test_tridiagonal_M_in_every_format(form):
    sparse = pytest.importorskip("scipy.sparse")
    n = 20
    dense = 4 * np.eye(n) - np.eye(n, k=1) - 0.5 * np.eye(n, k=-1)
    scene = dict(A=-np.eye(n), B=np.eye(n), N=np.eye(n), x0=np.zeros(n), T=1, steps=20, g=-np.linspace(0, 1, n))
    r = bromwich.solve(**scene, M=getattr(sparse, form)(dense))
    np.testing.assert_allclose(r.y, bromwich.solve(**scene, M=dense).y, atol=1e-13)
