"""Pictures of results."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ._arrays import listed, whole
from ._axes import label
from ._errors import require
from ._recorded import Recorded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# With more components, a picture of components against time is drawn in place of lines.
MOST_LINES = 10


def plot(result: Recorded, what: str, components: Iterable[int] | None, ax: Axes | None) -> Any:
    import matplotlib.pyplot as plt

    require(what in ("auto", "x", "y", "w", "modes"), "what", f"found {what!r}; use 'auto', 'x', 'y', 'w' or 'modes'")
    if what == "modes":
        return _bars(result, ax if ax is not None else plt.subplots(layout="constrained")[1])
    if ax is not None:
        _draw(result, "y" if what == "auto" else what, components, ax)
        return ax
    both = what == "auto" and components is None and result.x.shape[1] > 0
    panels = [(kind, part) for kind in ("x", "y") for part in _of_one_unit(result, kind)] if both else [(what, components)]
    figure, axes = plt.subplots(len(panels), 1, sharex=True, layout="constrained", squeeze=False)
    figure.set_figheight(max(figure.get_figheight(), 1.9 * len(panels)))
    for (kind, part), own in zip(panels, axes[:, 0]):
        _draw(result, "y" if kind == "auto" else kind, part, own)
    for own in axes[:-1, 0]:
        own.set_xlabel("")
    _title(result, axes[0, 0])
    return axes[:, 0] if both else axes[0, 0]


def _bars(result: Any, ax: Axes) -> Axes:
    """The modes of memories over time, a row for each, with their names."""
    require(bool(getattr(result, "modes", {})), "modes", "the scene has no elements with memory")
    end = float(result.t[-1])
    for row, (name, modes) in enumerate(result.modes.items()):
        changes = [change for change in result.mode_changes if change.memory == name]
        begins = [float(result.t[0]), *(change.t for change in changes)]
        names = [modes[0] if not changes else changes[0].previous, *(change.mode for change in changes)]
        colours = {mode: f"C{i}" for i, mode in enumerate(dict.fromkeys(names))}
        for begin, until, mode in zip(begins, [*begins[1:], end], names):
            ax.barh(row, until - begin, left=begin, height=0.6, color=colours[mode])
            ax.text((begin + until) / 2, row, mode, ha="center", va="center", clip_on=True)
    ax.set_yticks(range(len(result.modes)), list(result.modes))
    label(ax.xaxis, "t", result.units["t"], result.t)
    return ax


def _of_one_unit(result: Recorded, what: str) -> list[list[int] | None]:
    """The columns of x or y, those of one unit together; None: all."""
    units = _units(result, what)
    if len(set(units)) < 2 or len(units) > MOST_LINES:
        return [None] if getattr(result, what).shape[1] > 0 else []
    return [[i for i, unit in enumerate(units) if unit == one] for one in dict.fromkeys(units)]


def _title(result: Recorded, ax: Axes) -> None:
    status = "" if result.ok else f"({result.status})"
    ax.set_title(" ".join(word for word in (result.scene.name, status) if word))


def _draw(result: Recorded, what: str, components: Iterable[int] | None, ax: Axes) -> None:
    values = getattr(result, what)
    require(values is not None and values.shape[1] > 0, what, "was not recorded; solve with states='all'")
    if what != "x" and getattr(result, "starts_with_impulse", False):  # the first row is no value
        values = np.concatenate([np.full_like(values[:1], np.nan), values[1:]])
    numbers = np.array(result.x_components if what == "x" else range(values.shape[1]), dtype=int)
    names = np.array(_names(result, what) or [f"${what}_{{{i}}}$" for i in numbers])
    units = np.array(_units(result, what))
    if components is not None:
        columns = [whole(c, "components") for c in listed(components, "components")]
        for c in columns:
            require(-len(names) <= c < len(names), "components", f"found {c}; give columns from 0 to {len(names) - 1}")
        values, numbers, names, units = values[:, columns], numbers[columns], names[columns], units[columns]
    label(ax.xaxis, "t", result.units["t"], result.t)
    if len(names) > MOST_LINES:
        mesh = ax.pcolormesh(result.t, numbers, values.T, shading="nearest", rasterized=True)
        bar = ax.figure.colorbar(mesh, ax=ax)
        label(bar.ax.yaxis, what, units[0] if len(set(units)) == 1 else "", values)
        ax.set_ylabel("state" if what == "x" else "constraint")
        return
    drawstyle = "default" if what == "x" or result.continuous else "steps-pre"
    for name, unit, column in zip(names, units, values.T):
        alone = len(set(units)) == 1
        ax.plot(result.t, column, drawstyle=drawstyle, label=name if alone or not unit else f"{name} [{unit}]")
    named = str(names[0]) if len(names) == 1 and _names(result, what) else what
    label(ax.yaxis, named, units[0] if len(set(units)) == 1 else "", values)
    if len(names) > 1:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _names(result: Recorded, what: str) -> list[str]:
    if what == "w" and (names := getattr(result.scene, "names", {}).get("w")):
        return names
    return result.state_names if what == "x" else result.constraint_names if what == "y" else []


def _units(result: Recorded, what: str) -> list[str]:
    """One for each column."""
    columns = getattr(result, what).shape[1]
    of_scene = getattr(result.scene, "units", {}).get(what)
    if of_scene:
        return [of_scene[i] for i in result.x_components] if what == "x" else list(of_scene)
    return [result.units[what]] * columns
