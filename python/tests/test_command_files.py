"""HDF5, VTKHDF and NPZ by the command of the package, which has h5py write them: beside those of the command of the build,
and after kill -9."""

import os
import re
import signal
import subprocess
import sys
import time

import bromwich
import numpy as np
import pytest

OWN = [sys.executable, "-m", "bromwich"]
MEMBRANE = ["solve", "signorini", "--set", "Q=5", "--steps", "60"]
SWEEP = """
[parameters]
k = 1
[dynamics]
A = [["-k"]]
B = [[1]]
x0 = [0]
[complementarity]
N = [[1]]
M = [[1]]
g = ["-sin(3*t)"]
[time]
T = 2
steps = 50
[sweep]
k = [0.5, 1, 2]
"""
# Differ between two runs, or between the two programs.
OF_A_RUN = {"command", "created", "run", "seconds", "summary", "bromwich_commit"}
OF_ROUNDING = {"kernel_error", "residual"}


def run(words, folder, code=0, **options):
    found = subprocess.run([*OWN, *words], cwd=folder, capture_output=True, text=True, **options)
    assert found.returncode == code, found.stderr
    return found


def layout(path):
    h5py = pytest.importorskip("h5py")
    found = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda name, one: found.update(
                {name: (one.shape, one.dtype, one.maxshape, one.chunks, one.compression, one.fillvalue == one.fillvalue)}
                if isinstance(one, h5py.Dataset)
                else {name: set(one.attrs)}
            )
        )
        scales = {key: [list(axis.keys()) for axis in one.dims] for key, one in file.items() if isinstance(one, h5py.Dataset)}
        words = {key: dict(one.attrs).get("long_name") for key, one in file.items()}
        return found, scales, words, {key: type(value) for key, value in file.attrs.items()}


def arrays_of(path):
    h5py = pytest.importorskip("h5py")
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, one: found.update({name: one[()]}) if isinstance(one, h5py.Dataset) else None)
    return found


@pytest.mark.parametrize("name", ["r.h5", "r.vtkhdf", "y.vtkhdf", "s.h5"])
def test_as_the_command_of_the_build(tmp_path, name):
    pytest.importorskip("h5py")
    built = os.environ.get("BROMWICH_COMMAND")
    if not built:
        pytest.skip("BROMWICH_COMMAND names no command of the build")
    (tmp_path / "sweep.toml").write_text(SWEEP)
    words = ["solve", "sweep.toml"] if name == "s.h5" else [*MEMBRANE, "--states", "none" if name[0] == "y" else "all"]
    run([*words, "--out", name], tmp_path)
    other = subprocess.run([built, *words, "--out", f"built-{name}"], cwd=tmp_path, capture_output=True, text=True)
    if "which this build does not have" in other.stderr:
        pytest.skip("the build has no HDF5")
    assert layout(tmp_path / name) == layout(tmp_path / f"built-{name}")
    mine, built_arrays = arrays_of(tmp_path / name), arrays_of(tmp_path / f"built-{name}")
    for key, values in mine.items():
        if values.dtype.kind == "f":  # equal but for the order of sums in threads
            np.testing.assert_allclose(values, built_arrays[key], rtol=0, atol=1e-12)
        else:
            np.testing.assert_array_equal(values, built_arrays[key])
    if name != "s.h5":
        a, b = bromwich.load(tmp_path / name).attributes, bromwich.load(tmp_path / f"built-{name}").attributes
        assert a.keys() == b.keys()
        assert not any(one[key] > 1e-12 for one in (a, b) for key in OF_ROUNDING)  # NaN: not computed
        assert {key for key in a if a[key] != b[key]} <= OF_A_RUN | OF_ROUNDING


@pytest.mark.parametrize("name", ["r.h5", "r.vtkhdf", "r.npz"])
def test_what_is_written_is_the_solution(tmp_path, name):
    if name != "r.npz":
        pytest.importorskip("h5py")
    run([*MEMBRANE, "--states", "all", "--out", name], tmp_path)
    found, expected = bromwich.load(tmp_path / name), bromwich.solve(bromwich.scene("signorini", Q=5), steps=60, states="all")
    for key in ("t", "y", "w", "x"):
        np.testing.assert_allclose(getattr(found, key), getattr(expected, key), rtol=0, atol=1e-12)
    assert found.status == "solved" and found.steps == 60
    assert "solved" in run(["check", name], tmp_path).stdout
    run(["plot", name, "--out", "page.html"], tmp_path)
    assert "<svg" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("states", ["all", "none"])
def test_fields_saved_by_python_are_those_of_the_command(tmp_path, states):
    pytest.importorskip("h5py")
    run([*MEMBRANE, "--states", states, "--out", "r.vtkhdf"], tmp_path)
    bromwich.solve(bromwich.scene("signorini", Q=5), steps=60, states=states).save(tmp_path / "mine.vtkhdf")
    (mine, *_, my_facts), (other, *_, facts) = layout(tmp_path / "mine.vtkhdf"), layout(tmp_path / "r.vtkhdf")
    assert mine == other and facts.keys() - my_facts.keys() == {"command", "run"}
    for key, values in arrays_of(tmp_path / "mine.vtkhdf").items():
        np.testing.assert_allclose(values, arrays_of(tmp_path / "r.vtkhdf")[key], rtol=0, atol=1e-12)


