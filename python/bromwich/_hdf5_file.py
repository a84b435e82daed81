"""An HDF5 file that this process alone writes, and others may read at any time. By h5py."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

# Of a chunk, of a flush, and of the chunks of narrow results: rows are read one by one as well.
VALUES_PER_CHUNK, VALUES_PER_FLUSH, MOST_ROWS_PER_CHUNK = 1 << 17, 1 << 19, 1 << 12

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


def append(dataset: Any, written: int, values: Any) -> None:
    dataset.resize(written + len(values), axis=0)
    dataset[written : written + len(values)] = values
