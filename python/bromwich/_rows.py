"""What all results have in common: rows over time with names and units, as pictures, datasets and files."""

from __future__ import annotations

import enum
import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ._arrays import on_host
from ._errors import Error
from ._io import attributes, save
from ._measures import integral, largest, span_of
from ._plot import plot
from ._scene import Scene

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


class Status(str, enum.Enum):
    """How a solve ended. Each is a string: ``result.status == "solved"``."""

    solved = "solved"
    tolerance_not_met = "tolerance_not_met"  #: there is a y, but its residual or error is too large
    infeasible = "infeasible"  #: there is no solution from the time ``infeasible_at`` on
    unsupported = "unsupported"  #: the method cannot solve such a scene
    nonfinite = "nonfinite"  #: values that overflow a double
    interrupted = "interrupted"  #: by Ctrl-C, or by ``stop``
    running = "running"  #: of a file: the run goes on, or was killed
    failed = "failed"  #: of a file: the run ended with an error, which the command has printed

    def __str__(self) -> str:
        return self.value


class Switch(NamedTuple):
    """A constraint that becomes active or inactive."""

    t: float
    component: int  #: of y, from 0
    on: bool  #: y becomes positive
    error: float  #: estimated, of t; NaN: not known


class Rows:
    """Rows of ``t``, ``y``, ``w`` and ``x``, how the solve ended, and how it was done. Derived classes know how it is checked."""

    _answer: Any

    def __init__(self, answer: Any, scene: Scene) -> None:
        self._answer, self._scene = answer, scene

    @property
    def scene(self) -> Scene:
        """The scene, as it was given to ``solve`` or the solver."""
        return self._scene

    @property
    def status(self) -> Status:
        """``solved``, or what is wrong."""
        return Status(self._answer.status)

    @property
    def reason(self) -> str:
        """One line where the status is not ``solved``; otherwise empty."""
        return self._answer.reason

    @property
    def warning(self) -> str:
        """One line about uniqueness or accuracy, which a solved result may have too; otherwise empty."""
        return self._answer.warning

    @property
    def t(self) -> np.ndarray:
        """Times, J+1."""
        return self._answer.t

    @property
    def y(self) -> np.ndarray:
        """(J+1) x n."""
        return self._answer.y

    @property
    def w(self) -> np.ndarray | None:
        """(J+1) x n: N x + M y + g, with g as it is at the first access to w."""
        return self._answer.w

    @property
    def x(self) -> np.ndarray:
        """(J+1) x the number of components that were recorded."""
        return self._answer.x

    @property
    def x_components(self) -> list[int]:
        """Which component of the state each column of ``x`` is."""
        return self._answer.x_components

    @property
    def method(self) -> str:
        """The method that solved the scene, or was tried last."""
        return self._answer.method

    @property
    def backend(self) -> str:
        """``"cpu"`` or ``"cuda"``."""
        return self._answer.backend

    @property
    def continuous(self) -> bool:
        """Whether y is linear between its rows; otherwise it may jump from step to step."""
        return self._answer.continuous

    @property
    def error_estimate(self) -> float | None:
        """Relative error of what :attr:`error_estimate_of` says; None: not estimated."""
        return self._answer.error_estimate

    @property
    def error_estimate_of(self) -> str:
        """What :attr:`error_estimate` is the error of: "y and x", or "the mean of y over [0, t]" where y may jump; empty
        without an estimate."""
        return self._answer.error_estimate_of

    @property
    def ok(self) -> bool:
        """Whether the status is ``solved``."""
        return self.status == "solved"

    @property
    def constraint_names(self) -> list[str]:
        """Of the columns of ``y`` and ``w``, where the scene gives them; otherwise empty."""
        return self.scene.names["y"]

    @property
    def state_names(self) -> list[str]:
        """Of the columns of ``x``, likewise."""
        names = self.scene.names["x"]
        return [names[i] for i in self.x_components] if names else []

    @property
    def units(self) -> dict[str, str]:
        """Of ``t``, ``y``, ``w`` and ``x``, where the scene gives one for all components; otherwise an empty text."""
        found = self.scene.units
        return {key: found[key][0] if len(set(found[key])) == 1 else "" for key in ("t", "y", "w", "x")}

    def plot(self, what: str = "auto", *, components: Iterable[int] | None = None, ax: Axes | None = None) -> Any:
        """Draws y, x or w over time with matplotlib; many components as a picture over time.

        Args:
            what: ``"y"``, ``"x"``, ``"w"``, ``"modes"`` (bars of elements with memory), or ``"auto"``: x above y where x was
                recorded, otherwise y.
            components: columns to draw; None: all.
            ax: axes to draw into; None: new ones.

        Returns:
            The axes; an array of two, of x and of y, where both are drawn.
        """
        return plot(self, what, components, ax)

    def to_xarray(self) -> xarray.Dataset:
        """A dataset with dimensions ``t``, ``constraint`` and ``state``, names and units; the rest as attributes."""
        import xarray

        constraint = np.arange(self.y.shape[1])
        variables: dict[str, Any] = {"y": (("t", "constraint"), self.y)}
        if self.w is not None:
            variables["w"] = (("t", "constraint"), self.w)
        if self.x.shape[1] > 0:
            variables["x"] = (("t", "state"), self.x)
        coordinates: dict[str, Any] = {"t": self.t, "constraint": constraint, "state": np.array(self.x_components, dtype=int)}
        for dimension, names in (("constraint", self.constraint_names), ("state", self.state_names)):
            if names and len(names) == len(coordinates[dimension]):
                coordinates[f"{dimension}_name"] = (dimension, names)
        dataset = xarray.Dataset(variables, coordinates, attrs=self._attributes())
        for key, unit in self.units.items():
            if unit and key in dataset:
                dataset[key].attrs["units"] = unit
        return dataset

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the rows up to the last valid one in the layout of the command (``docs/output.md``).

        Args:
            path: ends in ``.h5`` (HDF5, needs h5py; ``xarray.open_dataset(path, engine="h5netcdf")`` opens it), in
                ``.npz`` (NumPy), in ``.csv`` (t, y and x), or, for scenes on a rectangle, in ``.vtkhdf`` (ParaView and VTK,
                needs h5py). For scenes with a mesh, in ``.vtu`` (the last row, meshio) or ``.pvd`` (all rows, in a folder beside
                it). :func:`bromwich.load` reads the others.

        Raises:
            Error: for another extension, or without h5py.
        """
        save(self, path)

    def mean(self, name: str, start: float | None = None, end: float | None = None) -> float:
        """The mean of a component over [start, end], by adaptive quadrature of high order between rows, switches and breakpoints
        (:meth:`at`).

        The mean of y is that of :attr:`Result.y_integral`: impulses count, those of a contact force at impacts.

        Args:
            name: of the component, or ``"x0"``, ``"y0"``, ``"w0"``.
            start, end: None: those of the result. The last period of a scene: ``start=r.scene.T - period``.
        """
        span = span_of(self, name, start, end)
        of_y = self._integral_of_y(span.start, span.end) if span.kind == "y" else None
        return (integral(self, span, 1) if of_y is None else float(of_y[span.column])) / (span.end - span.start)

    def rms(self, name: str, start: float | None = None, end: float | None = None) -> float:
        """The root of the mean square, as :meth:`mean`, without impulses."""
        span = span_of(self, name, start, end)
        return float(np.sqrt(integral(self, span, 2) / (span.end - span.start)))

    def max(self, name: str, start: float | None = None, end: float | None = None) -> float:
        """The largest value over [start, end], also between rows; at a jump those of both sides count."""
        return largest(self, span_of(self, name, start, end), 1)

    def min(self, name: str, start: float | None = None, end: float | None = None) -> float:
        """The least value, as :meth:`max`."""
        return largest(self, span_of(self, name, start, end), -1)

    def ripple(self, name: str, start: float | None = None, end: float | None = None) -> float:
        """:meth:`max` less :meth:`min`: peak to peak."""
        span = span_of(self, name, start, end)
        return largest(self, span, 1) - largest(self, span, -1)

    def _provenance(self) -> dict[str, Any]:
        """What a file says besides of the scene and of how it was solved."""
        return {}

    def _integral_of_y(self, start: float, end: float) -> np.ndarray | None:
        """Of each component over [start, end], with impulses; None where there are none, or they are not known."""
        return None

    def _pieces(self) -> list[float]:
        """When the polynomials of a located solution begin; empty for others."""
        return []

    def _times(self, t: Any) -> list[float]:
        """The times that ``at`` is given, checked."""
        times = np.atleast_1d(on_host(t, "t")).ravel()
        first, last = self._span()
        for time in times[~((times >= first) & (times <= last * (1 + np.finfo(float).eps)))][:1].tolist():
            raise Error(f"t: found {time!r}; give times from {first!r} to {last!r}", "t")
        return times.tolist()

    def _span(self) -> tuple[float, float]:
        """The first and the last time for which ``at`` has values."""
        return 0.0, self.scene.T

    def _attributes(self) -> dict[str, Any]:
        return attributes(self)

    def _estimate(self) -> str:
        """The estimate and what it is of, in words; empty without one."""
        if self.error_estimate is None:
            return ""
        of = self.error_estimate_of
        return f"error estimate {self.error_estimate:.1e}" + (f" of {of}" if of else "")
