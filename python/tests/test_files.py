"""Files of results: what Python and the command write, and what reads it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import bromwich
import numpy as np
import pytest

ARRAYS = ("t", "y", "w", "x")


# That of the build, which writes all formats; that of the package leaves HDF5 and NPZ to Python.
COMMAND = [os.environ["BROMWICH_COMMAND"]] if os.environ.get("BROMWICH_COMMAND") else [sys.executable, "-m", "bromwich"]


@pytest.fixture
def result(diode):
    return bromwich.solve(**diode, g=lambda t: -np.sin(3 * t), steps=200)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """What the command writes, in all formats."""
    folder = tmp_path_factory.mktemp("written")
    for extension in ("csv", "h5", "npz", "vtkhdf"):
        line = [*COMMAND, "solve", "signorini", "--set", "Q=5", "--steps", "60", "--states", "all", "--out", f"r.{extension}"]
        run = subprocess.run(line, cwd=folder, capture_output=True, text=True)
        if run.returncode != 0:
            assert "which this build does not have" in run.stderr
    return folder


def read(folder, extension):
    if extension in ("h5", "vtkhdf"):
        pytest.importorskip("h5py")
    if not (folder / f"r.{extension}").exists():
        pytest.skip(f"the command of this build writes no .{extension}")
    return bromwich.load(folder / f"r.{extension}")


def test_the_summary_names_the_files(tmp_path):
    files = ["r.csv", "s.csv", "r.html"]
    options = zip(("--out", "--switches", "--report"), files)
    line = [*COMMAND, "solve", "dlcp-small", "--steps", "40", *(word for pair in options for word in pair)]
    run = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1].split(maxsplit=1) == ["output", ", ".join(files)]
    assert all((tmp_path / name).stat().st_size > 0 for name in files)


@pytest.mark.parametrize("extension", ["npz", "h5", "csv"])
def test_round_trip(result, tmp_path, extension):
    if extension == "h5":
        pytest.importorskip("h5py")
    path = tmp_path / f"r.{extension}"
    result.save(path)
    read = bromwich.load(path)
    for name in ARRAYS if extension != "csv" else ("t", "y", "x"):
        np.testing.assert_array_equal(getattr(read, name), getattr(result, name))
        assert not getattr(read, name).flags.writeable
    assert read.status == "solved" and read.ok and read.x_components == [0]
    assert read.constraint_names == ["y0"] and read.state_names == ["x0"]
    if extension != "csv":
        assert read.steps == 200 and read.method == result.method and read.residual == result.residual
        assert read.attributes["bromwich_version"] == bromwich.__version__
    # What was read can be written and read again.
    read.save(tmp_path / f"again.{extension}")
    np.testing.assert_array_equal(bromwich.load(tmp_path / f"again.{extension}").y, result.y)


@pytest.mark.parametrize("extension", ["csv", "h5", "npz", "vtkhdf"])
def test_what_the_command_writes(written, extension):
    found = read(written, extension)
    mine = bromwich.solve(bromwich.scene("signorini", Q=5), steps=60, states="all")
    for name in ARRAYS:
        if name == "w" and extension == "csv":
            continue
        # The same solve in another process: equal but for the order of sums in threads.
        np.testing.assert_allclose(getattr(found, name), getattr(mine, name), rtol=0, atol=1e-12)
    assert found.status == "solved" and len(found.x_components) == 25
    if extension != "csv":
        assert found.scene.name == "signorini" and found.steps == 60
        assert found.attributes["command"].startswith("bromwich solve signorini")


def test_csv_of_named_columns(tmp_path):
    (tmp_path / "r.csv").write_text("t,diode,v\n0,1,10\n0.5,0,9\n")
    found = bromwich.load(tmp_path / "r.csv")
    assert list(found.columns) == ["t", "diode", "v"] and found.columns["v"].tolist() == [10, 9]
    assert found.y.shape == (2, 0) and found.units["t"] == ""


def test_both_write_one_layout(result, written, tmp_path):
    h5py = pytest.importorskip("h5py")
    read(written, "h5")
    result.save(tmp_path / "r.h5")

    def layout(path):
        with h5py.File(path) as file:
            return {
                key: (
                    file[key].ndim,
                    file[key].dtype,
                    [[scale.name for scale in axis.values()] for axis in file[key].dims],
                    file[key].maxshape[0] is None,
                    file[key].compression,
                    file[key].attrs.get("long_name"),
                )
                for key in file
            }, set(file.attrs)

    mine, my_facts = layout(tmp_path / "r.h5")
    other, facts = layout(written / "r.h5")
    assert mine == other
    assert my_facts - {"error_estimate", "error_estimate_of"} <= facts, "signorini has no certificate"
    assert facts - my_facts == {"command", "run"}
    if (written / "r.npz").exists():
        result.save(tmp_path / "r.npz")
        with np.load(tmp_path / "r.npz") as a, np.load(written / "r.npz") as b:
            assert {key for key in a.files if "attribute_" not in key} == {k for k in b.files if "attribute_" not in k}
            assert all(a[key].dtype.kind == b[key].dtype.kind for key in set(a.files) & set(b.files))


@pytest.mark.parametrize("source", ["command", "python"])
def test_hdf5_opens_in_xarray(result, written, tmp_path, source):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    pytest.importorskip("h5py")
    if source == "command":
        expected, path = read(written, "h5"), written / "r.h5"
    else:
        expected, path = result, tmp_path / "r.h5"
        result.save(path)
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        assert data["y"].dims == ("t", "constraint") and data["x"].dims == ("t", "state")
        assert data.attrs["status"] == "solved" and data["y"].attrs["long_name"]
        for name in ARRAYS:
            np.testing.assert_array_equal(data[name], getattr(expected, name))


def test_saved_results_are_results(result, tmp_path):
    pytest.importorskip("matplotlib").use("Agg")
    import matplotlib.pyplot as plt

    result.save(tmp_path / "r.npz")
    read = bromwich.load(tmp_path / "r.npz")
    assert isinstance(read, bromwich.Result)
    np.testing.assert_array_equal(read.plot("y").lines[0].get_ydata(), result.y[:, 0])
    plt.close("all")
    between = read.at([0.1234, 0.5])
    assert between.t.tolist() == [0.1234, 0.5]
    assert between.y[0, 0] == np.interp(0.1234, result.t, result.y[:, 0])
    assert repr(read) == f"<bromwich.Result solved by {result.method}, residual {result.residual:.1e}, error estimate {result.error_estimate:.1e} of y and x, 201 rows up to t = 2>"
    assert read.certificate == result.certificate
    for missing in (lambda: read.switches_with_errors(), lambda: read.y_integral, lambda: read.at(7.0)):
        with pytest.raises(bromwich.Error):
            missing()
    pytest.importorskip("xarray")
    assert read.to_xarray()["y"].dims == ("t", "constraint")


@pytest.mark.parametrize("extension", ["npz", "h5", "csv"])
def test_switches_come_from_the_rows(result, tmp_path, extension):
    if extension == "h5":
        pytest.importorskip("h5py")
    result.save(tmp_path / f"r.{extension}")
    found = bromwich.load(tmp_path / f"r.{extension}")
    assert len(found.switches) == 2 and found.switches == result.switches
    with pytest.raises(bromwich.Error, match="needs the scene"):
        found.switches_with_errors()
    # Rows at uneven distances around the switch at 0.9452, too few for the curvature: the error is half their distance.
    bromwich.load(tmp_path / f"r.{extension}").at([0.3, 0.9, 1.1]).save(tmp_path / "uneven.npz")
    (switch,) = bromwich.load(tmp_path / "uneven.npz").switches
    assert not switch.on and switch.error == pytest.approx(0.1) and abs(switch.t - 0.9452) <= switch.error


def test_free_rows_of_a_file_have_no_switches(tmp_path):
    mixed = bromwich.solve(A=-1, B=[[1, 1]], N=[[1], [1]], M=np.eye(2), x0=0, T=1, free=[1], g=lambda t: [-np.sin(9 * t), np.sin(7 * t)])
    assert any(np.diff(np.sign(mixed.y[1:, 1]))) and {s.component for s in mixed.switches} == {0}
    mixed.save(tmp_path / "m.npz")
    assert bromwich.load(tmp_path / "m.npz").switches == mixed.switches


@pytest.mark.parametrize("source", ["solve", "npz", "h5", "csv"])
def test_report(diode, tmp_path, source):
    result = bromwich.solve(bromwich.Scene(**diode, g="-sin(w*t)", parameters={"w": 3}, name="gate", names={"x": ["v"], "y": ["i_D"]},
                                           units={"t": "s", "y": "A"}), tol=1e-5)
    if source != "solve":
        if source == "h5":
            pytest.importorskip("h5py")
        result.save(tmp_path / f"r.{source}")
        result = bromwich.load(tmp_path / f"r.{source}")
    result.report(tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>") and page.count("<svg") >= 2 and "http" not in page.replace("http://www.w3.org", "")
    if source != "csv":
        for words in ("gate", "i_D", "[A]", "w = 3", "error", f"{result.steps} "):
            assert words in page, words
    with pytest.raises(bromwich.Error, match="path"):
        result.report(tmp_path / "r.pdf")


def test_report_of_values_at_other_times(result, tmp_path):
    result.at([0.1, 0.7]).report(tmp_path / "at.html")
    assert "<svg" in (tmp_path / "at.html").read_text(encoding="utf-8")
    result.save(tmp_path / "r.npz")
    between = bromwich.load(tmp_path / "r.npz").at([0.1, 0.7])
    between.save(tmp_path / "between.npz")
    assert len(bromwich.load(tmp_path / "between.npz").t) == 2
    with pytest.raises(bromwich.Error, match="between those of a file"):
        between.report(tmp_path / "no.html")


@pytest.mark.parametrize("extension", ["npz", "h5", "csv"])
def test_early_ends(tmp_path, extension):
    if extension == "h5":
        pytest.importorskip("h5py")
    ended = bromwich.solve(A=0, B=0, N=0, M=0, g="1 - t", x0=0, T=2, steps=20, method="march", check=False)
    assert ended.status == "infeasible"
    ended.save(tmp_path / f"e.{extension}")
    read = bromwich.load(tmp_path / f"e.{extension}")
    assert read.status == "infeasible" and read.reason and not read.ok
    assert 0.8 < read.t[-1] <= 1 and np.all(np.isfinite(read.y))
    np.testing.assert_array_equal(read.y, ended.y[: len(read.t)])


def test_bad_names(result, tmp_path):
    for name in ("r.mat", "r"):
        with pytest.raises(bromwich.Error, match="path"):
            result.save(tmp_path / name)
        with pytest.raises(bromwich.Error, match="path"):
            bromwich.load(tmp_path / name)
    with pytest.raises(OSError):
        bromwich.load(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(bromwich.Error, match="no result"):
        bromwich.load(tmp_path / "other.npz")


@pytest.mark.parametrize("extension", ["npz", "h5", "csv"])
def test_a_full_disk_leaves_the_old_file(result, tmp_path, extension):
    """A limit on the size of files stands for the disk; below it lie the old file and not the new one."""
    if extension == "h5":
        pytest.importorskip("h5py")
    resource = pytest.importorskip("resource")
    path = tmp_path / f"r.{extension}"
    result.save(path)
    old = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # the write fails instead
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError):
            result.save(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_bytes() == old and list(tmp_path.iterdir()) == [path]
    with pytest.raises(FileNotFoundError, match="create it first"):
        result.save(tmp_path / "none" / path.name)


def test_fields_with_constraints_on_two_sides(tmp_path):
    """As the command writes them: lines of 3 points, the second side on the last point of each of the 2 lines."""
    h5py = pytest.importorskip("h5py")
    y = np.arange(8.0).reshape(2, 4)
    with h5py.File(tmp_path / "two.vtkhdf", "w") as file:
        file.attrs["constraints"], file.attrs["status"] = 4, "solved"
        file["VTKHDF/Steps/Values"] = [0.0, 0.5]
        file["VTKHDF/Steps"].attrs["NSteps"] = 2
        points = [[[row[i], row[i], row[i + 2]] for i in range(2)] for row in y]
        file["VTKHDF/PointData/y"] = np.array(points)
    np.testing.assert_array_equal(bromwich.load(tmp_path / "two.vtkhdf").y, y)


@pytest.mark.skipif("BROMWICH_TEST_VTK" not in os.environ, reason="asks VTK, of 100 MB: set BROMWICH_TEST_VTK=1")
def test_vtk_reads_fields(written):
    found = read(written, "vtkhdf")
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    reader = hdf.vtkHDFReader()
    reader.SetFileName(str(written / "r.vtkhdf"))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 61
    for step in (0, 17, 60):
        reader.SetStep(step)
        reader.Update()
        image = reader.GetOutputDataObject(0)
        assert image.GetDimensions() == (5, 5, 1)
        assert np.allclose(image.GetBounds()[:4], (1 / 6, 5 / 6, 1 / 6, 5 / 6))
        x = numpy_support.vtk_to_numpy(image.GetPointData().GetArray("x"))
        y = numpy_support.vtk_to_numpy(image.GetPointData().GetArray("y"))
        np.testing.assert_array_equal(x, found.x[step])
        np.testing.assert_array_equal(y.reshape(5, 5)[:, 0], found.y[step])
