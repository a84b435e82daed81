"""The mesh of a field, and its results as unstructured grids of VTK."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ._arrays import on_host, whole
from ._errors import Error

if TYPE_CHECKING:
    from ._rows import Rows


class Mesh:
    """Points and cells, for ``Scene(mesh=...)``: ``result.save("r.vtu")`` then writes the field for ParaView and VTK by meshio.

    Args:
        points: points x 2 or 3 coordinates.
        cells: ``{"triangle": k x 3 numbers of points}``, with the names of meshio: ``"line"``, ``"quad"``, ``"tetra"``, ...
        states: the number of the point of each state; None: state i is at point i. Points without a state are NaN.
        constraints: the number of the point of each constraint; None: y and w are not written.
    """

    def __init__(self, points: Any, cells: dict[str, Any], *, states: Any = None, constraints: Any = None) -> None:
        self.points = on_host(points, "mesh.points")
        if self.points.ndim != 2 or self.points.shape[1] not in (2, 3):
            raise Error(f"mesh.points: have shape {self.points.shape}; give points x 2 or 3", "mesh")
        if not isinstance(cells, dict) or not cells:
            raise Error('mesh.cells: are no dict; give {"triangle": numbers of points}', "mesh")
        self.cells = {str(kind): self._numbers(numbers, f"mesh.cells[{kind!r}]", 2) for kind, numbers in cells.items()}
        self.states = None if states is None else self._numbers(states, "mesh.states", 1)
        self.constraints = None if constraints is None else self._numbers(constraints, "mesh.constraints", 1)

    def _numbers(self, given: Any, name: str, dimensions: int) -> np.ndarray:
        found = on_host(given, name)
        if found.ndim != dimensions:
            raise Error(f"{name}: has {found.ndim} dimensions; give {dimensions}", "mesh")
        outside = (found < 0) | (found >= len(self.points)) | (found != np.floor(found))
        if outside.any():
            raise Error(f"{name}: has {found[outside][0]:g}, and points are 0 to {len(self.points) - 1}; count from 0", "mesh")
        return found.astype(np.int64)

    def check(self, states: int, constraints: int) -> None:
        """Raises Error unless it has a point for each component."""
        m = len(self.points) if self.states is None else len(self.states)
        if m != states:
            raise Error(f"mesh: has a point for {m} states, and there are {states}; give mesh.states for each", "mesh")
        if self.constraints is not None and len(self.constraints) != constraints:
            found = f"has a point for {len(self.constraints)} constraints, and there are {constraints}"
            raise Error(f"mesh: {found}; give mesh.constraints for each", "mesh")


def save_mesh(result: Rows, name: str) -> None:
    """The last row as .vtu, or all rows in a folder beside a .pvd."""
    try:
        import meshio
    except ImportError:
        raise Error("path: .vtu and .pvd need meshio; pip install meshio", "path") from None
    mesh: Mesh | None = getattr(result.scene, "mesh", None)
    if mesh is None:
        raise Error("path: .vtu and .pvd need a mesh; give Scene(mesh=bromwich.Mesh(points, cells))", "path")
    if result.x.shape[1] == 0:
        raise Error("path: no states were recorded; solve with states='all'", "path")
    points = mesh.points if mesh.points.shape[1] == 3 else np.column_stack([mesh.points, np.zeros(len(mesh.points))])
    cells = list(mesh.cells.items())

    def write(row: int, path: str) -> None:
        meshio.write(path, meshio.Mesh(points, cells, point_data=_fields(result, mesh, row)), file_format="vtu")

    if name.endswith(".vtu"):
        write(len(result.t) - 1, name)
        return
    folder = os.path.splitext(name)[0]
    os.makedirs(folder, exist_ok=True)
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1"><Collection>']
    for row, t in enumerate(result.t):
        write(row, os.path.join(folder, f"{row:06d}.vtu"))
        lines.append(f'<DataSet timestep="{float(t)!r}" file={quoteattr(f"{os.path.basename(folder)}/{row:06d}.vtu")}/>')
    with open(name, "w", encoding="utf-8") as file:
        file.write("\n".join([*lines, "</Collection></VTKFile>"]) + "\n")


def _fields(result: Rows, mesh: Mesh, row: int) -> dict[str, np.ndarray]:
    """x at its points, y and w at those of the constraints; NaN elsewhere."""
    components = np.array([whole(i, "states") for i in result.x_components])
    x = np.full(len(mesh.points), np.nan)
    x[components if mesh.states is None else mesh.states[components]] = result.x[row]
    fields = {"x": x}
    for key in ("y", "w") if mesh.constraints is not None else ():
        values = getattr(result, key)
        if values is not None:
            fields[key] = np.full(len(mesh.points), np.nan)
            fields[key][mesh.constraints] = values[row]
    return fields
