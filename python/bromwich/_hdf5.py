"""HDF5 files by h5py, in the layout of the command (``docs/output.md``): for :meth:`Result.save`, and for the command of
the package, whose compiled part calls the functions of this file (``python/src/result_files.cpp``)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

# `library`, `read`, `read_checkpoint` and `write_checkpoint` are for the compiled part.
from ._hdf5_file import Facts, HdfFile, Refused, append, chunk_rows, flush_rows, library
from ._hdf5_reading import SECOND, read, read_checkpoint, read_sweep, write_checkpoint

MEANINGS = {
    "t": "time",
    "y": "complementary variable y",
    "w": "complementary variable w = N x + M y + g",
    "x": "state",
}
VALUES_PER_SWEEP_CHUNK = 1 << 15
STRIP = 2  # points across the image of a result without states


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
                    append(self.data[key], written, values)
        self.file.flush()

    def set(self, facts: Facts) -> None:
        self.file.set(facts)

    def add(self, series: Iterable[tuple[str, str, Any]]) -> None:
        for name, meaning, values in series:
            made = self._add(name, (), "", meaning)
            with self.file.writing():
                append(made, 0, values)
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
            key: (
                file.growing(data, key, np.float64, shape, self.chunk_rows),
                file.growing(offsets, key, np.int64, (), chunk_rows(1)),
            )
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
                append(values, written, self._on_points(key, rows[key]))
                append(offsets, written, np.arange(written, written + len(t)))
            append(self.times, written, t)
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
        for key, values in (("y", y), ("w", w), ("x", x)):
            if key in self.data:
                given[key] = values.reshape(len(residual), self.rows, -1)
        for key, values in given.items():
            self.waiting[key].append(values)
            self._write(key, self.data[key].chunks[0])
        self.file.flush()

    def _write(self, key: str, multiple: int) -> None:
        """Whole chunks: one that is written twice takes twice the space."""
        values = np.concatenate(self.waiting[key])
        count = len(values) // multiple * multiple
        with self.file.writing():
            append(self.data[key], self.written[key], values[:count])
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
