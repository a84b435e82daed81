"""Solving: one scene once, or one scene prepared for many solves."""

from __future__ import annotations

import operator
import os
import warnings
from collections.abc import Callable, Iterable
from typing import Any, Literal, get_args

from . import _core
from ._arrays import filled, listed, number, whole_number, word
from ._errors import Error, Interrupted, NotSolved, NotSolvedWarning
from ._machine import wanted
from ._progress import reporting
from ._ranks import Ranks, ranks_of
from ._result import Result
from ._rows import Status
from ._scene import Scene
from ._sources import on_this_host
from ._words import suggestion

# The largest number of states that are recorded by default.
RECORDED_STATES = 1000

# Options that are numbers: their names in the compiled part.
NUMBERS: dict[str, tuple[str, Callable[[Any, str], float]]] = {
    "steps": ("steps", whole_number),
    "tol": ("tolerance", number),
    "tol_x": ("tolerance_x", number),
    "tol_y": ("tolerance_y", number),
    "atol": ("absolute_tolerance", number),
    "max_steps": ("max_steps", whole_number),
    "max_seconds": ("max_seconds", number),
    "iteration_tol": ("iteration_tolerance", number),
    "max_iterations": ("max_iterations", whole_number),
    "memory_limit": ("memory_limit", number),
}
TOLERANCES = ("tol", "tol_x", "tol_y")
OPTIONS = frozenset({"method", "states", "event_location", "confirm", *NUMBERS})

Check = bool | Literal["warn"]
Method = Literal[
    "auto", "march", "contour", "multigrid", "dual", "euler", "events", "shooting", "galerkin", "goal", "contour-literal"
]
METHODS: tuple[str, ...] = get_args(Method)
Backend = Literal["auto", "cpu", "cuda"]
Progress = Callable[[int, int, float], object]


