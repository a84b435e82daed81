"""Results in files: NPZ, and HDF5 with dimensions that xarray reads."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ._errors import Error
from ._result import Result

ARRAYS = {"t": ("t",), "y": ("t", "constraint"), "w": ("t", "constraint"), "x": ("t", "state")}


def save(result: Result, path: str | os.PathLike[str]) -> None:
    name = os.fspath(path)
    arrays = {key: getattr(result, key) for key in ARRAYS}
    arrays = {key: value for key, value in arrays.items() if value is not None}
    arrays["x_components"] = np.array(result.x_components, dtype=np.int64)
    if name.endswith(".npz"):
        facts = {f"attribute_{key}": np.array(value) for key, value in result._attributes().items()}
        np.savez(name, allow_pickle=False, **arrays, **facts)
    elif name.endswith((".h5", ".hdf5", ".nc")):
        _save_hdf5(result, name, arrays)
    else:
        raise Error(f"path: found {name!r}; end it with .npz or .h5", "path")


def load(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Reads what :meth:`Result.save` has written: arrays by name, and ``attributes``.

    Raises:
        Error: for another extension.
    """
    name = os.fspath(path)
    if name.endswith(".npz"):
        with np.load(name, allow_pickle=False) as file:
            read = {key: file[key] for key in file.files}
        prefix = "attribute_"
        facts = {key[len(prefix) :]: read.pop(key).item() for key in list(read) if key.startswith(prefix)}
        return {**read, "attributes": facts}
    if not name.endswith((".h5", ".hdf5", ".nc")):
        raise Error(f"path: found {name!r}; end it with .npz or .h5", "path")
    import h5py

    with h5py.File(name) as file:
        read = {key: file[key][()] for key in (*ARRAYS, "x_components") if key in file}
        return {**read, "attributes": dict(file.attrs)}


def _save_hdf5(result: Result, name: str, arrays: dict[str, np.ndarray]) -> None:
    import h5py

    with h5py.File(name, "w") as file:
        for key, value in result._attributes().items():
            file.attrs[key] = value
        scales = {
            "t": arrays["t"],
            "constraint": np.arange(result.y.shape[1]),
            "state": np.array(result.x_components, dtype=np.int64),
        }
        for key, values in scales.items():
            file.create_dataset(key, data=values).make_scale(key)
        for key, dimensions in ARRAYS.items():
            if key == "t" or key not in arrays:
                continue
            file.create_dataset(key, data=arrays[key])
            for axis, dimension in enumerate(dimensions):
                file[key].dims[axis].attach_scale(file[dimension])
        file.create_dataset("x_components", data=arrays["x_components"])
        file["x_components"].dims[0].attach_scale(file["state"])
