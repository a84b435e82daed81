"""Linear dynamics that are no matrices: callbacks, and sums of second differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ._arrays import compressed, vector
from ._errors import Error, SingularShift

Solve = Callable[[np.ndarray], np.ndarray]


class Dynamics:
    """E x' = A x + B y known by what it does: a finite-element code, a matrix-free operator, a transform.

    Args:
        states: m.
        B: m x n, NumPy or SciPy sparse: how y drives the states.
        N: n x m: what the constraints see of the states.
        shifted: ``shifted(z)`` prepares the shift z, a complex number, and returns a function ``R -> X`` that solves
            ``(z E - A) X = R`` for complex arrays m x k. It is called a few hundred times in a solve; a factorization
            belongs there. Where z is an eigenvalue raise :class:`SingularShift` (``numpy.linalg.LinAlgError`` and
            SciPy's ``RuntimeError`` about a singular factor do as well) or return values that are not finite.
        mass: ``X -> E X`` for real arrays m x k; None: E is the identity.
        bound: ``(half_angle, abscissa)``, where the eigenvalues of E^-1 A lie: ``|arg(abscissa - z)| <= half_angle`` in
            radians, ``abscissa`` the largest real part; ``(0, 0)`` for a symmetric negative A. None: it is estimated.

    The callables run in the thread that called ``solve``, and what they raise leaves it.

    Example:
        >>> lu = lambda z: scipy.sparse.linalg.splu((z * I - A).tocsc()).solve
        >>> bromwich.solve(dynamics=bromwich.Dynamics(m, B, N, shifted=lu, bound=(0, 0)), M=M, x0=x0, T=1)
    """

    def __init__(
        self,
        states: int,
        B: Any,
        N: Any,
        *,
        shifted: Callable[[complex], Solve],
        mass: Solve | None = None,
        bound: tuple[float, float] | None = None,
    ) -> None:
        if not callable(shifted):
            raise Error("shifted: is no function; give z -> (R -> X)", "shifted")
        if mass is not None and not callable(mass):
            raise Error("mass: is no function; give X -> E X", "mass")
        self.states = int(states)
        self.B, self.N = compressed(B, "B", column=True), compressed(N, "N")
        self.shifted, self.mass = shifted, mass
        self.bound = None if bound is None else (float(bound[0]), float(bound[1]))


class Kronecker:
    """A = I (x) across + along (x) I on a rectangle whose constraints sit on one side, one on each grid line.

    Sine transforms diagonalise it, so nothing of size m x m is formed. The state index is
    ``line * points_across + position on the line``, counted from the constrained side.

    Args:
        along: ``(points, dx, c)``, c/dx^2 tridiag(1, -2, 1) along the constrained side; n = points.
        across: ``(points, dx, c)`` of one grid line.
        b: points-across values: how y of a line drives the line.
        n: points-across values: how the line is seen by its constraint.

    Sources f of such a scene enter through B: give ``f`` with n values and ``F="B"``.
    """

    def __init__(self, along: tuple[int, float, float], across: tuple[int, float, float], b: Any, n: Any) -> None:
        (p, dx, c), (q, dy, d) = along, across
        self.along, self.across = (int(p), float(dx), float(c)), (int(q), float(dy), float(d))
        self.b, self.n = vector(b, "b"), vector(n, "n")


def returned(found: Any, given: np.ndarray, name: str) -> np.ndarray:
    """What a callback has returned, of the shape and type of what it was given, column by column."""
    array = np.asarray(found)
    if array.ndim == 1 and given.shape[1] == 1:
        array = array.reshape(-1, 1)
    if array.shape != given.shape:
        raise Error(f"{name}: returned shape {array.shape}; return {given.shape}, as it was given", name)
    if np.iscomplexobj(array) and not np.iscomplexobj(given):
        raise Error(f"{name}: returned complex values; return real ones", name)
    return np.asfortranarray(array, dtype=given.dtype)


def says_singular(error: BaseException) -> bool:
    """Whether an exception of a callback says that z is an eigenvalue."""
    if isinstance(error, (SingularShift, np.linalg.LinAlgError)):
        return True
    return type(error) is RuntimeError and "singular" in str(error).lower()
