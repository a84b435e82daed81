"""Contact problems with friction on circles, without dynamics, and the files in which they are collected."""

from __future__ import annotations

import os
import warnings
from typing import Any, NamedTuple

import numpy as np

from . import _core
from ._arrays import on_host
from ._errors import Error, NotSolved, NotSolvedWarning
from ._hdf5_file import Refused
from ._hdf5_reading import reading
from ._solve import Check
from ._sparse import is_sparse


class FrictionProblem(NamedTuple):
    """u = W r + q with the coefficients of friction mu, as :func:`solve_friction` takes it."""

    W: np.ndarray  #: 3k x 3k
    q: np.ndarray  #: 3k
    mu: np.ndarray  #: k
    r: np.ndarray | None  #: forces that the file states as a solution


class FrictionResult(NamedTuple):
    """What :func:`solve_friction` returns."""

    r: np.ndarray  #: forces, 3k
    u: np.ndarray  #: velocities, 3k
    status: str  #: ``"solved"``: the residual is met; ``"unsolved"``; ``"nonfinite"``
    #: largest distance of r from the projection of r - rho u onto the cones, relative to the largest force, in units in which
    #: the diagonal of W is 1
    residual: float
    newton: int  #: linear systems solved
    sweeps: int  #: over all contacts

    @property
    def ok(self) -> bool:
        """Whether the status is ``solved``."""
        return self.status == "solved"


def solve_friction(
    W: Any, q: Any, mu: Any, *, tolerance: float = 1e-10, max_sweeps: int = 20000, check: Check = "warn"
) -> FrictionResult:
    """Solves a contact problem with Coulomb's friction on circles: u = W r + q and for each contact, with the normal first and
    then two tangents::

        0 <= r_n  ⊥  u_n >= 0,   |r_t| <= mu r_n,   r_t = -mu r_n u_t / |u_t| where u_t != 0.

    Sweeps of exact solves of each contact (nonsmooth Gauss-Seidel) and semismooth Newton take turns. What is returned is one
    solution: where contacts share a load there are others, and there may be none.

    Args:
        W: 3k x 3k, an array or a matrix of scipy.sparse.
        q: 3k values.
        mu: k values >= 0, or one for all contacts.
        tolerance: of the residual.
        max_sweeps: sweeps after which it ends as ``"unsolved"``.
        check: what happens where the status is not ``"solved"``: ``"warn"``, True (raises) or False.

    Raises:
        Error: shapes that do not fit, or a negative mu.
        NotSolved: with ``check=True``.

    Example:
        >>> solve_friction(np.eye(3), [-1.0, 3.0, 0.0], 0.5).r
        array([ 1. , -0.5,  0. ])
    """
    right = np.ascontiguousarray(on_host(q, "q"))
    if right.ndim != 1 or right.size % 3:
        raise Error(f"q: has shape {right.shape}; give 3 values for each contact", "q")
    matrix = np.ascontiguousarray(W.toarray() if is_sparse(W) else on_host(W, "W"), dtype=np.float64)
    if matrix.ndim != 2:
        raise Error(f"W: has {matrix.ndim} axes; give a matrix", "W")
    try:
        friction = np.ascontiguousarray(np.broadcast_to(on_host(mu, "mu"), (right.size // 3,)))
    except ValueError:
        raise Error(f"mu: has shape {np.shape(mu)}; give {right.size // 3} values, one for each contact", "mu") from None
    result = FrictionResult(*_core.friction_problem(matrix, right, friction, float(tolerance), int(max_sweeps)))
    if check and not result.ok:
        message = f"the contact problem is {result.status}, with a residual of {result.residual:.1e}"
        if check is True:
            raise NotSolved(f"status: {message}", result)
        warnings.warn(message, NotSolvedWarning, stacklevel=2)
    return result


def load_friction(path: str | os.PathLike[str]) -> FrictionProblem:
    """A contact problem in space from a file of FCLib (HDF5), as Siconos and LMGC90 write them.

    Local problems have W, q and mu. Global ones, M v = H r + f with u = H^T v + w, are reduced to W = H^T M^{-1} H and
    q = H^T M^{-1} f + w.

    Args:
        path: the file.

    Raises:
        Error: another file, or a problem in the plane or with rolling friction. Needs h5py, and scipy for
            global problems.
    """
    name = os.fspath(path)
    try:
        with reading(name) as file:
            return _problem(file, name)
    except Refused as refused:
        raise Error(f"path: {refused}", "path") from None
    except KeyError as error:
        raise Error(f"path: {name!r} is not whole ({error}); give a file of FCLib", "path") from None


def _problem(file: Any, name: str) -> FrictionProblem:
    kind = next((key for key in ("fclib_local", "fclib_global") if key in file), None)
    if kind is None:
        raise Refused(f"{name!r} has no group fclib_local or fclib_global", "give a file of FCLib with friction in space")
    group = file[kind]
    if int(np.ravel(group["spacedim"][()])[0]) != 3:
        raise Refused(f"{name!r} is a problem in the plane", "give one in space, with two tangents for each contact")

    def values(key: str) -> np.ndarray:
        return np.ravel(group["vectors"][key][()]).astype(np.float64)

    if kind == "fclib_local":
        W, q = _dense(group["W"], name), values("q")
    else:
        H = _dense(group["H"], name)
        solved = _solved(group["M"], np.column_stack([H, values("f")]), name)
        W, q = H.T @ solved[:, :-1], H.T @ solved[:, -1] + values("w")
    r = np.ravel(file["solution/r"][()]).astype(np.float64) if "solution/r" in file else None
    return FrictionProblem(W, q, values("mu"), r)


def _entries(group: Any, name: str) -> tuple[tuple[int, int], np.ndarray, np.ndarray, np.ndarray]:
    """Shape, rows, columns and values. nz >= 0: triplets (i, p, x); -1: compressed columns with the begins p; -2: rows."""
    rows, columns, count = (int(np.ravel(group[key][()])[0]) for key in ("m", "n", "nz"))
    i, p, x = (np.ravel(group[key][()]) for key in ("i", "p", "x"))
    if count >= 0:
        return (rows, columns), i[:count], p[:count], x[:count]
    if count not in (-1, -2):
        raise Refused(f"{name!r} has a matrix of an unknown storage, nz = {count}", "write it by fclib")
    begin = p[: (rows if count == -2 else columns) + 1]
    along, across = np.repeat(np.arange(begin.size - 1), np.diff(begin)), i[: begin[-1]]
    return (rows, columns), *((along, across) if count == -2 else (across, along)), x[: begin[-1]]


def _dense(group: Any, name: str) -> np.ndarray:
    shape, rows, columns, values = _entries(group, name)
    matrix = np.zeros(shape)
    np.add.at(matrix, (rows, columns), values)
    return matrix


def _solved(group: Any, right: np.ndarray, name: str) -> np.ndarray:
    """By the sparse factors of the matrix, which may have thousands of rows."""
    try:
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu
    except ImportError:
        raise Refused(f"{name!r} is a global problem, which needs scipy", "pip install scipy") from None
    shape, rows, columns, values = _entries(group, name)
    return splu(csc_matrix((values, (rows, columns)), shape=shape)).solve(right)
