"""Netlists in SPICE's language as scenes, read from a file, from text, or written in Python."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from . import _core
from ._arrays import number, word
from ._circuit_map import CircuitMap, circuit_map
from ._errors import Error, NotSolved, NotSolvedWarning, require
from ._machine import wanted
from ._progress import reporting
from ._scene import Scene
from ._solve import Backend, Check, Method, Progress, _options, judgement


class CircuitScene(Scene):
    """A netlist as a scene. States are voltages of capacitors and currents of inductors; results have outputs besides::

        r = solve(circuit("buck.cir"))
        r["V(out)"], r["V(in,out)"], r["P(R1)"]

    Made by :func:`circuit` and :meth:`Circuit.scene`. Without steps or a tolerance its states are solved to 1e-4.
    """

    _netlist: Any

    @property
    def outputs(self) -> dict[str, str]:
        """Names of outputs and their units: V of every node, I of every element, into its first node."""
        return dict(self._netlist.outputs)

    @property
    def elements(self) -> dict[str, str]:
        """Names of the elements, those of subcircuits as ``X1.R1``, and their kinds: R, L, C, V, ..."""
        return dict(self._netlist.elements)

    @property
    def times(self) -> np.ndarray:
        """The times of ``.tran``: ``r.at(scene.times)``. Empty where it gives no step."""
        return np.array(self._netlist.times)

    @property
    def notes(self) -> list[str]:
        """What was skipped, straightened or added, one line each."""
        return list(self._netlist.notes)

    @property
    def reduction(self) -> dict[str, Any]:
        """``summary``, and lists: ``states``, ``pairs``, ``open`` (diodes and switches without a parallel resistance), and as
        equations what others determine: ``loops`` (of capacitors), ``cutsets`` (of inductors), ``windings``."""
        return dict(self._netlist.reduction)

    @property
    def steps(self) -> dict[str, np.ndarray]:
        """Parameters that ``.step`` cards vary, in lower case, and their values: the default of :meth:`map`."""
        return {name: np.array(values) for name, values in self._netlist.steps}

    def map(
        self,
        *columns: str,
        backend: Backend = "cpu",
        threads: int = 0,
        method: Method = "auto",
        steps: int | None = None,
        tol_x: float | None = None,
        progress: Progress | bool | None = None,
        stop: Callable[[], bool] | None = None,
        check: Check = "warn",
        **axes: Any,
    ) -> CircuitMap:
        """Numbers of the solution at many operating points, which threads share.

        Args:
            columns: ``mean(V(out))``, also ``rms``, ``min``, ``max``, ``ripple`` and ``thd`` of an output, a difference or a
                power; ``V(out)``: at the end; ``power(D1)``: the mean that an element takes; ``efficiency``; names of ``.meas``
                cards. None: all ``.meas`` cards, otherwise means and efficiency of a periodic state, or voltages at the end.
            axes: parameters of the netlist and their values; every value is combined with every other one. None: those of
                ``.step`` cards.
            backend, threads, method, steps, tol_x, progress, stop: as :func:`solve` takes them. A periodic state takes 16 rows
                by default: its switches are located, whatever the rows are.
            check: ``"warn"`` warns where a point is not solved, True raises, False does nothing.

        Raises:
            Error: for a column or a parameter that is unknown.

        Example:
            >>> boost = circuit("boost.cir").periodic()
            >>> m = boost.map("efficiency", duty=np.linspace(0.2, 0.7, 100), rload=np.geomspace(5, 100, 100))
            >>> m.plot("efficiency")
        """
        assert self._recipe is not None
        judgement(check, progress, stop)
        given = {word(name, "axes").lower(): np.atleast_1d(np.asarray(v, dtype=float)) for name, v in axes.items()} or self.steps
        require(bool(given), "axes", "there is no parameter to vary; give one, map(duty=[0.3, 0.4]), or add .step to the netlist")
        for name, values in given.items():
            require(values.ndim == 1 and values.size > 0, name, "give a list of numbers")
            require(name in self.parameters, name, f"is no .param of the netlist; use one of {', '.join(self.parameters)}")
        _, (source, from_file, folder, period), settings = self._recipe
        text, title, folder = (_contents(source), os.path.basename(source), os.path.dirname(source)) if from_file else (source, "netlist", folder)
        kept = {name: float(v) for name, v in settings.items() if name.lower() not in given}
        of_period = period is not None and steps is None and tol_x is None
        options = _options(self, method=method, states="all", steps=16 if of_period else steps, tol_x=tol_x)
        netlist = _core.CircuitSource(text, title, folder, kept, period)
        with reporting(progress, options.iteration_tolerance) as report:
            found = circuit_map(self.name, netlist, given, [word(c, "columns") for c in columns], options, wanted(backend, None, threads, None), report, stop)
        unsolved = int(np.sum(~found.ok))
        if unsolved and check is not False:
            first = next(reason for reason in found.reason.flat if reason)
            message = f"{unsolved} of {found.ok.size} operating points are not solved; the first: {first}"
            if check is True:
                raise NotSolved(message, found)
            warnings.warn(message, NotSolvedWarning, stacklevel=2)
        return found

    def periodic(self, period: float | None = None) -> CircuitScene:
        """The periodic state, x(0) = x(T), as a scene with T the period; sources are as they are long after their delay.

        Args:
            period: in seconds; None: the least common one of the sources.

        Raises:
            Error: for a source that is not periodic, or has another period.

        Example:
            >>> r = solve(circuit("buck.cir").periodic())
            >>> r.ripple("V(out)"), r.balance().efficiency, r.multipliers
        """
        assert self._recipe is not None
        _, (source, from_file, folder, _), settings = self._recipe
        wanted = 0.0 if period is None else number(period, "period")
        if not (wanted >= 0 and np.isfinite(wanted)) or (period is not None and wanted == 0):
            raise Error(f"period: found {period!r}; give a positive number of seconds", "period")
        return type(self)._read(source, from_file, folder, wanted, **settings)

    @classmethod
    def _read(
        cls, source: str, from_file: bool, folder: str, period: float | None, /, **settings: float
    ) -> CircuitScene:
        try:
            if from_file:
                model, netlist = _core.read_circuit(source, settings, period)
            else:
                model, netlist = _core.parse_circuit(source, "netlist", folder, settings, period)
        except Error as error:
            if error.argument != "--set":  # the option of the command
                raise
            raise Error(str(error).replace("--set: ", "parameters: ", 1), "parameters") from None
        made = cls._of(model, netlist.parameters, {}, ("_read", (source, from_file, folder, period), settings))
        made._netlist = netlist
        return made


def _contents(file: str) -> str:
    with open(file, encoding="utf-8", errors="surrogateescape") as netlist:
        return netlist.read()


def circuit(source: str | os.PathLike[str], **parameters: float) -> CircuitScene:
    """A netlist in the language of SPICE as a scene (``docs/netlists.md``).

    Args:
        source: the path of a file, or text of more than one line, whose first one is the title.
        parameters: replace values of its ``.param``.

    Raises:
        Error: names file, line and element.

    Example:
        >>> buck = circuit("buck.cir", Rload=10)
        >>> r = solve(buck)
        >>> r.mean("V(out)", start=1e-3), r.ripple("I(L1)", start=1e-3)
    """
    values = {k: number(v, k) for k, v in parameters.items()}
    text = os.fspath(source)
    if not isinstance(text, str):
        raise Error(f"source: is {type(text).__name__}; give a path, or the text of a netlist", "source")
    if "\n" in text:
        return CircuitScene._read(text, False, os.getcwd(), None, **values)
    if not os.path.exists(text):
        raise Error(f"source: the file {text!r} does not exist; give the path of a netlist, or its text", "source")
    return CircuitScene._read(os.path.abspath(text), True, "", None, **values)


class Circuit:
    """A netlist that is written in Python. Each method adds an element and returns the circuit; ``str(c)`` is the netlist.

    Names begin with the letter of their kind, as in SPICE. Nodes are names or numbers, ``"0"`` or 0 is ground. Values are
    numbers in ohm, farad, henry, volt, ampere and seconds, or texts of SPICE: ``"10u"``, ``"{2*R}"``.

    Example:
        >>> c = Circuit("half wave")
        >>> c.V("V1", "in", 0, "SIN(0 10 50)").D("D1", "in", "out", Ron=0.01, Vfwd=0.6).R("R1", "out", 0, 100)
        >>> r = solve(c.scene(stop=0.04))
        >>> r["V(out)"]
    """

    def __init__(self, title: str = "circuit") -> None:
        self._title, self._cards = " ".join(word(title, "title").split()), []  # type: ignore[var-annotated]

    def R(self, name: str, a: Any, b: Any, value: Any) -> Circuit:
        """A resistance, ohm."""
        return self._element("R", name, (a, b), value)

    def C(self, name: str, a: Any, b: Any, value: Any, *, ic: Any = None, Rser: Any = None, Rpar: Any = None) -> Circuit:
        """A capacitance, farad. ``ic``: its voltage at t = 0, of a scene with ``uic``."""
        return self._element("C", name, (a, b), value, IC=ic, Rser=Rser, Rpar=Rpar)

    def L(self, name: str, a: Any, b: Any, value: Any, *, ic: Any = None, Rser: Any = None, Rpar: Any = None) -> Circuit:
        """An inductance, henry. ``ic``: its current at t = 0, of a scene with ``uic``."""
        return self._element("L", name, (a, b), value, IC=ic, Rser=Rser, Rpar=Rpar)

    def K(self, name: str, *inductors: str, k: Any = 1) -> Circuit:
        """A coupling of two or more inductors; k = 1: windings of an ideal transformer with their inductance."""
        return self._element("K", name, inductors, k)

    def V(self, name: str, a: Any, b: Any, value: Any) -> Circuit:
        """A source of voltage: a number, or ``"PULSE(...)"``, ``"SIN(...)"``, ``"PWL(...)"``, ``"EXP(...)"``, ``"SFFM(...)"``."""
        return self._element("V", name, (a, b), value)

    def I(self, name: str, a: Any, b: Any, value: Any) -> Circuit:  # noqa: E743
        """A source of current, from a through the source to b, as :meth:`V`."""
        return self._element("I", name, (a, b), value)

    def E(self, name: str, a: Any, b: Any, c: Any, d: Any, gain: Any) -> Circuit:
        """The voltage from a to b is gain times that from c to d."""
        return self._element("E", name, (a, b, c, d), gain)

    def G(self, name: str, a: Any, b: Any, c: Any, d: Any, gain: Any) -> Circuit:
        """The current from a to b is gain times the voltage from c to d."""
        return self._element("G", name, (a, b, c, d), gain)

    def F(self, name: str, a: Any, b: Any, source: str, gain: Any) -> Circuit:
        """The current from a to b is gain times that of a source of voltage."""
        return self._element("F", name, (a, b, source), gain)

    def H(self, name: str, a: Any, b: Any, source: str, gain: Any) -> Circuit:
        """The voltage from a to b is gain times the current of a source of voltage."""
        return self._element("H", name, (a, b, source), gain)

    def D(
        self,
        name: str,
        anode: Any,
        cathode: Any,
        *,
        Ron: Any = 0,
        Roff: Any = None,
        Vfwd: Any = 0,
        Vrev: Any = None,
        Rrev: Any = None,
    ) -> Circuit:
        """A diode of straight lines: open below ``Vfwd``, then with slope 1/``Ron``; ``Roff`` beside it, breakdown at ``Vrev``."""
        return self._model("D", name, (anode, cathode), "D", Ron=Ron, Roff=Roff, Vfwd=Vfwd, Vrev=Vrev, Rrev=Rrev)

    def S(
        self, name: str, a: Any, b: Any, c: Any, d: Any, *, Ron: Any = 1, Roff: Any = None, Vt: Any = 0, Vh: Any = 0
    ) -> Circuit:
        """A switch: closes where the voltage from c to d rises above Vt + Vh, and opens where it falls below Vt - Vh."""
        return self._model("S", name, (a, b, c, d), "SW", Ron=Ron, Roff=Roff, Vt=Vt, Vh=Vh)

    def B(self, name: str, a: Any, b: Any, *, V: Any = None, I: Any = None) -> Circuit:  # noqa: E741
        """A source of voltage ``V`` or current ``I`` with a piecewise linear expression, ``V="limit(10*V(c), -5, 5)"``."""
        if (V is None) == (I is None):
            raise Error("V: found both or none of V and I; give one expression", "V")
        kind, expression = ("V", V) if I is None else ("I", I)
        return self._element("B", name, (a, b), f"{kind}={word(expression, kind)}")

    def X(self, name: str, *nodes: Any, subcircuit: str, **parameters: Any) -> Circuit:
        """A subcircuit, of a card or of the library: ``c.X("X1", "in", "ref", "out", subcircuit="comparator", Vh=0.1)``."""
        return self._element("X", name, nodes, word(subcircuit, "subcircuit"), **parameters)

    def param(self, **values: Any) -> Circuit:
        """Parameters, which texts in braces use and :meth:`scene` may replace."""
        return self.card(".param " + " ".join(f"{key}={_braced(value)}" for key, value in values.items()))

    def card(self, text: str) -> Circuit:
        """One or more lines of SPICE as they are, such as ``".include parts.lib"`` or a subcircuit."""
        lines = text.split("\n") if isinstance(text, str) else [text]
        self._cards += [word(line, "text") for line in lines if line != ""]
        return self

    def scene(self, stop: Any, step: Any = None, *, uic: bool = False, **parameters: float) -> CircuitScene:
        """The scene on [0, stop].

        Args:
            stop: T in seconds.
            step: the distance of rows; None: stop / 200.
            uic: begin with ``ic``, 0 where none is given; False: at the operating point.
            parameters: replace values of :meth:`param`.

        Raises:
            Error: names the line of ``str(c)`` and the element.
        """
        step = f"{{({_inner(stop)})/200}}" if step is None else _braced(step)
        return circuit(f"{self}\n.tran {step} {_braced(stop)}{' uic' if uic else ''}\n", **parameters)

    def __str__(self) -> str:
        return "\n".join([self._title, *self._cards])

    def _element(self, kind: str, name: str, nodes: tuple, value: Any, **named: Any) -> Circuit:
        if not word(name, "name")[:1].upper() == kind or len(name.split()) != 1:
            raise Error(f"name: found {name!r}; begin it with {kind}, without blanks", "name")
        words = [name, *(_node(n) for n in nodes), _value(value)]
        return self.card(" ".join([*words, *(f"{key}={_value(v)}" for key, v in named.items() if v is not None)]))

    def _model(self, kind: str, name: str, nodes: tuple, type_: str, **named: Any) -> Circuit:
        given = " ".join(f"{key}={_value(v)}" for key, v in named.items() if v is not None)
        return self._element(kind, name, nodes, f"model_{name}").card(f".model model_{name} {type_}({given})")


def _node(node: Any) -> str:
    text = str(node)
    if not text or any(c.isspace() or c in ",;{}()='\"" for c in text):
        raise Error(f"node: found {node!r}; give a name or a number without blanks", "node")
    return text


def _value(value: Any) -> str:
    return word(value, "value") if isinstance(value, str) else repr(number(value, "value"))


def _inner(value: Any) -> str:
    text = _value(value)
    return text[1:-1] if text[:1] == "{" and text[-1:] == "}" else text


def _braced(value: Any) -> str:
    return f"{{{_inner(value)}}}"