def solve(
    scene: Scene | None = None,
    /,
    *,
    backend: Backend = "auto",
    device: int | None = None,
    threads: int = 0,
    ranks: Any = None,
    progress: Progress | bool | None = None,
    stop: Callable[[], bool] | None = None,
    check: Check = "warn",
    method: Method = "auto",
    steps: int | None = None,
    tol: float | None = None,
    tol_x: float | None = None,
    tol_y: float | None = None,
    atol: float | None = None,
    max_steps: int | None = None,
    max_seconds: float | None = None,
    iteration_tol: float | None = None,
    max_iterations: int | None = None,
    states: str | Iterable[int | str] | None = "auto",
    memory_limit: float | None = None,
    event_location: bool = False,
    confirm: bool = True,
    reuse: bool = True,
    **arguments: Any,
) -> Result:
    """Solves a scene on the time points t_j = j T/J, j = 0..J::

        E x' = A x + B y + f(t),   0 <= y  ⊥  w = N x + M y + g(t) >= 0,   x(0) = x0,   0 <= t <= T.

    Args:
        scene: a :class:`Scene`; or none, and A, B, N, M, x0, T, f, g, E, ... by name as :class:`Scene` takes them.
        backend: ``"cpu"``, ``"cuda"``, or ``"auto"``: a CUDA device where it is predicted to be faster.
        device: number of the CUDA device, as :func:`cuda_devices` lists them; None: the first one, and with ``ranks`` that
            of the rank's number on its machine.
        threads: of the host; 0: all cores, and with ``ranks`` a rank's share of them.
        ranks: a communicator of mpi4py, whose ranks call ``solve`` together with the same scene and options: each computes
            a slab of the time points, and all get the whole result. For methods ``"multigrid"``, ``"contour"``
            and ``"dual"``.
        progress: True: after a second, one line with what is done and an estimate of the time left, on a terminal or
            in a notebook. Or a function, called as ``progress(done, total, change)`` now and then: steps done and all
            steps, or sweeps done, 0 and the change of the last sweep.
        stop: called now and then; where it returns true the solve ends with status ``interrupted``.
        check: what happens where the status is not ``solved``: ``"warn"`` issues :class:`NotSolvedWarning`, True raises
            :class:`NotSolved`, False does nothing.
        method: ``"auto"``, ``"march"``, ``"contour"``, ``"multigrid"``, ``"dual"``, ``"euler"``, ``"events"``,
            ``"shooting"``, ``"galerkin"``, ``"goal"`` or ``"contour-literal"``.
        steps: time steps J, with a tolerance those of the first grid.
        tol: refine the grid until the error of every component of y, and of the states that are recorded, is estimated
            below tol times its largest value; where y may jump, of its mean over [0, t] (``error_estimate_of``). Where neither steps
            nor a tolerance is given, the scene decides; if it states none either, tol is 1e-3.
        tol_x, tol_y: the same for one kind; alone: the other one is not controlled.
        atol: error allowed besides, in the units of the scene.
        max_steps, max_seconds: where a tolerance ends refining.
        iteration_tol: where sweeps end, the largest change relative to max(1, |y|); None: 1e-12, or tol/1000.
        max_iterations: sweeps at most.
        states: components of x to record: ``"all"``, ``"none"`` or None, a list of indices from 0 or of names, or
            ``"auto"``: all of them where there are at most 1000.
        memory_limit: bytes; a solve that is predicted to need more is refused.
        event_location: method galerkin: solve again with nodes where constraints switch.
        confirm: False: solve once, and never again with other steps where something speaks against the result. For
            loops that have no time for it.
        reuse: keep what this solve prepares (fits, factorizations, plans, arrays of the device) for the next call with a scene
            of the same matrices and the same options, as a :class:`Solver` does; that of one scene for each device. The result is
            the same to rounding. Only large scenes are kept: Kronecker sums and sparse matrices with initial values.
            False: nothing is kept, and what was kept is dropped.

    Returns:
        A :class:`Result`, whatever the status is.

    Raises:
        Error: bad input, a ValueError whose ``argument`` says which; :class:`DoesNotFit` (also a MemoryError),
            :class:`DeviceError`, :class:`InternalError`.
        NotSolved: with ``check=True``.
        Interrupted: Ctrl-C, a KeyboardInterrupt whose ``result`` has the valid part.

    Exceptions of callables leave ``solve``. Callables run in the thread that called ``solve``; other threads of Python run
    while it computes.

    Example:
        >>> r = solve(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], g="-sin(2*pi*t)", x0=0, T=1)
        >>> r.status, r.y[-1]
    """
    known(arguments, solve)
    judgement(check, progress, stop)
    shared = ranks_of(ranks, stop)
    scene = stated(scene, steps, arguments)
    options = _options(
        scene,
        method=method,
        steps=steps,
        tol=tol,
        tol_x=tol_x,
        tol_y=tol_y,
        atol=atol,
        max_steps=max_steps,
        max_seconds=max_seconds,
        iteration_tol=iteration_tol,
        max_iterations=max_iterations,
        states=states,
        memory_limit=memory_limit,
        event_location=event_location,
        confirm=confirm,
    )
    on = wanted(backend, device, threads, shared)
    with reporting(progress if _speaks(shared) else None, options.iteration_tolerance) as report:
        of_ranks = None if shared is None else _core.Ranks(shared)
        answer = _core.solve(scene._model, options, on, report, stop, of_ranks, bool(reuse) and shared is None)
    return _checked(answer, scene, check if _speaks(shared) or check is True else False, stop)


def _speaks(ranks: Ranks | None) -> bool:
    """Whether this rank warns and shows progress: the first one does so for all."""
    return ranks is None or ranks.rank == 0


