"""Reads files of results in HDF5 and VTKHDF, and checkpoints (``docs/output.md``)."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from ._hdf5_file import Facts, HdfFile, Refused, library

SECOND = {"y": "constraint", "w": "constraint", "x": "state"}  # the second dimension of each array
CHECKPOINT = "bromwich-checkpoint/1"
WRITTEN = "give a file that 'bromwich solve --out' has written"


def read(name: str) -> dict[str, Any]:
    """A file of results: ``t``, ``y``, ``w``, ``x`` (those that it has), ``constraint_name``, ``state_name``, ``constraint``
    and ``state``, ``units``, ``others`` (name, meaning and values of further quantities over time) and ``facts``."""
    with reading(name) as file:
        facts = {key: value.item() if isinstance(value, np.generic) else value for key, value in file.attrs.items()}
        facts = {key: value for key, value in facts.items() if isinstance(value, (str, int, float))}
        found = _read_fields(file, facts) if "VTKHDF/Steps" in file else _read_rows(file)
        if facts.get("status") == "running":
            found = _without_unwritten(found)
        return {**found, "facts": facts}


def read_sweep(name: str) -> dict[str, Any] | None:
    """The table of a sweep: ``parameters``, ``columns`` and ``status``, texts, and ``swept`` and ``values``, a row for each
    scene; of each component its value in the last row, and its largest size. None for another file."""
    with reading(name) as file:
        if not all(key in file for key in ("scene", "y", "status")):
            return None
        parameters = str(file["y"].attrs["coordinates"]).split()
        columns, values = [], []
        for key, names in (("y", "constraint_name"), ("x", "state_name")):
            for k, one in enumerate(file[names].asstr()[()] if key in file else ()):
                columns += [f"{one}(T)", f"max|{one}|"]
                values += [file[key][:, -1, k], np.array([np.abs(scene[:, k]).max() for scene in file[key]])]
        return {
            "parameters": parameters,
            "columns": columns,
            "status": list(file["status"].asstr()[()]),
            "swept": np.array([file[key][()] for key in parameters], dtype=np.float64).T,
            "values": np.array(values, dtype=np.float64).T,
        }


@contextlib.contextmanager
def reading(name: str) -> Iterator[Any]:
    if not os.path.isfile(name):
        raise Refused(f"{name!r} is no file", "give a file that exists")
    h5py = library(name)
    try:
        access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
        access.set_file_locking(False, True)  # another process may be writing it
        with h5py.File(h5py.h5f.open(os.fsencode(name), h5py.h5f.ACC_RDONLY, fapl=access)) as file:
            yield file
    except (OSError, RuntimeError, ValueError) as error:
        raise Refused(f"{name!r} could not be read ({error})", "give an HDF5 file that is whole") from None


def _read_rows(file: Any) -> dict[str, Any]:
    if "t" not in file:
        raise Refused(f"{file.filename!r} has no dataset t", WRITTEN)
    found: dict[str, Any] = {}
    for key in ("t", *SECOND):
        if key in file:
            if file[key].ndim not in (1, 2):
                raise Refused(f"{file.filename!r} has a dataset {key} of {file[key].ndim} dimensions", WRITTEN)
            found[key] = np.asarray(file[key][()], dtype=np.float64)
    # A run that was killed may have written a block of one array and not yet of the next.
    rows = min(len(values) for values in found.values())
    found = {key: values[:rows] for key, values in found.items()}
    others = [
        (key, str(one.attrs.get("long_name", "")), one[()])
        for key, one in file.items()
        if key not in found and getattr(one, "shape", None) == (rows,) and one.dtype.kind == "f"
    ]
    for key in ("constraint", "state"):
        if key in file:
            found[key] = file[key][()]
        if f"{key}_name" in file:
            found[f"{key}_name"] = file[f"{key}_name"].asstr()[()].astype(str)
    units = {key: str(file[key].attrs["units"]) for key in ("t", *SECOND) if key in file and "units" in file[key].attrs}
    return {**found, "units": units, "others": others}


def _read_fields(file: Any, facts: Facts) -> dict[str, Any]:
    """The rows that were counted when they were complete."""
    data, count = file["VTKHDF/PointData"], int(file["VTKHDF/Steps"].attrs["NSteps"])
    found: dict[str, Any] = {"t": file["VTKHDF/Steps/Values"][:count]}
    for key in ("y", "w", "x"):
        if key not in data:
            continue
        points = data[key]
        if points.ndim != 3 or len(points) < count:
            raise Refused(f"{file.filename!r} has another layout of {key}", WRITTEN)
        if key == "x":
            found["x"] = points[:count].reshape(count, -1)
            found["state"] = np.arange(found["x"].shape[1])
        else:  # the first point of a line, and with constraints on two sides its last one
            sides = 2 if facts.get("constraints") == 2 * points.shape[1] else 1
            found[key] = np.concatenate([points[:count, :, 0], points[:count, :, -1]][:sides], axis=1)
    return {**found, "units": {}, "others": []}


def _without_unwritten(found: dict[str, Any]) -> dict[str, Any]:
    """Without the last rows of a killed run, whose number the file has and not yet the values: NaN."""
    written = ~np.isnan(found["t"])
    for key in SECOND:
        if key in found and found[key].size > 0:
            written &= ~np.isnan(found[key]).all(axis=1)
    rows = int(np.max(np.nonzero(written)[0], initial=-1)) + 1
    others = [(name, meaning, values[:rows]) for name, meaning, values in found["others"]]
    return {key: value[:rows] if key in ("t", *SECOND) else value for key, value in found.items()} | {"others": others}


def write_checkpoint(name: str, facts: Facts, totals: Facts, x: np.ndarray, y: np.ndarray) -> None:
    """Replaces the file by a complete one, which is on the disk before."""
    file = HdfFile(name, in_memory=True)
    file.file.attrs.update({"format": CHECKPOINT, **facts, **{f"total_{key}": value for key, value in totals.items()}})
    file.file["x"], file.file["y"] = x, y
    image = file.image()
    file.close()
    temporary = f"{name}.tmp"
    try:
        with open(temporary, "wb") as written:
            written.write(image)
            written.flush()
            os.fsync(written.fileno())
        os.replace(temporary, name)
    except OSError as error:
        raise Refused(f"{name!r} could not be written ({error.strerror})", "choose another folder") from None


def read_checkpoint(name: str) -> tuple[dict[str, Any], dict[str, float], np.ndarray, np.ndarray]:
    """Facts, totals, x and y, as :func:`write_checkpoint` takes them."""
    with reading(name) as file:
        if file.attrs.get("format") != CHECKPOINT:
            raise Refused(f"{name!r} is no checkpoint of this version", "give a file that --checkpoint has written")
        facts = {key: value.item() if isinstance(value, np.generic) else value for key, value in file.attrs.items()}
        for key in ("run", "scene", "row", "steps", "t", "x", "y"):
            if key not in (file if key in ("x", "y") else facts):
                raise Refused(f"{name!r} is damaged at {key}", "start without --restart")
        totals = {key.removeprefix("total_"): float(value) for key, value in facts.items() if key.startswith("total_")}
        return facts, totals, file["x"][()], file["y"][()]
