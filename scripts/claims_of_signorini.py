"""Figures 4.7 to 4.9 of Wu and Chen, for scripts/paper_claims: the Signorini problem at the membrane, by the functional
iteration and by implicit Euler, in sine modes of both directions."""
import math

import numpy as np


class Membrane:
    """Q points on a side, J steps up to T. y + psi is the value on the membrane, of (4.3)-(4.7)."""

    def __init__(self, Q=39, J=400, T=4.0, c=2e-3):
        self.Q, self.J, self.h, self.dx = Q, J, T / J, 1 / (Q + 1)
        self.s = np.arange(1, Q + 1) * self.dx
        self.sine = math.sqrt(2 * self.dx) * np.sin(math.pi * np.outer(np.arange(1, Q + 1), self.s))
        mode = 4 / self.dx**2 * np.sin(math.pi * np.arange(1, Q + 1) * self.dx / 2) ** 2
        self.rate = c * (mode[:, None] + mode[None, :])  # along x2, across x1
        self.enters, self.seen = c / self.dx**2 * self.sine[:, 0], -2 * self.sine[:, 0]
        self.t = np.arange(J + 1) * self.h
        outer = np.abs(self.s - 0.5) >= 0.25 - 1e-12
        self.psi = np.where(outer[None, :], 4 / (1 + self.t)[:, None], np.sin(2 * np.pi * self.t)[:, None])
        self.M = 4 * np.eye(Q) - np.eye(Q, k=1) - np.eye(Q, k=-1)
        bump = self.s * (1 - self.s)
        self.start = self.sine @ (2 * np.outer(bump, bump)) @ self.sine.T


def complementary(M, q):
    """LCP(M, q), M an M-matrix, by Newton on the active set."""
    active = q < 0
    for _ in range(50):
        y = np.zeros(len(q))
        if active.any():
            y[active] = np.linalg.solve(M[np.ix_(active, active)], -q[active])
        new = np.where(active, y > 0, M @ y + q < 0)
        if (new == active).all():
            return y
        active = new
    raise RuntimeError("no active set")


def figures_4_7_and_4_8(sweeps=(1, 2, 3, 5)):
    m = Membrane()
    z = -m.rate * m.h
    E, p1 = np.exp(z), np.where(np.abs(z) > 1e-8, np.expm1(z) / z, 1)
    p2 = (p1 - 1) / z
    left, right = m.h * (p1 - p2), m.h * p2
    v = np.tile(m.sine.T @ m.start @ m.seen, (m.J + 1, 1))
    iterates = []
    for _ in range(60):
        iterates.append(np.array([complementary(m.M, v[j] + m.M @ m.psi[j]) for j in range(m.J + 1)]))
        F = (iterates[-1] + m.psi) @ m.sine.T
        state, v = m.start.copy(), v.copy()
        for j in range(m.J):
            state = E * state + (left * F[j][:, None] + right * F[j + 1][:, None]) * m.enters[None, :]
            v[j + 1] = m.sine.T @ (state @ m.seen)
        if len(iterates) > 1 and np.abs(iterates[-1] - iterates[-2]).max() < 1e-12:
            break
    final, late, middle = iterates[-1], slice(m.J // 16, None), m.Q // 2
    errors = [float(np.abs(one - final)[late].max()) for one in iterates]
    tolerance = min(m.h, m.dx**2) / 50
    kept = {}
    for name, y in [*((str(k), iterates[k - 1]) for k in sweeps), ("converged", final)]:
        kept[name] = {"at_T": (y[-1] + m.psi[-1]).tolist(), "in_the_middle": (y[:, middle] + m.psi[:, middle]).tolist(),
                      "membrane": rounded_rows((y + m.psi)[::every])}
    return {"t": m.t.tolist(), "x2": m.s.tolist(), "iterates": kept, "errors": errors, "tolerance_4_8": tolerance,
            "largest_y": float(np.abs(final[late]).max()),
            "sweeps_to_4_8": int(next(k for k, e in enumerate(errors, 1) if e <= tolerance)),
            "sweeps_to_1e-12": len(iterates)}


every = 4  # time points of the pictures over the membrane


def rounded_rows(values):
    """Three decimals are enough for colours."""
    return [[round(float(v), 3) for v in row] for row in values]


def figure_4_9(seconds=(30, 180, 900, 1200), whole=27.5 * 60):
    """What implicit Euler has of y + psi after these times, if it takes `whole` for all steps, as the text says."""
    m = Membrane()
    inverse = 1 / (1 + m.h * m.rate)
    answer = m.h * m.sine.T @ ((inverse * m.enters[None, :]) @ m.seen[:, None] * m.sine)
    Mh = m.M + answer
    state, rows = m.start.copy(), [complementary(m.M, m.sine.T @ m.start @ m.seen + m.M @ m.psi[0]) + m.psi[0]]
    for j in range(1, m.J + 1):
        free = inverse * (state + m.h * (m.sine @ m.psi[j])[:, None] * m.enters[None, :])
        y = complementary(Mh, m.sine.T @ (free @ m.seen) + m.M @ m.psi[j])
        state = free + inverse * m.h * (m.sine @ y)[:, None] * m.enters[None, :]
        rows.append(y + m.psi[j])
    return {"seconds": list(seconds), "shares": [s / whole for s in seconds], "t": m.t[::every].tolist(),
            "membrane": rounded_rows(np.array(rows)[::every])}
