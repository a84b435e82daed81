"""Results from files that :meth:`bromwich.Result.save` or the command has written."""

from __future__ import annotations

import errno
import json
import math
import os
import zipfile
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np

from . import _core, _hdf5
from ._contacts import ContactReport, report_of_file
from ._errors import Error, require
from ._io import HDF5, extension_of
from ._memory import ModeChange
from ._result import Result
from ._rows import Switch

READ = (*HDF5, ".npz", ".csv", ".vtkhdf")


def load(path: str | os.PathLike[str]) -> SavedResult:
    """Reads a file of results that :meth:`Result.save` or ``bromwich solve --out`` has written.

    Args:
        path: a file ``.h5`` (needs h5py), ``.npz``, ``.csv`` or ``.vtkhdf`` (needs h5py). Of a run that was killed it
            has the rows up to there, with status ``running``.

    Raises:
        Error: for another extension, or a file that does not hold a result.
        OSError: for a file that cannot be read.
    """
    name, extension = extension_of(path, READ)
    if not os.path.exists(name):
        raise FileNotFoundError(errno.ENOENT, "path: the file does not exist; give a file of results", name)
    if extension == ".npz":
        try:
            with np.load(name, allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
        except (ValueError, EOFError, AttributeError, zipfile.BadZipFile):  # of what is no such archive
            arrays = {}
        prefix = "attribute_"
        facts = {key[len(prefix) :]: arrays.pop(key).item() for key in list(arrays) if key.startswith(prefix)}
    elif extension == ".csv":
        arrays, facts = _load_csv(name)
    else:
        arrays, facts = _load_hdf5(name)
    if "t" not in arrays:
        raise Error(f"path: {name!r} holds no result; give a file of Result.save or of bromwich solve --out", "path")
    return SavedResult(arrays, facts, os.path.abspath(name))


class SavedResult(Result):
    """A result that was read from a file: ``t``, ``y``, ``w``, ``x`` and what is known of them, as of :class:`Result`.

    Of the scene only the name is known. Switches and values at other times come from the rows.
    """

    def __init__(self, arrays: dict[str, np.ndarray], facts: dict[str, Any], name: str = "") -> None:
        self._name = name  # of the file
        for values in arrays.values():
            values.flags.writeable = False
        self._units, self._columns = facts.pop("_units", {}), facts.pop("_columns", {})
        scene: Any = SimpleNamespace(name=facts.get("scene", ""))
        super().__init__(_Answer(arrays, facts), scene)
        self._facts = facts

    @property
    def attributes(self) -> dict[str, Any]:
        """The attributes of the file, listed in ``docs/output.md``."""
        return dict(self._facts)

    @property
    def constraint_names(self) -> list[str]:
        """Of the columns of ``y`` and ``w``."""
        return [str(name) for name in self._answer.constraint_names]

    @property
    def state_names(self) -> list[str]:
        """Of the columns of ``x``."""
        return [str(name) for name in self._answer.state_names]

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Of a CSV file: every column by its header. ``y`` and ``x`` are those named y0, x0, ...; a header with names of
        the scene does not say which of the two a column is."""
        return dict(self._columns)

    @property
    def units(self) -> dict[str, str]:
        """Of ``t``, ``y``, ``w`` and ``x``; an empty text where the file has none."""
        return {key: str(self._units.get(key, "")) for key in ("t", "y", "w", "x")}

    def _attributes(self) -> dict[str, Any]:
        return dict(self._facts)

    def _integral_of_y(self, start: float, end: float) -> np.ndarray | None:
        return None

    def at(self, t: float | Iterable[float]) -> SavedResult:
        """The result at other times, interpolated linearly between the rows.

        Raises:
            Error: for times outside the rows, and for times between them where y may jump.
        """
        return SavedResult(self._answer.between(self._times(t)), {**self._facts, "_units": self._units})

    @property
    def contacts(self) -> ContactReport:
        """Of a structure with contacts: what the summary of the file says of them, and forces where it has their columns."""
        return report_of_file(self, self._answer.summary, self._answer.others)

    @property
    def modes(self) -> dict[str, np.ndarray]:
        """The mode of each memory at the rows, by its name; empty where the file has no summary."""
        found = {}
        for one in self._memories():
            found[one["name"]] = self._at_rows(one)
        return found

    @property
    def mode_changes(self) -> list[ModeChange]:
        """When memories change their modes, in order of time; empty where the file has no summary."""
        changes = [ModeChange(c["t"], one["name"], c["from"], c["to"]) for one in self._memories() for c in one["changes"]]
        return sorted(changes, key=lambda change: change.t)

    def _memories(self) -> list[dict[str, Any]]:
        return self._answer.summary.get("memories", [])

    def _at_rows(self, memory: dict[str, Any]) -> np.ndarray:
        names = np.array([memory["start"], *(change["to"] for change in memory["changes"])])
        return names[np.searchsorted([change["t"] for change in memory["changes"]], self.t, side="right")]

    def _mode_series(self) -> list[tuple[str, str, np.ndarray]]:
        return [
            (one["name"], "", np.array([float(one["modes"].index(mode)) for mode in self._at_rows(one)]))
            for one in self._memories()
        ]

    @property
    def switches(self) -> list[Switch]:
        """When constraints become active and inactive, interpolated between the rows. Where y may jump, and where the
        distances of rows differ, only the rows before and after are known: the middle, and half the distance as error. A
        file without a summary, such as CSV, does not tell free rows, whose changes of sign are here too."""
        h = np.diff(self.t)
        lines = self.continuous and bool(np.all(np.abs(h - h.mean()) <= 1e-6 * h.mean())) if h.size else True
        free = sorted(self._answer.summary.get("free_rows", []))
        return [Switch(*s) for s in _core.switches_of_rows(*map(_doubles, (self.t, self.y)), lines, free)]

    def _page(self) -> str:
        found = "these rows are between those of a file; report its result, bromwich.load(path).report(...)"
        require(bool(self._name), "report", found)
        return _core.page_of_file(self._name)

    def _provenance(self) -> dict[str, Any]:
        return {}

    def _span(self) -> tuple[float, float]:
        if not len(self.t):
            raise Error("t: the file has no rows; solve again", "t")
        return float(self.t[0]), float(self.t[-1])

    def _words(self) -> list[str]:
        """The parts of the text of ``repr``."""
        words = [f"{self.status}" + (f" by {self.method}" if self.method else "")]
        words += [self.reason] if self.reason else []
        words += [f"residual {self.residual:.1e}"] if math.isfinite(self.residual) else []
        words += [estimate] if (estimate := self._estimate()) else []
        words.append(f"{len(self.t)} rows" + (f" up to t = {self.t[-1]:g}" if len(self.t) else ""))
        words += [f"warning: {self.warning}"] if self.warning else []
        return words


class _Answer:
    """Arrays with the interface by which :class:`Result` reads the library's answer."""

    def __init__(self, arrays: dict[str, np.ndarray], facts: dict[str, Any]) -> None:
        rows = len(arrays["t"])
        self.t = arrays["t"]
        self.y = arrays.get("y", np.empty((rows, 0)))
        self.x = arrays.get("x", np.empty((rows, 0)))
        self.w = arrays.get("w")
        self.y_left = np.empty((0, 0))
        self.x_components = [int(i) for i in arrays.get("state", [])]
        self.constraint_names: Any = arrays.get("constraint_name", [])
        self.state_names: Any = arrays.get("state_name", [])
        self._facts = facts
        self.others = {key: values for key, values in arrays.items() if "." in key}  # NAME.lt, NAME.state of contacts
        try:
            self.summary = json.loads(facts.get("summary", "{}"))
        except ValueError:
            self.summary = {}
        self.seconds = self.summary.get("seconds") or {"total": facts.get("seconds", math.nan)}
        self.errors = self.summary.get("errors")
        self.certificate = self.summary.get("certificate")
        self.goal = self.summary.get("goal")

    # Facts and their values where a file does not have them.
    ABSENT = {
        "status": "solved",
        "reason": "",
        "warning": "",
        "method": "",
        "backend": "",
        "kernel": "",
        "residual": math.nan,
        "kernel_error": math.nan,
        "error_estimate": None,
        "error_estimate_of": "",
        "boundary_residual": None,
        "infeasible_at": None,
        "continuous": True,
        "starts_with_impulse": False,
        "iterations": 0,
    }

    def __getattr__(self, name: str) -> Any:
        if name in self.ABSENT:
            value = self._facts.get(name, self.ABSENT[name])
            return bool(value) if isinstance(self.ABSENT[name], bool) else value
        if name == "steps":
            return int(self._facts.get("steps", max(len(self.t) - 1, 0)))
        if name in ("cycles", "bytes"):
            return self.summary.get(name, 0)
        if name == "history":
            return []
        raise AttributeError(name)

    def y_integral(self) -> np.ndarray:
        raise Error("y_integral: is not in the file; solve again, or integrate y", "y_integral")

    def switches(self, with_errors: bool) -> list[Any]:
        raise Error("switches_with_errors: needs the scene, which is not in the file; use switches", "switches")

    def between(self, times: list[float]) -> dict[str, np.ndarray]:
        wanted = np.array(times)
        if not self.continuous and not np.all(np.isin(wanted, self.t)):
            raise Error("t: y may jump between the rows of the file; give times of rows", "t")
        between = {"t": wanted}
        for key in ("y", "x"):
            values = getattr(self, key)
            columns = [np.interp(wanted, self.t, column) for column in values.T]
            between[key] = np.array(columns).T.reshape(len(wanted), values.shape[1])
        for key, value in (("state", self.x_components), ("constraint_name", self.constraint_names)):
            between[key] = np.array(value)
        between["state_name"] = np.array(self.state_names)
        return between


def _doubles(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float64)


def _load_hdf5(name: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    try:
        found = _hdf5.read(name)
    except _hdf5.Refused as refused:
        raise Error(f"path: {refused}", "path") from None
    facts = {**found.pop("facts"), "_units": found.pop("units")}
    found.update((key, np.asarray(values)) for key, _, values in found.pop("others") if "." in key)
    return found, facts


def _load_csv(name: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    with open(name, encoding="utf-8") as file:
        lines = file.read().splitlines()
    header = lines[0].split(",") if lines else []
    if header[:1] != ["t"]:
        return {}, {}
    facts: dict[str, Any] = {"status": "solved"}
    rows = []
    for number, line in enumerate(lines[1:], 2):
        if line.startswith("# ended"):
            status, _, facts["reason"] = line.split(": ", 1)[1].partition(", ")
            facts["status"] = status
        elif not line.startswith("#"):
            try:
                rows.append([float(word) for word in line.split(",")])
            except ValueError as error:
                raise Error(f"path: {name!r}, line {number}: {error}; give numbers", "path") from None
            if len(rows[-1]) != len(header):
                found = f"has {len(rows[-1])} values under {len(header)} names"
                raise Error(f"path: {name!r}, line {number}: {found}; give one for each", "path")
    values = np.array(rows).reshape(len(rows), len(header))
    arrays = {"t": values[:, 0].copy()}
    facts["_columns"] = {word: values[:, i] for i, word in enumerate(header)}
    numbered = {key: [i for i, word in enumerate(header) if word[:1] == key and word[1:].isdigit()] for key in "yx"}
    for key, second in (("y", "constraint"), ("x", "state")):
        if numbered[key]:
            arrays[key] = values[:, numbered[key]]
            arrays[second] = np.array([int(header[i][1:]) for i in numbered[key]])
            arrays[f"{second}_name"] = np.array([header[i] for i in numbered[key]])
    return arrays, facts
