"""Elements with memory: modes that located events change."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from . import _core
from ._arrays import matrix, number, word
from ._errors import Error
from ._sources import on_this_host, source
from ._words import suggestion

_OF_MODE = ("f", "g", "A", "B", "N", "M", "leave")
_OF_LEAVE = ("to", "when", "set")


class Memory:
    """An element with memory, such as a thermostat, a thyristor or a switch with hysteresis.

    It is in one of its modes at a time. A mode adds to the scene while it lasts, and is left at a located time where its
    conditions hold.

    Args:
        name: of the memory; results have its modes by it.
        modes: by name, what each adds to the scene and how it is left, a dict with the keys

            - ``f``, ``g``: added to f (m values) and g (n values), as sources of :class:`Scene`;
            - ``A``, ``B``, ``N``, ``M``: matrices that are added;
            - ``leave``: a dict, or a list of them, of which the first that holds is taken: ``to``, a mode; ``when``, a comparison
              that is affine in states, y and the modes of memories, numbers from 0 by their names, ``"temperature < 0.9"``, or a
              list of them that all have to hold; ``set``, values of states that jump then, ``{"v": 0}``.
        start: the mode at t = 0; None: the first. A mode whose conditions hold is left at once.

    Example:
        >>> Memory("heater", {
        ...     "off": {"leave": {"to": "on", "when": "x0 < 0.9"}},
        ...     "on": {"f": [2], "leave": {"to": "off", "when": "x0 > 1.1"}},
        ... })
    """

    def __init__(self, name: str, modes: Mapping[str, Mapping[str, Any]], start: str | None = None) -> None:
        self.name = word(name, "memory")
        if not self.name:
            raise Error("memory: has no name; give one, such as 'heater'", "memory")
        if not isinstance(modes, Mapping) or not modes:
            raise _error(self.name, "modes", "are missing", "give a dict of modes by name")
        self.modes = {str(mode): dict(_table(given, f"{self.name}.{mode}", _OF_MODE)) for mode, given in modes.items()}
        self.start = next(iter(self.modes)) if start is None else start
        for where, mode in self._named():
            if mode not in self.modes:
                near = suggestion(str(mode), self.modes)
                raise _error(self.name, where, f"found {mode!r}{near}", f"the modes are {', '.join(self.modes)}")

    def _named(self) -> Iterable[tuple[str, Any]]:
        """Where modes are named."""
        yield "start", self.start
        for mode, given in self.modes.items():
            for leave in _leaves(given, f"{self.name}.{mode}"):
                yield f"{mode}.leave.to", leave["to"]

    def _stated(self, states: int, constraints: int, T: float, parameters: Mapping[str, float]) -> dict[str, Any]:
        """For the compiled part."""
        modes = []
        for name, given in self.modes.items():
            where = f"memory.{self.name}.{name}"
            mode: dict[str, Any] = {"name": name, "leave": _leaves(given, f"{self.name}.{name}")}
            for key, size in (("f", states), ("g", constraints)):
                if (one := source(on_this_host(given.get(key), f"{where}.{key}"), f"{where}.{key}", size, T, parameters)):
                    mode[key] = one
            for key in ("A", "B", "N", "M"):
                if given.get(key) is not None:
                    mode[key] = np.ascontiguousarray(matrix(given[key], f"{where}.{key}", column=key == "B"))
            modes.append(mode)
        return {"name": self.name, "start": self.start, "modes": modes}

    def __repr__(self) -> str:
        return f"<bromwich.Memory {self.name!r}: {', '.join(self.modes)}; begins with {self.start}>"


class ModeChange(NamedTuple):
    """A mode of a memory that begins."""

    t: float
    memory: str
    previous: str  #: the mode before
    mode: str


def _error(name: str, where: str, found: str, remedy: str) -> Error:
    return Error(f"memory.{name}.{where}: {found}; {remedy}", "memory")


def _table(given: Any, where: str, keys: tuple[str, ...]) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise Error(f"memory.{where}: found {given!r}; give a dict with the keys {', '.join(keys)}", "memory")
    for key in given:
        if key not in keys:
            found = f"{key!r} is no known key{suggestion(str(key), keys)}"
            raise Error(f"memory.{where}: {found}; use {', '.join(keys)}", "memory")
    return given


def _leaves(given: Mapping[str, Any], where: str) -> list[dict[str, Any]]:
    ways = given.get("leave") or []
    found = []
    for way in [ways] if isinstance(ways, Mapping) else ways:
        way = _table(way, f"{where}.leave", _OF_LEAVE)
        for key in ("to", "when"):
            if key not in way:
                raise Error(f"memory.{where}.leave: has no {key}; give a mode as to and a comparison as when", "memory")
        when = [way["when"]] if isinstance(way["when"], str) else list(way["when"])
        jumps = {str(state): number(value, f"memory.{where}.leave.set") for state, value in (way.get("set") or {}).items()}
        found.append({"to": way["to"], "when": when, "set": jumps})
    return found


def memories(given: Any) -> list[Memory]:
    """The memories of an argument: one or several, as :class:`Memory` or as dicts of its arguments."""
    if given is None:
        return []
    made = []
    for one in given if isinstance(given, (list, tuple)) else [given]:
        if isinstance(one, Mapping):
            stated = _table(one, str(one.get("name", "")), ("name", "modes", "start"))
            made.append(Memory(stated.get("name", ""), stated.get("modes", {}), stated.get("start")))
        elif isinstance(one, Memory):
            made.append(one)
        else:
            raise Error(f"memory: found {one!r}; give bromwich.Memory(...) or a dict", "memory")
    return made


def set_memories(
    model: _core.Model, all_of_them: list[Memory], names: Mapping[str, list[str]], parameters: Mapping[str, float]
) -> None:
    if not all_of_them:
        return
    stated = [one._stated(model.states, model.constraints, model.T, parameters) for one in all_of_them]
    _core.set_memories(model, stated, names.get("x") or [], names.get("y") or [], dict(parameters))


def modes_at_rows(model: _core.Model, answer: Any) -> dict[str, np.ndarray]:
    """By memory, the name of the mode at each row; empty where it is not known."""
    numbers = np.array(_core.modes_of(answer), dtype=int)
    found = {}
    for k, (name, modes, _) in enumerate(_core.memories_of(model)):
        found[name] = np.array([*modes, ""])[numbers[:, k]] if numbers.size else np.empty(0, dtype=str)
    return found


def mode_series(model: _core.Model, answer: Any) -> list[tuple[str, str, np.ndarray]]:
    """For files: name, meaning, and the number of the mode at each row, in the order of the scene."""
    numbers = np.array(_core.modes_of(answer), dtype=float)
    found = []
    for k, (name, modes, _) in enumerate(_core.memories_of(model)):
        if numbers.size:
            meaning = "mode: " + ", ".join(f"{i} {mode}" for i, mode in enumerate(modes))
            found.append((name, meaning, np.ascontiguousarray(numbers[:, k])))
    return found


def mode_changes(model: _core.Model, answer: Any) -> list[ModeChange]:
    known = _core.memories_of(model)
    changes = []
    for t, k, before, after in _core.mode_changes_of(answer):
        name, modes, _ = known[k]
        changes.append(ModeChange(t, name, modes[before], modes[after]))
    return changes
