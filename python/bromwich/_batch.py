"""Many scenes of one structure at once."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Literal, overload

import numpy as np

from . import _core
from ._array_solver import SharedArray
from ._arrays import of_other_library, on_host
from ._backends import cuda_devices
from ._batch_output import BatchOutput
from ._derivative import BatchDerivative, BatchJacobian
from ._errors import Error, Interrupted, NotSolved, NotSolvedWarning
from ._machine import wanted
from ._progress import reporting
from ._ranks import DealtAnswer, Ranks, ranks_of
from ._rows import Status
from ._scene import Scene
from ._solve import Backend, Check, Method, Progress, _options, known
from ._sources import source

MATRICES = ("A", "B", "N", "M", "E")
# Number of axes for one scene; an array with one more has the scenes as leading axis.
AXES = {"A": 2, "B": 2, "N": 2, "M": 2, "E": 2, "x0": 1}


class BatchResult(BatchOutput):
    """What :func:`solve_batch` returns, for K scenes.

    Attributes:
        t: times of the rows: J+1 time points, or the ``times`` that were given.
        residual: K values, max over time of ||min(y, w)|| / max(1, ||N x + g||), maximum norms.
        scene: the first scene, or that of the shared data, with names and units.
        in_lanes: scenes that were stepped side by side.
        backend, seconds: as in :class:`Result`.
    """

    def __init__(self, answer: _core.BatchAnswer | DealtAnswer, scene: Scene) -> None:
        self._answer, self.scene = answer, scene
        self.t: np.ndarray = answer.t
        self.residual: np.ndarray = answer.residual
        self.x_components: list[int] = answer.x_components
        self.in_lanes: int = answer.in_lanes
        self.backend: str = answer.backend
        self.seconds: float = answer.seconds

    # Lists of K entries take longer to make than the steps of many a batch.
    @cached_property
    def status(self) -> list[Status]:
        """K values; ``unsupported`` where the data of one scene are refused."""
        words = {str(s): s for s in Status}
        return [words[word] for word in self._answer.status]

    @cached_property
    def reason(self) -> list[str]:
        """K lines; empty where there is nothing to say."""
        return self._answer.reason

    @cached_property
    def warning(self) -> list[str]:
        """K lines, likewise."""
        return self._answer.warning

    @cached_property
    def method(self) -> list[str]:
        """K words, the method that solved each scene."""
        return self._answer.method

    @cached_property
    def infeasible_at(self) -> np.ndarray:
        """K times; NaN where there is none."""
        return np.array(self._answer.infeasible_at)

    @cached_property
    def y(self) -> np.ndarray:
        """K x (J+1) x n; NaN where a scene has no value. With ``results="device"`` a :class:`SharedArray`."""
        return self._rows("y")

    @cached_property
    def w(self) -> np.ndarray:
        """w = N x + M y + g, K x (J+1) x n."""
        return self._rows("w")

    @cached_property
    def x(self) -> np.ndarray:
        """K x (J+1) x the number of recorded components, which are ``x_components``."""
        return self._rows("x")

    def _rows(self, name: str) -> Any:
        columns = None if isinstance(self._answer, DealtAnswer) else self._answer.columns_on_backend
        if columns is not None:
            if name == "w" or (name == "x" and columns[1] == 0):
                return np.zeros((len(self), self.t.size, 0))
            shape = (len(self), self.t.size, columns[name == "x"])
            return SharedArray(self._answer, name, shape)
        found = self._answer.rows(name)
        return found.reshape(self._answer.scenes, self.t.size, found.shape[1])

    @property
    def ok(self) -> np.ndarray:
        """K booleans: whether the status is ``solved``."""
        return np.array(self._answer.solved, dtype=bool)

    @overload
    def derivative(
        self, *, located: bool | None = None, threads: int = 1, failed: str = "nan"
    ) -> BatchDerivative: ...
    @overload
    def derivative(
        self,
        *,
        located: bool | None = None,
        threads: int = 1,
        failed: str = "nan",
        parameters: Mapping[str, Any],
        scene_of: Callable[..., Scene],
    ) -> BatchJacobian: ...
    def derivative(
        self,
        *,
        located: bool | None = None,
        threads: int = 1,
        failed: str = "nan",
        parameters: Mapping[str, Any] | None = None,
        scene_of: Callable[..., Scene] | None = None,
    ) -> BatchDerivative | BatchJacobian:
        """The derivatives of all scenes, with their ``jvp`` and ``vjp`` (:class:`BatchDerivative`), or by parameters
        (:class:`BatchJacobian`). With located switches the rows may have any ``times``; otherwise they have to be the time
        points of the grid, without ``times`` and ``tol``.

        Args:
            located: with located switches; None: where M is not of class P, and where ``times`` were given.
            threads: for ``jvp`` and ``vjp``, or for all of the derivatives by parameters; 0: all.
            failed: what scenes without a derivative have in the tables, ``"nan"`` or ``"zero"``; ``"raise"``: the first one
                raises an :class:`Error`.
            parameters: values of the arguments of ``scene_of``, K each, or a number for all.
            scene_of: a function of these, by keyword, that returns the scene with these values.
        """
        if not isinstance(self._answer, DealtAnswer) and self._answer.columns_on_backend is not None:
            raise Error("derivative: is asked of results on a device; solve with results='host'", "results")
        if isinstance(self._answer, DealtAnswer):
            raise Error("derivative: is asked of scenes on several ranks; solve the scenes of each rank without ranks", "ranks")
        if parameters is None and scene_of is None:
            return BatchDerivative(self._answer, located, threads, failed)
        if parameters is None or scene_of is None:
            raise Error("parameters: are given together with scene_of; give both, or neither", "parameters")
        return BatchJacobian(self._answer, parameters, scene_of, located, threads, failed)

    def __len__(self) -> int:
        return self._answer.scenes

    def __repr__(self) -> str:
        return f"<bromwich.BatchResult {int(self.ok.sum())} of {len(self)} scenes solved, {self.t.size - 1} steps>"


def solve_batch(
    scenes: Scene | Sequence[Scene] | None = None,
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
    times: Any = None,
    states: Any = "auto",
    iteration_tol: float | None = None,
    max_iterations: int | None = None,
    memory_limit: float | None = None,
    results: Literal["host", "device"] = "host",
    **arguments: Any,
) -> BatchResult:
    """Solves K scenes of one structure on the time points t_j = j T/J::

        E_k x' = A_k x + B_k y + f_k(t),   0 <= y  ⊥  w = N_k x + M_k y + g_k(t) >= 0,   x(0) = x0_k.

    Small dense scenes with common A, B, N and M and method march are stepped side by side in vector lanes; the others
    one after the other, prepared once where they share their dynamics. Each result is that of :func:`solve`, to
    rounding, with a status of its own.

    Args:
        scenes: a list of scenes with equal m, n and steps; or one scene, or none and the arguments of :class:`Scene`,
            with a leading axis of length K for some of the following.
        A, B, N, M, E: K x rows x columns, or shared, rows x columns.
        x0: K x m, or shared, m values.
        f, g: K x (J+1) x width, tables on the grid; a list of K functions or sources (each as :class:`Scene` takes
            them, in a tuple ``("each", [...])``); or shared, as :class:`Scene` takes it.
        times: of the rows, increasing from 0 to T (scenes with another T: at the same parts of it); the time points of
            the grid without. Needed with ``tol``, where grids differ from scene to scene.
        steps: J, one for all scenes, whose steps are taken side by side; None: those of the first scene, or 400, and with
            ``times`` but without ``tol`` each scene is solved as :func:`solve` does it, to 1e-3.
        backend, device, threads, progress, stop, method, tol, states, iteration_tol, max_iterations, memory_limit:
            as :func:`solve` takes them. ``progress`` counts scenes.
        results: ``"device"``: y and x stay in the memory of a CUDA device, as :class:`SharedArray`, which other libraries
            take without a copy; w is not computed. ``backend="auto"`` is a device then, where there is one. On the cpu
            they are NumPy's arrays.
        ranks: a communicator of mpi4py, whose ranks call ``solve_batch`` together with the same arguments: scene k goes to
            rank k modulo their number, and all get the whole result.
        check: what happens where a status is not ``solved``, as in :func:`solve`; there is one warning for all.

    Returns:
        A :class:`BatchResult`.

    Raises:
        Error: wrong shapes, different lengths of leading axes, bad options. Bad values of one scene (NaN in its x0) are
            its own: status ``unsupported``, and the reason.
        NotSolved: with ``check=True``, if any scene is not solved.
        Interrupted: Ctrl-C.

    Example:
        >>> r = solve_batch(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], g="-sin(t)", x0=[[0.0], [0.5], [1.0]], T=6)
        >>> r.y.shape, r.status[0]
        ((3, 401, 1), <Status.solved: 'solved'>)
    """
    known(arguments, solve_batch)
    if results not in ("host", "device"):
        raise Error(f'results: is {results!r}; use "host" or "device"', "results")
    shared = ranks_of(ranks, stop)
    if shared is not None and results == "device":
        raise Error("results: stay on a device of one rank; use results='host' with ranks", "results")
    models, count, axes, x0, f, g, first = _batch(scenes, steps, arguments)
    options = _options(
        first,
        method=method,
        steps=steps,
        tol=tol,
        states=states,
        iteration_tol=iteration_tol,
        max_iterations=max_iterations,
        memory_limit=memory_limit,
        one_grid=times is None,
    )
    rows = [] if times is None else np.ravel(np.asarray(times, dtype=float)).tolist()
    data = (models, count, axes, x0, f, g) if shared is None else _share(shared, models, count, axes, x0, f, g)
    if results == "device" and backend == "auto" and cuda_devices():
        backend = "cuda"
    on = wanted(backend, device, threads, shared)
    first_rank = shared is None or shared.rank == 0

    def own() -> _core.BatchAnswer:
        with reporting(progress if first_rank else None, options.iteration_tolerance) as report:
            return _core.solve_batch(*data, rows, results == "device", options, on, report, stop)

    answer = own() if shared is None else DealtAnswer(shared.together(own), count or len(models), shared)
    result = BatchResult(answer, first)
    if answer.by_keyboard:
        raise Interrupted("stopped on request", result)
    failed = int(np.sum(~result.ok))
    if failed:
        k = int(np.argmin(result.ok))
        message = f"{failed} of {count or len(models)} scenes are not solved; scene {k}: {result.status[k]}: {result.reason[k]}"
        if check is True:
            raise NotSolved(message, result)
        if check and first_rank and not (stop is not None and result.status[-1] is Status.interrupted):
            warnings.warn(message, NotSolvedWarning, stacklevel=2)
    return result


def _share(ranks: Ranks, models: list, count: int, axes: dict, x0: Any, f: list, g: list) -> tuple:
    """The arguments of one rank: every scene k with k % size = rank."""
    scenes = count or len(models)
    if scenes < ranks.size:
        raise Error(f"ranks: found {ranks.size} for {scenes} scenes; use fewer ranks", "ranks")
    if any(one != scenes for one in ranks.comm.allgather(scenes)):
        raise Error("ranks: have different numbers of scenes; give all ranks the same", "ranks")
    mine = slice(ranks.rank, None, ranks.size)
    return (
        models if count else models[mine],
        len(range(scenes)[mine]) if count else 0,
        {name: np.ascontiguousarray(values[mine]) for name, values in axes.items()},
        None if x0 is None else np.ascontiguousarray(x0[mine]),
        f[mine],
        g[mine],
    )


def _batch(scenes: Any, steps: int | None, arguments: dict[str, Any]) -> tuple:
    if scenes is not None and not isinstance(scenes, Scene):
        listed = list(scenes)
        if not listed or not all(isinstance(s, Scene) for s in listed):
            raise Error("scenes: is no list of scenes; give bromwich.Scene objects, or A, B, N, ... by name", "scenes")
        if arguments:
            name = next(iter(arguments))
            raise Error(f"{name}: is given with a list of scenes; make the scenes with it", name)
        return [s._model for s in listed], 0, {}, None, [], [], listed[0]
    axes, x0, own, common = _split(arguments)
    lengths = {name: len(value) for name, value in {**axes, **own}.items()}
    if x0 is not None:
        lengths["x0"] = x0.shape[0]
    count = next(iter(lengths.values()), 1)
    for name, length in lengths.items():
        if length != count:
            first = next(iter(lengths))
            raise Error(f"{name}: has {length} scenes, and {first} has {count}; give one number of scenes", name)
        if length == 0:
            raise Error(f"{name}: has no scenes; give at least one", name)
    if isinstance(scenes, Scene):
        unknown = [n for n in arguments if n not in (*AXES, "f", "g")]
        shared = [n for n in common if n in arguments and n not in axes and n not in own and not (n == "x0" and x0 is not None)]
        if unknown or shared:
            name = (unknown or shared)[0]
            raise Error(f"{name}: is given with a scene and has no leading axis; make the scene with it", name)
        stated = scenes
    else:
        tables = [v.shape[1] - 1 for v in own.values() if isinstance(v, np.ndarray) and v.shape[1] > 1]
        stated = Scene(steps=steps if steps is not None else max(tables, default=None), **common)
    parts = []
    for name, width in (("f", stated._model.sources), ("g", stated.constraints)):
        parts.append([source(v, f"{name} of scene {k}", width, stated.T, stated._parameters) for k, v in enumerate(own.get(name, ()))])
    return [stated._model], count, axes, x0, *parts, stated


def _split(arguments: dict[str, Any]) -> tuple[dict[str, np.ndarray], np.ndarray | None, dict[str, Any], dict[str, Any]]:
    """The arguments with a leading axis, and the arguments of the first scene."""
    axes: dict[str, np.ndarray] = {}
    own: dict[str, Any] = {}
    common, x0 = dict(arguments), None
    for name, one in AXES.items():
        given = arguments.get(name)
        if given is None or hasattr(given, "tocsc") or hasattr(given, "diagonal") and not hasattr(given, "ndim"):
            continue
        array = on_host(given, name)
        if array.ndim == one + 1:
            common[name] = _first_finite(array) if array.shape[0] else array
            if name == "x0":
                x0 = np.ascontiguousarray(array)
                common[name] = np.zeros(array.shape[1])
            else:
                axes[name] = np.ascontiguousarray(array)
        elif array.ndim > one + 1:
            raise Error(f"{name}: has {array.ndim} axes; give {one}, or {one + 1} with the scenes first", name)
    for name in ("f", "g"):
        given = arguments.get(name)
        if isinstance(given, tuple) and len(given) == 2 and given[0] == "each":
            own[name] = list(given[1])
        elif isinstance(given, np.ndarray) or of_other_library(given):
            array = on_host(given, name)
            if array.ndim == 3:
                own[name] = np.ascontiguousarray(array)
        if name in own:
            common[name] = None
    return axes, x0, own, common


def _first_finite(array: np.ndarray) -> np.ndarray:
    """Entries for what all scenes have in common. Each scene has its own, and says what is wrong with them."""
    good = np.isfinite(array).reshape(array.shape[0], -1).all(axis=1)
    return array[np.argmax(good)] if good.any() else np.zeros_like(array[0])
