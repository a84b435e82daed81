"""Results: the solution, its status and its errors."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any, overload

import numpy as np

from . import _core
from ._arrays import number, whole_number
from ._balance import Balance, ElementPower
from ._contacts import ContactReport, contact_series, report_of
from ._derivative import Derivative
from ._errors import require
from ._io import complete, extension_of
from ._memory import ModeChange, mode_changes, mode_series, modes_at_rows
from ._parameters import ParameterDerivative
from ._rows import Rows, Switch
from ._scene import Scene
from ._sources import restored


class Result(Rows):
    """The result of a solve. Arrays are read-only views without a copy; they keep the result alive.

    ``t`` has J+1 times; ``y``, ``x``, ``w`` have one row for each. Rows after the last valid time are NaN.
    """

    def __reduce__(self) -> tuple:
        """Pickles the arrays with the scene; the copy computes later values on the host."""
        return _restored, (self._scene, _core.state_of_answer(self._answer))

    @property
    def y_left(self) -> np.ndarray:
        """J x n, method galerkin: y at the left end of step j, of Radau IIA at a third of it. Otherwise 0 x 0."""
        return self._answer.y_left

    @property
    def y_integral(self) -> np.ndarray:
        """(J+1) x n: the integral of y over [0, t_j], impulses that move the state included. Computed at each call."""
        return self._answer.y_integral()

    @property
    def residual(self) -> float:
        """max_j ||min(y, w)|| / max(1, ||N x + g||) in the maximum norm; NaN where no solution was evaluated."""
        return self._answer.residual

    @property
    def boundary_residual(self) -> float | None:
        """max |E0 x(0) + ET x(T) - b| / max(1, max |b|); None without boundary values."""
        return self._answer.boundary_residual

    @property
    def multipliers(self) -> np.ndarray:
        """Method ``shooting``, periodic conditions: the eigenvalues of the derivative of x(T) by x(0), the largest first.

        Perturbations of the periodic state decay where all are less than 1 in size. Empty for others.
        """
        return np.array(self._answer.multipliers, dtype=complex)

    @property
    def error_estimate(self) -> float | None:
        """Relative error of what :attr:`error_estimate_of` says; None: not estimated, as at given steps of large scenes."""
        return self._answer.error_estimate

    @property
    def errors(self) -> dict[str, Any] | None:
        """With a tolerance: the parts of the estimate, the order that was observed, and the grids."""
        return self._answer.errors

    @property
    def certificate(self) -> dict[str, Any] | None:
        """Of given steps of small dense scenes: what y of the result is worth. Numbers have no units.

        ``error_of_x``, ``error_of_y`` and ``error_of_mean_of_y`` are the largest differences at the rows from a solution
        with located switches, relative to the largest value of the component; ``typical_error_of_x`` is
        exceeded at one row of twenty.
        ``largest_defect`` is that of complementarity inside the steps, |min(w, D y)| relative to the terms of w, at
        ``defect_at`` (of T) in row ``defect_row`` of w; ``mean_defect`` is its mean: the result is exact for a scene whose
        g is off by that. With ``impulses`` y is known by its mean. None elsewhere, and with ``confirm=False``."""
        return self._answer.certificate

    @property
    def kernel_error(self) -> float:
        """Relative error of the weights of the time convolution; NaN where there is nothing to compare them with."""
        return self._answer.kernel_error

    @property
    def infeasible_at(self) -> float | None:
        """With status ``infeasible``: the first time without a solution."""
        return self._answer.infeasible_at

    @property
    def seconds(self) -> float:
        """Wall-clock time of the solve; :attr:`timings` has its parts."""
        return self._answer.seconds["total"]

    @property
    def timings(self) -> dict[str, float]:
        """Seconds: total, setup and solve, and of the last one lcp, convolution, transform and other."""
        return self._answer.seconds

    @property
    def kernel(self) -> str:
        """How the kernel was made and applied, in words."""
        return self._answer.kernel

    @property
    def steps(self) -> int:
        """J."""
        return self._answer.steps

    @property
    def iterations(self) -> int:
        """Sweeps of the functional iteration."""
        return self._answer.iterations

    @property
    def history(self) -> list[float]:
        """Largest change of y in each sweep or cycle, relative to max(1, |y|). With a tolerance and a method without sweeps:
        the estimated error of each grid, NaN where it could not be estimated; ``errors["grids"]`` are their steps."""
        found = self._answer.history
        return found if found or not self.errors else list(self.errors["estimates"])

    @property
    def starts_with_impulse(self) -> bool:
        """x0 violates the constraints: the state jumps at t = 0. The first row has x0, and y and w of methods march and
        events behind the jump; other methods give the mean of the impulse over the first step."""
        return self._answer.starts_with_impulse

    @property
    def bytes(self) -> int:
        """Memory that the solve has held in arrays and plans."""
        return self._answer.bytes

    @property
    def goal(self) -> dict[str, Any] | None:
        """Method goal: the quantity, and the history of the grids."""
        return self._answer.goal

    @property
    def modes(self) -> dict[str, np.ndarray]:
        """The mode of each memory at the rows, names by the name of the memory; empty texts after the last valid row."""
        return modes_at_rows(self._scene._model, self._answer)

    def _mode_series(self) -> list[tuple[str, str, np.ndarray]]:
        return mode_series(self._scene._model, self._answer) + contact_series(self)

    @property
    def mode_changes(self) -> list[ModeChange]:
        """When memories change their modes, located, in order of time."""
        return mode_changes(self._scene._model, self._answer)

    @property
    def switches(self) -> list[Switch]:
        """When constraints become active and inactive, in order of time.

        Those of method ``events`` are located, and two integrations differ by the errors. Those of other methods are
        interpolated between the rows, and the errors are those of interpolation, NaN for ``galerkin``:
        :meth:`switches_with_errors` solves on coarser grids for the error of the grid.
        """
        return [Switch(*s) for s in self._answer.switches(False)]

    def switches_with_errors(self) -> list[Switch]:
        """The same with errors that include those of the grid: where they are not located, by solves on coarser grids."""
        return [Switch(*s) for s in self._answer.switches(True)]

    def at(self, t: float | Iterable[float]) -> Result:
        """The result at other times: a row of ``t``, ``y``, ``w`` and the recorded ``x`` for each.

        Times of rows give these rows. Between them a result with located switches has the values of its polynomials. For
        other methods the scene is solved again from the row before up to the requested time, so that a switch or a jump
        inside the step is followed. Two cases need no further solve: method ``galerkin``, whose y is linear on its
        interval, and steps of Kronecker sums (or of y alone of sparse scenes) in which nothing switches or jumps. Where
        the state at the rows was not recorded and cannot be computed from y, the whole scene is solved again.

        Raises:
            Error: for times outside [0, T]; for method ``goal``, whose time points are the answer; for a result of ``at``
                without located switches, whose steps are not known; :class:`DoesNotFit` where the states at all time points
                take more than 4 GB.
        """
        return Result(self._answer.at(self._times(t)), self._scene)

    def _integral_of_y(self, start: float, end: float) -> np.ndarray | None:
        first, last = self.at([start, end]).y_integral
        return last - first if np.all(np.isfinite(last - first)) else None

    def _pieces(self) -> list[float]:
        return getattr(self._answer, "piece_begins", list)()  # not of files

    def __getitem__(self, name: str) -> np.ndarray:
        """An output of a circuit at the rows: ``r["V(out)"]``, ``r["V(a,b)"]``, ``r["I(L1)"]``, the power ``r["P(R1)"]`` that an
        element takes, or an expression of these, t and parameters: ``r["V(in)*I(L1)/eta"]``. J+1 values.

        Raises:
            Error: for an unknown node or element, a scene that is no circuit, or states that were not all recorded.
        """
        return _netlist(self, name).probe(self._answer, name)

    @property
    def measures(self) -> dict[str, float]:
        """Of a circuit: the values of its ``.meas`` cards by name, NaN where one has none. Computed at each call."""
        return _netlist(self, "measures").measures(self._answer)

    def balance(self, start: float | None = None, end: float | None = None) -> Balance:
        """Of a circuit: what sources supply, what is stored and what each element takes over [start, end]."""
        found = _netlist(self, "balance").balance(self._answer, *self._between(start, end))
        elements = {name: ElementPower(*values) for name, values in found.pop("elements").items()}
        return Balance(**found, elements=elements)

    @property
    def contacts(self) -> ContactReport:
        """Of a structure with contacts: forces, times of stick, slip and opening, impacts, and where the energy goes. Computed
        at each call; states have to be recorded, ``states="all"``."""
        return report_of(self)

    def harmonics(self, name: str, count: int, start: float | None = None, end: float | None = None) -> np.ndarray:
        """Of a circuit: complex amplitudes c_1, ..., c_count of an output over [start, end], a period P of it:
        mean + sum of Re(c_k exp(2 pi i k (t - start) / P)).

        The integrals are taken between switches, without sampling.
        """
        counted = whole_number(count, "count")
        return np.array(_netlist(self, name).harmonics(self._answer, name, counted, *self._between(start, end)))

    def thd(self, name: str, start: float | None = None, end: float | None = None) -> float:
        """Of a circuit: total harmonic distortion of an output over [start, end], all frequencies above 1/(end - start)
        relative to that one; NaN without it."""
        return _netlist(self, name).distortion(self._answer, name, *self._between(start, end))

    def frequency_response(self, name: str, source: str | None = None, frequencies: Any = None) -> np.ndarray:
        """Of the periodic state of a circuit: what a small sine of a source does to an output at the same frequency, as a
        complex number for each of ``frequencies`` in Hz.

        Switches move with the signal, and gates and modes with memory do: no averaged model is made, and no transient is
        computed.

        Args:
            name: an output, a difference or a power; or ``"gain(Vz)"``, ``"impedance(out)"``, ``"impedance(a,b)"``.
            source: an independent source, ``"V1"`` or ``"I1"``; None: all with ``AC`` in the netlist.
            frequencies: None: those of ``.ac``.

        Example:
            >>> p = solve(circuit("buck.cir").periodic())
            >>> np.abs(p.frequency_response("V(out)", "Vin", [100, 1e3, 10e3]))
        """
        return self._responses([name], source, frequencies)[1][:, 0]

    def loop_gain(self, source: str, frequencies: Any = None) -> np.ndarray:
        """Of the periodic state of a circuit: the gain of the loop that a source ``V`` of 0 V is put into, -V(second)/V(first node).

        The first node of the source is the input of what controls, the second one the output that is fed back (Middlebrook
        1975); the loop is stable where the gain has less than 180 degrees of lag at 1.
        """
        return self.frequency_response(f"gain({source})", None, frequencies)

    def stability_margins(self, source: str, frequencies: Any = None) -> dict[str, float]:
        """Of the loop of :meth:`loop_gain`: ``crossover`` in Hz, where the size falls below 1, and the margin of ``phase`` there
        in degrees; ``phase_crossover`` in Hz, where the phase falls below -180 degrees, and the margin of ``gain`` there in
        dB. NaN where there is none within the frequencies.
        """
        at, found = self._responses([f"gain({source})"], None, frequencies)
        names = ("crossover", "phase", "phase_crossover", "gain")
        return dict(zip(names, _core.stability_margins(at.tolist(), found[:, 0])))

    def output_impedance(self, node: str, frequencies: Any = None) -> np.ndarray:
        """Of the periodic state of a circuit: V(node) for a current of 1 A into it, ohm; ``"a,b"``: between two nodes."""
        return self.frequency_response(f"impedance({node})", None, frequencies)

    def bode(self, *names: str, source: str | None = None, frequencies: Any = None) -> Any:
        """Draws sizes in dB and phases of :meth:`frequency_response` over frequency. Returns the two axes."""
        import matplotlib.pyplot as plt

        at, found = self._responses(list(names), source, frequencies)
        figure, (size, phase) = plt.subplots(2, 1, sharex=True, layout="constrained")
        for name, values in zip(names, found.T):
            size.semilogx(at, 20 * np.log10(np.abs(values)), label=name)
            phase.semilogx(at, np.degrees(np.unwrap(np.angle(values))), label=name)
        size.set_ylabel("size / dB")
        phase.set_ylabel("phase / degrees")
        phase.set_xlabel("frequency / Hz")
        size.legend(frameon=False)
        return size, phase

    def _responses(self, names: list[str], source: str | None, frequencies: Any) -> tuple[np.ndarray, np.ndarray]:
        netlist = _netlist(self, names[0])
        at = np.atleast_1d(np.asarray(netlist.frequencies if frequencies is None else frequencies, dtype=float))
        require(at.size > 0, "frequencies", "give some; the netlist has no .ac")
        return at, netlist.responses(self._answer, names, source or "", at.tolist())

    def _between(self, start: float | None, end: float | None) -> tuple[float, float]:
        first, last = self._span()
        return (first if start is None else number(start, "start"), last if end is None else number(end, "end"))

    def report(self, path: str | os.PathLike[str]) -> None:
        """Writes a page on the result, one HTML file that stands alone: what was solved, what was checked, curves, errors
        and times (``docs/report.md``).

        Args:
            path: ends in ``.html``.
        """
        name, _ = extension_of(path, (".html",))
        page = self._page()
        with complete(name) as written, open(written, "w", encoding="utf-8") as file:
            file.write(page)

    def _page(self) -> str:
        return _core.page(self._answer, *self._stated())

    def _provenance(self) -> dict[str, Any]:
        """As the command writes it."""
        summary = json.loads(_core.summary(self._answer, *self._stated()))
        return {
            "T": self._scene.T,
            "parameters": json.dumps(summary["parameters"]),
            "options": json.dumps({key: value for key, value in summary["requested"].items() if value is not None}),
            "threads": summary["threads"],
            "bromwich_commit": _core.commit,
            "summary": json.dumps(summary),
        }

    def _stated(self) -> tuple[dict[str, float], dict[str, list[str]], dict[str, list[str]], Any]:
        """Parameters, names and units of the scene, and its structure."""
        return self._scene.parameters, self._scene.names, self._scene.units, self._structure()

    def _structure(self) -> Any:
        return getattr(self._scene, "_mechanism", None)

    @overload
    def derivative(self, *, located: bool | None = None, all_times: bool = False) -> Derivative: ...
    @overload
    def derivative(
        self,
        *,
        located: bool | None = None,
        parameters: str | Iterable[str] | Mapping[str, float],
        scene_of: Callable[..., Scene] | None = None,
    ) -> ParameterDerivative: ...
    def derivative(
        self,
        *,
        located: bool | None = None,
        all_times: bool = False,
        parameters: str | Iterable[str] | Mapping[str, float] | None = None,
        scene_of: Callable[..., Scene] | None = None,
    ) -> Derivative | ParameterDerivative:
        """The derivative of y, x and w with respect to the data of the scene, or to its parameters
        (``docs/derivatives.md``).

        Args:
            located: False: of the discrete solution, for a continuous y and the methods march, shooting, contour and multigrid.
                True: of the solution with located switches, for dense scenes of up to 128 states and 96 constraints, also
                where y or x jumps (relays, M = 0, impacts). None: located where y may jump, and where that of the
                discrete solution is refused.
            all_times: of the discrete solution over all time points, on the backend of the result and by its method, for
                dense scenes and small Kronecker sums too: by x0, f (through B), g and M.
            parameters: names of parameters of a scene file, of a built-in scene, or of the expressions of f and g. With
                ``scene_of``: names and values of the arguments of that function.
            scene_of: a function of these, by keyword, that returns a :class:`Scene`; ``result`` is that of
                ``scene_of(**parameters)``.

        With more than 1000 states there are derivatives by x0, f, g and M alone: those of Kronecker sums in modes on the
        host or over all time points on the backend of the result, whichever takes less time; those of sparse dynamics
        over all time points.

        Raises:
            Error: the solution is not differentiable here, and why.
        """
        if parameters is None:
            require(scene_of is None, "scene_of", "is given without parameters; give their names and values")
            return Derivative(self, located, all_times)
        require(not all_times, "all_times", "is given with parameters; leave it out")
        return ParameterDerivative(self, parameters, scene_of, located)

    def __repr__(self) -> str:
        return f"<bromwich.Result {', '.join(self._words())}>"

    def _words(self) -> list[str]:
        words = [f"{self.status} by {self.method}"]
        if self.ok:
            words += [f"residual {self.residual:.1e}", self._estimate() or "error not estimated (give tol)"]
        else:
            words.append(self.reason)
        words.append(f"{self.steps} steps")
        words.append(_seconds(self.seconds))
        if self.warning:
            words.append(f"warning: {self.warning}")
        return words


def _netlist(result: Result, name: str) -> Any:
    netlist = getattr(result.scene, "_netlist", None)
    require(netlist is not None, "name", f"found {name!r}, and the scene is no circuit; take a column of x or y")
    require(len(result.x_components) == result.scene.states, "states", "were not all recorded; solve with states='all'")
    return netlist


def _restored(scene: Scene, state: dict[str, Any]) -> Result:
    model = scene._model
    if "x0" in state or "sources" in state:  # of a Solver whose sources have changed since
        f, g, breakpoints, known = state.get("sources", (None, None, [], False))
        model = _core.changed_model(
            model, state.get("x0"), "sources" in state, restored(f), restored(g), breakpoints, known
        )
    return Result(_core.answer_from(model, state), scene)


def _seconds(s: float) -> str:
    for unit, scale in (("s", 1.0), ("ms", 1e-3)):
        if s >= scale:
            return f"{s / scale:.3g} {unit}"
    return f"{s / 1e-6:.3g} us"
