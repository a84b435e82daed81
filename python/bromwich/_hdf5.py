"""HDF5 files by h5py, in the layout of the command (``docs/output.md``): for :meth:`Result.save`, and for the command of
the package, whose compiled part calls the functions at the end (``python/src/result_files.cpp``)."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

MEANINGS = {
    "t": "time",
    "y": "complementary variable y",
    "w": "complementary variable w = N x + M y + g",
    "x": "state",
}
SECOND = {"y": "constraint", "w": "constraint", "x": "state"}
# Of a chunk, of a flush, and of the chunks of narrow results: rows are read one by one as well.
VALUES_PER_CHUNK, VALUES_PER_FLUSH, MOST_ROWS_PER_CHUNK = 1 << 17, 1 << 19, 1 << 12
VALUES_PER_SWEEP_CHUNK = 1 << 15
STRIP = 2  # points across the image of a result without states
CHECKPOINT = "bromwich-checkpoint/1"
WRITTEN = "give a file that 'bromwich solve --out' has written"

Facts = Mapping[str, Any]


class Refused(Exception):
    """What was found, and the remedy. The caller knows the argument."""

    def __init__(self, found: str, remedy: str) -> None:
        super().__init__(f"{found}; {remedy}")
        self.found, self.remedy = found, remedy


def library(name: str) -> Any:
    try:
        import h5py
    except ImportError:
        raise Refused(f"{name!r} needs h5py, which is not installed", "pip install h5py, or use a file .npz") from None
    return h5py


def chunk_rows(width: int) -> int:
    return min(max(VALUES_PER_CHUNK // max(width, 1), 1), MOST_ROWS_PER_CHUNK)


def flush_rows(width: int) -> int:
    rows, chunk = max(VALUES_PER_FLUSH // max(width, 1), 1), chunk_rows(width)
    return max(rows // chunk, 1) * chunk


class HdfFile:
    """A file that this process alone writes and others may read at any time, or an image of one in memory.

    Metadata reaches the file by flushes alone: what a killed process leaves is the state of the last flush.
    """

    # What could not be written, with all objects on the way there: HDF5 may end the process when it closes them.
    failed: list[Exception] = []

    def __init__(self, name: str, continued: bool = False, in_memory: bool = False) -> None:
        self.h5py, self.name, self._lock = library(name), name, None
        self.file: Any = None
        self.broken = False
        if in_memory:  # a file that cannot be written, on a full disk, would end the process
            self.file = self.h5py.File(name, "w", driver="core", backing_store=False, block_size=1 << 20)
            return
        self._lock = _lock(name)
        access = _access(self.h5py)
        with self.writing():
            if continued:
                self.file = self.h5py.File(self.h5py.h5f.open(os.fsencode(name), self.h5py.h5f.ACC_RDWR, fapl=access))
                return
            creation = self.h5py.h5p.create(self.h5py.h5p.FILE_CREATE)
            # What the last flush refers to is not overwritten.
            creation.set_file_space_strategy(self.h5py.h5f.FSPACE_STRATEGY_NONE, False, 1)
            creation.set_link_creation_order(self.h5py.h5p.CRT_ORDER_TRACKED | self.h5py.h5p.CRT_ORDER_INDEXED)
            made = self.h5py.h5f.create(os.fsencode(name), self.h5py.h5f.ACC_TRUNC, fcpl=creation, fapl=access)
            self.file = self.h5py.File(made)

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Names the file where it cannot be written."""
        if self.broken:
            raise Refused(f"{self.name!r} could not be written before", "choose another file")
        try:
            yield
        except (OSError, RuntimeError, ValueError) as error:
            self.broken = True
            found = re.search(r"errno = (\d+)", str(error))
            number = getattr(error, "errno", None) or (int(found[1]) if found else 0)
            full = number in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
            remedy = "free some space, raise ulimit -f, or choose another folder" if full else "choose another file"
            why = os.strerror(number) if number else str(error)
            refused = Refused(f"{self.name!r} could not be written ({why}); rows before stay in it", remedy)
            HdfFile.failed += [error, refused]
            raise refused from None

    def flush(self) -> None:
        with self.writing():
            self.file.flush()
            end = self.file.id.get_filesize()
            if self._lock is not None and os.stat(self.name).st_size < end:
                os.truncate(self.name, end)  # a reader expects the whole length

    def image(self) -> bytes:
        self.file.flush()
        return self.file.id.get_file_image()

    def close(self) -> None:
        if self.broken:
            return
        self.file.close()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def set(self, facts: Facts) -> None:
        with self.writing():
            for key, value in facts.items():
                self.file.attrs[key] = value
        self.flush()

    def text(self, name: str) -> str:
        found = self.file.attrs.get(name, "")
        return found if isinstance(found, str) else ""

    def growing(self, group: Any, name: str, kind: Any, row: Sequence[int], rows: int) -> Any:
        """A dataset without rows yet. One row may be too large for a chunk."""
        chunk, size = [rows, *row], int(np.prod([rows, *row]))
        for i in range(1, len(chunk)):
            if size > VALUES_PER_CHUNK:
                others = size // chunk[i]
                chunk[i] = max(1, VALUES_PER_CHUNK // others)
                size = others * chunk[i]
        nothing = {"fillvalue": np.nan} if kind == np.float64 else {}
        with self.writing():
            return group.create_dataset(
                name, shape=(0, *row), maxshape=(None, *row), dtype=kind, chunks=tuple(chunk), compression=1,
                shuffle=True, **nothing,
            )

    def texts(self, name: str, values: Iterable[str]) -> Any:
        return self.file.create_dataset(name, data=np.array(list(values), dtype=object), dtype=self.h5py.string_dtype())

    def scale(self, name: str, values: Any) -> Any:
        made = self.file.create_dataset(name, data=values)
        made.make_scale(name)
        return made


def _access(h5py: Any) -> Any:
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_file_locking(False, True)  # others may read
    cache = access.get_mdc_config()
    cache.evictions_enabled = False
    cache.incr_mode = cache.flash_incr_mode = cache.decr_mode = 0
    access.set_mdc_config(cache)
    return access


def _lock(name: str) -> int:
    """The lock that the command takes, until it is closed."""
    try:
        descriptor = os.open(name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise Refused(f"{name!r} cannot be written ({error.strerror})", "choose another file") from None
    try:
        fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES):
            os.close(descriptor)
            found, remedy = "is being written by another process", "choose another file, or wait until that one has ended"
            raise Refused(f"{name!r} {found}", remedy) from None
    return descriptor


def _append(dataset: Any, written: int, values: Any) -> None:
    dataset.resize(written + len(values), axis=0)
    dataset[written : written + len(values)] = values


class ResultRows:
    """t, y, w and x with their dimension scales, as netCDF-4, h5netcdf and xarray expect them."""

    def __init__(self, file: HdfFile, columns: SimpleNamespace, expected_rows: int, facts: Facts) -> None:
        n, k = columns.constraints, len(columns.states)
        self.file, width = file, max(n, k)
        self.chunk_rows, self.flush_rows = min(max(expected_rows, 1), chunk_rows(width)), flush_rows(width)
        file.set(facts)
        with file.writing():
            if n > 0:
                self._add_scale("constraint", range(n), columns.constraint_names)
            if k > 0:
                self._add_scale("state", columns.states, columns.state_names)
        self.data: dict[str, Any] = {}
        self._add("t", (), columns.units.get("t", ""), MEANINGS["t"])
        self.data["t"].make_scale("t")
        for key, width in (("y", n), ("w", n if columns.slack else 0), ("x", k)):
            if width > 0:
                self._add(key, (width,), columns.units.get(key, ""), MEANINGS[key])
        file.flush()

    def _add_scale(self, name: str, numbers: Iterable[int], names: Iterable[str]) -> None:
        scale = self.file.scale(name, np.array(list(numbers), dtype=np.int64))
        self.file.texts(f"{name}_name", names).dims[0].attach_scale(scale)

    def _add(self, name: str, row: tuple[int, ...], unit: str, meaning: str) -> Any:
        made = self.file.growing(self.file.file, name, np.float64, row, self.chunk_rows)
        with self.file.writing():
            if self.data:
                made.dims[0].attach_scale(self.data["t"])
            if row:
                made.dims[1].attach_scale(self.file.file[SECOND[name]])
            made.attrs["long_name"] = meaning
            if unit:
                made.attrs["units"] = unit
        self.data[name] = made
        return made

    @classmethod
    def continued(cls, file: HdfFile, columns: SimpleNamespace, rows: int, run: str) -> ResultRows:
        """An existing file, cut after its first rows."""
        self = cls.__new__(cls)
        n, k = columns.constraints, len(columns.states)
        self.file, self.data = file, {}
        self.chunk_rows, self.flush_rows = chunk_rows(max(n, k)), flush_rows(max(n, k))
        _require_run(file, run)
        for key, width in (("t", 1), ("y", n), ("w", n if columns.slack else 0), ("x", k)):
            found = file.file.get(key)
            if (found is not None) != (width > 0) or (found is not None and found.shape[1:] not in ((), (width,))):
                remedy = "ask for the same columns, or choose a new file"
                raise Refused(f"{file.name!r} has other columns of {key}", remedy)
            if found is not None:
                self.data[key] = found
        if len(self.data["t"]) < rows:
            found = f"{file.name!r} has {len(self.data['t'])} rows and the checkpoint is at row {rows - 1}"
            raise Refused(found, "choose a new file: it gets the rows from the checkpoint on")
        with file.writing():
            for one in self.data.values():
                one.resize(rows, axis=0)
        file.flush()
        return self

    def write(self, t: Any, y: Any, w: Any, x: Any, written: int) -> None:
        with self.file.writing():
            for key, values in (("t", t), ("y", y), ("w", w), ("x", x)):
                if key in self.data:
                    _append(self.data[key], written, values)
        self.file.flush()

    def set(self, facts: Facts) -> None:
        self.file.set(facts)

    def add(self, series: Iterable[tuple[str, str, Any]]) -> None:
        for name, meaning, values in series:
            made = self._add(name, (), "", meaning)
            with self.file.writing():
                _append(made, 0, values)
        self.file.flush()

    def close(self) -> None:
        self.file.close()


class FieldRows:
    """VTKHDF 2.0, images over time: x on the rectangle, y and w of a constraint on all points of its line, or of the half of
    it that is next to the constraint."""

    def __init__(self, file: HdfFile, grid: Sequence[float], columns: SimpleNamespace, expected_rows: int, facts: Facts):
        self._measure(file, grid, columns)
        self.chunk_rows: int = min(max(expected_rows, 1), self.chunk_rows)
        file.set({**facts, "constraints": columns.constraints})
        with file.writing():
            image = file.file.create_group("VTKHDF")
            steps = image.create_group("Steps")
            self._describe(image, grid, bool(columns.states))
            data, offsets = image.create_group("PointData"), steps.create_group("PointDataOffsets")
        shape = (self.along, self.across)
        self.fields = {
            key: (file.growing(data, key, np.float64, shape, self.chunk_rows), file.growing(offsets, key, np.int64, (), chunk_rows(1)))
            for key in self.keys
        }
        self.times, self.steps = file.growing(steps, "Values", np.float64, (), chunk_rows(1)), steps
        self._count(0)

    def _measure(self, file: HdfFile, grid: Sequence[float], columns: SimpleNamespace) -> None:
        self.file, self.along = file, int(grid[0])
        self.across = int(grid[1]) if columns.states else STRIP
        self.keys = (["x"] if columns.states else []) + ["y"] + (["w"] if columns.slack else [])
        name = repr(file.name)
        if columns.constraints not in (self.along, 2 * self.along):
            raise Refused(f"{name} needs one constraint per line of the grid, or two", "write a file .h5")
        if columns.states and len(columns.states) != self.along * self.across:
            raise Refused(f"{name} holds x of all points or of none", "add --states all or --states none")
        if self.along < 2 or self.across < 2:
            raise Refused(f"{name} needs a grid of at least 2 x 2 points", "write a file .h5")
        self.chunk_rows, self.flush_rows = (f(self.along * self.across) for f in (chunk_rows, flush_rows))

    def _describe(self, image: Any, grid: Sequence[float], with_states: bool) -> None:
        along_dx, across_dx, along_first, across_first = grid[2:]
        first = across_first or across_dx
        image.attrs["Version"] = np.array([2, 0], dtype=np.int64)
        image.attrs.create("Type", np.bytes_("ImageData"))
        image.attrs["WholeExtent"] = np.array([0, self.across - 1, 0, self.along - 1, 0, 0], dtype=np.int64)
        image.attrs["Origin"] = np.array([first if with_states else 0.0, along_first or along_dx, 0])
        image.attrs["Spacing"] = np.array([across_dx, along_dx, 1])
        image.attrs["Direction"] = np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 1])

    @classmethod
    def continued(cls, file: HdfFile, grid: Sequence[float], columns: SimpleNamespace, rows: int, run: str) -> FieldRows:
        self = cls.__new__(cls)
        self._measure(file, grid, columns)
        _require_run(file, run)
        image, remedy = file.file["VTKHDF"], "choose a new file: it gets the rows from the checkpoint on"
        self.steps, self.times = image["Steps"], image["Steps/Values"]
        for key in self.keys:
            if key not in image["PointData"]:
                raise Refused(f"{file.name!r} has no {key}", remedy)
            if image["PointData"][key].shape[1:] != (self.along, self.across):
                raise Refused(f"{file.name!r} is of another grid", remedy)
        if len(self.times) < rows:
            raise Refused(f"{file.name!r} ends before the checkpoint", remedy)
        self.fields = {key: (image["PointData"][key], image["Steps/PointDataOffsets"][key]) for key in self.keys}
        self._count(rows)
        with file.writing():
            for one in (self.times, *(part for field in self.fields.values() for part in field)):
                one.resize(rows, axis=0)
        file.flush()
        return self

    def write(self, t: Any, y: Any, w: Any, x: Any, written: int) -> None:
        rows = {"y": y, "w": w, "x": x}
        with self.file.writing():
            for key, (values, offsets) in self.fields.items():
                _append(values, written, self._on_points(key, rows[key]))
                _append(offsets, written, np.arange(written, written + len(t)))
            _append(self.times, written, t)
        self.file.flush()  # the rows are there before they are counted
        self._count(written + len(t))

    def _on_points(self, key: str, values: np.ndarray) -> np.ndarray:
        if key == "x":
            return values.reshape(-1, self.along, self.across)
        points = np.repeat(values[:, : self.along, None], self.across, axis=2)
        if values.shape[1] == 2 * self.along:
            points[:, :, (self.across + 1) // 2 :] = values[:, self.along :, None]
        return points

    def _count(self, rows: int) -> None:
        with self.file.writing():
            self.steps.attrs["NSteps"] = np.int64(rows)
        self.file.flush()

    def set(self, facts: Facts) -> None:
        self.file.set(facts)

    def add(self, series: Iterable[tuple[str, str, Any]]) -> None:
        """It has fields alone."""

    def close(self) -> None:
        self.file.close()


class SweepRows:
    """One array for all scenes and times, with the parameters as coordinates."""

    def __init__(self, file: HdfFile, columns: SimpleNamespace, names: Sequence[str], scenes: int, t: np.ndarray) -> None:
        self.file, self.names, self.rows = file, list(names), len(t)
        with file.writing():
            self.scene, time = file.scale("scene", np.arange(scenes, dtype=np.int64)), file.scale("t", t)
            self.data = {name: self._variable(name, (), ()) for name in (*names, "residual")}
            n, k = columns.constraints, len(columns.states)
            constraint = file.scale("constraint", np.arange(n, dtype=np.int64))
            for key in ("y", "w") if columns.slack else ("y",):
                self.data[key] = self._variable(key, (self.rows, n), (time, constraint))
            file.texts("constraint_name", columns.constraint_names).dims[0].attach_scale(constraint)
            if k > 0:
                state = file.scale("state", np.array(columns.states, dtype=np.int64))
                self.data["x"] = self._variable("x", (self.rows, k), (time, state))
                file.texts("state_name", columns.state_names).dims[0].attach_scale(state)
        self.waiting: dict[str, list[np.ndarray]] = {key: [] for key in self.data}
        self.written = dict.fromkeys(self.data, 0)

    def _variable(self, name: str, shape: tuple[int, ...], scales: Iterable[Any]) -> Any:
        width = int(np.prod([max(1, length) for length in shape]))
        rows = min(max(VALUES_PER_SWEEP_CHUNK // width, 1), VALUES_PER_SWEEP_CHUNK)
        made = self.file.growing(self.file.file, name, np.float64, shape, rows)
        made.dims[0].attach_scale(self.scene)
        for axis, scale in enumerate(scales, 1):
            made.dims[axis].attach_scale(scale)
        if shape:
            made.attrs["coordinates"] = " ".join(self.names)
        return made

    def append(self, parameters: np.ndarray, residual: np.ndarray, y: np.ndarray, w: np.ndarray, x: np.ndarray) -> None:
        given = {name: parameters[:, i] for i, name in enumerate(self.names)} | {"residual": residual}
        given |= {key: values.reshape(len(residual), self.rows, -1) for key, values in (("y", y), ("w", w), ("x", x)) if key in self.data}
        for key, values in given.items():
            self.waiting[key].append(values)
            self._write(key, self.data[key].chunks[0])
        self.file.flush()

    def _write(self, key: str, multiple: int) -> None:
        """Whole chunks: one that is written twice takes twice the space."""
        values = np.concatenate(self.waiting[key])
        count = len(values) // multiple * multiple
        with self.file.writing():
            _append(self.data[key], self.written[key], values[:count])
        self.written[key] += count
        self.waiting[key] = [values[count:]]

    def finish(self, status: Iterable[str], reason: Iterable[str], warning: Iterable[str], facts: Facts) -> None:
        for key in self.data:
            self._write(key, 1)
        with self.file.writing():
            for name, texts in (("status", status), ("reason", reason), ("warning", warning)):
                self.file.texts(name, texts).dims[0].attach_scale(self.scene)
        self.file.set(facts)

    def close(self) -> None:
        self.file.close()


def _require_run(file: HdfFile, run: str) -> None:
    if file.text("run") != run:
        found, remedy = "is not of the run of the checkpoint", "choose a new file: it gets the rows from the checkpoint on"
        raise Refused(f"{file.name!r} {found}", remedy)


# What the compiled part calls.


def create_hdf5(name: str, columns: SimpleNamespace, expected_rows: int, facts: Facts) -> ResultRows:
    return ResultRows(HdfFile(name), columns, expected_rows, facts)


def continue_hdf5(name: str, columns: SimpleNamespace, rows: int, run: str) -> ResultRows:
    return _continued(name, lambda file: ResultRows.continued(file, columns, rows, run))


def create_vtkhdf(name: str, grid: Sequence[float], columns: SimpleNamespace, expected_rows: int, facts: Facts) -> FieldRows:
    return FieldRows(HdfFile(name), grid, columns, expected_rows, facts)


def continue_vtkhdf(name: str, grid: Sequence[float], columns: SimpleNamespace, rows: int, run: str) -> FieldRows:
    return _continued(name, lambda file: FieldRows.continued(file, grid, columns, rows, run))


def create_sweep(name: str, columns: SimpleNamespace, names: Sequence[str], scenes: int, t: np.ndarray) -> SweepRows:
    return SweepRows(HdfFile(name), columns, names, scenes, t)


def _continued(name: str, made: Callable[[HdfFile], Any]) -> Any:
    file = HdfFile(name, continued=True)
    try:
        return made(file)
    except Refused:
        file.close()
        raise


def read(name: str) -> dict[str, Any]:
    """A file of results: ``t``, ``y``, ``w``, ``x`` (those that it has), ``constraint_name``, ``state_name``, ``constraint``
    and ``state``, ``units``, ``others`` (name, meaning and values of further quantities over time) and ``facts``."""
    with _reading(name) as file:
        facts = {key: value.item() if isinstance(value, np.generic) else value for key, value in file.attrs.items()}
        facts = {key: value for key, value in facts.items() if isinstance(value, (str, int, float))}
        found = _read_fields(file, facts) if "VTKHDF/Steps" in file else _read_rows(file)
        if facts.get("status") == "running":
            found = _without_unwritten(found)
        return {**found, "facts": facts}


@contextlib.contextmanager
def _reading(name: str) -> Iterator[Any]:
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
    with _reading(name) as file:
        if file.attrs.get("format") != CHECKPOINT:
            raise Refused(f"{name!r} is no checkpoint of this version", "give a file that --checkpoint has written")
        facts = {key: value.item() if isinstance(value, np.generic) else value for key, value in file.attrs.items()}
        for key in ("run", "scene", "row", "steps", "t", "x", "y"):
            if key not in (file if key in ("x", "y") else facts):
                raise Refused(f"{name!r} is damaged at {key}", "start without --restart")
        totals = {key.removeprefix("total_"): float(value) for key, value in facts.items() if key.startswith("total_")}
        return facts, totals, file["x"][()], file["y"][()]