class Solver:
    """One scene, prepared once and solved many times with other x0, f and g.

    It keeps what does not depend on them: fits of the kernel, factorizations, plans, arrays of the host and the device.
    The first solve makes them. The scene itself stays as it is.

    Args:
        scene: a :class:`Scene`.
        backend, device, threads, ranks, and options: as :func:`solve` takes them; ``progress``, ``stop`` and ``check`` belong to each
            solve.

    Example:
        >>> solver = Solver(scene("signorini", Q=127), steps=400)
        >>> first = solver.solve()
        >>> solver.set_x0(x0)
        >>> second = solver.solve()
    """

    def __init__(
        self,
        scene: Scene,
        *,
        backend: Backend = "auto",
        device: int | None = None,
        threads: int = 0,
        ranks: Any = None,
        **options: Any,
    ) -> None:
        if not isinstance(scene, Scene):
            raise Error(f"scene: is a {type(scene).__name__}; give a bromwich.Scene", "scene")
        for name in options:
            if name not in OPTIONS:
                raise Error(f"{name}: is no option of a solver; use {', '.join(sorted(OPTIONS))}", name)
        self._scene = scene
        self._stated = options
        made = _options(scene, **options)
        self._iteration_tolerance = made.iteration_tolerance
        self._ranks = ranks_of(ranks, None)
        on = wanted(backend, device, threads, self._ranks)
        self._prepared = _core.Prepared(scene._model, made, on, None if self._ranks is None else _core.Ranks(self._ranks))

    @property
    def scene(self) -> Scene:
        """As it was given."""
        return self._scene

    def __repr__(self) -> str:
        stated = "".join(f", {name} = {value!r}" for name, value in self._stated.items())
        return f"<bromwich.Solver of {self._scene!r}{stated}>"

    def set_x0(self, x0: Any) -> None:
        """The state at t = 0, m values.

        Raises:
            Error: for another length, values that are not finite, and scenes with boundary values.
        """
        self._prepared.set_x0(filled(x0, self._scene.states, "x0"))

    def set_sources(self, f: Any = None, g: Any = None, breakpoints: Iterable[float] = ()) -> None:
        """Both sources, as :class:`Scene` takes them; None is zero.

        A solver keeps the values of sources. Where a function has changed in itself, hand it over again.
        """
        parts = self._scene._sources(on_this_host(f, "f"), on_this_host(g, "g"))
        self._prepared.set_sources(*parts, sorted(number(t, "breakpoints") for t in listed(breakpoints, "breakpoints")))

    def solve(
        self, *, progress: Progress | bool | None = None, stop: Callable[[], bool] | None = None, check: Check = "warn"
    ) -> Result:
        """As :func:`bromwich.solve`, with the scene as it is now; on ranks all of them call it."""
        judgement(check, progress, stop)
        if self._ranks is not None:
            ranks_of(self._ranks.comm, stop)
        with reporting(progress if _speaks(self._ranks) else None, self._iteration_tolerance) as report:
            answer = self._prepared.solve(report, stop)
        return _checked(answer, self._scene, check if _speaks(self._ranks) or check is True else False, stop)


def known(arguments: dict[str, Any], function: Callable) -> None:
    """Refuses arguments that neither a scene nor the function takes, as Python does, and suggests a similar name."""
    of_scene, own = Scene.__init__.__kwdefaults__ or {}, function.__kwdefaults__ or {}
    for name in (n for n in arguments if n not in of_scene):
        near = suggestion(name, [*of_scene, *own])
        raise TypeError(f"{function.__name__}() got an unexpected keyword argument {name!r}{near}")


def _options(
    scene: Scene,
    *,
    method: Method = "auto",
    states: str | Iterable[int | str] | None = "auto",
    event_location: bool = False,
    confirm: bool = True,
    one_grid: bool = False,
    **numbers: float | None,
) -> _core.Options:
    """``numbers``: those of NUMBERS; None is that of the compiled part. ``one_grid``: its steps, where no tolerance is given."""
    o = _core.Options()
    word(method, "method")
    try:
        o.method = method
    except Error:
        near = suggestion(method, METHODS)
        raise Error(f"method: found {method!r}{near}; use one of {', '.join(METHODS)}", "method") from None
    o.trace = True
    o.event_location = bool(event_location)
    o.confirm = bool(confirm)
    absolute = method == "goal"  # of its quantity
    given = {name: value for name, value in numbers.items() if value is not None}
    for name, value in given.items():
        attribute, kind = NUMBERS[name]
        setattr(o, attribute, _tolerance(value, name, absolute) if name in TOLERANCES else kind(value, name))
    if not one_grid:
        stated = o.tolerance > 0 or o.tolerance_x > 0 or o.tolerance_y > 0
        o = o.with_defaults(scene._model)
        if hasattr(scene, "_netlist") and not stated:  # y of ideal switches need not be unique
            o.tolerance, o.tolerance_x = 0.0, o.tolerance
    tolerances = [t for t in (o.tolerance, o.tolerance_x, o.tolerance_y) if t > 0]
    if tolerances and not absolute and "iteration_tol" not in given:
        o.iteration_tolerance = max(1e-3 * min(tolerances), o.iteration_tolerance)
    _select_states(o, scene, states)
    return o


