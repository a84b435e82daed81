"""Names and units of the components of a scene of arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from . import _core
from ._errors import Error


def _components(model: _core.Model) -> dict[str, int]:
    return {"x": model.states, "y": model.constraints, "w": model.constraints}


def _by_letter(given: Any, what: str, letters: Iterable[str]) -> Mapping[str, Any]:
    known = ", ".join(letters)
    if not isinstance(given, Mapping):
        raise Error(f"{what}: is a {type(given).__name__}; give a dict with the keys {known}", what)
    for key in given:
        if key not in letters:
            raise Error(f"{what}: has the key {key!r}; use {known}", what)
    return given


def _texts(given: Any, key: str, what: str, count: int) -> list[str]:
    texts = list(given)
    if len(texts) != count or not all(isinstance(text, str) for text in texts):
        raise Error(f"{what}: {key} is {texts!r}; give {count} texts", what)
    return texts


def names_of(model: _core.Model, given: Any) -> dict[str, list[str]]:
    """Lists for x, y and w; empty where nothing is given."""
    sizes = _components(model)
    if given is None:
        return {}
    found = {key: _texts(texts, key, "names", sizes[key]) for key, texts in _by_letter(given, "names", sizes).items()}
    taken = [name for texts in found.values() for name in texts]
    for name in taken:
        if not name or taken.count(name) > 1:
            raise Error(f"names: found {name!r} {taken.count(name)} times; give every component a name of its own", "names")
    unnamed = {f"{key}{i}": key for key in sizes if key not in found for i in range(sizes[key])}
    for name in taken:
        if name == "t" or name in unnamed:
            of = unnamed.get(name, "the time")
            raise Error(f"names: {name!r} is the column of {of}; give another name, or name {of} too", "names")
    return {key: found.get(key, []) for key in sizes}


def units_of(model: _core.Model, given: Any) -> dict[str, list[str]]:
    sizes = {"t": 1, **_components(model)}
    if given is None:
        return {}
    found = {}
    for key, texts in _by_letter(given, "units", sizes).items():
        found[key] = [texts] * sizes[key] if isinstance(texts, str) else _texts(texts, key, "units", sizes[key])
    return {key: found.get(key, []) for key in sizes}
