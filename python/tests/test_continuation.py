"""Branches of periodic states: against the response of a linear structure, and what they refuse."""

from math import pi

import bromwich
import numpy as np
import pytest


def forced(contacts=()):
    mass = bromwich.Structure(M=1, C=0.1, K=1, f="cos(w*t)", contacts=contacts, parameters={"w": 1.0})
    return lambda w: mass.scene(T=2 * pi / w, periodic=True, w=w)


def test_the_response_of_a_linear_structure():
    b = bromwich.continuation(forced(), 0.5, 2)
    assert b.complete and b.stable.all() and not b.marks
    exact = 1 / np.abs(1 - b.parameter**2 + 0.1j * b.parameter)
    # Steps of 1e-9 of the states, 16 a period, and (I - D)^{-1} below 10.
    np.testing.assert_allclose(b.amplitude("q0"), exact, rtol=1e-6)
    np.testing.assert_allclose(b.amplitude(1), b.parameter * exact, rtol=1e-6)
    np.testing.assert_allclose(b.T, 2 * pi / b.parameter, rtol=1e-6)
    assert b.x0.shape == b.multipliers.shape == (b.parameter.size, 2)
    ax = b.plot("q0", name="w")
    assert ax.get_xlabel() == "w" and ax.get_ylabel() == "amplitude of q0"


def test_marks_of_an_impact_oscillator():
    b = bromwich.continuation(forced(bromwich.Contact(normal=[1], gap=1, restitution=0.8)), 1.2, 2)
    assert [m.event for m in b.marks] == ["fold", "grazing", "fold"]
    assert b.marks[1].component == "c0.normal"
    # Free motion touches the stop where its amplitude is 1.
    assert abs(1 / abs(1 - b.marks[1].parameter ** 2 + 0.1j * b.marks[1].parameter) - 1) < 1e-4
    assert set(b.impacts) == {0, 1} and not b.stable.all()
    assert b.plot().get_legend() is not None
    there = int(np.flatnonzero(b.stable & (b.impacts == 1))[-1])
    again = bromwich.continuation(forced(bromwich.Contact(normal=[1], gap=1, restitution=0.8)), b.parameter[there], 2, x0=b.x0[there])
    assert again.impacts[0] == 1
    assert "fold" in repr(again)


def test_refusals():
    with pytest.raises(bromwich.Error, match="end: found an interval"):
        bromwich.continuation(forced(), 1, 1)
    with pytest.raises(bromwich.Error, match="scene_of: gave a int"):
        bromwich.continuation(lambda w: 3, 1, 2)
    with pytest.raises(bromwich.Error, match="no periodic condition"):
        bromwich.continuation(lambda w: bromwich.Scene(A=-1, B=1, N=1, M=1, x0=0, T=1), 1, 2)
    with pytest.raises(bromwich.Error, match="state: found 'z'"):
        bromwich.continuation(forced(), 1, 1.1).amplitude("z")
    with pytest.raises(ZeroDivisionError):
        bromwich.continuation(lambda w: 1 / 0, 1, 2)
