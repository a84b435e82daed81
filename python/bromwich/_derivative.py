"""Derivatives of a result with respect to the data of its scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from . import _core
from ._errors import Error
from ._recorded import Recorded
from ._result_derivative import Margin, ResultDerivative, Tangent, tables, values
from ._scene import Scene
from ._sources import _require


class Gradient(NamedTuple):
    """Derivatives of a number with respect to the data, each of the shape of its data: x0 (m), f (J+1) x m and g (J+1) x
    n at the time points, A, B, N, M and E. M is None where y jumps at a switch or M is singular on an active set (a change
    of M acts from one side only), E is None where switches are not located. Where y_i = w_i = 0 and only some changes
    have a derivative, the data are None on which that depends: x0; f, A, B and E; or g, N and M. Of scenes with more than
    1000 states there are x0 (None for dynamics of callbacks), f (through B: (J+1) x n), g and M. Boundary-value problems
    have b (m), E0 and ET in place of x0. Where impacts are located there is restitution (n); None where a contact strikes
    with e = 0, since bounces that begin there act from one side."""

    x0: np.ndarray | None
    f: np.ndarray | None
    g: np.ndarray | None
    A: np.ndarray | None
    B: np.ndarray | None
    N: np.ndarray | None
    M: np.ndarray | None
    E: np.ndarray | None
    b: np.ndarray | None = None
    E0: np.ndarray | None = None
    ET: np.ndarray | None = None
    restitution: np.ndarray | None = None


class ParameterGradient(NamedTuple):
    """Derivatives of a number with respect to the parameters of a Kronecker sum, as :meth:`Derivative.jvp_parameters` takes
    them."""

    face: float
    across: float
    decay: float
    B: float
    N: float


class Derivative(ResultDerivative):
    """The derivative of a solution, not by differences. It is exact for the steps of the solve, or with located switches for
    the solution; :meth:`vjp_error` estimates how far they are apart.

    Made by :meth:`Result.derivative`. ``jvp`` follows a change of the data forward in time, ``vjp`` gives the gradient
    of a number with respect to all data by one pass backward. Where y is continuous it is the derivative of the discrete
    solution with its active sets held. Where y or x may jump, switches are located, and the jump of the sensitivity at
    each is included (``located``).

    Example:
        >>> d = solve(A=A, B=B, N=N, M=M, x0=x0, T=1, g=g, steps=400).derivative()
        >>> d.jvp(x0=[1, 0]).y                           # dy/dx0_0 at all times
        >>> d.vjp(x=np.eye(401, 2, k=-400)).x0           # gradient of x_0(T) with respect to x0
    """

    def __init__(self, result: Recorded, located: bool | None = None, all_times: bool = False) -> None:
        super().__init__(_core.Derivative(result._answer, located, all_times), result)

    @property
    def without_M(self) -> str:
        """Empty, or why there is no derivative with respect to M."""
        return self._core.without_M

    def jvp(
        self,
        *,
        x0: Any = None,
        f: Any = None,
        g: Any = None,
        A: Any = None,
        B: Any = None,
        N: Any = None,
        M: Any = None,
        E: Any = None,
        b: Any = None,
        E0: Any = None,
        ET: Any = None,
        restitution: Any = None,
        states: bool = False,
    ) -> Tangent:
        """The change of the solution that a change of the data causes, to first order.

        Args:
            x0: m values. f, g: (J+1) x m and (J+1) x n, at the time points. A, B, N, M, E: as those of the scene. b, E0,
                ET: m values and m x m, of a boundary condition. restitution: n values. None: no change.
            states: whether x of scenes with more than 1000 states is wanted, (J+1) x m numbers; smaller ones always have it.

        Raises:
            Error: another shape, or entries that are not finite; a change of M where :attr:`without_M` says that there is no
                derivative.
        """
        *arrays, E0, ET = tables(f=f, g=g, A=A, B=B, N=N, M=M, E=E, E0=E0, ET=ET)
        given = {"x0": x0, "b": b, "restitution": restitution}
        x0, b, restitution = (None if v is None else values(v, name).ravel() for name, v in given.items())
        return Tangent(*self._core.jvp(x0, *arrays, b, E0, ET, restitution, bool(states)))

    def vjp(
        self, *, y: Any = None, x: Any = None, w: Any = None, integral: Any = None, x0: bool = True
    ) -> Gradient:
        """The gradient of Σ y̅·y + x̅·x + w̅·w + i̅·∫y with respect to the data.

        Args:
            y, x, w, integral: y̅, x̅, w̅ and i̅, (J+1) x n, m, n and n; None: zero. Row j of i̅ weighs the integral of y
                over [0, t_j].
            x0: False: without the gradient by x0 where it costs more than all others (sparse A with more than 1000 states).

        Raises:
            Error: another shape, or entries that are not finite; weights of y, x or w at a switch (:attr:`one_sided`).
        """
        return Gradient(*self._core.vjp(*tables(y=y, x=x, w=w, integral=integral), bool(x0)))

    def jvp_error(self, *, states: bool = False, **changes: Any) -> Tangent:
        """The estimated error of each entry of :meth:`jvp` against the solution that the steps approximate: twice what half
        the step changes, or, with located switches, what a hundred times the tolerance of the integration changes. The
        scene is solved once more, on the first call.

        Args:
            changes, states: as for :meth:`jvp`.

        Raises:
            Error: as :meth:`jvp`, and where the solution with half the step is not found or has no derivative.
        """
        given = {name: changes.pop(name, None) for name in "x0 f g A B N M E b E0 ET restitution".split()}
        for name in changes:
            raise Error(f"{name}: is not known; use {', '.join(given)}", name)
        *arrays, E0, ET = tables(**{name: given[name] for name in "f g A B N M E E0 ET".split()})
        x0, b, restitution = (
            None if given[name] is None else values(given[name], name).ravel() for name in ("x0", "b", "restitution")
        )
        return Tangent(*self._error.jvp(x0, *arrays, b, E0, ET, restitution, bool(states)))

    def vjp_error(
        self, *, y: Any = None, x: Any = None, w: Any = None, integral: Any = None, x0: bool = True
    ) -> Gradient:
        """The estimated error of each entry of :meth:`vjp`, as :meth:`jvp_error`. Where the solution is right to three
        digits its gradient may be off by a third: a switch between two time points moves it by a share of the step.

        Args:
            y, x, w, integral, x0: as for :meth:`vjp`.

        Example:
            >>> d.vjp_error(x=np.eye(401, 2, k=-400)).x0     # of the gradient of x_0(T) with respect to x0
        """
        return Gradient(*self._error.vjp(*tables(y=y, x=x, w=w, integral=integral), bool(x0)))

    @cached_property
    def _error(self) -> Any:
        return self._core.error(self._result._answer)

    def jvp_parameters(
        self,
        *,
        face: float = 0.0,
        across: float = 0.0,
        decay: float = 0.0,
        B: float = 0.0,
        N: float = 0.0,
        states: bool = False,
    ) -> Tangent:
        """The change of the solution of a Kronecker sum (scenes on rectangles and boxes) that a change of its parameters
        causes, with x0, f and g held; f through B changes with B.

        Args:
            face, across: relative changes of the diffusivities along the face with the constraints, and across it. Both
                equal dc/c: that of c. decay: change of the decay rate, 1/time. B, N: relative changes of B and N.
            states: as for :meth:`jvp`.

        Raises:
            Error: the dynamics are no Kronecker sum, or y may jump.
        """
        return Tangent(*self._core.jvp_parameters(face, across, decay, B, N, bool(states)))

    def vjp_parameters(self, *, y: Any = None, x: Any = None, w: Any = None, integral: Any = None) -> ParameterGradient:
        """The gradient of the number of :meth:`vjp` with respect to these parameters.

        Args:
            y, x, w, integral: as for :meth:`vjp`.
        """
        return ParameterGradient(*self._core.vjp_parameters(*tables(y=y, x=x, w=w, integral=integral)))

    def quantity(self, *, W: Any = None, c: Any = None, end_W: Any = None, end_c: Any = None) -> QuantityGradient:
        """A quantity of interest of the discrete states and its gradient with respect to the data:

            I = ∫ (x^T W x + c(t)^T x) dt + x(T)^T end_W x(T) + end_c^T x(T),   x linear between the time points.

        Args:
            W, end_W: m x m. c: a function, expressions or a table, as ``f`` of a scene. end_c: m. None: zero; all None: the
                section [quantity] of the scene file.

        Returns:
            ``value``, ``gradient`` (a :class:`Gradient`) and ``weights`` ((J+1) x m, dI/dx, to weigh a :class:`Tangent`).
        """
        value, weights = self._core.quantity(*self._quantity(W, c, end_W, end_c))
        return QuantityGradient(value, self.vjp(x=weights), weights)


class QuantityGradient(NamedTuple):
    """A quantity of interest, its gradient, and dI/dx at the time points."""

    value: float
    gradient: Gradient
    weights: np.ndarray


class BatchDerivative:
    """The derivatives of the scenes of a batch, with the scenes as leading axis.

    Made by :meth:`BatchResult.derivative`. A scene that is not solved, or not differentiable where it is, has a line in
    ``reason`` and NaN (with ``failed="zero"``: 0) in all tables; the others do not see it. Changes and weights of a scene
    that are not finite count as no derivative of this scene.

    Attributes:
        reason: K lines, empty where there is a derivative.
        ok: K booleans, whether there is one.
        located: K booleans, whether switches are located.
        side_by_side: how many scenes are differentiated together, on a device.
        margin: K of :class:`Margin`.
    """

    # Number of axes for one scene; an array with one more has the scenes as leading axis.
    _AXES = {"x0": 1, "restitution": 1, **{name: 2 for name in "f g A B N M E y x w integral".split()}}

    def __init__(
        self, answer: _core.BatchAnswer, located: bool | None = None, threads: int = 1, failed: str = "nan"
    ) -> None:
        _require(failed in ("nan", "zero", "raise"), "failed", f"found {failed!r}", "use nan, zero or raise")
        self._core, self._K, self._threads = _core.BatchDerivative(answer, located), answer.scenes, threads
        self._failed = failed
        self.reason: list[str] = self._core.reason
        self.ok = np.array([not reason for reason in self.reason])
        self.located = np.array(self._core.located)
        self.side_by_side: int = self._core.side_by_side
        self.margin = [Margin(*one) for one in self._core.margin]

    def jvp(self, **changes: Any) -> tuple[Tangent, list[str]]:
        """The changes of the solutions: tables K x (J+1) x n, m, n, n, and K reasons.

        Args:
            changes: x0, f, g, A, B, N, M, E, restitution as :meth:`Derivative.jvp` takes them, or with a leading axis of length K.
        """
        given, finite = self._each(changes, "x0 f g A B N M E restitution")
        *found, reason = self._core.jvp(given, self._threads)
        found, reason = self._judged([self._stacked(t) for t in found], reason, finite)
        return Tangent(*found), reason

    def vjp(self, **weights: Any) -> tuple[Gradient, list[str]]:
        """The gradients of one number each: members with a leading axis of length K, and K reasons. M of a scene is NaN
        where a change of M acts from one side only, as in :class:`Gradient`.

        Args:
            weights: y, x, w, integral as :meth:`Derivative.vjp` takes them, or with a leading axis of length K.
        """
        given, finite = self._each(weights, "y x w integral")
        *found, reason = self._core.vjp(given, self._threads)
        found, reason = self._judged([self._stacked(t) for t in found], reason, finite)
        *of_data, restitution = [None if t is None else t[:, :, 0] if i in (0, 8) else t for i, t in enumerate(found)]
        return Gradient(*of_data, restitution=restitution), reason

    def _judged(self, tables: list[Any], reason: list[str], finite: np.ndarray) -> tuple[list[Any], list[str]]:
        reason = [r or ("" if good else "derivative: changes or weights are not finite") for r, good in zip(reason, finite)]
        return _of_failed(tables, reason, self._failed), reason

    def _stacked(self, table: np.ndarray | None) -> Any:
        return _stacked(table, self._K)

    def _each(self, given: dict[str, Any], names: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Tables for the compiled part, and whether those of each scene are finite."""
        taken, finite = {}, np.ones(self._K, dtype=bool)
        for name, value in given.items():
            _require(name in names.split(), name, "is not known", f"use {', '.join(names.split())}")
            if value is None:
                continue
            v, axes = values(value, name), self._AXES[name]
            _require(v.ndim in (axes, axes + 1), name, f"has {v.ndim} axes", f"give {axes}, or one more for the scenes")
            own = v.ndim == axes + 1
            _require(not own or v.shape[0] == self._K, name, f"has a leading axis of length {v.shape[0] if own else 0}",
                     f"give {self._K} entries, or one for all")
            v = np.broadcast_to(v, (self._K, *v.shape[-axes:]))
            v = v[:, None, :] if v.ndim == 2 else v
            good = np.isfinite(v).all(axis=(1, 2))
            if own and not good.all():
                v = np.where(good[:, None, None], v, 0)
                finite &= good
            taken[name] = np.ascontiguousarray(v)
        return taken, finite


