"""Netlists: from files, from text and written in Python, with outputs of their results."""

import pickle

import numpy as np
import pytest

import bromwich

BUCK = """Buck converter
.param Rload=5
Vin in 0 24
S1 in sw g 0 SI
Vg g 0 PULSE(0 5 0 10n 10n 3.99u 10u)
D1 0 sw DI
L1 sw out 100u
C1 out 0 47u
R1 out 0 {Rload}
.model SI SW(Ron=10m Roff=1Meg Vt=2.5)
.model DI D(Ron=10m Roff=1Meg Vfwd=0.5)
.tran 10u 1m uic
"""


def written():
    c = bromwich.Circuit("Buck converter").param(Rload=5)
    c.V("Vin", "in", 0, 24).S("S1", "in", "sw", "g", 0, Ron="10m", Roff=1e6, Vt=2.5)
    c.V("Vg", "g", 0, "PULSE(0 5 0 10n 10n 3.99u 10u)").D("D1", 0, "sw", Ron=0.01, Roff=1e6, Vfwd=0.5)
    return c.L("L1", "sw", "out", 100e-6).C("C1", "out", 0, "47u").R("R1", "out", 0, "{Rload}")


@pytest.mark.parametrize("made", ["text", "file", "python"])
def test_buck_against_a_mode_by_mode_program(made, tmp_path):
    if made == "file":
        (tmp_path / "buck.cir").write_text(BUCK)
        scene = bromwich.circuit(tmp_path / "buck.cir")
    else:
        scene = bromwich.circuit(BUCK) if made == "text" else written().scene(stop=1e-3, step=1e-5, uic=True)
    assert scene.names["x"] == ["I(L1)", "V(C1)"] and scene.units["x"] == ["A", "V"]
    assert scene.outputs["V(out)"] == "V" and scene.outputs["I(S1)"] == "A" and scene.elements["D1"] == "D"
    assert scene.reduction["states"] == ["I(L1)", "V(C1)"] and scene.times.size == 101
    r = bromwich.solve(scene, tol_x=1e-6)
    assert r.ok, r.reason
    last = r.at(1e-3)  # values have 8 digits
    np.testing.assert_allclose([last["V(out)"][0], last["i(l1)"][0]], [9.1249652, 1.9269147], rtol=1e-7)


