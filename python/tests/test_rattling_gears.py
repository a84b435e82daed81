"""examples/rattling_gears.py: derivatives of a batch by parameters beside differences of solves and beside those of one result."""

import importlib.util
import pathlib

import bromwich
import numpy as np
import pytest

place = pathlib.Path(__file__).resolve().parents[2] / "examples" / "rattling_gears.py"
if not place.exists():
    pytest.skip("the examples are not here", allow_module_level=True)
spec = importlib.util.spec_from_file_location("rattling_gears", place)
example = importlib.util.module_from_spec(spec)
spec.loader.exec_module(example)

T = 4.0
mus, es = np.array([0.1, 0.2, 0.3]), np.array([0.8, 0.7, 0.0])


def end(mu, e):
    r = bromwich.solve(example.gear(mu, e, T), method="events", tol=1e-10, states="all")
    assert r.ok
    return r.x[-1]


@pytest.fixture(scope="module")
def both():
    return example.gears(mus, es, T, threads=2)


# Solves to 1e-10 of their sizes, divided by the step of the differences.
def test_slopes_are_differences(both):
    found, slopes = both
    assert found.ok.all() and list(slopes.ok) == [True, True, False]
    step = 1e-4
    for k in (0, 1):
        by_mu = (end(mus[k] + step, es[k]) - end(mus[k] - step, es[k])) / (2 * step)
        by_e = (end(mus[k], es[k] + step) - end(mus[k], es[k] - step)) / (2 * step)
        np.testing.assert_allclose(slopes.by["mu"].x[k, -1], by_mu, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(slopes.by["e"].x[k, -1], by_e, rtol=1e-4, atol=1e-5)
        assert abs(by_e).max() > 0.1 and slopes.margin[k].transversality > 0


def test_what_has_none(both):
    slopes = both[1]
    assert "e = -0.002" in slopes.reason[2] and np.isnan(slopes.by["e"].x[2]).all()
    assert slopes.margin[2].margin == 0
    r = both[0]
    zero = r.derivative(parameters={"mu": mus, "e": es}, scene_of=lambda mu, e: example.gear(mu, e, T), failed="zero")
    assert (zero.by["mu"].x[2] == 0).all()
    with pytest.raises(bromwich.Error, match="scene 2: derivative"):
        r.derivative(parameters={"mu": mus, "e": es}, scene_of=lambda mu, e: example.gear(mu, e, T), failed="raise")
    with pytest.raises(bromwich.Error, match="parameters"):
        r.derivative(parameters={"mu": mus})
    with pytest.raises(bromwich.Error, match="mu"):
        r.derivative(parameters={"mu": mus[:2]}, scene_of=example.gear)


# By the data: the coefficients of restitution of the rows of both flanks.
def test_restitution_of_rows(both):
    found, slopes = both
    rows = np.zeros(6)
    rows[[0, 3]] = 1
    single = bromwich.solve(example.gear(mus[0], es[0], T), method="events", tol=1e-8, states="all")
    d = single.derivative(located=True)
    np.testing.assert_allclose(d.jvp(restitution=rows).x[-1], slopes.by["e"].x[0, -1], rtol=1e-5, atol=1e-7)
    last = np.zeros((single.t.size, 4))
    last[-1, 0] = 1
    np.testing.assert_allclose(d.vjp(x=last).restitution @ rows, slopes.by["e"].x[0, -1, 0], rtol=1e-5, atol=1e-7)
    of_batch = found.derivative()
    change, reason = of_batch.jvp(restitution=rows)
    assert not reason[0]
    np.testing.assert_allclose(change.x[0, -1], slopes.by["e"].x[0, -1], rtol=1e-5, atol=1e-7)
