"""Structures with contacts: as files and as C++ state them, against references of a program of its own."""

import json
import pickle

import numpy as np
import pytest

import bromwich

K = np.array([[2, -0.6], [-0.6, 1.5]])
FILE = """
[structure]
M = 1
K = [[2, -0.6], [-0.6, 1.5]]
C = [[0.06, -0.006], [-0.006, 0.055]]
f = ["0.3*sin(2.1*t)", "-1 + 1.3*cos(2.1*t)"]
q0 = [0, 0]
[[contact]]
name = "belt"
normal = [0, 1]
tangent = [1, 0]
velocity = 0.4
mu = 0.4
restitution = 0.5
[time]
T = 10
"""


def belt(**changed):
    return bromwich.Contact(**{**dict(normal=[0, 1], tangent=[1, 0], velocity=0.4, mu=0.4, name="belt"), **changed})


def block(contact, f=("0.3*sin(2.1*t)", "-1 + load*cos(2.1*t)"), **more):
    return bromwich.Structure(
        M=np.eye(2), K=K, C=0.04 * np.eye(2) + 0.01 * K, f=list(f), contacts=contact, parameters={"load": 1.3}, **more
    )


def test_block_that_lifts_off_and_bounces(tmp_path):
    (tmp_path / "belt.toml").write_text(FILE)
    known = [-0.2024374329, 0.0637274032, -0.2157451367, -0.5111438908]
    for scene in (block(belt(restitution=0.5)).scene(T=10), bromwich.Scene.from_toml(tmp_path / "belt.toml")):
        r = bromwich.solve(scene, tol=1e-6, states="all")
        assert r.ok, r.reason
        np.testing.assert_allclose(r.x[-1], known, atol=1e-8)
        assert scene.names["y"] == ["belt.normal", "belt.friction", "belt.slip"]


def test_contacts_of_a_result():
    scene = block(belt(restitution=0.5)).scene(T=10)
    r = bromwich.solve(scene, tol=1e-6, states="all")
    report = r.contacts
    assert report.located and report.energy.error < 1e-9
    np.testing.assert_allclose(report.energy.impacts, 0.5099665386, atol=1e-8)
    c = report["belt"]
    np.testing.assert_allclose(c.stick + c.slip + c.open, 10, rtol=1e-12)
    assert c.impacts == len(report.impacts) and report.impacts[0].contact == "belt"
    np.testing.assert_allclose(report.impacts[0].t, 0.814291739, atol=2e-9)
    assert np.all(np.abs(report.friction["belt"]) <= 0.4 * report.normal["belt"] + 1e-12)
    with pytest.raises(bromwich.Error, match="name: found 'jaw'; choose from belt"):
        report["jaw"]
    with pytest.raises(bromwich.Error, match="states: were not all recorded"):
        bromwich.solve(scene, tol=1e-3, states=[0]).contacts
    with pytest.raises(bromwich.Error, match="contacts: the scene is no structure"):
        bromwich.solve(bromwich.scene("bridge"), states="all").contacts


def test_bars_of_contacts():
    plt = pytest.importorskip("matplotlib.pyplot")
    r = bromwich.solve(block(belt(restitution=0.5)).scene(T=10), tol=1e-6, states="all")
    ax = r.contacts.plot()
    assert [label.get_text() for label in ax.get_yticklabels()] == ["belt"] and ax.get_xlabel() == "t"
    plt.close("all")


