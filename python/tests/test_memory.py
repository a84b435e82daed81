"""Elements with memory, stated in Python, beside closed forms."""

import math
import pickle

import bromwich
import numpy as np
import pytest

# Located times are exact to rounding, and states to the tolerance of the solves.
CLOSE = 1e-8


def plain(A, x0, T, memory, **more):
    """A scene without constraints."""
    A = np.atleast_2d(A)
    m = A.shape[0]
    return bromwich.Scene(
        A=A, B=np.zeros((m, 0)), N=np.zeros((0, m)), M=np.zeros((0, 0)), x0=x0, T=T, memory=memory, **more
    )


def solved(scene):
    r = bromwich.solve(scene, tol_x=1e-8, states="all", check=True)
    assert r.method == "events"
    return r


def times(r):
    return [c.t for c in r.mode_changes]


def heater(low=0.9, high=1.1):
    return bromwich.Memory(
        "heater",
        {
            "off": {"leave": {"to": "on", "when": f"temperature < {low}"}},
            "on": {"f": [2], "leave": [{"to": "off", "when": f"temperature > {high}"}]},
        },
    )


def room(T=1.0, **more):
    return plain(-1, 1.1, T, heater(), names={"x": ["temperature"]}, **more)


WAY = math.log(1.1 / 0.9)


def test_a_thermostat():
    r = solved(room(5.5 * WAY))
    assert times(r) == pytest.approx([k * WAY for k in range(1, 6)], abs=CLOSE)
    assert r.x[-1, 0] == pytest.approx(2 - 1.1 * math.exp(-WAY / 2), abs=CLOSE)
    assert r.x.shape[1] == 1 and r.y.shape[1] == 0
    modes = r.modes["heater"]
    assert modes[0] == "off" and modes[-1] == "on" and len(modes) == len(r.t)
    assert r.mode_changes[0] == (pytest.approx(WAY, abs=CLOSE), "heater", "off", "on")
    assert list(r.at([0.5 * WAY, 1.5 * WAY]).modes["heater"]) == ["off", "on"]


def test_a_switch_with_hysteresis():
    switch = {
        "name": "switch",
        "modes": {
            "up": {"f": [1], "leave": {"to": "down", "when": "x0 > 0.5"}},
            "down": {"f": [-1], "leave": {"to": "up", "when": "x0 < -0.5"}},
        },
        "start": "down",
    }
    r = solved(plain(-1, 0.5, 3, switch))
    assert times(r) == pytest.approx([math.log(3), 2 * math.log(3)], abs=CLOSE)
    assert r.x[-1, 0] == pytest.approx(-1 + 1.5 * math.exp(-(3 - 2 * math.log(3))), abs=CLOSE)


def test_a_schmitt_trigger_of_a_parameter():
    trigger = bromwich.Memory(
        "trigger",
        {
            "low": {"leave": {"to": "high", "when": "0.8*sin(2*pi*t) > level"}},
            "high": {"f": lambda t: np.ones(1), "leave": {"to": "low", "when": "0.8*sin(2*pi*t) < -level"}},
        },
    )
    r = solved(plain(0, 0, 1.2, trigger, parameters={"level": 0.5}))
    first = math.asin(0.625) / (2 * math.pi)
    assert times(r) == pytest.approx([first, 0.5 + first, 1 + first], abs=CLOSE)
    assert r.x[-1, 0] == pytest.approx(0.5 + 0.2 - first, abs=CLOSE)


def test_a_thyristor():
    R, L, a, w = 2, 0.01, 0.003, 100 * math.pi
    thyristor = bromwich.Memory(
        "thyristor",
        {
            "blocks": {"leave": {"to": "conducts", "when": ["sin(w*t) > 0", "pulse(t - 0.003, 0.02, 1e-4) > 0.5"]}},
            "conducts": {
                "A": [[-R / L]],
                "f": ["325*sin(w*t)/0.01"],
                "leave": {"to": "blocks", "when": "i < 0", "set": {"i": 0}},
            },
        },
    )
    Z, phi = math.hypot(R, w * L), math.atan2(w * L, R)

    def current(s):
        return 325 / Z * (math.sin(w * s - phi) - math.sin(w * a - phi) * math.exp(-(s - a) * R / L))

    low, high = 0.01, 0.0199
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if current(middle) > 0 else (low, middle)
    r = solved(plain(0, 0, 0.03, thyristor, parameters={"w": w}, names={"x": ["i"]}))
    assert times(r) == pytest.approx([a, low, 0.02 + a], abs=1e-10)
    assert r.at(0.009).x[0, 0] == pytest.approx(current(0.009), abs=100 * CLOSE)
    assert r.at(0.0199).x[0, 0] == 0


