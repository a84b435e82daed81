"""Contact on one side of a square with a conductivity that varies by a factor of fifty, as arrays: the scene of
`bromwich bench fields`, written independently of it.

x' = A x + B y, 0 <= y ⊥ w = N x + M y + g >= 0, x(0) = 0. Contact i sits at the state contacts[i]: N has a 1 there, column i
of B the value b, and M = compliance I.
"""
import dataclasses

import numpy as np
import scipy.sparse as sp


@dataclasses.dataclass
class Field:
    cells: int
    compliance: float
    T: float = 4.0

    def __post_init__(self):
        Q = self.cells
        self.A = conduction(Q)
        self.contacts = np.arange(Q) * Q
        self.b = float(Q + 1)
        unit = sp.csc_array((np.ones(Q), (self.contacts, np.arange(Q))), shape=(Q * Q, Q))
        self.B, self.N, self.M = self.b * unit, unit.T.tocsr(), self.compliance * sp.eye_array(Q, format="csr")

    def g(self, steps):
        """(steps + 1) x cells."""
        t = self.T * np.arange(steps + 1)[:, None] / steps
        x = np.arange(1, self.cells + 1) / (self.cells + 1)
        moving = 0.5 * np.sin(np.pi * x) * (1 + 0.5 * np.cos(5 * x)) * np.sin(3 * t)
        return (1 - np.exp(-5 * t)) * (moving + 0.05 * np.sin(7 * np.pi * x))


def conductivity(x, y):
    layer = 0.05 * 10 ** (0.5 * np.sin(7 * x + 3 * y))
    return np.where((x - 0.4) ** 2 + (y - 0.6) ** 2 < 0.04, 0.2 * layer, layer)


def conduction(Q):
    """Cells by rows, joined by the conductivity at their common side; the side of the contacts is insulated, the opposite
    one is kept at 0."""
    place = np.arange(1, Q + 1) / (Q + 1)
    half, scale = 0.5 / (Q + 1), float(Q + 1) ** 2
    i, k = np.meshgrid(np.arange(Q), np.arange(Q), indexing="ij")
    cell, x, y = i * Q + k, place[k], place[i]
    down, right = i + 1 < Q, k + 1 < Q
    first = np.concatenate([cell[down], cell[right]])
    second = np.concatenate([cell[down] + Q, cell[right] + 1])
    joint = scale * np.concatenate([conductivity(x, y + half)[down], conductivity(x + half, y)[right]])
    last = k == Q - 1
    ground = -2 * scale * conductivity(1.0, y[last])
    rows = np.concatenate([first, second, first, second, cell[last]])
    columns = np.concatenate([second, first, first, second, cell[last]])
    return sp.coo_array((np.concatenate([joint, joint, -joint, -joint, ground]), (rows, columns)), shape=(Q * Q,) * 2).tocsc()
