"""Poles of a function from its values, by the AAA algorithm (Nakatsukasa, Sète, Trefethen, SIAM J. Sci. Comput. 40, 2018)."""

from __future__ import annotations

import numpy as np

MOST_SUPPORT = 48
TOLERANCE = 1e-12
# A function that half of the terms do not describe to this part has no such rational function.
HALF_WAY, HOPELESS = 24, 1e-4


def poles_of(z: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poles and residues of a rational function r with r(z) = f to 1e-12 of the largest f: branch points become rows of
    poles along a cut, the outermost near their end. None where there is no such function of low degree."""
    none = np.zeros(0, complex), np.zeros(0, complex)
    if z.size < 4 or not np.abs(f).max() > 0:
        return none
    scale = np.abs(f).max()
    chosen: list[int] = []
    left = np.ones(z.size, bool)
    r = np.full(z.size, f.mean())
    w = np.ones(0, complex)
    converged = False
    for _ in range(min(MOST_SUPPORT, z.size // 2)):
        new = int(np.argmax(np.where(left, np.abs(f - r), -1.0)))
        chosen.append(new)
        left[new] = False
        cauchy = 1 / (z[left][:, None] - z[chosen])
        loewner = (f[left][:, None] - f[chosen]) * cauchy
        w = np.linalg.svd(loewner, full_matrices=False)[2][-1].conj()
        r = f.copy()
        with np.errstate(all="ignore"):
            r[left] = (cauchy @ (w * f[chosen])) / (cauchy @ w)
        error = np.abs(f - r).max()
        converged = bool(error <= TOLERANCE * scale)
        if converged or (len(chosen) == HALF_WAY and error > HOPELESS * scale):
            break
    support, values = z[chosen], f[chosen]
    if not converged or w.size < 2:
        return none
    # The zeros of Σ w_j/(z - z_j): (z - D) v = (1, ..., 1), w v = 0.
    left_of = np.linalg.qr(np.column_stack([np.ones(w.size), np.eye(w.size)[:, 1:]]).astype(complex))[0][:, 1:]
    right_of = np.linalg.qr(np.column_stack([w.conj(), np.eye(w.size)]))[0][:, 1 : w.size]
    inner = left_of.conj().T @ right_of
    poles = np.linalg.eigvals(np.linalg.lstsq(inner, left_of.conj().T @ (support[:, None] * right_of), rcond=None)[0])
    with np.errstate(all="ignore"):
        cauchy = 1 / (poles[:, None] - support)
        residues = (cauchy @ (w * values)) / -(cauchy**2 @ w)
    good = np.isfinite(poles) & np.isfinite(residues)
    return poles[good], residues[good]
