"""Scenes that Python reads from TOML files."""

import bromwich
import numpy as np
import pytest


def test_files(tmp_path):
    file = tmp_path / "rlcd.toml"
    file.write_text(
        """
        description = "an RLC circuit with a diode"
        [parameters]
        L = 1e-2
        C = 1e-6
        R = 1e3
        [dynamics]
        A = [[0, "-1/C"], ["1/L", 0]]
        B = [["-1/C"], [0]]
        x0 = [10, 0]
        [complementarity]
        N = [[-1, 0]]
        M = [["R"]]
        [time]
        T = 5e-3
        steps = 4000
        """
    )
    scene = bromwich.Scene.from_toml(file, R=500)
    assert scene.parameters == {"L": 1e-2, "C": 1e-6, "R": 500}
    assert (scene.states, scene.constraints, scene.steps) == (2, 1, 4000)
    L, C, R = 1e-2, 1e-6, 500
    arrays = bromwich.solve(A=[[0, -1 / C], [1 / L, 0]], B=[-1 / C, 0], N=[-1, 0], M=R, x0=[10, 0], T=5e-3, steps=4000)
    np.testing.assert_allclose(bromwich.solve(scene).y, arrays.y, atol=1e-13)
    with pytest.raises(bromwich.Error, match="rlcd.toml"):
        bromwich.Scene.from_toml(file, Rx=1)
    assert bromwich.Scene.from_toml(file, T=1e-3).T == 1e-3
    assert scene.names == {"x": [], "y": [], "w": []} and scene.units["t"] == []


def test_files_with_names_and_a_tolerance(tmp_path):
    file = tmp_path / "decay.toml"
    file.write_text(
        """
        [dynamics]
        A = [[-1]]
        B = [[0]]
        x0 = [2]
        [complementarity]
        N = [[1]]
        M = [[1]]
        [time]
        T = 1
        steps = 8
        tolerance = 1e-4
        [names]
        x = ["level"]
        [units]
        t = "s"
        x = "m"
        """
    )
    scene = bromwich.Scene.from_toml(file)
    assert scene.names["x"] == ["level"]
    assert scene.units == {"t": ["s"], "x": ["m"], "y": [], "w": []}
    r = bromwich.solve(scene)
    assert r.error_estimate is not None
    assert (r.state_names, r.constraint_names) == (["level"], [])
    assert r.units == {"t": "s", "y": "", "w": "", "x": "m"}
    r.save(tmp_path / "decay.npz")
    assert bromwich.load(tmp_path / "decay.npz").state_names == ["level"]
    with pytest.raises(bromwich.Error, match="settings: 'Tx' is no parameter of .*decay.toml; use one of T, steps"):
        bromwich.Scene.from_toml(file, Tx=1)
    with pytest.raises(bromwich.Error, match="path: the file .*none.toml' does not exist; give the path"):
        bromwich.Scene.from_toml(tmp_path / "none.toml")
    assert bromwich.solve(scene, steps=16).t.size == 17
    bad = tmp_path / "bad.toml"
    bad.write_text("[time]\nT = 'a'\n")
    with pytest.raises(bromwich.Error) as refused:
        bromwich.Scene.from_toml(bad)
    assert refused.value.argument.endswith("bad.toml:1: dynamics.A")
