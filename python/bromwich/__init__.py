"""Differential linear complementarity problems, all time points at once::

    E x' = A x + B y + f(t),   0 <= y  ⊥  w = N x + M y + g(t) >= 0,   x(0) = x0,   0 <= t <= T.

    import bromwich
    r = bromwich.solve(A=A, B=B, N=N, M=M, x0=x0, T=1, g=lambda t: ...)
    r.status, r.t, r.y, r.x, r.w, r.residual

:func:`solve` takes arrays or a :class:`Scene`; :class:`Solver` keeps what it has prepared for other x0 and sources.
"""

from . import _load

_variant, _openmp = _load.core()

from . import _core
from ._arrays import Tridiagonal
from ._array_solver import ArrayResult, ArraySolver, SharedArray
from ._derivative import (
    BatchDerivative,
    BatchJacobian,
    Derivative,
    Gradient,
    ParameterGradient,
    QuantityGradient,
)
from ._dynamics import Dynamics, Kronecker
from ._contacts import ContactImpact, ContactPhase, ContactReport, ContactSummary, MechanicalEnergy
from ._errors import (
    DeviceError,
    DoesNotFit,
    Error,
    InternalError,
    Interrupted,
    NotSolved,
    NotSolvedWarning,
    SingularShift,
)
from ._batch import BatchResult, solve_batch
from ._balance import Balance, ElementPower
from ._backends import BackendInfo, backends, cuda_devices
from ._circuit import Circuit, CircuitScene, circuit
from ._circuit_map import CircuitMap
from ._continuation import Branch, BranchMark, continuation
from ._friction import FrictionProblem, FrictionResult, load_friction, solve_friction
from ._invert import Inverse, invert
from ._lcp import LcpGradient, LcpResult, LcpTangent, lcp
from ._mechanics import Contact, MechanicalScene, Structure
from ._memory import Memory, ModeChange
from ._mesh import Mesh
from ._nonlinear import NonlinearResult, solve_nonlinear
from ._parameters import ParameterDerivative
from ._result import Result
from ._result_derivative import Margin, Tangent
from ._rows import Status, Switch
from ._saved_result import SavedResult, load
from ._scene import Scene, scene, scenes
from ._solve import Solver, solve

__version__: str = _core.version


__all__ = [
    "ArrayResult",
    "ArraySolver",
    "BackendInfo",
    "Balance",
    "BatchDerivative",
    "BatchJacobian",
    "BatchResult",
    "Branch",
    "BranchMark",
    "Circuit",
    "CircuitMap",
    "CircuitScene",
    "Contact",
    "ContactImpact",
    "ContactPhase",
    "ContactReport",
    "ContactSummary",
    "Derivative",
    "DeviceError",
    "DoesNotFit",
    "Dynamics",
    "ElementPower",
    "Error",
    "FrictionProblem",
    "FrictionResult",
    "Gradient",
    "InternalError",
    "Interrupted",
    "Inverse",
    "Kronecker",
    "LcpGradient",
    "LcpResult",
    "LcpTangent",
    "Margin",
    "MechanicalEnergy",
    "MechanicalScene",
    "Memory",
    "Mesh",
    "ModeChange",
    "NonlinearResult",
    "NotSolved",
    "NotSolvedWarning",
    "ParameterDerivative",
    "ParameterGradient",
    "QuantityGradient",
    "Result",
    "SavedResult",
    "Scene",
    "SharedArray",
    "SingularShift",
    "Solver",
    "Status",
    "Structure",
    "Switch",
    "Tangent",
    "Tridiagonal",
    "__version__",
    "backends",
    "circuit",
    "continuation",
    "cuda_devices",
    "invert",
    "lcp",
    "load",
    "load_friction",
    "scene",
    "scenes",
    "solve",
    "solve_batch",
    "solve_friction",
    "solve_nonlinear",
]