def test_outputs_obey_kirchhoff_and_ohm():
    scene = bromwich.circuit(BUCK, Rload=10)
    assert scene.parameters == {"rload": 10}
    r = bromwich.solve(scene)
    assert r.error_estimate_of and r.ok
    v, size = r["V(out)"], np.max(r["I(L1)"])
    np.testing.assert_allclose(r["I(R1)"], v / 10, atol=1e-12 * size)
    np.testing.assert_allclose(r["I(L1)"] - r["I(C1)"] - r["I(R1)"], 0, atol=1e-9 * size)
    np.testing.assert_allclose(r["V(in,sw)"], r["V(in)"] - r["V(sw)"], atol=1e-12 * 24)
    np.testing.assert_allclose(r["P(R1)"], v**2 / 10, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(r["V(out)*I(R1)*2 - t/rload"], 2 * v**2 / 10 - r.t / 10, rtol=1e-12, atol=1e-12)
    total = sum(r[f"P({name})"] for name in scene.elements)
    np.testing.assert_allclose(total, 0, atol=1e-8 * 24 * size)  # Tellegen


def test_measures_of_outputs():
    scene = bromwich.circuit("t\nV1 a 0 SIN(1 2 50)\nD1 a b DI\nR1 b 0 10\nC1 c 0 1u\nR2 c 0 1\n.model DI D(Ron=1m)\n.tran 1m 20m uic\n")
    r = bromwich.solve(scene, tol_x=1e-6)
    assert abs(r.mean("V(a)") - 1) < 1e-9 and abs(r.rms("V(a)") - np.sqrt(1 + 2)) < 1e-9
    assert abs(r.max("V(a)") - 3) < 1e-6 and abs(r.ripple("V(a)") - 4) < 1e-6
    # the positive part of 1 + 2 sin: (2 pi / 3 + sqrt 3) / pi of its mean over ... by quadrature
    s = np.linspace(0, 1, 2_000_001)
    positive = np.maximum(1 + 2 * np.sin(2 * np.pi * s), 0) * 10 / 10.001
    assert abs(r.mean("V(b)") - np.trapezoid(positive, s) if hasattr(np, "trapezoid") else np.trapz(positive, s)) < 1e-9


def test_periodic_state_with_losses_and_harmonics():
    scene = bromwich.circuit(BUCK).periodic()
    assert abs(scene.T - 1e-5) < 1e-17
    r = bromwich.solve(scene, steps=16)
    assert r.ok, r.reason
    # of a program that integrates mode by mode and closes the period, 8 digits
    np.testing.assert_allclose([r["V(out)"][-1], r["I(L1)"][-1]], [9.2793276, 1.5626621], rtol=1e-7)
    b = r.balance()
    assert b.load == "R1" and b.error < 1e-9 and abs(b.stored) < 1e-9 * b.supplied
    assert abs(b.elements["R1"].power - r.rms("V(out)") ** 2 / 5) < 1e-9 * b.elements["R1"].power
    assert abs(b.efficiency - b.elements["R1"].power * 1e-5 / b.supplied) < 1e-12
    assert b.elements["S1"].power > 0 and b.elements["D1"].power > 0 and b.elements["Vin"].power < 0


def test_harmonics_of_a_pulse():
    text = "t\nV1 a 0 PULSE(0 5 0 10n 10n 3.99u 10u)\nR1 a b 1\nC1 b 0 1u\n.tran 1u 10u\n"
    r = bromwich.solve(bromwich.circuit(text).periodic(), steps=16)
    # 5 V from 5 ns to 4.005 us between lines of 10 ns
    w, top = 2 * np.pi / 1e-5, 5.0
    c = r.harmonics("V(a)", 3)
    for k in (1, 2, 3):
        edge = np.sinc(k * 10e-9 / 1e-5)  # of lines: a box of 10 ns over one of 4 us that begins at 5 ns
        box = top * (1 - np.exp(-1j * k * w * 4e-6)) / (1j * np.pi * k) * np.exp(-1j * k * w * 5e-9)
        assert abs(c[k - 1] - box * edge) < 1e-9 * top
    assert abs(r.thd("V(a)") - np.sqrt(2 * (r.rms("V(a)") ** 2 - r.mean("V(a)") ** 2) / abs(c[0]) ** 2 - 1)) < 1e-9


def test_cards_of_measures():
    r = bromwich.solve(bromwich.circuit(BUCK + ".meas tran vo AVG V(out) FROM=990u TO=1m\n.meas TRAN late FIND V(out) AT=1m\n"))
    assert r.measures.keys() == {"vo", "late"}
    assert abs(r.measures["vo"] - r.mean("V(out)", 990e-6, 1e-3)) < 1e-6
    assert abs(r.measures["late"] - 9.1249652) < 1e-3


def test_pickle_and_derivatives_make_the_scene_again():
    scene = bromwich.circuit(BUCK)
    again = pickle.loads(pickle.dumps(scene))
    assert again.outputs == scene.outputs and isinstance(again, bromwich.CircuitScene)
    linear = bromwich.circuit("t\n.param R=2\nV1 a 0 1\nR1 a b {R}\nL1 b 0 1\n.tran 10m 1 uic\n")
    r = bromwich.solve(linear, tol_x=1e-9)
    # i = (1 - e^{-R t}) / R, di/dR at t = 1
    found = r.derivative(parameters=["r"]).jacobian()["r"].x[-1, 0]
    R = 2.0
    assert abs(found - (R * np.exp(-R) - (1 - np.exp(-R))) / R**2) < 1e-5


@pytest.mark.parametrize(
    "make, argument, words",
    [
        (lambda: bromwich.circuit("none.cir"), "source", "does not exist"),
        (lambda: bromwich.circuit(BUCK, q=1), "parameters", "'q' is no .param"),
        (lambda: bromwich.circuit("t\nV1 a 0 1\nV2 a 0 2\n.tran 1m\n"), "netlist: line 3", "V2 closes a loop"),
        (lambda: bromwich.Circuit().R("L1", "a", 0, 1), "name", "begin it with R"),
        (lambda: bromwich.Circuit().R("R1", "a b", 0, 1), "node", "without blanks"),
        (lambda: bromwich.Circuit().R("R1", "a", 0, [1]), "value", "value"),
        (lambda: bromwich.Circuit().R("R1", "a", 0, 0).scene(1), "netlist: line 2", "R1 = 0"),
    ],
)
def test_mistakes_are_named(make, argument, words):
    with pytest.raises(bromwich.Error) as caught:
        make()
    assert caught.value.argument == argument and words in str(caught.value)


@pytest.mark.parametrize("text, words", [("V(nowhere)", "no node 'nowhere'"), ("I(R9)", "no element 'r9'"), ("V(out", "')'"), ("V(a,b,c)", "write V(node)")])
def test_unknown_outputs_are_named(text, words):
    r = bromwich.solve(bromwich.circuit(BUCK))
    with pytest.raises(bromwich.Error, match="name") as caught:
        r[text]
    assert words in str(caught.value)


def test_scenes_of_arrays_have_no_outputs():
    r = bromwich.solve(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], x0=1, T=1, steps=4)
    with pytest.raises(bromwich.Error, match="no circuit"):
        r["V(a)"]


