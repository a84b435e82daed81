"""Derivatives of a result with respect to the data of its scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from . import _core

if TYPE_CHECKING:
    from ._result import Result


class Tangent(NamedTuple):
    """Changes of y (J+1) x n, x (J+1) x m and w (J+1) x n at the time points."""

    y: np.ndarray
    x: np.ndarray
    w: np.ndarray


class Gradient(NamedTuple):
    """Derivatives of a number with respect to the data, each of the shape of its data: x0 (m), f (J+1) x m and g (J+1) x
    n at the time points, A, B, N and M."""

    x0: np.ndarray
    f: np.ndarray
    g: np.ndarray
    A: np.ndarray
    B: np.ndarray
    N: np.ndarray
    M: np.ndarray


class Margin(NamedTuple):
    """Where the solution is nearest to a point at which it is not differentiable."""

    margin: float  #: smallest max(y_i, w_i), relative to the largest y_i and w_i
    t: float
    constraint: int  #: i; -1: no constraint is near


class Derivative:
    """The derivative of the discrete solution, its active sets held: exact, not by differences.

    Made by :meth:`Result.derivative`. ``jvp`` follows a change of the data forward in time, ``vjp`` gives the gradient
    of a number with respect to all data by one pass backward.

    Example:
        >>> d = solve(A=A, B=B, N=N, M=M, x0=x0, T=1, g=g, steps=400).derivative()
        >>> d.jvp(x0=[1, 0]).y                           # dy/dx0_0 at all times
        >>> d.vjp(x=np.eye(401, 2, k=-400)).x0           # gradient of x_0(T) with respect to x0
    """

    def __init__(self, result: Result) -> None:
        self._core, self._result = _core.SolutionDerivative(result._answer), result

    @property
    def margin(self) -> Margin:
        """How near y_i = w_i = 0 is, where derivatives are one-sided. Changes of the data that move y and w by less than
        this share leave the active sets as they are."""
        return Margin(*self._core.margin)

    def jvp(
        self,
        *,
        x0: Any = None,
        f: Any = None,
        g: Any = None,
        A: Any = None,
        B: Any = None,
        N: Any = None,
        M: Any = None,
    ) -> Tangent:
        """The change of the solution that a change of the data causes, to first order.

        Args:
            x0: m values. f, g: (J+1) x m and (J+1) x n, at the time points. A, B, N, M: as those of the scene. None: no
                change.

        Raises:
            Error: another shape.
        """
        arrays = [None if v is None else _table(v) for v in (f, g, A, B, N, M)]
        return Tangent(*self._core.jvp(None if x0 is None else _values(x0).ravel(), *arrays))

    def vjp(self, *, y: Any = None, x: Any = None, w: Any = None) -> Gradient:
        """The gradient of Σ y̅·y + x̅·x + w̅·w with respect to the data.

        Args:
            y, x, w: y̅, x̅ and w̅, (J+1) x n, m and n; None: zero.

        Raises:
            Error: another shape.
        """
        return Gradient(*self._core.vjp(*(None if v is None else _table(v) for v in (y, x, w))))


def _values(v: Any) -> np.ndarray:
    return np.ascontiguousarray(v, dtype=np.float64)


def _table(v: Any) -> np.ndarray:
    return np.atleast_2d(_values(v))
