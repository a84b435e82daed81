"""Matrices of SciPy whose indices leave them: SciPy does not check them, and reads and writes wherever they say."""

import numpy as np
import pytest

import bromwich

sparse = pytest.importorskip("scipy.sparse")

STATES, CONSTRAINTS = 6, 3


def stated(name):
    """The matrix of a scene with 6 states and 3 constraints, with an entry in the last row and column."""
    shapes = {"B": (STATES, CONSTRAINTS), "N": (CONSTRAINTS, STATES), "M": (CONSTRAINTS, CONSTRAINTS)}
    rows, columns = shapes.get(name, (STATES, STATES))
    matrix = (-5 if name == "A" else 1) * np.eye(rows, columns)
    matrix[-1, -1] = matrix[0, 0]
    return matrix


def with_parts(matrix, **parts):
    """The same object with other arrays, as a program that fills them itself makes it."""
    for name, values in parts.items():
        setattr(matrix, name, values)
    return matrix


def compressed(form):
    """Broken matrices of rows or columns, and what is said of them."""
    make = {"csc": sparse.csc_array, "csr": sparse.csr_array}[form]

    def broken(dense, change):
        a = make(dense)
        return with_parts(a, **change(a))

    return {
        f"{form} from one": (lambda d: broken(d, lambda a: {"indices": a.indices + 1}), "count from 0"),
        f"{form} negative": (lambda d: broken(d, lambda a: {"indices": a.indices - 1}), "count from 0"),
        f"{form} far": (lambda d: broken(d, lambda a: {"indices": a.indices + 10**8}), "count from 0"),
        f"{form} falling starts": (lambda d: broken(d, lambda a: {"indptr": np.array([0, 10**8, *a.indptr[2:]])}), "indptr"),
        f"{form} late starts": (lambda d: broken(d, lambda a: {"indptr": a.indptr + 1}), "indptr"),
        f"{form} few starts": (lambda d: broken(d, lambda a: {"indptr": a.indptr[:-1]}), "indptr"),
        f"{form} few values": (lambda d: broken(d, lambda a: {"data": a.data[:1]}), "1 values"),
        f"{form} fractions": (lambda d: broken(d, lambda a: {"indices": a.indices + 0.5}), "whole numbers"),
    }


def coordinates(dense):
    a = sparse.coo_array(dense)
    return with_parts(a, coords=tuple(c + 1 for c in a.coords)) if hasattr(a, "coords") else with_parts(a, row=a.row + 1, col=a.col + 1)


def lists(dense):
    a = sparse.lil_array(dense)
    a.rows[0] = [10**6]
    return a


def diagonals(dense):
    a = sparse.dia_array(dense)
    return with_parts(a, offsets=np.array([0, 1, 2]))


def blocks(dense):
    a = sparse.bsr_array(dense, blocksize=(1, 1))
    return with_parts(a, indices=a.indices + 1)


CASES = {
    **compressed("csc"),
    **compressed("csr"),
    "coo from one": (coordinates, "count from 0"),
    "lil far": (lists, "count from 0"),
    "dia with other offsets": (diagonals, "offsets"),
    "bsr from one": (blocks, "count from 0"),
}


@pytest.mark.parametrize("name", ["A", "B", "N", "M", "E", "F", "E0"])
@pytest.mark.parametrize("case", CASES)
def test_indices_outside_are_refused(name, case):
    make, said = CASES[case]
    arguments = {key: stated(key) for key in "ABNM"}
    if name != "A":
        arguments["A"] = sparse.csc_array(stated("A"))
    arguments |= {"E0": np.eye(STATES), "ET": -np.eye(STATES), "b": 0} if name == "E0" else {"x0": 1.0}
    arguments |= {"f": np.ones(STATES)} if name == "F" else {}
    arguments[name] = make(stated(name))
    with pytest.raises(bromwich.Error, match=said) as caught:
        bromwich.Scene(**arguments, T=1.0)
    assert caught.value.argument == name


def test_callbacks_and_large_matrices_are_checked_too():
    make = CASES["csc from one"][0]
    eye = np.eye(3)
    with pytest.raises(bromwich.Error, match="B: has row indices"):
        bromwich.Dynamics(3, make(eye), eye, shifted=lambda z: lambda R: R)
    large = make(np.eye(300))
    with pytest.raises(bromwich.Error, match="M: has row indices from 1 to 300, and 300 of them; count from 0"):
        bromwich.Scene(A=-np.eye(300), B=np.eye(300), N=np.eye(300), M=large, x0=1.0, T=1.0)


@pytest.mark.parametrize("form", ["csc", "csr", "coo", "lil", "dok", "dia", "bsr"])
def test_what_is_right_is_taken(form):
    """Duplicates are summed and order does not matter, as SciPy has it."""
    dense = {key: stated(key) for key in "ABNM"}
    expected = bromwich.solve(**dense, x0=1.0, T=1.0, g=-np.ones(3), steps=20)
    given = {key: sparse.csc_array(value).asformat(form) for key, value in dense.items()}
    found = bromwich.solve(**given, x0=1.0, T=1.0, g=-np.ones(3), steps=20)
    np.testing.assert_allclose(found.y, expected.y, rtol=0, atol=1e-12)
    indices, starts = np.array([1, 0, 0, *range(1, 6)]), np.array([0, 3, *range(4, 9)])
    doubled = sparse.csc_array((np.array([0.0, -2, -3, *[-5] * 5]), indices, starts), shape=(6, 6))
    found = bromwich.solve(**{**dense, "A": doubled}, x0=1.0, T=1.0, g=-np.ones(3), steps=20)
    np.testing.assert_allclose(found.y, expected.y, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: bromwich.Dynamics(3, np.eye(3), np.eye(3), shifted=lambda z: lambda R: R, bound=(1,)), "bound: has 1 values"),
        (lambda: bromwich.Scene(A=-1, B=1, N=1, M=1, x0=0, T=1, g=([-np.inf, np.inf], [0.0, 1.0])), "g: has times that are not finite"),
        (lambda: bromwich.Scene(A=-1, B=1, N=1, M=1, x0=0, T=1, breakpoints=[np.nan]), "breakpoints: found nan"),
        (lambda: bromwich.Scene(A=-np.eye(20), B=np.eye(20), N=np.eye(20), M=bromwich.Tridiagonal([0.0], np.ones(20), 0), x0=0, T=1),
         "M.lower: has 1 entries"),
        (lambda: bromwich._core.Model.empty().set_M_sparse((2, 2, np.ones(2), np.array([0, 7], np.int32), np.array([0, 1, 2], np.int32))),
         "compressed columns are inconsistent"),
        (lambda: bromwich._core.Model.empty().set_M_sparse((2, 2, np.ones(2), np.array([0, 1], np.int32), np.array([0, 10**8, 2], np.int32))),
         "compressed columns are inconsistent"),
    ],
)
def test_other_arrays_from_outside(make, said):
    with pytest.raises(bromwich.Error, match=said):
        make()
