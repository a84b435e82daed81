"""Linear dynamics without a matrix A: callbacks, and sums of second differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ._arrays import compressed, filled, number, vector, whole_number
from ._errors import Error, SingularShift

Solve = Callable[[np.ndarray], np.ndarray]


class Dynamics:
    """E x' = A x + B y by callbacks: a finite-element code, a matrix-free operator, a transform.

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
        self.states = whole_number(states, "states")
        self.B, self.N = compressed(B, "B", column=True), compressed(N, "N")
        self.shifted, self.mass = shifted, mass
        two = None if bound is None else vector(bound, "bound")
        if two is not None and two.size != 2:
            raise Error(f"bound: has {two.size} values; give two, (half_angle, abscissa)", "bound")
        self.bound = None if two is None else (float(two[0]), float(two[1]))


End = str | float
Ends = End | tuple[End, End]


class Kronecker:
    """Diffusion, advection and reaction on a line, a rectangle or a box of points, with constraints on one or two sides.

    ``x' = (I (x) across + along (x) I - reaction I) x + B y`` with ``c u'' - v u'`` by central differences in each
    direction. The state index is ``line * points_across + position on the line``, counted from the constrained side;
    there is one constraint for each grid line, and one more for each where the opposite side has constraints too.

    Args:
        along: ``(points, dx, c)``, c/dx^2 tridiag(1, -2, 1) along the constrained side; None: there is one line alone.
        across: ``(points, dx, c)`` of one grid line. ``spacing`` gives dx for a length.
        b: points-across values: how y of a line drives the line.
        n: points-across values: how the line is seen by its constraint.
        ends_along, ends_across: what holds at the first and at the last end, one for both or two: ``"dirichlet"``
            (u = 0 at one dx from the last point), ``"neumann"``, or a number a >= 0 for ``du/dn = -a u`` (Robin), both
            at dx/2 from the last point. That of the constrained side holds where y = 0.
        advection: v, one for both directions or (along, across); ``|v| dx < 2 c``.
        reaction: r, 1/time.
        far_b, far_n: b and n of the opposite side, counted from there; None: no constraints there.
        beside: ``[(points, dx, c)]``, a further direction of the constrained side, which makes a box, with Dirichlet ends.
            Lines are counted with ``along`` slowest.

    Dirichlet ends, diffusion alone and constraints on one side: sine transforms diagonalise it, and nothing of size
    m x m is formed. Sources f of such a scene enter through B: give ``f`` with n values and ``F="B"``. The same holds with
    other ends, a reaction, two sides that are alike (the same b and n, and the same condition at both ends), and advection of up to |v| L/(2c) of about seven in all directions together, above 512 states,
    if f enters through B or there is none. Others are sparse dynamics, set up by modes of their directions, and take every
    f.

    Raises:
        Error: a value that makes no sense, by its name (``across.advection``), when the scene is made.
    """

    def __init__(
        self,
        along: tuple[int, float, float] | None,
        across: tuple[int, float, float],
        b: Any,
        n: Any,
        *,
        ends_along: Ends = "dirichlet",
        ends_across: Ends = "dirichlet",
        advection: float | tuple[float, float] = 0.0,
        reaction: float = 0.0,
        far_b: Any = None,
        far_n: Any = None,
        beside: Any = (),
    ) -> None:
        v = filled(advection, 2, "advection")
        if v.size != 2:
            raise Error(f"advection: has {v.size} values; give one, or (along, across)", "advection")
        self.across = _line(across, "across")
        if along is None:  # one line: nothing flows along
            along, ends_along, v = (1, *self.across[1:]), "neumann", np.array([0.0, v[1]])
        self.along = _line(along, "along")
        self.beside = [_line(one, "beside") for one in beside]
        self.b, self.n = vector(b, "b"), vector(n, "n")
        self.ends_along, self.ends_across = _ends(ends_along, "ends_along"), _ends(ends_across, "ends_across")
        self.advection, self.reaction = (float(v[0]), float(v[1])), number(reaction, "reaction")
        if (far_b is None) != (far_n is None):
            missing = "far_b" if far_b is None else "far_n"
            raise Error(f"{missing}: is missing; give far_b and far_n, or neither", missing)
        self.far_b = np.zeros(0) if far_b is None else vector(far_b, "far_b")
        self.far_n = np.zeros(0) if far_n is None else vector(far_n, "far_n")

    @property
    def in_sine_modes(self) -> bool:
        """Whether sine transforms diagonalise it."""
        plain = self.advection == (0, 0) and self.reaction == 0 and self.far_b.size == 0
        return plain and self.ends_along == self.ends_across == (None, None)

    @staticmethod
    def spacing(points: int, length: float, ends: Ends = "dirichlet") -> float:
        """The spacing of the points of a line, from its number of points and its length."""
        return number(length, "length") / (whole_number(points, "points") + 1 - 0.5 * sum(end is not None for end in _ends(ends, "ends")))


def _line(line: Any, name: str) -> tuple[int, float, float]:
    """Points, spacing, diffusivity."""
    try:
        points, spacing, diffusivity = line
    except (TypeError, ValueError):
        raise Error(f"{name}: found {line!r}; give (points, spacing, diffusivity)", name) from None
    return whole_number(points, name), number(spacing, name), number(diffusivity, name)


def _ends(ends: Ends, name: str) -> tuple[float | None, float | None]:
    """Coefficients of Robin conditions; None: Dirichlet."""
    two = tuple(ends) if isinstance(ends, tuple | list) else (ends, ends)
    if len(two) != 2:
        raise Error(f"{name}: has {len(two)} values; give one for both ends, or two", name)
    found: list[float | None] = []
    for end in two:
        if isinstance(end, str) and end not in ("dirichlet", "neumann"):
            raise Error(f"{name}: found {end!r}; use 'dirichlet', 'neumann' or a number (Robin)", name)
        found.append({"dirichlet": None, "neumann": 0.0}[end] if isinstance(end, str) else number(end, name))
    return found[0], found[1]


def returned(found: Any, given: np.ndarray, name: str) -> np.ndarray:
    """The array that a callback has returned, checked: of the shape and type of its argument, in column order."""
    array = np.asarray(found)
    if array.ndim == 1 and given.shape[1] == 1:
        array = array.reshape(-1, 1)
    if array.shape != given.shape:
        raise Error(f"{name}: returned shape {array.shape}; return {given.shape}, as it was given", name)
    if np.iscomplexobj(array) and not np.iscomplexobj(given):
        raise Error(f"{name}: returned complex values; return real ones", name)
    return np.asfortranarray(array, dtype=given.dtype)


def says_singular(error: BaseException) -> bool:
    """Whether an exception of a callback means that z is an eigenvalue."""
    if isinstance(error, (SingularShift, np.linalg.LinAlgError)):
        return True
    return type(error) is RuntimeError and "singular" in str(error).lower()
