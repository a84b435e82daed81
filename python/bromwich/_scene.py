"""Scenes: the problems to solve."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from . import _core
from ._arrays import filled, listed, matrix, multiple, number, vector, whole, whole_number, word
from ._dynamics import Dynamics, Kronecker
from ._errors import Error
from ._labels import names_of, units_of
from ._matrices import matrices
from ._memory import Memory, memories, set_memories
from ._mesh import Mesh
from ._model import parameters_of, set_conditions, set_dynamics, set_f_entry, set_lcp
from ._pickled_scene import fingerprint, made_again, restored
from ._sources import on_this_host, source, steps_of, values_at
from ._words import suggestion


def _matrix(name: str, text: str) -> property:
    return property(lambda scene: matrices(scene._model)[name], doc=text)


class Scene:
    """A differential linear complementarity problem with m states and n constraints::

        E x' = A x + B y + f(t),   0 <= y  ⊥  w = N x + M y + g(t) >= 0,   x(0) = x0,   0 <= t <= T.

    Args:
        A: m x m, NumPy or SciPy sparse. Sparse: many states (10^5 and more) and few constraints.
        B: m x n; one dimension is a column.
        N: n x m; one dimension is a row.
        M: n x n, NumPy, SciPy sparse, :class:`Tridiagonal` or a number where n = 1; None: zero.
        x0: m values, the state at t = 0.
        T: final time, in the user's unit of time.
        f: source of the states, m values (see F). None, a number, m values, a table, a function or expressions, below.
        g: source of the constraints, n values.
        E: m x m, regular; None: the identity.
        F: f enters as F f(t) with this m x k matrix and f of k values, or as B f(t) with n values where it is ``"B"``.
        E0, ET, b: instead of x0: ``E0 x(0) + ET x(T) = b``, m x m, m x m and m values (methods shooting
            and galerkin).
        free: rows i of mixed problems, with w_i = 0 and y_i of either sign.
        lcp_class: ``"auto"``, ``"P"``, ``"Z"`` or ``"PSD"``, what is known of M.
        restitution: coefficients e of Newton's law of impact, in [0, 1], n values or one for all: where w_i reaches 0, it leaves
            with -e times its velocity. For rows of rigid contact; by methods events and, with steps, march. None: 0.
        breakpoints: times in [0, T] at which f or g may jump or have a kink. Others are searched in functions.
        parameters: names and values for expressions.
        steps: time steps J of a solve that names neither steps nor ``tol``; None: those of a table, and without one such a
            solve reaches 1e-3.
        dynamics: in place of A, B, N and E: :class:`Dynamics` (callbacks) or :class:`Kronecker`.
        name: for messages.
        names: of components, ``{"x": ["v", "i"], "y": ["i_D"]}``: m for x, n for y and for w. ``states=`` takes them;
            results, pictures and files have them.
        mesh: :class:`Mesh`, of which the states are values at points.
        memory: :class:`Memory`, or several: elements with modes that located events change.
        units: likewise, one for each component or one text for all, and ``"t"``: ``{"t": "s", "x": ["V", "A"]}``.

    Sources are given as

    - an array of as many values: constant;
    - an array with J+1 rows: a table on the uniform grid over [0, T], linear between its rows;
    - ``(times, table)``: the same at times of one's own, each a kink; two rows of equal time are a jump;
    - a function of t; where it takes an array of k times as well, and returns k x n or n x k values, it is called for
      all times of a grid at once;
    - a string or a list of strings, expressions of t and the parameters, ``"max(sin(2*pi*t), 0)"``, whose jumps and
      kinks are found exactly.

    Raises:
        Error: an argument has a wrong shape, or values that are not finite; ``argument`` says which.

    Example:
        >>> Scene(A=[[0, -1 / C], [1 / L, 0]], B=[-1 / C, 0], N=[-1, 0], M=R, x0=[10, 0], T=5e-3)
    """

    def __init__(
        self,
        *,
        A: Any = None,
        B: Any = None,
        N: Any = None,
        M: Any = None,
        x0: Any = None,
        T: float | None = None,
        f: Any = None,
        g: Any = None,
        E: Any = None,
        F: Any = None,
        E0: Any = None,
        ET: Any = None,
        b: Any = None,
        free: Iterable[int] = (),
        lcp_class: str = "auto",
        restitution: Any = None,
        breakpoints: Iterable[float] = (),
        parameters: Mapping[str, float] | None = None,
        steps: int | None = None,
        dynamics: Dynamics | Kronecker | None = None,
        name: str = "",
        names: Mapping[str, Iterable[str]] | None = None,
        units: Mapping[str, str | Iterable[str]] | None = None,
        mesh: Mesh | None = None,
        memory: Memory | Mapping[str, Any] | list[Memory | Mapping[str, Any]] | None = None,
    ) -> None:
        if T is None:
            raise Error("T: is missing; give the final time", "T")
        model = _core.Model.empty()
        model.name, model.T = word(name, "name"), number(T, "T")
        in_sine_modes = isinstance(dynamics, Kronecker) and dynamics.in_sine_modes
        single_states = not isinstance(F, str) and (F is not None or (f is not None and not in_sine_modes))
        set_dynamics(model, A, B, N, E, dynamics, single_states)
        set_lcp(model, M)
        model.set_lcp_class(word(lcp_class, "lcp_class"))
        if restitution is not None:
            model.restitution = filled(restitution, model.constraints, "restitution")
        model.free_rows = [whole(i, "free") for i in listed(free, "free")]
        set_conditions(model, x0, E0, ET, b)
        if not (model.T > 0 and np.isfinite(model.T)):
            raise Error(f"T: is {model.T:g}; give a positive finite number", "T")
        if in_sine_modes and f is not None and F is None:
            raise Error("f: enters the states of a Kronecker sum; give n values and F='B', for B f(t)", "f")
        set_f_entry(model, F)
        self._model, self._parameters = model, parameters_of(parameters)
        f, g = on_this_host(f, "f"), on_this_host(g, "g")
        parts = self._sources(f, g)
        tables = [steps_of(f, model.sources), steps_of(g, model.constraints)]
        model.steps = whole_number(steps, "steps") if steps is not None else max(tables)
        model.set_sources(*parts, sorted(number(t, "breakpoints") for t in listed(breakpoints, "breakpoints")))
        model.validate()
        if mesh is not None:
            mesh.check(model.states, model.constraints)
        self._facts: dict[str, Any] = {"names": names_of(model, names), "units": units_of(model, units), "mesh": mesh}
        if all_of_them := memories(memory):
            set_memories(model, all_of_them, self.names, self._parameters)
            self._facts["memory"] = all_of_them
        self._recipe: tuple | None = None

    def _sources(self, f: Any, g: Any) -> tuple[_core.Source | None, _core.Source | None]:
        m = self._model
        return (
            source(f, "f", m.sources, m.T, self._parameters),
            source(g, "g", m.constraints, m.T, self._parameters),
        )

    @classmethod
    def _of(
        cls, model: _core.Model, parameters: Mapping[str, float], facts: dict[str, Any], recipe: tuple | None = None
    ) -> Scene:
        scene = cls.__new__(cls)
        scene._model, scene._parameters, scene._facts, scene._recipe = model, dict(parameters), facts, recipe
        return scene

    def _with(self, name: str, value: float) -> Scene:
        """The scene with another value of one of its parameters."""
        if self._recipe is not None:
            maker, arguments, named = self._recipe
            changed = {**named, name: value}
            if maker in ("relay", "_structured"):
                changed = {**named, "parameters": {**named["parameters"], name: value}}
            return getattr(type(self), maker)(*arguments, **changed)
        parameters = {**self._parameters, name: value}
        *sources, breakpoints = _core.state_of_sources(self._model)
        of_text = [
            (s[0], s[1], parameters, *s[3:]) if s is not None and s[0] == "expressions" else s for s in sources
        ]
        return restored(type(self), _core.state_of_model(self._model), (*of_text, breakpoints), parameters, self._facts)

    def __reduce__(self) -> tuple:
        """Pickles what was given; functions, and scenes of files and of the catalogue, by name."""
        if self._recipe is not None:
            return made_again, (type(self), self._recipe, fingerprint(self._model))
        state = _core.state_of_model(self._model)
        return restored, (type(self), state, _core.state_of_sources(self._model), self._parameters, self._facts)

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str], **settings: float) -> Scene:
        """Reads a scene file (docs/scene-files.md); ``settings`` replace values of its ``[parameters]``, or T and steps.

        Raises:
            Error: names file, line and key.
        """
        values = {k: number(v, k) for k, v in settings.items()}
        name = os.fspath(path)
        if not os.path.exists(name):
            raise Error(f"path: the file {name!r} does not exist; give the path of a scene file", "path")
        try:
            model, facts = _core.read_scene(name, values)
        except Error as error:
            if error.argument != "--set":  # the option of the command
                raise
            raise Error(str(error).replace("--set: ", "settings: ", 1), "settings") from None
        return cls._of(model, facts["parameters"], facts, ("from_toml", (os.path.abspath(path),), values))

    @classmethod
    def _built_in(cls, name: str, **settings: float) -> Scene:
        """See :func:`scene`."""
        catalogue = {known: (summary, parameters) for known, summary, parameters in _core.catalogue()}
        if name not in catalogue:
            near = suggestion(name, catalogue)
            raise Error(f"scene: found {name!r}{near}, which is not built in; choose one of {', '.join(catalogue)}", "scene")
        summary, parameters = catalogue[name]
        for key in (k for k in settings if k not in parameters):
            near = suggestion(key, parameters)
            raise Error(f"{key}: is no parameter of scene {name}{near}; choose from {', '.join(parameters)}", key)
        values = {k: number(v, k) for k, v in settings.items()}
        defaults = {k: default for k, (default, _) in parameters.items() if np.isfinite(default)}
        facts = {"description": summary}
        return cls._of(_core.build_scene(name, values), {**defaults, **values}, facts, ("_built_in", (name,), values))

    @classmethod
    def relay(
        cls,
        *,
        A: Any,
        B: Any,
        C: Any,
        x0: Any,
        T: float,
        f: Any = None,
        e: Any = None,
        bound: Any = None,
        N: Any = None,
        M: Any = None,
        g: Any = None,
        parameters: Mapping[str, float] | None = None,
        steps: int | None = None,
        name: str = "",
        names: Mapping[str, Iterable[str]] | None = None,
        units: Mapping[str, str | Iterable[str]] | None = None,
    ) -> Scene:
        """Relays: ``x' = A x + B l + f(t)``, ``l_i`` in ``-b_i(t) Sgn(C_i x + e_i(t))`` between -b_i and b_i, for k outputs.

        A is m x m, B m x k, C k x m; f has m values, e has k, and bound, b >= 0, has k; None: 1. As a complementarity problem
        y has 2k components, ``l = b - 2 y[:, :k]``. With N (n x m), M (n x n) and g there are n constraints ``0 <= y  ⊥  w = N x + M y
        + g`` beside the relays: y has 2k + n components, and B k + n columns.
        The other arguments are those of :class:`Scene`.
        """
        A, B, C = matrix(A, "A"), matrix(B, "B", column=True), matrix(C, "C")
        N = np.zeros((0, A.shape[0])) if N is None else matrix(N, "N")
        n, x0 = N.shape[0], vector(x0, "x0")
        M = multiple(0.0 if M is None else M, n, "M")
        T, steps = number(T, "T"), 0 if steps is None else whole_number(steps, "steps")
        values, given_sources = parameters_of(parameters), {"f": f, "e": e, "bound": bound, "g": g}
        given_sources = {key: on_this_host(one, key) for key, one in given_sources.items()}
        widths = {"f": A.shape[0], "e": C.shape[0], "bound": C.shape[0], "g": n}
        sources = {key: source(one, key, widths[key], T, values) for key, one in given_sources.items()}
        model = _core.relay(A, B, C, x0, N, M, **sources)
        model.name, model.T, model.steps = word(name, "name"), T, steps
        model.validate()
        facts = {"names": names_of(model, names), "units": units_of(model, units)}
        given = {key: one.copy() for key, one in {"A": A, "B": B, "C": C, "x0": x0, "M": M, "N": N}.items()}
        given |= {"T": T, "parameters": values}
        given |= given_sources | {"steps": steps or None, "name": name, "names": names, "units": units}
        return cls._of(model, values, facts, ("relay", (), given))

    @property
    def name(self) -> str:
        return self._model.name

    @property
    def states(self) -> int:
        """m"""
        return self._model.states

    @property
    def constraints(self) -> int:
        """n"""
        return self._model.constraints

    @property
    def T(self) -> float:
        """Final time."""
        return self._model.T

    @property
    def steps(self) -> int:
        """Time steps J of a solve that names neither steps nor ``tol``; 0: such a solve reaches 1e-3, or the tol of its file."""
        return self._model.steps

    @property
    def x0(self) -> np.ndarray:
        """m values; none where the scene has boundary values."""
        return np.array(self._model.x0())

    A = _matrix("A", "m x m, a copy: NumPy, or SciPy's CSC where it is stored sparse. None for callbacks and Kronecker sums.")
    B = _matrix("B", "m x n, as :attr:`A`; of callbacks too.")
    N = _matrix("N", "n x m, as :attr:`B`.")
    M = _matrix("M", "n x n, a copy: NumPy, or SciPy's CSC where it is stored sparse.")
    E = _matrix("E", "m x m, as :attr:`A`; None: the identity, or a mass by callbacks.")
    F = _matrix("F", "m x k, SciPy's CSC; None where f enters without a matrix, or by B.")
    E0 = _matrix("E0", "m x m; None where the scene has x0.")
    ET = _matrix("ET", "m x m, as :attr:`E0`.")

    @property
    def b(self) -> np.ndarray | None:
        """m values, as :attr:`E0`."""
        state = _core.state_of_model(self._model)
        return np.array(state["boundary"][2]) if "boundary" in state else None

    def f(self, t: Any) -> np.ndarray:
        """The source at k times: k x m, or as many columns as F has; its values alone where t is a number. Zeros where there is none."""
        return values_at(self._model.f_at, t)

    def g(self, t: Any) -> np.ndarray:
        """The source of the constraints at k times: k x n, as :meth:`f`."""
        return values_at(self._model.g_at, t)

    @property
    def restitution(self) -> np.ndarray | None:
        """n coefficients; None where none were given."""
        given = np.array(self._model.restitution)
        return given if given.size else None

    @property
    def breakpoints(self) -> list[float]:
        """Times at which f or g may jump or have a kink, as far as they are known before a solve."""
        return self._model.breakpoints

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of a file or a built-in scene, with the settings, or those given for expressions."""
        return dict(self._parameters)

    @property
    def names(self) -> dict[str, list[str]]:
        """Names of the components, under the keys x, y and w; empty lists where none were given."""
        return dict(self._facts.get("names") or self._model.names)

    @property
    def units(self) -> dict[str, list[str]]:
        """Units of the components under x, y and w, and the unit of time, a list of one text, under t."""
        of_file = {"t": [self._model.time_unit] if self._model.time_unit else [], **self._model.units}
        return dict(self._facts.get("units") or of_file)

    @property
    def mesh(self) -> Mesh | None:
        """The mesh that was given."""
        return self._facts.get("mesh")

    @property
    def description(self) -> str:
        """One line, of a file or a built-in scene."""
        return self._facts.get("description", "")

    @property
    def warning(self) -> str:
        """A limit of the reader that concerns this file, or an empty string."""
        return self._facts.get("warning", "")

    @property
    def reference(self) -> dict[str, Any] | None:
        """The reference of a file for its solution: t, x, y, tolerance, status, source; None without one."""
        return self._facts.get("reference")

    def exact(self, t: float) -> tuple[np.ndarray, np.ndarray] | None:
        """x (m) and y (n) at t, of built-in scenes whose solution is known; otherwise None."""
        return self._model.exact(number(t, "t"))

    def __repr__(self) -> str:
        name = f"{self.name!r}: " if self.name else ""
        ends = "boundary values" if self._model.has_boundary else "initial values"
        return (
            f"<bromwich.Scene {name}{self.states} states ({self._model.form}), {self.constraints} constraints, "
            f"{ends}, T = {self.T:g}>"
        )


def scene(name: str, **settings: float) -> Scene:
    """A built-in scene, such as ``scene("signorini", Q=127)``; :func:`scenes` lists them.

    Raises:
        Error: for an unknown name, an unknown parameter or a value out of range.
    """
    return Scene._built_in(name, **settings)


def scenes() -> dict[str, dict[str, Any]]:
    """The built-in scenes: ``summary`` and ``parameters``, each with its default and its meaning."""
    return {name: {"summary": summary, "parameters": parameters} for name, summary, parameters in _core.catalogue()}
