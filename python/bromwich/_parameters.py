"""Derivatives of a result with respect to parameters of its scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from . import _core
from ._recorded import Recorded
from ._result_derivative import ResultDerivative, Tangent, tables
from ._scene import Scene
from ._sources import _require


class ParameterDerivative(ResultDerivative):
    """The derivative of a solution with respect to parameters of its scene.

    Made by :meth:`Result.derivative` with ``parameters``. The derivative with respect to the data of the scene is exact; how
    the data change with the parameters is found by central differences of the data (``words`` says how far apart). No scene is
    solved again. Rows are those of the result.

    Attributes:
        parameters: names and values.

    Example:
        >>> r = solve(Scene.from_toml("circuit.toml"))
        >>> d = r.derivative(parameters=["R", "C"])
        >>> d.jacobian()["R"].y                  # dy/dR at all times
        >>> d.vjp(x=last)["C"]                   # of the number that the weights `last` make of x
    """

    def __init__(
        self,
        result: Recorded,
        parameters: str | Iterable[str] | Mapping[str, float],
        scene_of: Callable[..., Scene] | None = None,
        located: bool | None = None,
    ) -> None:
        scene = result.scene
        known = scene.parameters
        if isinstance(parameters, Mapping):
            _require(scene_of is not None, "parameters", "have values without scene_of", "give their names, ['R', 'C']")
            values = {name: float(value) for name, value in parameters.items()}
        else:
            _require(scene_of is None, "parameters", "have no values for scene_of", "give a mapping, {'R': 1e3}")
            names = [parameters] if isinstance(parameters, str) else list(parameters)
            for name in names:
                _require(name in known, "parameters", f"found {name!r}", f"use parameters of the scene: {', '.join(known)}")
            values = {name: known[name] for name in names}
        _require(bool(values), "parameters", "is empty", "name one or more")

        def model(name: str, value: float) -> _core.Model:
            made = scene._with(name, value) if scene_of is None else scene_of(**{**values, name: value})
            return made._model

        self.parameters: dict[str, float] = values
        core = _core.ParameterDerivative(result._answer, list(values), list(values.values()), model, located)
        super().__init__(core, result)

    @property
    def words(self) -> str:
        """The form, and how the data were differentiated."""
        return self._core.words

    def jvp(self, *, states: bool = False, **changes: float) -> Tangent:
        """The change of the solution with a change of the parameters, to first order: ``jvp(R=1.0)`` is the derivative by R.

        Args:
            states: as for :meth:`Derivative.jvp`.
            changes: numbers by name; others do not change.

        Raises:
            Error: a name that is not among ``parameters``; a change of M, where it acts from one side only.
        """
        for name in changes:
            _require(name in self.parameters, name, "is not differentiated by", f"use {', '.join(self.parameters)}")
        by = np.array([float(changes.get(name, 0.0)) for name in self.parameters])
        return Tangent(*self._core.jvp(by, bool(states)))

    def jacobian(self, *, states: bool = False) -> dict[str, Tangent]:
        """The derivative by each parameter, under its name."""
        return {name: self.jvp(states=states, **{name: 1.0}) for name in self.parameters}

    def vjp(self, *, y: Any = None, x: Any = None, w: Any = None, integral: Any = None) -> dict[str, float]:
        """The gradient of the number of :meth:`Derivative.vjp` with respect to the parameters, by one pass for all of them."""
        found = self._core.vjp(*tables(y=y, x=x, w=w, integral=integral))
        return dict(zip(self.parameters, found))

    def quantity(
        self, *, W: Any = None, c: Any = None, end_W: Any = None, end_c: Any = None
    ) -> tuple[float, dict[str, float]]:
        """A quantity of interest, as for :meth:`Derivative.quantity`, and its gradient with respect to the parameters. That of
        the scene file may depend on them itself."""
        value, found = self._core.quantity(*self._quantity(W, c, end_W, end_c))
        return value, dict(zip(self.parameters, found))
