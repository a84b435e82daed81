"""The scenes of scripts/bench_peers as arrays, written independently of bromwich's own definitions.

x' = A x + B y + f, 0 <= y ⊥ w = N x + M y + g >= 0, x(0) = x0, 0 <= t <= T

A         (rows, columns, values)
f, g      functions of an array of times; one row per time
exact     y and x at an array of times, or None
y0        y(0)
observed  the components of x that N takes
"""
import dataclasses
import typing

import numpy as np


@dataclasses.dataclass
class Scene:
    label: str
    command: list  # the scene and its parameters for bromwich
    parameters: dict
    T: float
    A: tuple
    B: np.ndarray
    N: np.ndarray
    M: np.ndarray
    x0: np.ndarray
    f: typing.Callable
    g: typing.Callable
    y0: np.ndarray
    exact: typing.Optional[typing.Callable] = None
    observed: np.ndarray = dataclasses.field(init=False)

    def __post_init__(self):
        self.observed = np.flatnonzero(self.N.any(axis=0))

    def dense_A(self):
        A = np.zeros((len(self.x0), len(self.x0)))
        A[self.A[0], self.A[1]] = self.A[2]
        return A

    def trace(self, x):
        """N x from the observed components, one row per time."""
        return x @ self.N[:, self.observed].T

    def residual(self, t, y, x):
        """max over time of ||min(y, w)|| / max(1, ||N x + g||), maximum norms."""
        q = self.trace(x) + self.g(t)
        w = q + y @ self.M.T
        return float(np.max(np.abs(np.minimum(y, w)).max(axis=1) / np.maximum(1, np.abs(q).max(axis=1))))


def coordinates(A):
    rows, columns = np.nonzero(A)
    return rows, columns, A[rows, columns]


def projected_gauss_seidel(M, q):
    """The solution of LCP(M, q) for a diagonally dominant M."""
    y = np.zeros(len(q))
    for _ in range(200):
        for i in range(len(q)):
            y[i] = max(0, y[i] - (q[i] + M[i] @ y) / M[i, i])
    return y


def signorini(Q, T=4.0, c=2e-3):
    """Heat in the unit square, Q x Q interior points, a semipermeable side x1 = 0; component j Q + i is the point
    ((i+1) dx, (j+1) dx)."""
    dx = 1 / (Q + 1)
    second = (np.diag(np.full(Q, -2.0)) + np.diag(np.ones(Q - 1), 1) + np.diag(np.ones(Q - 1), -1)) / dx**2
    eye, first = np.eye(Q), np.eye(Q)[:, :1]
    B = c / dx**2 * np.kron(eye, first)
    N = -2 * np.kron(eye, first.T)
    M = 2 * eye - dx**2 * second
    points = np.arange(1, Q + 1) * dx
    bump = points * (1 - points)
    outside = np.abs(4 * np.arange(1, Q + 1) - 2 * (Q + 1)) >= Q + 1

    def obstacle(t):
        t = np.asarray(t)[:, None]
        return np.where(outside, 4 / (1 + t), np.sin(2 * np.pi * t))

    x0 = 2 * np.outer(bump, bump).ravel()
    return Scene(
        label=f"signorini, dx = 1/{Q + 1}",
        command=["signorini", "--set", f"Q={Q}"],
        parameters={"Q": Q, "T": T, "c": c},
        T=T,
        A=coordinates(c * (np.kron(eye, second) + np.kron(second, eye))),
        B=B,
        N=N,
        M=M,
        x0=x0,
        f=lambda t: obstacle(t) @ B.T,
        g=lambda t: obstacle(t) @ M.T,
        y0=projected_gauss_seidel(M, N @ x0 + M @ obstacle([0.0])[0]),
    )


def dlcp_small(T=1.0):
    """M is a Z-matrix; x, y, w are prescribed, y is the least element of the LCP at every t."""
    A = np.array([[-2, 1, 0], [1, -2, 1.5], [0, -1, -2]])
    B = np.array([[-1.0, -4, -2, 0], [-3, -2, -2, 0], [-3, -3, 0, 3]])
    N = np.array([[0, 0, -1], [-2, -2, 1.5], [-0.5, -1, -0.5], [1, 2.5, 1.5]])
    M = np.array([[2, -3, -1, -5], [-2, 1, -2, -4], [-2, -0.1, 0, -5], [-3, 0, -5, 1]]) / 3

    def exact(t):
        t = np.asarray(t)
        S, zero = np.sin(3 * np.pi * t), 0 * t
        y = np.stack([zero, np.maximum(S, 0) / 2, zero, np.maximum(-S - 0.3, 0) / 4], axis=1)
        return y, np.stack([np.exp(-t), np.cos(2 * t), 1 + t], axis=1)

    def f(t):
        t = np.asarray(t)
        y, x = exact(t)
        return np.stack([-np.exp(-t), -2 * np.sin(2 * t), 0 * t + 1], axis=1) - x @ A.T - y @ B.T

    def g(t):
        t = np.asarray(t)
        y, x = exact(t)
        S = np.sin(3 * np.pi * t)
        w = [0.15 + t * np.exp(-t), np.maximum(-S, 0), 0.15 + t * np.exp(-t / 3), np.maximum(S + 0.3, 0)]
        return np.stack(w, axis=1) - x @ N.T - y @ M.T

    y0, x0 = (values[0] for values in exact([0.0]))
    return Scene("dlcp-small", ["dlcp-small"], {"T": T}, T, coordinates(A), B, N, M, x0, f, g, y0, exact)


def diode_bridge(file, T=5e-3, L=1e-2, C=1e-6, R=1e3, V=10.0):
    """Four ideal diodes between a resonator and a resistor: the resonator sees the resistor, x is that of a linear
    circuit, x1 = v; y = (v+, v-, v+/R, v-/R)."""
    A = np.array([[0, -1 / C], [1 / L, 0]])
    B = np.array([[0, 0, -1 / C, 1 / C], [0, 0, 0, 0]])
    N = np.array([[0.0, 0], [0, 0], [-1, 0], [1, 0]])
    M = np.array([[1 / R, 1 / R, -1, 0], [1 / R, 1 / R, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]])
    a = 1 / (2 * R * C)
    omega = np.sqrt(1 / (L * C) - a**2)

    def exact(t):
        t = np.asarray(t)
        swing = V * np.exp(-a * t)
        v = swing * (np.cos(omega * t) - a / omega * np.sin(omega * t))
        current = swing * C * (a**2 / omega + omega) * np.sin(omega * t)
        up, down = np.maximum(v, 0), np.maximum(-v, 0)
        return np.stack([up, down, up / R, down / R], axis=1), np.stack([v, current], axis=1)

    y0, x0 = (values[0] for values in exact([0.0]))
    return Scene(
        label="diode-bridge",
        command=[str(file)],
        parameters={"T": T, "L": L, "C": C, "R": R, "V": V},
        T=T,
        A=coordinates(A),
        B=B,
        N=N,
        M=M,
        x0=x0,
        f=lambda t: np.zeros((len(t), 2)),
        g=lambda t: np.zeros((len(t), 4)),
        y0=y0,
        exact=exact,
    )