STEPPED = """t
.param duty=0.3 R=1k
.step param duty 0.2 0.8 0.2
.step param R list 500 1k 3k
V1 a 0 PULSE(0 1 0 0 0 {duty*1m} 1m)
R1 a b {R}
C1 b 0 1u
.meas m AVG V(b)
.tran 1u 1m
"""


def test_map_over_steps_and_over_given_values(tmp_path):
    scene = bromwich.circuit(STEPPED).periodic()
    assert list(scene.steps) == ["duty", "r"] and scene.steps["r"].tolist() == [500, 1000, 3000]
    m = scene.map("mean(V(b))", "ripple(V(b))", "m")
    assert m["m"].shape == (4, 3) and m.ok.all() and m.columns == {"mean(V(b))": "V", "ripple(V(b))": "V", "m": "V"}
    duty, tau = np.meshgrid(m.axes["duty"], m.axes["r"] * 1e-6, indexing="ij")
    np.testing.assert_allclose(m["mean(V(b))"], duty, atol=1e-9)
    np.testing.assert_allclose(m["m"], duty, atol=1e-9)
    q, p = np.exp(-duty * 1e-3 / tau), np.exp(-(1 - duty) * 1e-3 / tau)
    np.testing.assert_allclose(m["ripple(V(b))"], (1 - q) * (1 - p) / (1 - p * q), atol=1e-7)
    one = scene.map(r=[1000, 2000], threads=2)
    assert list(one.columns) == ["m"] and one["m"].shape == (2,)
    np.testing.assert_allclose(one["m"], 0.3, atol=1e-9)
    m.save(tmp_path / "m.csv")
    rows = (tmp_path / "m.csv").read_text().splitlines()
    assert rows[0] == "scene,duty,r,status,residual,mean(V(b)),ripple(V(b)),m,reason,warning" and len(rows) == 13
    assert m.plot("m").get_xlabel() == "r" and one.plot("m").get_ylabel() == "m / V"


def test_maps_name_mistakes_and_points_that_fail():
    scene = bromwich.circuit(STEPPED)
    for call, words in [
        (lambda: scene.map(q=[1]), "is no .param"),
        (lambda: scene.map("mean(V(x))"), "no node 'x'"),
        (lambda: scene.map(r=[]), "give a list"),
        (lambda: bromwich.circuit(BUCK).map(), "no parameter to vary"),
        (lambda: scene.map()["x"], "use one of"),
    ]:
        with pytest.raises(bromwich.Error, match=words):
            call()
    with pytest.warns(bromwich.NotSolvedWarning, match="1 of 2 operating points"):
        m = scene.map(r=[0, 1])
    assert m.status.tolist() == ["unsupported", "solved"] and "R1 = 0" in m.reason[0] and np.isnan(m["m"][0])


def test_elements_with_memory_and_expressions():
    c = bromwich.Circuit("oscillator").B("B1", "o", 0, V="5 - 5*schmitt(V(c), 2, 3)")
    c.R("R1", "o", "c", 1e3).C("C1", "c", 0, 1e-6, ic=2).X("X1", "c", "r", "q", subcircuit="comparator", Vhigh=1)
    c.V("V1", "r", 0, 2.5).R("R2", "q", 0, 1)
    scene = c.scene(stop=5e-3, uic=True)
    assert scene.reduction["states"] == ["V(C1)"]
    r = bromwich.solve(scene, tol_x=1e-7)
    assert set(r.modes) == {"B1.u1", "X1.B1.u1"} and r.modes["B1.u1"][0] == "off"
    way = 1e-3 * np.log(1.5)
    last = r.at([4.5 * way, 5.5 * way])
    np.testing.assert_allclose(last["V(c)"], [5 - 3 * 1.5**-0.5, 3 * 1.5**-0.5], rtol=1e-7)
    assert last["V(q)"][1] == 0 or last["V(q)"][1] == 1
    with pytest.raises(bromwich.Error, match="both or none"):
        c.B("B2", "o", 0)


def test_responses_of_a_low_pass():
    """1/(1 + s RC) about the operating point; the impedance is R beside C."""
    r = bromwich.solve(bromwich.circuit("low pass\nV1 a 0 0 AC 1\nR1 a b 1k\nC1 b 0 1u\n.ac dec 1 10 1k\n").periodic())
    known = 1 / (1 + 2j * np.pi * np.array([10, 100, 1000]) * 1e-3)
    np.testing.assert_allclose(r.frequency_response("V(b)"), known, rtol=1e-7)
    np.testing.assert_allclose(r.output_impedance("b"), 1e3 * known, rtol=1e-7)
    np.testing.assert_allclose(r.frequency_response("V(b)", "V1", 100), known[1:2], rtol=1e-7)
    with pytest.raises(bromwich.Error):
        r.loop_gain("V1")
