"""Results on a mesh as unstructured grids of VTK."""

from __future__ import annotations

import os
from xml.sax.saxutils import quoteattr

import numpy as np

from ._arrays import whole
from ._errors import Error
from ._mesh import Mesh
from ._recorded import Recorded


def save_mesh(result: Recorded, name: str) -> None:
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


def _fields(result: Recorded, mesh: Mesh, row: int) -> dict[str, np.ndarray]:
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
