"""Mean, RMS, least and largest value of a component over a span of time, such as the last period."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._arrays import number
from ._errors import Error
from ._words import suggestion

# Gauss-Legendre points of a piece, of order 8: a piece lies between two rows or switches, where x and y are smooth.
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(4)
# An extreme value is looked for among so many points around the largest one, so many times.
AROUND, ROUNDS = 9, 4


class Span(NamedTuple):
    """A component between two times."""

    kind: str  #: x, y or w, or an output of a circuit
    column: int  #: -1: of an output
    start: float
    end: float


def span_of(result: Any, name: str, start: float | None, end: float | None) -> Span:
    """The component of this name, also ``x0``, ``y0`` or ``w0``, and the times, checked."""
    first, last = result._span()
    start = first if start is None else number(start, "start")
    end = last if end is None else number(end, "end")
    if not first <= start < end <= last * (1 + np.finfo(float).eps):
        raise Error(f"start: found {start!r} to {end!r}; give start < end from {first!r} to {last!r}", "start")
    if hasattr(result.scene, "_netlist") and "(" in name and (name in result.scene.outputs or name not in result.state_names):
        return Span(name, -1, start, min(end, last))
    kind, column = component_of(name, result.state_names, result.constraint_names, result.x_components, result.y.shape[1])
    return Span(kind, column, start, min(end, last))


def component_of(name: str, states: list[str], constraints: list[str], recorded: list[int], n: int) -> tuple[str, int]:
    """x, y or w, and the column of the table."""
    known = {f"{kind}{i}": (kind, i) for kind in "yw" for i in range(n)}
    known |= {f"x{i}": ("x", column) for column, i in enumerate(recorded)}
    known |= {one: ("y", i) for i, one in enumerate(constraints)} | {one: ("x", i) for i, one in enumerate(states)}
    if name not in known:
        near = suggestion(str(name), known)
        raise Error(f"name: found {name!r}{near}; use one of {', '.join(known)}; x is known of the states that are recorded", "name")
    return known[name]


def integral(result: Any, span: Span, power: int) -> float:
    """Of the component, or of its square, over the span."""
    edges = _edges(result, span)
    half, middle = np.diff(edges) / 2, (edges[1:] + edges[:-1]) / 2
    times = middle[:, None] + half[:, None] * POINTS
    values = _values(result, span, times.ravel()).reshape(times.shape)
    return float(np.sum(half * (values**power @ WEIGHTS)))


def largest(result: Any, span: Span, sign: int) -> float:
    """The largest value of sign * component."""
    edges = _edges(result, span)
    inside = 1e-9 * np.diff(edges)  # a value at a jump is that of one side
    times = np.sort(np.concatenate([edges[:-1] + inside, edges[1:] - inside, (edges[1:] + edges[:-1]) / 2]))
    found = sign * _values(result, span, times)
    best = float(np.max(found))
    for _ in range(ROUNDS):
        k = int(np.argmax(found))
        piece = np.searchsorted(edges, times[k])  # stays between the edges
        low, high = max(times[max(k - 1, 0)], edges[piece - 1]), min(times[min(k + 1, len(times) - 1)], edges[min(piece, len(edges) - 1)])
        times = np.linspace(low, high, AROUND + 2)[1:-1]
        found = sign * _values(result, span, times)
        best = max(best, float(np.max(found)))
    return sign * best


def _edges(result: Any, span: Span) -> np.ndarray:
    """Start, end, and the rows and switches between them."""
    switches = np.array([s.t for s in result.switches]) if result.t.size > 1 else np.zeros(0)
    breaks = np.array(getattr(result.scene, "breakpoints", ()), dtype=float)
    all_times = np.concatenate([result.t, switches, breaks])
    shortest = 1e-12 * (span.end - span.start)
    between = np.unique(all_times[(all_times > span.start + shortest) & (all_times < span.end - shortest)])
    edges = np.concatenate([[span.start], between, [span.end]])
    return edges[np.concatenate([[True], np.diff(edges) > shortest])]


def _values(result: Any, span: Span, times: np.ndarray) -> np.ndarray:
    rows = result.at(times)
    if span.column < 0:
        return rows[span.kind]
    values = getattr(rows, span.kind)
    if values is None:
        raise Error(f"name: {span.kind} is not known between the rows; give a component of x or y", "name")
    return values[:, span.column]


def of_rows(t: np.ndarray, values: np.ndarray, start: float, end: float) -> dict[str, np.ndarray]:
    """mean, rms, min and max of columns that are linear between rows; values are (..., rows)."""
    at = np.unique(np.concatenate([[start], t[(t > start) & (t < end)], [end]]))
    flat = values.reshape(-1, t.size)
    v = np.array([np.interp(at, t, one) for one in flat]).reshape(*values.shape[:-1], at.size)
    a, b, h = v[..., :-1], v[..., 1:], np.diff(at)
    mean, square = ((a + b) / 2 @ h) / (end - start), ((a * a + a * b + b * b) / 3 @ h) / (end - start)
    return {"mean": mean, "rms": np.sqrt(square), "min": v.min(-1), "max": v.max(-1), "ripple": v.max(-1) - v.min(-1)}
