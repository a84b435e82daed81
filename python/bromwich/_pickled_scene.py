"""Scenes that were pickled: those of arrays by their arrays, others by what makes them. `cls` is the class of scenes."""

from __future__ import annotations

import hashlib
import pickle
from typing import Any

import numpy as np

from . import _core, _sources
from ._errors import Error
from ._memory import set_memories


def restored(
    cls: Any, state: dict[str, Any], sources: tuple, parameters: dict[str, float], facts: dict[str, Any]
) -> Any:
    """A scene of arrays, from the state that ``Scene.__reduce__`` has pickled."""
    model = _core.Model.empty()
    for key in ("name", "T", "steps", "tolerance", "free_rows", "restitution"):
        setattr(model, key, state[key])
    for key in ("dynamics", "M"):
        setter, *arguments = state[key]
        getattr(model, setter)(*arguments)
    model.set_lcp_class(state["lcp_class"])
    model.set_f_entry(*state["f_entry"])
    if "boundary" in state:
        model.set_boundary(*state["boundary"])
    else:
        model.set_x0(state["x0"])
    f, g, breakpoints = sources
    model.set_sources(_sources.restored(f), _sources.restored(g), breakpoints)
    model.validate()
    set_memories(model, facts.get("memory") or [], facts.get("names") or {}, parameters)
    return cls._of(model, parameters, facts)


def made_again(cls: Any, recipe: tuple, found: str) -> Any:
    """A scene of a file, of the catalogue or of a relay, made again."""
    maker, arguments, named = recipe
    made = getattr(cls, maker)(*arguments, **named)
    if fingerprint(made._model) != found:
        where = arguments[0] if arguments else maker
        raise Error(f"scene: {where} is not what it was when the scene was pickled; pickle it again", "scene")
    return made


def fingerprint(model: _core.Model) -> str:
    """A hash of all numbers of a scene, and of its sources at a few times."""
    times = model.T * np.array([0.0, 0.137, 0.381, 0.729, 1.0])
    values = [_core.source_values(model, float(t)) for t in times]
    return hashlib.sha256(pickle.dumps((_core.state_of_model(model), values), protocol=4)).hexdigest()
