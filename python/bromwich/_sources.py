"""Sources f and g: constants, tables over time, expressions, and functions of t."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from . import _core
from ._arrays import of_other_library, on_host, vector
from ._errors import Error

# Where a file has its [parameters].
IN_PARAMETERS = "define it in parameters={...},"


def source(given: Any, name: str, width: int, T: float, parameters: Mapping[str, float]) -> _core.Source | None:
    """The source for an argument f or g, with ``width`` values; None: zero."""
    if given is None or isinstance(given, _core.Source):
        return given
    if isinstance(given, str):
        given = [given]
    if callable(given):
        return _function(given, name, width, T)
    if isinstance(given, (list, tuple)) and given and any(isinstance(entry, str) for entry in given):
        _require(len(given) == width, name, f"has {len(given)} expressions", f"give {width}")
        texts = [entry if isinstance(entry, str) else repr(float(entry)) for entry in given]
        try:
            return _core.Source.expressions(texts, dict(parameters), T, name)
        except Error as error:
            raise Error(str(error).replace("define it in [parameters], before its first use,", IN_PARAMETERS), name) from None
    if isinstance(given, tuple) and len(given) == 2 and np.ndim(given[1]) >= 1 and np.ndim(given[0]) == 1:
        times, values = vector(given[0], name), on_host(given[1], name)
        if values.shape in ((times.size,), (times.size, width)) and times.size > 1:
            return _table(times, values, name, width, T, kinks=True)
        if np.shape(given[0]) != np.shape(given[1]):
            found = f"is a pair with {times.size} times and values of shape {values.shape}"
            raise Error(f"{name}: {found}; give a row of {width} values for each time", name)
    array = on_host(given, name)
    if array.ndim == 2 and array.shape[0] > 1 or array.ndim == 1 and width == 1 and array.size > 1:
        return _table(np.linspace(0, T, array.shape[0]), array, name, width, T, kinks=False)
    constant = np.full(width, float(array)) if array.ndim == 0 else vector(array, name)
    _require(constant.size == width, name, f"has {constant.size} values", f"give {width}, or {width} columns over time")
    return _core.Source.constant(constant)


def on_this_host(given: Any, name: str) -> Any:
    """Arrays of other libraries as NumPy's, also in tables with times of their own."""
    if isinstance(given, tuple):
        return tuple(on_this_host(part, name) for part in given)
    return on_host(given, name) if of_other_library(given) else given


def steps_of(given: Any, width: int) -> int:
    """The steps of a table on the uniform grid; 0 for anything else."""
    if given is None or callable(given) or isinstance(given, (str, tuple, _core.Source)):
        return 0
    if isinstance(given, list) and any(isinstance(entry, str) for entry in given):
        return 0
    shape = np.shape(given)
    on_grid = len(shape) == 2 and shape[0] > 1 or len(shape) == 1 and width == 1 and shape[0] > 1
    return shape[0] - 1 if on_grid else 0


def _require(held: bool, name: str, found: str, remedy: str) -> None:
    if not held:
        raise Error(f"{name}: {found}; {remedy}", name)


def _table(times: np.ndarray, values: np.ndarray, name: str, width: int, T: float, kinks: bool) -> _core.Source:
    if values.ndim == 1:
        values = values.reshape(-1, 1)
    pair = f", or times of your own in a tuple, {name}=(times, values)" if not kinks and len(values) == 2 else ""
    _require(values.shape[1] == width, name, f"has {values.shape[1]} columns", f"give {width}{pair}")
    _require(bool(np.all(np.isfinite(times))), name, "has times that are not finite", "give finite ones")
    _require(bool(np.all(np.diff(times) >= 0)), name, "has times that decrease", "sort them")
    _require(
        times[0] <= 0 and times[-1] >= T, name, f"has times from {times[0]:g} to {times[-1]:g}", f"cover 0 to {T:g}"
    )
    inside = (times[1:] != times[:-1]) | ((times[1:] > 0) & (times[1:] < T))
    keep = np.concatenate([[True], inside])
    return _core.Source.table(np.ascontiguousarray(times[keep]), np.ascontiguousarray(values[keep]), kinks)


class _OneTime:
    """A user's function as the compiled part calls it: one time, ``width`` values."""

    def __init__(self, function: Callable, name: str, width: int) -> None:
        self.function, self.name, self.width = function, name, width

    def __call__(self, t: float) -> np.ndarray:
        returned, name, width = self.function(t), self.name, self.width
        try:
            if returned is None:
                raise TypeError("None")
            found = np.asarray(returned, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise Error(f"{name}: returned no numbers at t = {t:g} ({error}); return {width} values", name) from error
        if found.shape != (width,):
            _require(found.size == width, name, f"returned shape {found.shape} at t = {t:g}", f"return {width} values")
            found = found.ravel()
        return np.ascontiguousarray(found)


class _ManyTimes:
    """The same for an array of times: times x width. ``turned``: the user's function returns width x times."""

    def __init__(self, function: Callable, name: str, width: int, turned: bool) -> None:
        self.function, self.name, self.width, self.turned = function, name, width, turned

    def __call__(self, t: np.ndarray) -> np.ndarray:
        values = np.asarray(self.function(t), dtype=np.float64)
        name, shape = self.name, (t.size, self.width)
        if self.turned and values.size == t.size * self.width:
            values = values.reshape(self.width, t.size).T
        if values.shape != shape:
            raise Error(f"{name}: returned shape {values.shape} for {t.size} times; return {shape}", name)
        return np.ascontiguousarray(values)


def _function(function: Callable, name: str, width: int, T: float) -> _core.Source:
    one = _OneTime(function, name, width)
    return _core.Source.function(one, _many(one, T), width, T)


def _many(one: _OneTime, T: float) -> _ManyTimes | None:
    """The function for many times at once, if a test shows that it takes an array of times; otherwise None.

    It may return times x width or width x times; with one value, times alone.
    """
    width = one.width
    count = 5 if width != 5 else 7  # a number of times that differs from the number of values
    times = T * np.array([0.0, 0.137, 0.381, 0.5, 0.729, 0.901, 1.0])[:count]
    try:
        with np.errstate(all="ignore"):
            found = np.asarray(one.function(times), dtype=np.float64)
    except Exception:  # it takes a single time only
        return None
    if found.shape == (count, width):
        turned = False
    elif found.shape == (width, count) or (width == 1 and found.shape == (count,)):
        turned = True
    else:
        return None
    found = found.reshape(width, count).T if turned else found
    alone = np.array([one(float(t)) for t in times])
    scale = np.max(np.abs(alone), initial=0.0, where=np.isfinite(alone))
    if not np.allclose(found, alone, rtol=1e-12, atol=1e-13 * scale, equal_nan=True):
        return None
    return _ManyTimes(one.function, one.name, width, turned)


def restored(state: tuple | None) -> _core.Source | None:
    """The source from its description by the compiled part (``state_of_sources``)."""
    if state is None:
        return None
    word, *arguments = state
    return getattr(_core.Source, word)(*arguments)


def values_at(values: Callable[[np.ndarray], np.ndarray], t: Any) -> np.ndarray:
    """Of a source at one time or several: a row for each."""
    times = np.asarray(t, dtype=float)
    if times.ndim > 1 or not np.isfinite(times).all():
        raise Error(f"t: has {times.ndim} dimensions or values that are not finite; give a number or a list of times", "t")
    found = values(np.atleast_1d(times))
    return found if times.ndim else found[0]