class BatchJacobian:
    """The derivatives of the scenes of a batch by parameters, with the scenes as leading axis.

    Made by :meth:`BatchResult.derivative` with ``parameters``. A scene that is not solved, or not differentiable where it
    is, has a line in ``reason`` and NaN (with ``failed="zero"``: 0) in all tables.

    Attributes:
        by: a :class:`Tangent` of tables K x rows x columns under the name of each parameter.
        reason: K lines, empty where there is a derivative.
        ok: K booleans, whether there is one.
        margin: K of :class:`Margin`.

    Example:
        >>> r = solve_batch([gear(mu, e) for mu, e in zip(mus, es)], tol=1e-6, times=[0, 1, 2], states="all")
        >>> d = r.derivative(parameters={"mu": mus, "e": es}, scene_of=gear)
        >>> d.by["mu"].x[d.ok, -1]                       # dx(T)/dmu of the scenes that have it
    """

    def __init__(
        self,
        answer: _core.BatchAnswer,
        parameters: Mapping[str, Any],
        scene_of: Callable[..., Scene],
        located: bool | None,
        threads: int,
        failed: str,
    ) -> None:
        _require(failed in ("nan", "zero", "raise"), "failed", f"found {failed!r}", "use nan, zero or raise")
        _require(bool(parameters), "parameters", "is empty", "name one or more")
        names, K = list(parameters), answer.scenes
        given = [np.asarray(parameters[name], dtype=float) for name in names]
        for name, v in zip(names, given):
            _require(v.shape in ((), (K,)), name, f"has shape {v.shape}", f"give a number, or {K}")
        table = np.ascontiguousarray(np.column_stack([np.broadcast_to(v, (K,)) for v in given]))

        def model(at: list[float]) -> _core.Model:
            return scene_of(**dict(zip(names, at)))._model

        by, self.reason, margins = _core.batch_jacobian(answer, names, table, model, located, threads)
        self.ok = np.array([not reason for reason in self.reason])
        self.margin = [Margin(*one) for one in margins]
        self.by: dict[str, Tangent] = {}
        for name, tables_of in zip(names, by):
            found = [_stacked(t, K) for t in tables_of]
            self.by[name] = Tangent(*_of_failed(found, self.reason, failed))


def _stacked(table: np.ndarray | None, K: int) -> Any:
    return None if table is None else table.reshape(K, -1, table.shape[1])


def _of_failed(tables: list[Any], reason: list[str], failed: str) -> list[Any]:
    """What scenes without a derivative have."""
    bad = np.array([bool(r) for r in reason])
    if failed == "raise" and bad.any():
        k = int(np.argmax(bad))
        raise Error(f"scene {k}: {reason[k]}", "derivative")
    if bad.any():
        tables = [None if t is None else np.array(t) for t in tables]
        for t in tables:
            if t is not None:
                t[bad] = 0 if failed == "zero" else np.nan
    return tables