def _tolerance(value: Any, name: str, absolute: bool) -> float:
    found = number(value, name)
    if absolute and 0 < found < float("inf"):
        return found
    if not 0 < found < 1:
        raise Error(f"{name}: found {value!r}; give a number between 0 and 1", name)
    return found


def _select_states(o: _core.Options, scene: Scene, states: str | Iterable[int | str] | None) -> None:
    if isinstance(states, str):
        if states not in ("auto", "all", "none"):
            remedy = "use 'auto', 'all', 'none' or a list of indices or names"
            raise Error(f"states: found {states!r}; {remedy}", "states")
        if states == "all" or (states == "auto" and scene.states <= RECORDED_STATES):
            o.record_all_states()
    elif states is not None:
        components = _components(states, scene.names["x"])
        if components:
            o.record_states(components)


def _components(states: Any, names: list[str]) -> list[int]:
    try:
        wanted = list(states)
    except TypeError:
        raise Error(f"states: found {states!r}; give a list, such as [0]", "states") from None
    known = {name: i for i, name in enumerate(names)}
    components = []
    for state in wanted:
        found = known.get(state) if isinstance(state, str) else state
        try:
            components.append(operator.index(found))  # type: ignore[arg-type]
        except TypeError:
            remedy = f"give indices from 0, or names: {', '.join(names)}" if names else "give indices from 0"
            raise Error(f"states: found {state!r}{suggestion(str(state), names)}; {remedy}", "states") from None
    return components


def judgement(check: Any, progress: Any, stop: Any) -> None:
    """Refuses what cannot be meant, before a solve."""
    if not isinstance(check, (bool, str)) or check not in (True, False, "warn"):
        raise Error(f"check: found {check!r}; use 'warn', True to raise NotSolved, or False", "check")
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise Error(f"progress: found {progress!r}; give True or a function of (done, total, change)", "progress")
    if not (stop is None or callable(stop)):
        raise Error(f"stop: found {stop!r}; give a function without arguments", "stop")


def stated(scene: Scene | None, steps: int | None, arguments: dict[str, Any]) -> Scene:
    """The given scene, or a new one of the arguments by name."""
    if scene is None:
        return Scene(steps=steps, **arguments)
    if isinstance(scene, (str, os.PathLike)):
        maker = "Scene.from_toml" if os.fspath(scene).endswith(".toml") else "scene"
        raise Error(f"scene: is the name {os.fspath(scene)!r}; give bromwich.{maker}({os.fspath(scene)!r})", "scene")
    if not isinstance(scene, Scene):
        remedy = "its entries by name, solve(**scene)" if isinstance(scene, dict) else "A, B, N, ... by name"
        raise Error(f"scene: is a {type(scene).__name__}; give a bromwich.Scene, or {remedy}", "scene")
    if arguments:
        name = next(iter(arguments))
        raise Error(f"{name}: is given with a scene; make the scene with it", name)
    return scene


def _checked(answer: _core.Answer, scene: Scene, check: Check, stop: Callable[[], bool] | None) -> Result:
    return judged(Result(answer, scene), answer.by_keyboard, check, stop)


def judged(
    result: Any, by_keyboard: bool, check: Check, stop: Callable[[], bool] | None, stacklevel: int = 4
) -> Any:
    """Returns the result; warns or raises as `check` says if it is not solved. `stacklevel`: of the caller's line."""
    if result.ok:
        return result
    if by_keyboard:
        raise Interrupted(result.reason, result)
    asked = stop is not None and result.status is Status.interrupted
    if check is True:
        raise NotSolved(f"status: {result.status}: {result.reason}", result)
    if check and not asked:
        warnings.warn(f"{result.status}: {result.reason}", NotSolvedWarning, stacklevel=stacklevel)
    return result
