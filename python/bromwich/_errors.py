"""Exceptions of the package, a class for each way to react to a failure."""

from __future__ import annotations

import re
from typing import Any


class Error(ValueError):
    """Bad input: one line that names the argument, what was found, and what to do.

    Attributes:
        argument: what is wrong, such as ``"x0"``, ``"M"``, ``"tol"`` or, in a scene file, ``"my.toml:7: dynamics.A"``.
    """

    def __init__(self, message: str, argument: str = "") -> None:
        super().__init__(message)
        self.argument = argument


class DoesNotFit(Error, MemoryError):
    """The solve needs more memory or work than there is. Ask for less: steps, states, or a smaller scene."""


class DeviceError(Error, RuntimeError):
    """A device or one of its libraries failed. The input may be right: try ``backend="cpu"``."""


class InternalError(Error, RuntimeError):
    """A defect of bromwich. Please report it."""


class SingularShift(Error, ArithmeticError):
    """zE - A is singular: z is an eigenvalue. Callbacks of :class:`bromwich.Dynamics` may raise it."""

    def __init__(self, message: str = "z is an eigenvalue", argument: str = "shifted") -> None:
        super().__init__(message, argument)


class NotSolved(Error, RuntimeError):
    """Raised by ``check=True`` where the status is not ``solved``.

    Attributes:
        result: what the solve returns otherwise, such as a :class:`bromwich.Result`, with its valid part.
    """

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message, "status")
        self.result = result


class NotSolvedWarning(RuntimeWarning):
    """Issued where the status of a result is not ``solved`` and ``check`` is its default."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended the solve. A KeyboardInterrupt, so that loops around a solve end too.

    Attributes:
        result: what the solve returns otherwise, such as a :class:`bromwich.Result`, with its valid part; rows of y after
            it are NaN.
    """

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


def require(held: bool, argument: str, message: str) -> None:
    """Raises Error unless it holds."""
    if not held:
        raise Error(f"{argument}: {message}", argument)


_KINDS = {
    "bad input": Error,
    "does not fit": DoesNotFit,
    "device": DeviceError,
    "internal": InternalError,
    "singular shift": SingularShift,
}

# Names of arguments in the library and its command, and here.
_NAMES = {
    "--backend": "backend",
    "absolute_tolerance": "atol",
    "default_steps": "steps",
    "free_rows": "free",
    "iteration_tolerance": "iteration_tol",
    "tolerance": "tol",
    "tolerance_x": "tol_x",
    "tolerance_y": "tol_y",
}


def made(kind: str, argument: str, rest: str) -> Error:
    """The exception for an error of the library, with the argument that it names."""
    if argument.endswith("(0)"):  # a source at t = 0
        argument, rest = argument.removesuffix("(0)"), f"at t = 0 {rest}"
    argument = _NAMES.get(argument, argument)
    rest = re.sub(r"--backend (\w+)", r"backend='\1'", rest)
    rest = re.sub(r"--(\w+)", r"\1", rest)
    return _KINDS[kind](f"{argument}: {rest}", argument)