def test_fields_of_rectangles_that_are_sparse_and_of_none(tmp_path):
    pytest.importorskip("h5py")
    spacing = bromwich.Kronecker.spacing(7, 1.0, "neumann")
    plate = bromwich.Kronecker((7, spacing, 0.05), (5, 0.1, 0.05), [5.0, 0, 0, 0, 0], [-2.0, 0, 0, 0, 0], ends_along="neumann", advection=0.3)
    made = bromwich.solve(dynamics=plate, M=1.0 * np.eye(7), g=lambda t: -np.sin(t) * np.ones(7), x0=np.ones(35), T=1, steps=20)
    made.save(tmp_path / "p.vtkhdf")
    found = bromwich.load(tmp_path / "p.vtkhdf")
    for key in ("t", "y", "w", "x"):
        np.testing.assert_array_equal(getattr(found, key), getattr(made, key))
    import h5py

    with h5py.File(tmp_path / "p.vtkhdf") as file:  # ends of Neumann are half a spacing beyond the first point
        np.testing.assert_allclose(file["VTKHDF"].attrs["Origin"], [0.1, spacing / 2, 0])
    with pytest.raises(bromwich.Error, match="states='all'"):
        bromwich.solve(bromwich.scene("signorini", Q=5), steps=9, states=[0]).save(tmp_path / "one.vtkhdf")
    with pytest.raises(bromwich.Error, match="grid of a rectangle"):
        bromwich.solve(A=-1, B=1, N=1, M=1, x0=0, T=1, steps=9).save(tmp_path / "none.vtkhdf")
    with pytest.raises(bromwich.Error, match="grid of a rectangle"):
        found.save(tmp_path / "again.vtkhdf")
    assert not list(tmp_path.glob("*.part*"))


def test_scenes_of_a_sweep(tmp_path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "sweep.toml").write_text(SWEEP)
    run(["solve", "sweep.toml", "--states", "all", "--out", "s.h5"], tmp_path)
    with h5py.File(tmp_path / "s.h5") as file:
        assert file["k"][()].tolist() == [0.5, 1, 2] and file["status"].asstr()[()].tolist() == ["solved"] * 3
        for k, y in zip(file["k"][()], file["y"][()]):
            alone = bromwich.solve(bromwich.Scene.from_toml(tmp_path / "sweep.toml", k=k), method="march", steps=50)
            np.testing.assert_allclose(y, alone.y, rtol=0, atol=1e-12)
    run(["plot", "s.h5"], tmp_path)
    run(["solve", "sweep.toml", "--states", "all", "--out", "s.csv"], tmp_path)
    run(["plot", "s.csv", "--out", "table.html"], tmp_path)
    figures = [re.findall(r"<figure.*?</figure>", (tmp_path / name).read_text(), re.DOTALL) for name in ("s.html", "table.html")]
    assert len(figures[0]) == 4 and figures[0] == figures[1]


@pytest.mark.parametrize("name", ["k.h5", "k.vtkhdf"])
def test_a_killed_run_is_read_and_continued(tmp_path, name):
    pytest.importorskip("h5py")
    long = ["solve", "signorini", "--set", "Q=5", "--method", "march", "--steps", "150000"]
    words = [*long, "--checkpoint", "c.h5", "--checkpoint-every", "0.05", "--out", name]
    process = subprocess.Popen([*OWN, *words], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    while process.poll() is None and not (tmp_path / "c.h5").exists():
        time.sleep(0.01)
    time.sleep(0.1)
    process.kill()
    output = process.communicate()
    if process.returncode != -signal.SIGKILL:
        assert process.returncode == 0, output
        pytest.skip("the run ended before it was killed")
    killed = bromwich.load(tmp_path / name)
    assert killed.status == "running" and 0 < len(killed.t) < 150001 and np.all(np.isfinite(killed.y))
    assert "running" in run(["check", name], tmp_path, 3).stdout
    run([*words, "--restart", "c.h5"], tmp_path)
    rest = bromwich.load(tmp_path / name)
    assert rest.status == "solved" and len(rest.t) == 150001
    np.testing.assert_array_equal(rest.y[: len(killed.t) // 2], killed.y[: len(killed.t) // 2])
    # Parts are the run as a whole, to rounding as the scene amplifies it.
    whole = bromwich.solve(bromwich.scene("signorini", Q=5), method="march", steps=150000, states=None)
    np.testing.assert_allclose(rest.y, whole.y, rtol=0, atol=1e-9)


def test_refusals(tmp_path):
    pytest.importorskip("h5py")
    (tmp_path / "no.h5").write_text("not this")
    assert re.search(r"RESULT: 'no.h5' could not be read .*; give an HDF5 file", run(["check", "no.h5"], tmp_path, 2).stderr)
    assert "'none.h5' is no file" in run(["plot", "none.h5"], tmp_path, 2).stderr
    found = run([*MEMBRANE, "--restart", "no.h5", "--checkpoint", "c.h5"], tmp_path, 2).stderr
    assert found.startswith("bromwich: --restart: 'no.h5' could not be read")
    without = "import sys; sys.modules['h5py'] = None; from bromwich.__main__ import main; main()"
    words = [sys.executable, "-c", without, *MEMBRANE, "--out", "r.h5"]
    found = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert found.returncode == 2 and "--out: 'r.h5' needs h5py, which is not installed; pip install h5py" in found.stderr
    assert not (tmp_path / "r.h5").exists()


def test_a_full_disk_is_one_line(tmp_path):
    """A limit on the size of files stands for the disk."""
    pytest.importorskip("h5py")
    resource = pytest.importorskip("resource")
    smaller = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20480, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    for name in ("r.h5", "r.vtkhdf"):
        found = run(["solve", "signorini", "--set", "Q=31", "--steps", "60", "--out", name], tmp_path, 2, preexec_fn=smaller)
        assert len(found.stderr.splitlines()) == 1, found
        assert f"{name}' could not be written" in found.stderr and "ulimit -f" in found.stderr
