"""Arguments of the wrong kind: one line that names the argument, and nothing of the inside."""

import numpy as np
import pytest

import bromwich

GOOD = dict(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], x0=[1.0], T=1.0, g="-t", steps=8, check=False)
NO_NUMBERS = ["5", "", [1], {}, object(), 1j, b"5", 10**400, np.ones((2, 2))]
NO_WORDS = [5, None, b"march", ["march"], "auto\0", "auto\nx", ""]
NO_ARRAYS = ["x", {}, [[1, 2], [3]], 1j, [None], 10**400, np.datetime64("2020"), np.zeros((2, 3, 5)), [[float("nan")]]]
NO_LISTS = [5, 1.5, 1j, True, object(), np.array(5)]


def cases():
    numbers = ("T", "steps", "tol", "tol_x", "tol_y", "atol", "max_steps", "max_seconds", "iteration_tol")
    for name in (*numbers, "max_iterations", "memory_limit", "threads"):
        yield from ((name, value) for value in NO_NUMBERS)
    for name in ("steps", "threads", "max_steps", "max_iterations"):
        yield from ((name, value) for value in (float("nan"), float("inf"), 1.5, 2**63, -(2**63), -1))
    for name in ("method", "backend", "lcp_class"):
        yield from ((name, value) for value in NO_WORDS)
    for name in ("A", "B", "N", "M", "x0"):
        yield from ((name, value) for value in NO_ARRAYS)
    for name in ("free", "breakpoints"):
        yield from ((name, value) for value in NO_LISTS)
    yield from (("stop", value) for value in (5, "stop", []))
    yield from (("progress", value) for value in (5, "yes", [1]))


LINE = dict(along=None, across=(3, 0.25, 1.0), b=[1.0, 0, 0], n=[1.0, 0, 0])


@pytest.mark.parametrize("name", ["steps", "max_steps", "tol", "iteration_tol"])
@pytest.mark.parametrize("value", ["3", -1, float("nan"), 1j], ids=repr)
def test_of_nonlinear_solves(name, value):
    with pytest.raises(bromwich.Error, match=rf"^{name}: (found|is) "):
        bromwich.solve_nonlinear(**{**GOOD, name: value}, phi=lambda t, x, y: [0.0])


@pytest.mark.parametrize("name, value", [("across", (3, 0.25)), ("across", (2.5, 0.25, 1)), ("along", 5), ("reaction", "1")])
def test_of_lines_and_squares(name, value):
    with pytest.raises(bromwich.Error, match=f"^{name}: found "):
        bromwich.Kronecker(**{**LINE, name: value})


def test_of_parameters():
    with pytest.raises(bromwich.Error, match="^Q: found 'many'; give a number$"):
        bromwich.scene("signorini", Q="many")
    with pytest.raises(bromwich.Error, match="^steps: found 2.5; give a whole number from 1 on$"):
        bromwich.Scene.relay(A=[[0.0]], B=[[1.0]], C=[[1.0]], x0=[1.0], T=1, steps=2.5)


@pytest.mark.parametrize("name, value", list(cases()), ids=lambda v: " ".join(repr(v).split())[:20])
def test_is_refused_in_one_line(name, value):
    with pytest.raises(bromwich.Error) as refused:
        bromwich.solve(**{**GOOD, name: value})
    message = str(refused.value)
    assert not isinstance(refused.value, bromwich.InternalError)
    assert name in message and "\n" not in message
    assert not any(inside in message for inside in ("std::", "nanobind", "incompatible"))
