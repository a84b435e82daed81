"""Periodic states followed in a parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from . import _core
from ._arrays import number, vector, whole
from ._errors import Error
from ._scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class BranchMark(NamedTuple):
    """A place of a branch where its states change their kind."""

    event: str  #: ``fold``, ``grazing``, ``period-doubling``, ``torus`` or ``branching``
    parameter: float
    x0: np.ndarray
    after: int  #: the point before it
    component: str  #: of y, at a grazing: it or its w touches zero


class Branch:
    """A branch of periodic states in the order in which it was followed, with a row for each of its points.

    Attributes:
        parameter: the parameter at each point; it turns back at folds.
        T: the period.
        x0: the states at t = 0, points x states.
        least, largest: the least and largest values of the states within the period, likewise.
        multipliers: by which a period multiplies small changes, points x states, the largest first.
        stable: whether no multiplier is outside of the unit circle.
        impacts: jumps of the state within the period.
        marks: :class:`BranchMark` of folds, grazings and passages of multipliers.
        complete: whether the branch was followed until it left the interval; otherwise ``reason`` says why.
        reason: why not.
        integrations: how many periods were integrated.
    """

    def __init__(self, found: dict[str, Any], names: dict[str, list[str]]) -> None:
        self._names = names
        self.parameter: np.ndarray = found["parameter"][:, 0]
        self.T: np.ndarray = found["T"][:, 0]
        self.x0: np.ndarray = found["x0"]
        self.least: np.ndarray = found["least"]
        self.largest: np.ndarray = found["largest"]
        self.multipliers: np.ndarray = found["multipliers"]
        self.stable: np.ndarray = np.array(found["stable"], dtype=bool)
        self.impacts: np.ndarray = np.array(found["impacts"], dtype=int)
        y = names.get("y", [])
        self.marks: list[BranchMark] = [
            BranchMark(event, p, np.array(x0), after, "" if i < 0 else y[i] if y else f"y{i}")
            for event, p, x0, after, i in found["marks"]
        ]
        self.complete: bool = found["complete"]
        self.reason: str = found["reason"]
        self.integrations: int = found["integrations"]

    def amplitude(self, state: int | str = 0) -> np.ndarray:
        """Half of what lies between the least and the largest value of a state, by number or name, at each point."""
        i = self._index(state)
        return (self.largest[:, i] - self.least[:, i]) / 2

    def _index(self, state: int | str) -> int:
        names = self._names.get("x", [])
        if isinstance(state, str):
            if state not in names:
                raise Error(f"state: found {state!r}; use one of {', '.join(names) or 'their numbers'}", "state")
            return names.index(state)
        count = self.x0.shape[1]
        if not 0 <= whole(state, "state") < count:
            raise Error(f"state: is {state} of {count}; states are counted from 0", "state")
        return state

    def __repr__(self) -> str:
        end = "" if self.complete else f"; ended: {self.reason}"
        kinds = ", ".join(f"{m.event} at {m.parameter:.6g}" for m in self.marks)
        return f"<bromwich.Branch of {self.parameter.size} points, {np.sum(self.stable)} stable{': ' if kinds else ''}{kinds}{end}>"

    def plot(self, state: int | str = 0, ax: Axes | None = None, name: str = "parameter", **style: Any) -> Axes:
        """The amplitude of a state over the parameter: stable states as lines, unstable ones dashed, marks as points.

        Args:
            state: number or name.
            ax: of Matplotlib; None: new ones.
            name: of the parameter.
            style: of the lines, as Matplotlib takes it.
        """
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.subplots(layout="constrained")[1]
        values, style = self.amplitude(state), {"color": "C0", **style}
        edges = np.flatnonzero(np.diff(self.stable.astype(int)))
        for begin, last in zip([0, *edges], [*edges + 1, values.size - 1]):
            part = slice(begin, last + 1)
            dashed = {} if self.stable[(begin + last + 1) // 2] else {"linestyle": "--"}
            ax.plot(self.parameter[part], values[part], **{**style, **dashed})
        for event, shape in (("fold", "o"), ("grazing", "x"), ("period-doubling", "s"), ("torus", "d"), ("branching", "^")):
            at = [m for m in self.marks if m.event == event]
            heights = [values[min(m.after + 1, values.size - 1)] for m in at]
            if at:
                ax.plot([m.parameter for m in at], heights, shape, color="black", markersize=4, label=event)
        names = self._names.get("x", [])
        i = self._index(state)
        ax.set_xlabel(name)
        ax.set_ylabel(f"amplitude of {names[i] if names else f'x{i}'}")
        if self.marks:
            ax.legend(frameon=False)
        return ax


def continuation(
    scene_of: Callable[[float], Scene],
    start: float,
    end: float,
    *,
    x0: Any = None,
    longest_step: float = 0.01,
    tol: float = 1e-9,
    max_points: int = 5000,
) -> Branch:
    """Follows a periodic state in a parameter by pseudo-arclength continuation: frequency responses, with stable and
    unstable states, folds and grazings.

    Args:
        scene_of: the scene of a value of the parameter: with a periodic condition, dense dynamics, and the same states for
            all values. T may depend on the parameter. Sources are stated best as expressions: functions of Python are
            searched for jumps in each scene.
        start: the value where the branch begins.
        end: the value towards which it is followed. It ends where it leaves the interval, at either end.
        x0: near the first periodic state; None: the one that motion from rest settles to.
        longest_step: between two points the parameter moves by this share of the interval at most, and the states by five
            times this share of their sizes.
        tol: of the integrations, relative to the sizes of the states.
        max_points: the branch ends after as many.

    Returns:
        A :class:`Branch`, whether it is complete or not.

    Raises:
        Error: of a scene, or where the scenes do not fit.

    Example:
        >>> b = continuation(lambda w: gear.scene(T=2 * np.pi / w, periodic=True, w=w), 0.5, 3)
        >>> b.plot("q0", name="w"), b.marks
    """
    first: list[Scene] = []

    def model(p: float) -> Any:
        scene = scene_of(p)
        if not isinstance(scene, Scene):
            raise Error(f"scene_of: gave a {type(scene).__name__}; give bromwich.Scene", "scene_of")
        if not first:
            first.append(scene)
        return scene._model

    found = _core.continuation(
        model,
        number(start, "start"),
        number(end, "end"),
        number(longest_step, "longest_step"),
        number(tol, "tol"),
        whole(max_points, "max_points", 1),
        None if x0 is None else vector(x0, "x0"),
    )
    return Branch(found, first[0].names if first else {})
