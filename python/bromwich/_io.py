"""Results to files. The layout is that of the command, in ``docs/output.md``."""

from __future__ import annotations

import contextlib
import datetime
import errno
import os
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np

from . import _core, _hdf5
from ._errors import Error
from ._mesh_file import save_mesh
from ._recorded import Recorded

FORMAT = "bromwich-result/1"
HDF5 = (".h5", ".hdf5", ".nc")


def save(result: Recorded, path: str | os.PathLike[str]) -> None:
    """Writes a result; see :meth:`Result.save`."""
    name, extension = extension_of(path, (*HDF5, ".vtkhdf", ".vtu", ".pvd", ".npz", ".csv"))
    if extension in (".vtu", ".pvd"):
        return save_mesh(result, name)
    rows = _valid_rows(result)
    arrays = {"t": result.t[:rows]}
    for key in _hdf5.SECOND:
        values = getattr(result, key)
        if values is not None and values.shape[1] > 0:
            arrays[key] = values[:rows]
    modes = [(name, meaning, values[:rows]) for name, meaning, values in getattr(result, "_mode_series", list)()]
    facts = {**result._attributes(), **result._provenance()}
    with complete(name) as written:
        if extension == ".csv":
            _save_csv(result, written, arrays, modes)
        elif extension == ".npz":
            named = {f"attribute_{key}": np.array(value) for key, value in facts.items()}
            arrays |= {name: values for name, _, values in modes}
            np.savez_compressed(written, allow_pickle=False, **arrays, **_scales(result, arrays), **named)
        else:
            _save_hdf5(result, written, arrays, facts, modes, _grid(result, name) if extension == ".vtkhdf" else None)


@contextlib.contextmanager
def complete(name: str) -> Iterator[str]:
    """A temporary name, renamed to `name` once all is written. With a full disk the old file stays, or none."""
    folder = os.path.dirname(name) or "."
    if not os.path.isdir(folder):
        raise FileNotFoundError(errno.ENOENT, "path: the folder does not exist; create it first", folder)
    stem, extension = os.path.splitext(name)
    written = f"{stem}.{os.getpid()}.part{extension}"
    try:
        yield written
        os.replace(written, name)
    finally:
        if os.path.exists(written):
            os.remove(written)


def extension_of(path: str | os.PathLike[str], extensions: tuple[str, ...]) -> tuple[str, str]:
    name = os.fspath(path)
    extension = os.path.splitext(name)[1].lower()
    if extension not in extensions:
        raise Error(f"path: found {name!r}; end it with {', '.join(extensions)}", "path")
    return name, extension


def _valid_rows(result: Recorded) -> int:
    """Rows up to the last one with a value."""
    rows = len(result.t)
    if result.ok:
        return rows
    finite = np.isfinite(result.y).any(axis=1) | np.isfinite(result.x).any(axis=1)
    return int(np.max(np.nonzero(finite)[0], initial=-1)) + 1


def _scales(result: Recorded, arrays: dict[str, np.ndarray], named: bool = True) -> dict[str, np.ndarray]:
    """The second dimensions: numbers and names, those of the scene or y0, x0, ..."""
    numbers = {"constraint": np.arange(result.y.shape[1], dtype=np.int64)}
    if "x" in arrays:
        numbers["state"] = np.array(result.x_components, dtype=np.int64)
    scales: dict[str, np.ndarray] = {}
    for key, letter in (("constraint", "y"), ("state", "x")):
        if key not in numbers or numbers[key].size == 0:
            continue
        names = list(getattr(result, f"{key}_names")) if named else []
        names = names or [f"{letter}{i}" for i in numbers[key]]
        scales[key], scales[f"{key}_name"] = numbers[key], np.array(names)
    return scales


def _grid(result: Recorded, name: str) -> tuple[float, ...]:
    """The points of a scene on a rectangle."""
    grid = getattr(getattr(result.scene, "_model", None), "grid", None)
    if grid is None:
        raise Error(f"path: {name!r} is for fields on a grid of a rectangle, which the scene does not have; use .h5", "path")
    if len(result.x_components) not in (0, grid[0] * grid[1]):
        raise Error(f"path: {name!r} holds x of all points or of none; solve with states='all' or 'none'", "path")
    return grid


Series = list[tuple[str, str, np.ndarray]]  # name, meaning and values at the rows


def _save_hdf5(
    result: Recorded,
    name: str,
    arrays: dict[str, np.ndarray],
    facts: dict[str, Any],
    modes: Series,
    grid: tuple[float, ...] | None,
) -> None:
    scales = _scales(result, arrays)
    columns = SimpleNamespace(
        constraints=arrays["y"].shape[1] if "y" in arrays else 0,
        slack="w" in arrays,
        states=list(scales.get("state", [])),
        constraint_names=list(scales.get("constraint_name", [])),
        state_names=list(scales.get("state_name", [])),
        units=result.units,
    )
    try:
        file, rows = _hdf5.HdfFile(name, in_memory=True), len(arrays["t"])
        written: Any = (
            _hdf5.FieldRows(file, grid, columns, rows, facts) if grid else _hdf5.ResultRows(file, columns, rows, facts)
        )
    except _hdf5.Refused as refused:
        raise Error(f"path: {refused}", "path") from None
    written.write(arrays["t"], arrays.get("y"), arrays.get("w"), arrays.get("x"), 0)
    if modes:
        written.add(modes)
    image = written.file.image()
    written.close()
    with open(name, "wb") as whole:
        whole.write(image)


def _shortest(value: float) -> str:
    text = repr(float(value))
    return text[:-2] if text.endswith(".0") else text


def _save_csv(result: Recorded, name: str, arrays: dict[str, np.ndarray], modes: Series) -> None:
    scales = _scales(result, arrays, named=False)  # the letters of the header tell y from x
    columns = [arrays["t"][:, None], result.y[: len(arrays["t"])], arrays.get("x", np.empty((len(arrays["t"]), 0)))]
    columns += [values[:, None] for _, _, values in modes]
    header = ["t", *scales.get("constraint_name", []), *scales.get("state_name", []), *(name for name, _, _ in modes)]
    with open(name, "w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(header) + "\n")
        for row in zip(*(part for part in columns)):
            file.write(",".join(_shortest(value) for part in row for value in part) + "\n")
        if not result.ok:
            end = f"at t = {_shortest(arrays['t'][-1])}" if len(arrays["t"]) else "before t = 0"
            file.write(f"# ended {end}: {result.status}, {result.reason or 'no reason was given'}\n")


# Members of results that are attributes of their files. A nonlinear result does not have all of them.
FACTS = (
    "reason warning method backend kernel steps iterations residual kernel_error seconds error_estimate error_estimate_of "
    "boundary_residual infeasible_at"
).split()
FLAGS = ("continuous", "starts_with_impulse")


def attributes(result: Recorded) -> dict[str, Any]:
    """The attributes of a result, as the command writes them."""
    facts: dict[str, Any] = {"format": FORMAT, "scene": result.scene.name, "status": str(result.status)}
    known = {name: getattr(result, name, None) for name in (*FACTS, *FLAGS)}
    known["error_estimate_of"] = known["error_estimate_of"] or None
    facts |= {name: int(value) if name in FLAGS else value for name, value in known.items() if value is not None}
    facts["created"] = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    facts["bromwich_version"] = _core.version
    if rows := _valid_rows(result):
        facts["t_end"] = float(result.t[rows - 1])
    return facts
