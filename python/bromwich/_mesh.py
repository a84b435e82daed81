"""The mesh of a field."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._arrays import on_host
from ._errors import Error


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
