"""Where the energy of a circuit goes."""

from __future__ import annotations

from typing import NamedTuple


class ElementPower(NamedTuple):
    """An element over a span of time."""

    power: float  #: W, the mean of v i: what it takes; less than 0 where it supplies
    mean: float  #: of its current, A
    rms: float  #: of its current
    peak: float  #: the largest absolute value of its current


class Balance(NamedTuple):
    """Where the energy of a circuit goes over a span of time: supplied = stored + dissipated."""

    supplied: float  #: J, by sources
    stored: float  #: J, by capacitors and inductors, from the states at both ends
    dissipated: float  #: J, by resistors, diodes and switches
    error: float  #: of the balance, relative to what flows
    load: str  #: the resistor that takes most
    efficiency: float  #: its part of what is supplied
    elements: dict[str, ElementPower]  #: by name
