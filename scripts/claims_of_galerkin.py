"""The matrix that Wang and Chen print for their Galerkin method, for scripts/paper_claims: below the diagonal the response of the
state to an earlier interval has no power of e^{hA}, so that it stays what it was at the end of that interval. Written again
in NumPy, with the correct block beside it: errors of u on refined grids, kinks on the nodes."""
import math

import numpy as np
from scipy.linalg import expm

GAUSS = [(0.5 - math.sqrt(0.15), 5 / 18), (0.5, 8 / 18), (0.5 + math.sqrt(0.15), 5 / 18)]


def phis(X, last=4):
    """G_0, ..., G_last at X, from one exponential of a block matrix."""
    m = len(X)
    big = np.zeros(((last + 1) * m,) * 2)
    big[:m, :m] = X
    for k in range(last):
        big[k * m:(k + 1) * m, (k + 1) * m:(k + 2) * m] = np.eye(m)
        E = expm(big)
    return [E[:m, k * m:(k + 1) * m] for k in range(last + 1)]


def lemke(M, q):
    """Lemke's method for 0 <= z, M z + q >= 0, complementary; None where it ends in a ray."""
    n = len(q)
    if (q >= 0).all():
        return np.zeros(n)
    T = np.hstack([np.eye(n), -M, -np.ones((n, 1)), q[:, None]])
    basis = list(range(n))
    row, entering = int(np.argmin(q)), 2 * n
    for _ in range(50 * n):
        T[row] /= T[row, entering]
        others = np.arange(n) != row
        T[others] -= np.outer(T[others, entering], T[row])
        left, basis[row] = basis[row], entering
        if left == 2 * n:
            z = np.zeros(2 * n + 1)
            z[basis] = T[:, -1]
            return z[n:2 * n]
        entering = left + n if left < n else left - n
        column = T[:, entering]
        rows = np.flatnonzero(column > 1e-11)
        if not len(rows):
            return None
        ratio = T[rows, -1] / column[rows]
        ties = rows[ratio <= ratio.min() + 1e-12]
        row = next((r for r in ties if basis[r] == 2 * n), ties[np.argmax(column[ties])])
    return None


def without_u(s, J, ends, powers):
    """q: the means of N x + g with the weights 1 - s and s on each interval, x the state without u; f linear on quarters."""
    A, h, n = s["A"], s["T"] / J, s["M"].shape[0]
    lengths = [h / 4, *(node * h for node, _ in GAUSS)]
    known = {length: [length**min(k, 1) * G for k, G in enumerate(phis(length * A, 2))] for length in lengths}

    def forced(x, t, length):
        E, one, slope = known[length]
        return E @ x + (one - slope) @ s["f"](t) + slope @ s["f"](t + length)

    free = [np.zeros(len(A))]
    for k in range(4 * J):
        free.append(forced(free[-1], k * h / 4, h / 4))
    x0 = ends @ (s["b"] - s["ET"] @ free[-1])
    q = np.zeros((J, 2, n))
    for k in range(J):
        for node, weight in GAUSS:
            x = forced(free[4 * k], k * h, node * h) + known[node * h][0] @ powers[k] @ x0
            q[k] += weight * np.outer((1 - node, node), s["N"] @ x + s["g"]((k + node) * h))
    return q.ravel()


def error_of_u(s, J, printed):
    """In L2; None where Lemke's method finds no solution of the problem of all intervals."""
    m, n, h = len(s["A"]), s["M"].shape[0], s["T"] / J
    G = phis(h * s["A"])
    A, B, N, M = s["A"], s["B"], s["N"], s["M"]
    H = h * np.hstack([(G[1] - G[2]) @ B, G[2] @ B])
    C = np.vstack([N @ G[2], N @ (G[1] - G[2])])
    D = np.kron([[2, 1], [1, 2]], M) / 6 + h * np.block([[N @ (G[3] - G[4]) @ B, N @ G[4] @ B],
                                                       [N @ (G[2] - 2 * G[3] + G[4]) @ B, N @ (G[3] - G[4]) @ B]])
    powers = [np.eye(m)]
    for _ in range(J):
        powers.append(G[0] @ powers[-1])
    ends = np.linalg.inv(s["E0"] + s["ET"] @ powers[J])
    L = np.zeros((2 * n * J,) * 2)
    for row in range(J):
        for column in range(J):
            entry = -C @ powers[row] @ ends @ s["ET"] @ powers[J - column - 1] @ H
            if row == column:
                entry = entry + D
            elif row > column:
                entry = entry + (np.vstack([N, N]) @ H / 2 if printed else C @ powers[row - column - 1] @ H)
            L[row * 2 * n:(row + 1) * 2 * n, column * 2 * n:(column + 1) * 2 * n] = entry
    z = lemke(L, without_u(s, J, ends, powers))
    if z is None:
        return None
    z = z.reshape(J, 2, n)
    total = sum(weight * h * np.sum((z[k, 0] * (1 - node) + z[k, 1] * node - s["u"]((k + node) * h)) ** 2)
                for k in range(J) for node, weight in GAUSS)
    return math.sqrt(total)


