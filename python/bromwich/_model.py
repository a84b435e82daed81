"""Fills the model of a scene in the compiled part with the arguments of :class:`Scene`, after checking them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from . import _core
from ._arrays import Tridiagonal, compressed, filled, is_sparse, lcp_matrix, matrix, multiple, number, vector
from ._dynamics import Dynamics, Kronecker
from ._errors import Error


def parameters_of(given: Mapping[str, float] | None) -> dict[str, float]:
    """Names and values for expressions."""
    if given is not None and not isinstance(given, Mapping):
        raise Error(f"parameters: is a {type(given).__name__}; give a dict of names and numbers", "parameters")
    return {str(k): number(v, f"parameters[{k!r}]") for k, v in (given or {}).items()}


def set_dynamics(
    model: _core.Model, A: Any, B: Any, N: Any, E: Any, dynamics: Dynamics | Kronecker | None, single_states: bool
) -> None:
    """A, B, N and E, or what describes them. `single_states`: f acts on single states of a Kronecker sum."""
    given = [name for name, value in (("A", A), ("B", B), ("N", N), ("E", E)) if value is not None]
    if dynamics is not None:
        if given:
            raise Error(f"{given[0]}: is given with dynamics; give one of the two", given[0])
        if isinstance(dynamics, Kronecker):
            k = dynamics
            along, across = (*k.along, k.advection[0], *k.ends_along), (*k.across, k.advection[1], *k.ends_across)
            beside = [(*line, 0.0, None, None) for line in k.beside]
            model.set_rectangle(along, across, k.reaction, k.b, k.n, k.far_b, k.far_n, beside, single_states)
        elif isinstance(dynamics, Dynamics):
            d = dynamics
            model.set_supplied(d.states, d.B, d.N, d.shifted, d.mass, d.bound)
        else:
            found = type(dynamics).__name__
            raise Error(f"dynamics: is a {found}; give bromwich.Dynamics or bromwich.Kronecker", "dynamics")
        return
    without_constraints = B is None and N is None
    for name, value in (("A", A), ("B", B), ("N", N)):
        if value is None and not (without_constraints and name != "A"):
            raise Error(f"{name}: is missing; give A, B and N, A alone for a scene without constraints, or dynamics", name)
    A = A if is_sparse(A) else matrix(A, "A")
    m = A.shape[0]
    if without_constraints:
        B, N = np.zeros((m, 0)), np.zeros((0, m))
    if is_sparse(A):
        sparse_E = None if E is None else compressed(E if np.ndim(E) else multiple(E, m, "E"), "E")
        model.set_sparse(compressed(A, "A"), compressed(B, "B", column=True), compressed(N, "N"), sparse_E)
        return
    dense_E = None if E is None else multiple(E, m, "E")
    model.set_dense(A, matrix(B, "B", column=True), matrix(N, "N"), dense_E)


def set_lcp(model: _core.Model, M: Any) -> None:
    """M as it is stored: dense, three diagonals or sparse."""
    found = lcp_matrix(M, model.constraints)
    if isinstance(found, Tridiagonal):
        model.set_M_tridiagonal(found.lower, found.diagonal, found.upper)
    elif isinstance(found, tuple):
        model.set_M_sparse(found)
    else:
        model.set_M(found)


def set_conditions(model: _core.Model, x0: Any, E0: Any, ET: Any, b: Any) -> None:
    """Initial values, or boundary values."""
    if E0 is None and ET is None and b is None:
        if x0 is None:
            raise Error("x0: is missing; give the state at t = 0, or E0, ET and b", "x0")
        model.set_x0(filled(x0, model.states, "x0"))
        return
    for name, value in (("E0", E0), ("ET", ET), ("b", b)):
        if value is None:
            raise Error(f"{name}: is missing; give E0, ET and b, E0 x(0) + ET x(T) = b", name)
    if x0 is not None:
        raise Error("x0: is given with boundary values; give one of the two", "x0")
    m = model.states
    model.set_boundary(multiple(E0, m, "E0"), multiple(ET, m, "ET"), filled(b, m, "b"))


def set_f_entry(model: _core.Model, F: Any) -> None:
    """How f enters x': as it is, by B, or by a matrix F."""
    if F is None:
        model.set_f_entry("x", None)
    elif isinstance(F, str):
        if F != "B":
            raise Error(f"F: found {F!r}; give a matrix m x k, or 'B'", "F")
        model.set_f_entry("B", None)
    else:
        model.set_f_entry("F", compressed(F, "F", column=True))
