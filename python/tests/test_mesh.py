"""Fields on meshes: files for ParaView and VTK, read again by meshio."""

import numpy as np
import pytest

import bromwich

POINTS = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]])
CELLS = {"triangle": [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]}


def solved(mesh, **options):
    """Four states that decay, two constraints that are never active."""
    A = -np.diag([1.0, 2, 3, 4])
    scene = bromwich.Scene(A=A, B=np.zeros((4, 2)), N=np.zeros((2, 4)), M=1.0, g=1.0, x0=1.0, T=1, steps=5, mesh=mesh)
    return bromwich.solve(scene, states="all", **options)


def mesh(**given):
    return bromwich.Mesh(POINTS, CELLS, **{"states": [0, 1, 2, 4], "constraints": [1, 2]} | given)


def test_the_last_row_and_a_series(tmp_path):
    meshio = pytest.importorskip("meshio")
    r = solved(mesh())
    r.save(tmp_path / "r.vtu")
    read = meshio.read(tmp_path / "r.vtu")
    np.testing.assert_array_equal(read.points[:, :2], POINTS)
    np.testing.assert_array_equal(read.cells_dict["triangle"], CELLS["triangle"])
    np.testing.assert_array_equal(read.point_data["x"], [*r.x[-1, :3], np.nan, r.x[-1, 3]])
    np.testing.assert_array_equal(read.point_data["w"], [np.nan, *r.w[-1], np.nan, np.nan])
    r.save(tmp_path / "r.pvd")
    series = (tmp_path / "r.pvd").read_text()
    assert series.count("<DataSet") == 6 and 'timestep="0.2"' in series
    np.testing.assert_array_equal(meshio.read(tmp_path / "r" / "000001.vtu").point_data["x"][:3], r.x[1, :3])
    r.at(0.5).save(tmp_path / "half.vtu")
    np.testing.assert_allclose(meshio.read(tmp_path / "half.vtu").point_data["x"][0], np.exp(-0.5), rtol=1e-12)


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: bromwich.Mesh(POINTS, {"triangle": [[1, 2, 5]]}), r"mesh.cells\['triangle'\]: has 5, and points are 0 to 4"),
        (lambda: bromwich.Mesh(POINTS, {"triangle": [[-1, 2, 3]]}), "has -1, and points are 0 to 4; count from 0"),
        (lambda: bromwich.Mesh(POINTS, {"triangle": [[0.5, 2, 3]]}), "has 0.5"),
        (lambda: bromwich.Mesh(POINTS[:, :1], CELLS), "mesh.points: have shape"),
        (lambda: bromwich.Mesh(POINTS, [[0, 1, 2]]), "mesh.cells: are no dict"),
        (lambda: mesh(states=[9, 1, 2, 3]), "mesh.states: has 9"),
        (lambda: solved(mesh(states=None)), "mesh: has a point for 5 states, and there are 4"),
        (lambda: solved(mesh(constraints=[1])), "mesh: has a point for 1 constraints, and there are 2"),
    ],
)
def test_wrong_meshes(make, said):
    with pytest.raises(bromwich.Error, match=said):
        make()


def test_without_a_mesh_or_states(tmp_path):
    pytest.importorskip("meshio")
    with pytest.raises(bromwich.Error, match="need a mesh"):
        solved(None).save(tmp_path / "r.vtu")
    with pytest.raises(bromwich.Error, match="no states were recorded"):
        bromwich.solve(solved(mesh()).scene, states="none").save(tmp_path / "r.vtu")