def game():
    """nash-game, with its prescribed solution (catalogue/nash_game.cpp)."""
    A = np.array([[2, 0, 0, 0], [-2, -2, -1, 0], [0, 0, -1, 0], [1, 0, -2, 1.0]])
    B = np.array([[1, 2, 0, 0, 0], [-1, 0, 0, -1, 0], [0, 0, 2, 1, 0], [0, 1, 1, 0, 0.0]])
    N = np.array([[1, 1, 0, 0], [0, 2, 1, 0], [0, 0, -1, 2], [-1, 0, 0, 1], [0, 0, 0, 0.0]])
    M = np.array([[2, 2, 0.5, 0, 1], [2, 2, 0, 0.5, 1], [-0.5, 0, 2, -2, 1], [0, -0.5, -2, 2, 1], [-1, -1, -1, -1, 0.0]])
    E0, ET = np.zeros((4, 4)), np.zeros((4, 4))
    E0[0, 0] = E0[1, 2] = 1
    ET[2, 0] = ET[3, 2] = -2
    ET[2, 1] = ET[3, 3] = 1
    last = 4 * math.cos(1) - 1
    x = lambda t: np.array([t - 1, 1 + math.sin(math.pi * t), 2 * math.cos(t), last * math.exp(t - 1)])
    dx = lambda t: np.array([1, math.pi * math.cos(math.pi * t), -2 * math.sin(t), last * math.exp(t - 1)])
    u = lambda t: np.array([t / 2, max(0.3 - t, 0), 0.25, t if t < 0.5 else 0.75 - t / 2, max(t - 0.5, 0)])
    w = lambda t: np.array([0, max(t - 0.3, 0), 0, 0, 1 - u(t)[:4].sum()])
    return {"A": A, "B": B, "N": N, "M": M, "E0": E0, "ET": ET, "b": np.array([-1, 2, 1, -1.0]), "T": 1.0, "u": u,
            "f": lambda t: dx(t) - A @ x(t) - B @ u(t), "g": lambda t: w(t) - N @ x(t) - M @ u(t)}


def bridge():
    """The suspension bridge from 0 with velocity 1 (catalogue/bridge.cpp): kinks at multiples of T/6."""
    def u(t):
        k = math.floor(t / (1.5 * math.pi))
        s, v = t - 1.5 * math.pi * k, 1 + 2 * k / 15
        x = (v + 1 / 3) / 2 * math.sin(2 * s) - math.sin(4 * s) / 12 if s <= math.pi / 2 else (v + 0.4) * math.cos(s) - math.sin(4 * s) / 15
        return np.array([max(-x, 0)])
    return {"A": np.array([[0, 1], [-4, 0.0]]), "B": np.array([[0], [-3.0]]), "N": np.array([[1, 0.0]]), "M": np.array([[1.0]]),
            "E0": np.eye(2), "ET": np.zeros((2, 2)), "b": np.array([0, 1.0]), "T": 3 * math.pi, "u": u,
            "f": lambda t: np.array([0, math.sin(4 * t)]), "g": lambda t: np.zeros(1)}


def printed_matrix():
    rows = []
    for name, scene, grids in (("nash-game", game(), (10, 20, 40)), ("bridge", bridge(), (24, 48, 96, 192))):
        for J in grids:
            rows.append({"scene": name, "steps": J, **{key: error_of_u(scene, J, printed)
                                                     for key, printed in (("printed", True), ("correct", False))}})
    return rows
