"""Lines, rectangles and boxes of grid points, against the matrices that they stand for."""

import pickle

import bromwich
import numpy as np
import pytest
import scipy.sparse


def test_kronecker_is_what_signorini_is(Q15):
    p = Q15.parameters
    assert p["Q"] == 15
    dx = 1 / 16
    kronecker = bromwich.Kronecker((15, dx, 1.0), (15, dx, 1.0), np.eye(15)[0], np.eye(15)[0])
    scene = bromwich.Scene(dynamics=kronecker, M=np.eye(15), g=lambda t: [-np.sin(t)] * 15, x0=0, T=1)
    assert scene.states == 225
    assert bromwich.solve(scene, steps=20).ok
    with pytest.raises(bromwich.Error, match="F='B'"):
        bromwich.Scene(dynamics=kronecker, M=np.eye(15), f=1.0, x0=0, T=1)


def line_of_points(points, dx, c, v, first, last):
    """c u'' - v u' with u = first u_1 and last u_points beyond the ends."""
    before, after = c / dx**2 + v / (2 * dx), c / dx**2 - v / (2 * dx)
    D = before * np.eye(points, k=-1) - 2 * c / dx**2 * np.eye(points) + after * np.eye(points, k=1)
    D[0, 0] += first * before
    D[-1, -1] += last * after
    return D


def test_rectangles_with_ends_of_their_own():
    P, Q, c, dx, loss = 4, 3, 0.2, 0.25, 1.5
    dy = bromwich.Kronecker.spacing(Q, 1, ("dirichlet", "neumann"))
    assert dy == pytest.approx(1 / 3.5)
    near, far = np.eye(Q)[0], np.eye(Q)[-1]
    reflected = (1 - loss * dx / 2) / (1 + loss * dx / 2)
    along, across = line_of_points(P, dx, c, 0.8, 1, reflected), line_of_points(Q, dy, c, 0, 0, 1)
    matrices = {
        "A": np.kron(np.eye(P), across) + np.kron(along, np.eye(Q)) - 0.5 * np.eye(P * Q),
        "B": np.hstack([np.kron(np.eye(P), near[:, None]), np.kron(np.eye(P), 2 * far[:, None])]),
        "N": np.vstack([np.kron(np.eye(P), -near), np.kron(np.eye(P), -far)]),
    }
    rest = {"M": np.eye(2 * P), "g": lambda t: [np.sin(3 * t + i) for i in range(2 * P)], "x0": 0.3, "T": 2}
    sides = {"b": near, "n": -near, "far_b": 2 * near, "far_n": -near}
    sides |= {"ends_along": ("neumann", loss), "ends_across": ("dirichlet", "neumann"), "reaction": 0.5}

    def rectangle(v):
        return bromwich.Kronecker((P, dx, c), (Q, dy, c), advection=(v, 0), **sides)

    for method in ("march", "contour"):
        known = bromwich.solve(**matrices, **rest, steps=100, method=method)
        found = bromwich.solve(dynamics=rectangle(0.8), **rest, steps=100, method=method)
        assert known.y.max() > 0.1
        np.testing.assert_allclose(found.y, known.y, atol=1e-12)
    with pytest.raises(bromwich.Error, match=r"along.advection: is -2, and central differences oscillate from 1.6"):
        bromwich.Scene(dynamics=rectangle(-2), **rest)
    with pytest.raises(bromwich.Error, match="ends_along: found 'neuman'; use 'dirichlet', 'neumann' or a number"):
        bromwich.Kronecker((P, dx, c), (Q, dy, c), near, near, ends_along="neuman")
    with pytest.raises(bromwich.Error, match="far_n: is missing"):
        bromwich.Kronecker((P, dx, c), (Q, dy, c), near, near, far_b=near)


@pytest.mark.parametrize("ends", [("neumann", "dirichlet"), ("neumann", 0.4), ("dirichlet", "neumann")])
def test_rectangles_in_modes(ends):
    Q, c, reaction = 24, 0.05, 0.3  # 576 states: below 513 they are written out as dense matrices
    dx, dy = 1 / (Q + 1), bromwich.Kronecker.spacing(Q, 1, ends)
    reflected = [{"dirichlet": 0, "neumann": 1}.get(end, None) for end in ends]
    reflected = [(1 - end * dy / 2) / (1 + end * dy / 2) if q is None else q for q, end in zip(reflected, ends)]
    along, across = line_of_points(Q, dx, c, 0, 0, 0), line_of_points(Q, dy, c, 0, *reflected)
    A = np.kron(np.eye(Q), across) + np.kron(along, np.eye(Q)) - reaction * np.eye(Q * Q)
    b, n = np.eye(Q)[0] / dy, np.eye(Q)[0]
    rest = {"M": 0.2 * np.eye(Q), "g": lambda t: 0.3 * np.sin(5 * t + np.arange(Q) / 9) - 0.1, "x0": 0.02, "T": 1}
    field = bromwich.Kronecker((Q, dx, c), (Q, dy, c), b, n, ends_across=ends, reaction=reaction)
    scene = bromwich.Scene(dynamics=field, **rest)
    assert scene._model.form == "kronecker"
    known = bromwich.solve(A=scipy.sparse.csr_array(A), B=np.kron(np.eye(Q), b[:, None]), N=np.kron(np.eye(Q), n), **rest,
                           steps=64, method="march")  # fmt: skip
    found = bromwich.solve(scene, steps=64, method="march", states=[0, 30, Q * Q - 1])
    assert found.ok and known.y.max() > 0.1
    np.testing.assert_allclose(found.y[1:], known.y[1:], atol=1e-8)
    still = bromwich.Scene(dynamics=field, **{**rest, "g": -0.3})
    again = pickle.loads(pickle.dumps(still))
    assert again._model.form == "kronecker"
    np.testing.assert_array_equal(*(bromwich.solve(each, steps=16, method="march").y for each in (still, again)))
    # f in every state: as sparse matrices.
    assert bromwich.Scene(dynamics=field, f=0.1, **rest)._model.form == "sparse"


