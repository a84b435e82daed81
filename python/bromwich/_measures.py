"""Mean, RMS, least and largest value of a component over a span of time, such as the last period."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._arrays import number
from ._errors import Error
from ._words import suggestion

# Lobatto's rule with four points and Kronrod's with three more (Gander & Gautschi, BIT 40, 2000): both ends of a piece are looked at,
# and the difference of the two says whether the piece is divided. A value at a jump is that of one side, so ends are moved inside.
INNER = 1 - 2e-9
POINTS = np.array([-INNER, -np.sqrt(2 / 3), -np.sqrt(1 / 5), 0, np.sqrt(1 / 5), np.sqrt(2 / 3), INNER])
LOBATTO = np.array([1, 0, 5, 0, 5, 0, 1]) / 6
KRONROD = np.array([77, 432, 625, 672, 625, 432, 77]) / 1470
# Of the integral of the absolute values: what a piece may be off by. The length of the shortest piece, of the span.
ACCURATE, SHORTEST = 1e-10, 1e-12
# Times that are looked at, at the most, beside those of the pieces there are: what rounding of :meth:`at` may cost.
MOST = 200_000
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
    return _divided(result, span, power)[2]


def _divided(result: Any, span: Span, power: int = 1) -> tuple[np.ndarray, np.ndarray, float]:
    """Times and values where the component was looked at, piece by piece, and the integral of its power."""
    edges = _edges(result, span)
    begin, end = edges[:-1], edges[1:]
    shortest = SHORTEST * (span.end - span.start)
    total, size, left, times, values = 0.0, 0.0, MOST, [], []
    while begin.size:
        half, middle = (end - begin) / 2, (end + begin) / 2
        at = middle[:, None] + half[:, None] * POINTS
        found = _values(result, span, at.ravel()).reshape(at.shape)
        times.append(at.ravel())
        values.append(found.ravel())
        of_power = found**power
        fine = half * (of_power @ KRONROD)
        size = max(size, float(np.sum(half * (np.abs(of_power) @ KRONROD))))
        divide = (np.abs(fine - half * (of_power @ LOBATTO)) > ACCURATE * size) & (half > shortest)
        left -= 2 * POINTS.size * int(np.sum(divide))
        divide &= left > 0
        total += float(np.sum(fine[~divide]))
        begin, end = np.sort(np.concatenate([begin[divide], middle[divide]])), np.sort(np.concatenate([middle[divide], end[divide]]))
    return np.concatenate(times), np.concatenate(values), total


def largest(result: Any, span: Span, sign: int) -> float:
    """The largest value of sign * component."""
    times, found, _ = _divided(result, span)
    order = np.argsort(times)
    times, found = times[order], sign * found[order]
    best = float(np.max(found))
    edges = _edges(result, span)
    for _ in range(ROUNDS):
        k = int(np.argmax(found))
        piece = np.searchsorted(edges, times[k])  # stays between the edges
        low, high = max(times[max(k - 1, 0)], edges[piece - 1]), min(times[min(k + 1, len(times) - 1)], edges[min(piece, len(edges) - 1)])
        times = np.linspace(low, high, AROUND + 2)[1:-1]
        found = sign * _values(result, span, times)
        best = max(best, float(np.max(found)))
    return sign * best


def _edges(result: Any, span: Span) -> np.ndarray:
    """Start, end, and between them the rows, switches, breakpoints and begins of polynomials."""
    switches = np.array([s.t for s in result.switches]) if result.t.size > 1 else np.zeros(0)
    breaks = np.array(getattr(result.scene, "breakpoints", ()), dtype=float)
    all_times = np.concatenate([result.t, switches, breaks, result._pieces()])
    shortest = SHORTEST * (span.end - span.start)
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
