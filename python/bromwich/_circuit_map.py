"""Netlists at many operating points: numbers of each solution over the values of parameters."""

from __future__ import annotations

import csv
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _core
from ._errors import Error, Interrupted, require
from ._rows import Status
from ._words import suggestion

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class CircuitMap:
    """What :meth:`CircuitScene.map` returns: an array over the stepped parameters for each column.

    Attributes:
        axes: name of each stepped parameter and its values, in the order of the axes of the arrays.
        columns: name of each column and its unit.
        status: an array of :class:`Status` over the axes.
        reason: an array of texts; empty where a point is solved.
        residual: an array, of the complementarity.
        backend: where it was solved.

    Example:
        >>> m = circuit("boost.cir").periodic().map("efficiency", "ripple(V(out))", duty=np.linspace(0.2, 0.7, 11))
        >>> m["efficiency"], m.axes["duty"]
    """

    def __init__(self, title: str, axes: dict[str, np.ndarray], found: dict[str, Any]) -> None:
        self.title, self.axes = title, axes
        shape = tuple(values.size for values in axes.values())
        self.columns = dict(zip(found["columns"], found["units"]))
        self.status = _texts([Status(word) for word in found["status"]], shape)
        self.reason = _texts(found["reason"], shape)
        self.residual: np.ndarray = found["residual"].reshape(shape)
        self.backend: str = found["backend"]
        self._values: np.ndarray = found["values"].reshape(*shape, len(self.columns))

    def __getitem__(self, column: str) -> np.ndarray:
        """Values of a column over the axes; NaN where a point is not solved or has no such number."""
        names = list(self.columns)
        if column not in names:
            raise Error(f"column: found {column!r}{suggestion(str(column), names)}; use one of {', '.join(names)}", "column")
        return self._values[..., names.index(column)]

    @property
    def ok(self) -> np.ndarray:
        """Booleans over the axes: whether a point is solved."""
        return self.status == Status.solved

    def __repr__(self) -> str:
        over = ", ".join(f"{name} ({values.size})" for name, values in self.axes.items())
        return f"<CircuitMap of {self.title} over {over}: {', '.join(self.columns)}; {np.sum(self.ok)} of {self.ok.size} solved>"

    def plot(self, column: str, ax: Axes | None = None) -> Axes:
        """A curve over one parameter, or a map over two; parameters with one value do not count."""
        import matplotlib.pyplot as plt

        values = np.squeeze(self[column])
        varied = [(name, own) for name, own in self.axes.items() if own.size > 1]
        require(0 < len(varied) < 3, "column", f"is over {len(varied)} parameters; give one or two of them several values")
        if ax is None:
            ax = plt.subplots(layout="constrained")[1]
        unit = self.columns[column]
        text = f"{column} / {unit}" if unit else column
        ax.set_title(self.title)
        if len(varied) == 1:
            ax.plot(varied[0][1], values, marker="." if values.size <= 50 else None)
            ax.set_xlabel(varied[0][0])
            ax.set_ylabel(text)
            return ax
        (down, rows), (across, places) = varied
        mesh = ax.pcolormesh(places, rows, np.ma.masked_invalid(values), shading="nearest")
        ax.figure.colorbar(mesh, ax=ax, label=text)
        ax.set_xlabel(across)
        ax.set_ylabel(down)
        return ax

    def save(self, file: str | os.PathLike[str]) -> None:
        """Writes the table that ``bromwich solve`` writes of ``.step``: CSV, one row a point."""
        name = os.fspath(file)
        require(name.endswith(".csv"), "file", f"found {name!r}; end it in .csv")
        points = np.stack([one.ravel() for one in np.meshgrid(*self.axes.values(), indexing="ij")], axis=1)
        values = self._values.reshape(points.shape[0], -1)
        with open(name, "w", newline="", encoding="utf-8") as out:
            rows = csv.writer(out, lineterminator="\n")
            rows.writerow(["scene", *self.axes, "status", "residual", *self.columns, "reason", "warning"])
            for i, (point, row) in enumerate(zip(points, values)):
                numbers = [repr(float(v)) for v in row]
                rows.writerow([i, *map(repr, map(float, point)), self.status.flat[i], float(self.residual.flat[i]), *numbers, self.reason.flat[i], ""])


def _texts(words: list[Any], shape: tuple[int, ...]) -> np.ndarray:
    made = np.empty(len(words), dtype=object)
    made[:] = words
    return made.reshape(shape)


def circuit_map(title: str, source: _core.CircuitSource, axes: dict[str, np.ndarray], columns: list[str], options: Any, on: Any, report: Any, stop: Any) -> CircuitMap:
    """Solves all points, or raises what Ctrl-C means."""
    steps = [(name, [float(v) for v in values]) for name, values in axes.items()]
    found = _core.circuit_map(source, steps, columns, options, on, report, stop)
    made = CircuitMap(title, axes, found)
    if found["interrupted"]:
        raise Interrupted("interrupted by Ctrl-C", made)
    return made
