"""What all derivatives of a result have in common: their form, switches and margin, and the arrays that they take."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._arrays import on_host
from ._recorded import Recorded
from ._sources import source


class Tangent(NamedTuple):
    """Changes of y (J+1) x n, x (J+1) x m and w (J+1) x n at the time points, and of the integral of y over [0, t]
    (impulses included)."""

    y: np.ndarray
    x: np.ndarray
    w: np.ndarray
    integral: np.ndarray


class Margin(NamedTuple):
    """Where the solution is nearest to a point at which it is not differentiable."""

    margin: float  #: smallest max(y_i, w_i), relative to the largest y_i and w_i
    t: float
    constraint: int  #: i; -1: no constraint is near
    transversality: float  #: smallest T |c'| at a switch where c vanishes, relative to the largest c; inf: none is located
    grazing_time: float  #: its time


class ResultDerivative:
    """A derivative of one result with its active sets held, or with located switches.

    Derived classes say with respect to what: :class:`Derivative` the data, :class:`ParameterDerivative` parameters.
    """

    _core: Any  # the compiled part

    def __init__(self, core: Any, result: Recorded) -> None:
        self._core, self._result = core, result

    @property
    def t(self) -> np.ndarray:
        """Times of the rows: those of the result."""
        return self._result.t

    @property
    def form(self) -> str:
        """``discrete solution``, ``modes``, ``over all time points``, ``boundary values`` or ``located switches``."""
        return self._core.form

    @property
    def located(self) -> bool:
        """Whether switches are located."""
        return self._core.switches is not None

    @property
    def switches(self) -> np.ndarray | None:
        """Times of the switches; None where they are not located."""
        found = self._core.switches
        return None if found is None else np.array(found, dtype=float)

    @property
    def one_sided(self) -> np.ndarray:
        """Time points at a switch: their rows are limits from the right."""
        return np.array(self._core.one_sided, dtype=int)

    @property
    def margin(self) -> Margin:
        """How near y_i = w_i = 0 is, where derivatives are one-sided. Changes of the data that move y and w by less than
        this share leave the active sets as they are."""
        return Margin(*self._core.margin)

    def _quantity(self, W: Any, c: Any, end_W: Any, end_c: Any) -> tuple:
        """The members of a quantity of interest, as the compiled part takes them."""
        W, end_W = tables(W=W, end_W=end_W)
        c = source(c, "c", self._core.states, float(self.t[-1]), {})
        return W, c, end_W, None if end_c is None else values(end_c, "end_c").ravel()


def values(given: Any, name: str) -> np.ndarray:
    return np.ascontiguousarray(on_host(given, name))


def tables(**given: Any) -> list[np.ndarray | None]:
    """Arrays of two dimensions, in the order of the arguments; None stays None."""
    return [None if v is None else np.atleast_2d(values(v, name)) for name, v in given.items()]