def test_a_deadband():
    band = bromwich.Memory(
        "band",
        {
            "idle": {"leave": [{"to": "push", "when": "x0 < -1"}, {"to": "pull", "when": "x0 > 1"}]},
            "push": {"f": [2], "leave": {"to": "idle", "when": "x0 > -0.5"}},
            "pull": {"f": [-2], "leave": {"to": "idle", "when": "x0 < 0.5"}},
        },
    )
    # x' = 1: idle from 0 to 1, at -1 to 0.5, idle again to 1.
    r = solved(plain(0, 0, 2.2, band, f=[1]))
    assert times(r) == pytest.approx([1, 1.5, 2], abs=CLOSE)
    assert [c.mode for c in r.mode_changes] == ["pull", "idle", "pull"]
    assert r.x[-1, 0] == pytest.approx(0.8, abs=CLOSE)
    mirrored = solved(plain(0, 0, 2.2, band, f=[-1]))
    assert [c.mode for c in mirrored.mode_changes] == ["push", "idle", "push"]
    assert mirrored.x[-1, 0] == pytest.approx(-0.8, abs=CLOSE)


def test_static_above_kinetic_friction():
    k, m, V, static, kinetic = 3, 0.5, 0.2, 1.2, 0.7
    friction = bromwich.Memory(
        "friction",
        {
            "sticks": {"leave": {"to": "slides", "when": "3*(0.2*t - q) > 1.2"}},
            "slides": {
                "A": [[0, 0], [-k / m, 0]],
                "f": [0, "(0.6*t - 0.7)/0.5"],
                "leave": {"to": "sticks", "when": "v < 0", "set": {"v": 0}},
            },
        },
    )
    r = solved(plain([[0, 1], [0, 0]], [0, 0], 6, friction, names={"x": ["q", "v"]}))
    w, first = math.sqrt(k / m), static / (k * V)
    slides = 2 / w * (math.pi - math.atan((static - kinetic) / (m * w * V)))
    sticks = 2 * (static - kinetic) / (k * V)
    assert times(r) == pytest.approx([first, first + slides, first + slides + sticks], abs=CLOSE)
    assert r.at(first + slides + 0.1).x[0, 1] == 0


def test_pairs_and_a_matrix_M_of_a_mode():
    fuse = bromwich.Memory(
        "fuse",
        {"closed": {"leave": {"to": "open", "when": "i > 1"}}, "open": {"M": 1.5}},
    )
    scene = bromwich.Scene(A=-1, B=-1, N=-1, M=0.5, x0=0, T=2, f=[2], names={"y": ["i"]}, memory=[fuse])
    r = bromwich.solve(scene, tol_x=1e-8, states="all", check=True)
    first, rest = -math.log(1 - 0.75) / 3, 4 / 3
    assert times(r) == pytest.approx([first], abs=CLOSE)
    assert r.x[-1, 0] == pytest.approx(rest + (0.5 - rest) * math.exp(-1.5 * (2 - first)), abs=CLOSE)
    assert np.max(np.abs(np.minimum(r.y, r.w))) < 1e-12, "w has M of the mode"


def test_periodic_states():
    a, b = 1.4, 1.0
    switch = bromwich.Memory(
        "switch",
        {
            "off": {"f": [-b], "leave": {"to": "on", "when": "pulse(t, 1, 0.01) > 0.5"}},
            "on": {"f": [a], "leave": {"to": "off", "when": "x0 > 1"}},
        },
    )
    scene = bromwich.Scene(
        A=0, B=np.zeros((1, 0)), N=np.zeros((0, 1)), M=np.zeros((0, 0)), T=1, E0=1, ET=-1, b=0, memory=switch
    )
    r = bromwich.solve(scene, steps=64, states="all", check=True)
    assert r.method == "shooting"
    assert r.x[0, 0] == pytest.approx(1 - a * b / (a + b), abs=1e-9)
    assert r.multipliers == pytest.approx([-b / a], abs=1e-9)


def test_scenes_and_results_are_pickled():
    r = solved(room(2.5 * WAY))
    again = pickle.loads(pickle.dumps(r))
    assert again.mode_changes == r.mode_changes
    assert np.array_equal(again.modes["heater"], r.modes["heater"])
    scene = pickle.loads(pickle.dumps(room(2.5 * WAY)))
    assert times(solved(scene)) == pytest.approx(times(r), abs=CLOSE)