def test_contacts_in_files_and_pages(tmp_path):
    r = bromwich.solve(block(belt(restitution=0.5)).scene(T=10), tol=1e-6, states="all")
    r.save(tmp_path / "r.npz")
    with np.load(tmp_path / "r.npz") as file:
        np.testing.assert_array_equal(file["belt.lt"], r.contacts.friction["belt"])
        sticks = file["belt.state"] == 1
        assert sticks.any() and np.abs(r.x[sticks, 2] - 0.4).max() < 1e-9
    r.save(tmp_path / "r.csv")
    assert (tmp_path / "r.csv").read_text().splitlines()[0].endswith(",belt.lt,belt.state")
    r.report(tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text()
    assert "<h2>Contacts</h2>" in page and "balance of energy" in page and "q1 in the phase plane" in page
    summary = json.loads(bromwich.load(tmp_path / "r.npz").attributes["summary"])
    assert summary["contacts"]["belt"]["friction_loss"] == r.contacts["belt"].friction_loss


@pytest.mark.parametrize("extension", ["npz", "h5"])
def test_contacts_of_a_loaded_result(tmp_path, extension):
    if extension == "h5":
        pytest.importorskip("h5py")
    scene = block(belt(restitution=0.5)).scene(T=10)
    r = bromwich.solve(scene, tol=1e-6, states="all")
    r.save(tmp_path / f"r.{extension}")
    known, found = r.contacts, bromwich.load(tmp_path / f"r.{extension}").contacts
    assert found.contacts == known.contacts and found.energy == known.energy and found.located
    assert found.phases == known.phases and found.impacts == known.impacts
    for key in ("normal", "friction"):
        np.testing.assert_array_equal(getattr(found, key)["belt"], getattr(known, key)["belt"])
    bromwich.solve(scene, tol=1e-3, states=[0]).save(tmp_path / "without.npz")
    with pytest.raises(bromwich.Error, match="contacts: the file does not say what contacts do"):
        bromwich.load(tmp_path / "without.npz").contacts


def test_phase_plane():
    plt = pytest.importorskip("matplotlib.pyplot")
    r = bromwich.solve(block(belt(restitution=0.5)).scene(T=10), tol=1e-6, states="all")
    ax = r.contacts.phase_plane("q1")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("q1", "v_q1")
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), r.x[:, [1, 3]])
    with pytest.raises(bromwich.Error, match="coordinate: found 'q7'; choose from q0, q1, 0, 1"):
        r.contacts.phase_plane("q7")
    plt.close("all")


def test_sources_may_be_functions_and_tables():
    def f(t):
        return [0.3 * np.sin(2.1 * t), -1 + 1.3 * np.cos(2.1 * t)]

    moving = ([0, 10], [0.4, 0.4])
    structure = bromwich.Structure(
        M=np.eye(2), K=K, C=0.04 * np.eye(2) + 0.01 * K, f=f, contacts=[belt(velocity=moving, restitution=0.5)]
    )
    r = bromwich.solve(structure.scene(T=10), tol=1e-6, states="all")
    np.testing.assert_allclose(r.x[-1, :2], [-0.2024374329, 0.0637274032], atol=1e-7)


def test_parameters_replace_values_and_survive_pickle():
    scene = block(belt()).scene(T=4, load=0.6)
    assert scene.parameters == {"load": 0.6} and scene.contacts == ["belt"] and scene.uniqueness == "unique"
    again = pickle.loads(pickle.dumps(scene))
    assert again.parameters == {"load": 0.6} and again.contacts == ["belt"]
    a, b = (bromwich.solve(s, steps=200, states="all") for s in (scene, again))
    np.testing.assert_array_equal(a.x, b.x)
    with pytest.raises(bromwich.Error, match="lod: is no parameter of the structure; choose from load"):
        block(belt()).scene(T=4, lod=1)


def test_sparse_structures_and_compliant_contacts():
    sparse = pytest.importorskip("scipy.sparse")
    d = 120
    stiffness = sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(d, d), format="csc")
    stop = bromwich.Contact(normal=-np.eye(d)[60], gap=0.05, kn=1e3)
    structure = bromwich.Structure(M=sparse.identity(d, format="csc"), K=stiffness, f=["sin(t)"] * d, contacts=stop)
    scene = structure.scene(T=2)
    r = bromwich.solve(scene, steps=400, states="all")
    assert r.ok, r.reason
    force = r.y[:, 0]
    assert force.max() > 0
    np.testing.assert_allclose(np.maximum(r.x[1:, 60] - 0.05, 0) * 1e3, force[1:], atol=1e-8 * force.max())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bromwich.Contact(normal=[1], kn=0), "kn: found 0; give a positive stiffness"),
        (lambda: bromwich.Contact(normal=[1], mu="a"), "mu: found 'a'; give a number"),
        (lambda: bromwich.Structure(M=1, contacts=[1]), r"contacts\[0\]: is a int; give bromwich.Contact"),
        (lambda: bromwich.Structure(M=[[1, 2], [2, 1]]).scene(T=1), "M: is not symmetric and positive definite"),
        (lambda: block(belt(mu=-1)).scene(T=1), r"contacts\[0\].mu: is -1; give a number >= 0"),
        (lambda: block(belt(velocity=[1, 2, 3], normal=[1])).scene(T=1), r"contacts\[0\].normal: has 1 entries"),
        (lambda: block(belt(gap="s")).scene(T=1), "gap: 's' uses 's'"),
        (lambda: block(belt()).scene(T=-1), "T: is -1; give a positive finite number"),
    ],
)
def test_mistakes_are_one_line(make, message):
    with pytest.raises(bromwich.Error, match=message):
        make()
