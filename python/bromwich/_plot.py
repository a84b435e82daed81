"""Pictures of results."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ._arrays import listed, whole
from ._result import require
from ._rows import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# With more components, a picture of components against time is drawn in place of lines.
MOST_LINES = 10


def plot(result: Rows, what: str, components: Iterable[int] | None, ax: Axes | None) -> Any:
    import matplotlib.pyplot as plt

    require(what in ("auto", "x", "y", "w"), "what", f"found {what!r}; use 'auto', 'x', 'y' or 'w'")
    if what == "auto" and ax is None and components is None and result.x.shape[1] > 0:
        figure, axes = plt.subplots(2, 1, sharex=True, layout="constrained")
        _draw(result, "x", None, axes[0])
        _draw(result, "y", None, axes[1])
        axes[0].set_xlabel("")
        _title(result, axes[0])
        return axes
    if ax is None:
        _, ax = plt.subplots(layout="constrained")
        _title(result, ax)
    _draw(result, "y" if what == "auto" else what, components, ax)
    return ax


def _title(result: Rows, ax: Axes) -> None:
    status = "" if result.ok else f"({result.status})"
    ax.set_title(" ".join(word for word in (result.scene.name, status) if word))


def _draw(result: Rows, what: str, components: Iterable[int] | None, ax: Axes) -> None:
    values = getattr(result, what)
    require(values is not None and values.shape[1] > 0, what, "was not recorded; solve with states='all'")
    if what != "x" and getattr(result, "starts_with_impulse", False):  # the first row is no value
        values = np.concatenate([np.full_like(values[:1], np.nan), values[1:]])
    numbers = np.array(result.x_components if what == "x" else range(values.shape[1]), dtype=int)
    names = np.array(_names(result, what) or [f"${what}_{{{i}}}$" for i in numbers])
    if components is not None:
        columns = [whole(c, "components") for c in listed(components, "components")]
        for c in columns:
            require(-len(names) <= c < len(names), "components", f"found {c}; give columns from 0 to {len(names) - 1}")
        values, numbers, names = values[:, columns], numbers[columns], names[columns]
    ax.set_xlabel(_with_unit(result, "t", "t"))
    if len(names) > MOST_LINES:
        mesh = ax.pcolormesh(result.t, numbers, values.T, shading="nearest", rasterized=True)
        ax.figure.colorbar(mesh, ax=ax, label=_with_unit(result, what, what))
        ax.set_ylabel("state" if what == "x" else "constraint")
        return
    drawstyle = "default" if what == "x" or result.continuous else "steps-pre"
    for name, column in zip(names, values.T):
        ax.plot(result.t, column, drawstyle=drawstyle, label=name)
    alone = len(names) == 1 and bool(_names(result, what))
    ax.set_ylabel(_with_unit(result, what, str(names[0]) if alone else what))
    if len(names) > 1:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _names(result: Rows, what: str) -> list[str]:
    return result.state_names if what == "x" else result.constraint_names if what == "y" else []


def _with_unit(result: Rows, what: str, label: str) -> str:
    unit = result.units[what]
    return f"{label} [{unit}]" if unit else label