def test_other_ends_and_advection_in_modes():
    P, Q, c, loss = 24, 25, 0.05, 1.5  # above 512 states
    dx, dy = bromwich.Kronecker.spacing(P, 1, ("neumann", loss)), bromwich.Kronecker.spacing(Q, 2, ("neumann", "dirichlet"))
    reflected = (1 - loss * dx / 2) / (1 + loss * dx / 2)
    b, n = 20 * np.eye(Q)[0], np.eye(Q)[0]
    rest = {"M": np.eye(P), "g": lambda t: 0.3 * np.sin(5 * t + np.arange(P) / 9) - 0.1, "x0": 0.02, "T": 1}
    for v in (0.0, -0.04):
        along, across = line_of_points(P, dx, c, v, 1, reflected), line_of_points(Q, dy, c, v, 1, 0)
        A = scipy.sparse.csr_array(np.kron(np.eye(P), across) + np.kron(along, np.eye(Q)))
        field = bromwich.Kronecker((P, dx, c), (Q, dy, c), b, n, ends_along=("neumann", loss),
                                   ends_across=("neumann", "dirichlet"), advection=v)  # fmt: skip
        known = bromwich.solve(A=A, B=np.kron(np.eye(P), b[:, None]), N=np.kron(np.eye(P), n), **rest, steps=64, method="march")
        found = bromwich.solve(dynamics=field, **rest, steps=64, method="march", states=[0, 30, P * Q - 1])
        assert found.ok and known.y.max() > 0.1
        assert ("symmetric form" in found.kernel) == (v != 0)
        np.testing.assert_allclose(found.y[1:], known.y[1:], atol=1e-8)


def test_boxes():
    P, R, Q, dx, c = 4, 3, 5, 0.2, 0.1
    D = [line_of_points(points, dx, c, 0, 0, 0) for points in (P, R, Q)]
    A = np.kron(np.kron(D[0], np.eye(R)), np.eye(Q)) + np.kron(np.kron(np.eye(P), D[1]), np.eye(Q)) + np.kron(np.eye(P * R), D[2])
    first = np.eye(Q)[0]
    box = bromwich.Kronecker((P, dx, c), (Q, dx, c), 2 * first, first, beside=[(R, dx, c)])
    rest = {"M": scipy.sparse.eye_array(P * R), "g": lambda t: np.sin(4 * t + np.arange(P * R)), "x0": 0.1, "T": 1}
    scene = bromwich.Scene(dynamics=box, **rest)
    assert scene.states == P * R * Q and scene.constraints == P * R
    known = bromwich.solve(A=A, B=np.kron(np.eye(P * R), 2 * first[:, None]), N=np.kron(np.eye(P * R), first), **{**rest, "M": np.eye(P * R)},
                           steps=32, method="march")  # fmt: skip
    found = bromwich.solve(scene, steps=32, method="march")
    assert found.ok and known.y.max() > 0.1
    np.testing.assert_allclose(found.y, known.y, atol=1e-10)
    with pytest.raises(bromwich.Error, match=r"beside\[0\].spacing: is 0; give a positive finite number"):
        bromwich.Scene(dynamics=bromwich.Kronecker((P, dx, c), (Q, dx, c), first, first, beside=[(R, 0, c)]), **rest)


def test_lines_of_points():
    line = bromwich.Kronecker(None, (5, 0.5, 2.0), [1, 0, 0, 0, 0], [1, 0, 0, 0, 0], advection=1, ends_across="neumann")
    rest = {"M": 1, "x0": np.arange(5.0), "g": lambda t: [np.sin(3 * t) - 1], "T": 1}
    A = line_of_points(5, 0.5, 2, 1, 1, 1)
    known = bromwich.solve(A=A, B=np.eye(5)[0], N=np.eye(5)[0], **rest, f=np.ones(5), steps=64)
    np.testing.assert_allclose(bromwich.solve(dynamics=line, **rest, f=np.ones(5), steps=64).y, known.y, atol=1e-13)
