"""What results of many scenes have in common with those of one: names, switches, measures, data sets, files and pictures."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _core
from ._arrays import number
from ._axes import label
from ._errors import Error
from ._io import complete, extension_of
from ._measures import component_of, of_rows
from ._rows import Status, Switch
from ._scene import Scene

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

# With more scenes, a picture of scenes against time is drawn in place of curves.
MOST_CURVES = 10


class BatchOutput:
    """Derived classes have t, y, w, x, status, reason, warning, method, residual and x_components."""

    scene: Scene
    t: np.ndarray
    status: Any
    reason: Any
    warning: Any
    method: Any
    residual: np.ndarray
    x_components: list[int]
    x: Any
    y: Any
    w: Any

    @property
    def constraint_names(self) -> list[str]:
        """Of the last axis of ``y`` and ``w``, where the scenes give them; otherwise empty."""
        return self.scene.names["y"]

    @property
    def state_names(self) -> list[str]:
        """Of the last axis of ``x``, likewise."""
        names = self.scene.names["x"]
        return [names[i] for i in self.x_components] if names else []

    @property
    def switches(self) -> list[list[Switch]]:
        """For each scene when constraints become active and inactive, from its rows: the middle between two rows, and half
        their distance as error. :func:`solve` with ``method="events"`` locates them."""
        free = sorted(self.scene._model.free_rows)
        t = np.ascontiguousarray(self.t)
        return [[Switch(*s) for s in _core.switches_of_rows(t, np.ascontiguousarray(y), False, free)] for y in np.asarray(self.y)]

    def _measured(self, what: str, name: str, start: float | None, end: float | None) -> np.ndarray:
        first, last = float(self.t[0]), float(self.t[-1])
        start, end = first if start is None else number(start, "start"), last if end is None else number(end, "end")
        if not first <= start < end <= last:
            raise Error(f"start: found {start!r} to {end!r}; give start < end from {first!r} to {last!r}", "start")
        kind, column = component_of(name, self.state_names, self.constraint_names, self.x_components, self.y.shape[2])
        return of_rows(self.t, np.asarray(getattr(self, kind))[:, :, column], start, end)[what]

    def mean(self, name: str, start: float | None = None, end: float | None = None) -> np.ndarray:
        """K means of a component over [start, end], linear between the rows.

        Args:
            name: of the component, or ``"x0"``, ``"y0"``, ``"w0"``.
            start, end: None: the first and the last row.
        """
        return self._measured("mean", name, start, end)

    def rms(self, name: str, start: float | None = None, end: float | None = None) -> np.ndarray:
        """K roots of the mean square, as :meth:`mean`."""
        return self._measured("rms", name, start, end)

    def min(self, name: str, start: float | None = None, end: float | None = None) -> np.ndarray:
        """K least values at rows, as :meth:`mean`."""
        return self._measured("min", name, start, end)

    def max(self, name: str, start: float | None = None, end: float | None = None) -> np.ndarray:
        """K largest values at rows, as :meth:`mean`."""
        return self._measured("max", name, start, end)

    def ripple(self, name: str, start: float | None = None, end: float | None = None) -> np.ndarray:
        """:meth:`max` less :meth:`min`: peak to peak."""
        return self._measured("ripple", name, start, end)

    def to_xarray(self) -> xarray.Dataset:
        """A dataset with dimensions ``scene``, ``t``, ``constraint`` and ``state``, with names and units."""
        import xarray

        arrays = self._arrays()
        scales = {"t": ("t",), "status": ("scene",), "reason": ("scene",), "warning": ("scene",), "method": ("scene",)}
        dimensions = {"y": ("scene", "t", "constraint"), "w": ("scene", "t", "constraint"), "x": ("scene", "t", "state")}
        dimensions |= {"residual": ("scene",), "constraint_name": ("constraint",), "state_name": ("state",), "state": ("state",), **scales}
        coordinates = ("t", "state", "constraint_name", "state_name")
        found = {key: (dimensions[key], value) for key, value in arrays.items()}
        data = {key: value for key, value in found.items() if key not in coordinates}
        dataset = xarray.Dataset(data, {key: found[key] for key in coordinates if key in found}, attrs={"title": self.scene.name})
        units = self.scene.units
        for key in ("t", "y", "w", "x"):
            if key in dataset and len(set(units[key])) == 1:
                dataset[key].attrs["units"] = units[key][0]
        return dataset

    def _arrays(self) -> dict[str, np.ndarray]:
        arrays = {"t": self.t, "y": np.asarray(self.y), "residual": self.residual, "status": np.array([str(s) for s in self.status])}
        arrays |= {"reason": np.array(self.reason), "warning": np.array(self.warning), "method": np.array(self.method)}
        if self.w.shape[2] > 0:
            arrays["w"] = self.w
        if self.x.shape[2] > 0:
            arrays |= {"x": np.asarray(self.x), "state": np.array(self.x_components, dtype=int)}
        for key, names in (("constraint_name", self.constraint_names), ("state_name", self.state_names)):
            if names:
                arrays[key] = np.array(names)
        return arrays

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes all scenes.

        Args:
            path: ends in ``.npz`` (NumPy), or in ``.h5`` or ``.nc`` (needs xarray and h5netcdf, and opens with
                ``xarray.open_dataset``).
        """
        name, extension = extension_of(path, (".npz", ".h5", ".nc"))
        with complete(name) as written:
            if extension == ".npz":
                np.savez_compressed(written, allow_pickle=False, **self._arrays())
            else:
                self.to_xarray().to_netcdf(written, engine="h5netcdf")

    def plot(self, name: str = "y0", ax: Axes | None = None) -> Axes:
        """One component of all scenes over time: curves, and with more than ten scenes a map of scenes and times.

        Args:
            name: of the component, or ``"x0"``, ``"y0"``, ``"w0"``.
        """
        import matplotlib.pyplot as plt

        kind, column = component_of(name, self.state_names, self.constraint_names, self.x_components, self.y.shape[2])
        values, units = getattr(self, kind)[:, :, column], self.scene.units
        own = units[kind][self.x_components[column] if kind == "x" else column] if units[kind] else ""
        if ax is None:
            _, ax = plt.subplots(layout="constrained")
            ax.set_title(self.scene.name)
        label(ax.xaxis, "t", units["t"][0] if units["t"] else "", self.t)
        if len(values) > MOST_CURVES:
            mesh = ax.pcolormesh(self.t, np.arange(len(values)), values, shading="nearest", rasterized=True)
            label(ax.figure.colorbar(mesh, ax=ax).ax.yaxis, name, own, values)
            ax.set_ylabel("scene")
            return ax
        for k, one in enumerate(values):
            ax.plot(self.t, one, label=f"scene {k}")
        label(ax.yaxis, name, own, values)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        return ax