def test_batches_take_them():
    scenes = [room(T) for T in (0.3, 0.5)]
    batch = bromwich.solve_batch(scenes, steps=50, states="all")
    for scene, x in zip(scenes, batch.x):
        known = bromwich.solve(scene, steps=50, states="all")
        assert np.allclose(x, known.x, atol=1e-12)


def test_files(tmp_path):
    path = tmp_path / "room.toml"
    path.write_text(
        '[dynamics]\nA = [[-1]]\nx0 = [1.1]\n[names]\nx = ["temperature"]\n[[memory]]\nname = "heater"\n'
        '[memory.modes.off]\nleave = [{ to = "on", when = "temperature < 0.9" }]\n[memory.modes.on]\nf = ["2"]\n'
        'leave = [{ to = "off", when = "temperature > 1.1" }]\n[time]\nT = 1\n'
    )
    scene = bromwich.Scene.from_toml(path)
    r = solved(scene)
    assert times(r) == pytest.approx(times(solved(room())), abs=1e-12)
    assert r.modes["heater"][-1] == "off"
    assert pickle.loads(pickle.dumps(scene)).states == 1


def test_modes_are_drawn_as_bars():
    pytest.importorskip("matplotlib").use("Agg")
    r = solved(room(2.5 * WAY))
    ax = r.plot("modes")
    assert [bar.get_x() for bar in ax.patches] == pytest.approx([0, WAY, 2 * WAY], abs=CLOSE)
    assert [text.get_text() for text in ax.texts] == ["off", "on", "off"]
    with pytest.raises(bromwich.Error, match="no elements with memory"):
        bromwich.solve(bromwich.scene("ladder"), steps=10, check=False).plot("modes")


@pytest.mark.parametrize("extension", ["csv", "npz", "h5"])
def test_modes_are_in_files(tmp_path, extension):
    if extension == "h5":
        h5py = pytest.importorskip("h5py")
    r = solved(room(1.5 * WAY))
    path = tmp_path / f"r.{extension}"
    r.save(path)
    if extension == "csv":
        lines = path.read_text().splitlines()
        assert lines[0] == "t,x0,heater"
        found = [float(line.split(",")[2]) for line in lines[1:]]
    elif extension == "npz":
        found = np.load(path)["heater"]
    else:
        with h5py.File(path) as file:
            found = file["heater"][:]
            assert file["heater"].attrs["long_name"] == "mode: 0 off, 1 on"
    assert list(found) == [float(mode == "on") for mode in r.modes["heater"]]
    loaded = bromwich.load(path)
    if extension != "csv":
        assert loaded.mode_changes == r.mode_changes
        assert list(loaded.modes["heater"]) == list(r.modes["heater"])


@pytest.mark.parametrize(
    "memory, message",
    [
        (3, "memory: found 3; give bromwich.Memory"),
        ({"name": "m"}, "modes"),
        ({"name": "m", "modes": {"a": {"F": 1}}}, "'F' is no known key"),
        ({"name": "m", "modes": {"a": {"leave": {"to": "b", "when": "x0 > 1"}}}}, "memory.m.a.leave.to: found 'b'"),
        ({"name": "m", "modes": {"a": {}}, "start": "c"}, "memory.m.start: found 'c'"),
        ({"name": "m", "modes": {"a": {"leave": {"to": "a"}}}}, "has no when"),
        ({"name": "m", "modes": {"a": {"leave": {"to": "a", "when": "x0^2 > 1"}}}}, "not affine"),
        ({"name": "m", "modes": {"a": {"leave": {"to": "a", "when": "x0"}}}}, "one comparison"),
        ({"name": "m", "modes": {"a": {"leave": {"to": "a", "when": "x0 > 1", "set": {"z": 0}}}}}, "no state"),
        ({"name": "m", "modes": {"a": {"f": ["1", "2"]}}}, "memory.m.a.f: has 2"),
        ({"name": "m", "modes": {"a": {"A": [[1, 2]]}}}, "A: is 1 x 2"),
        ([{"name": "m", "modes": {"a": {}}}, {"name": "m", "modes": {"a": {}}}], "a name of its own"),
    ],
)
def test_mistakes_are_named(memory, message):
    with pytest.raises(bromwich.Error) as raised:
        plain(-1, 1, 1, memory)
    assert message in str(raised.value) and "\n" not in str(raised.value)


def test_other_methods_refuse():
    r = bromwich.solve(room(), method="march", steps=10, check=False)
    assert r.status == "unsupported" and "modes with memory" in r.reason
