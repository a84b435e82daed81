"""What a result says of the contacts of a structure."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._errors import Error


class ContactSummary(NamedTuple):
    """One contact over [0, T]."""

    open: float  #: time that it is open
    stick: float  #: time that it sticks
    slip: float  #: time that it slips, or is closed without friction
    normal_impulse: float  #: integral of the normal force, impacts included
    friction_impulse: list[float]  #: integral of the friction, of each tangent
    largest_normal: float  #: normal force outside impacts
    impacts: int
    friction_loss: float  #: energy, friction during impacts included
    impact_loss: float  #: energy; negative where Newton's law with friction raises it


class ContactPhase(NamedTuple):
    """What a contact does for a while."""

    contact: str
    begin: float
    end: float
    state: str  #: open, stick or slip


class ContactImpact(NamedTuple):
    """An impact of one contact."""

    contact: str
    t: float
    normal: float  #: impulse
    friction: list[float]  #: impulse of each tangent
    loss: float  #: energy, by the normal impulse
    friction_loss: float  #: energy, by the impulse of friction


class MechanicalEnergy(NamedTuple):
    """initial + supplied = stored + damping + friction + impacts."""

    initial: float  #: kinetic and potential energy at t = 0
    supplied: float  #: by f, moving bodies and the skew part of K
    stored: float  #: at T
    damping: float
    friction: float
    impacts: float
    error: float  #: of the balance, relative to its largest term


class ContactReport:
    """Contacts of a result: ``report["c0"].stick``, ``report.energy.error``, ``report.phases``."""

    def __init__(self, result: Any, found: dict[str, Any]) -> None:
        mechanism = result.scene._mechanism
        names = mechanism.contacts
        #: whether switches and impacts are located; otherwise the numbers are from the rows, with the order of the steps
        self.located: bool = found["located"]
        #: :class:`ContactSummary` of each contact by name
        self.contacts: dict[str, ContactSummary] = {n: ContactSummary(*c) for n, c in zip(names, found["contacts"])}
        #: :class:`ContactPhase`, of each contact in order of time
        self.phases: list[ContactPhase] = [ContactPhase(*p) for p in found["phases"]]
        #: :class:`ContactImpact`, in order of time
        self.impacts: list[ContactImpact] = [ContactImpact(*p) for p in found["impacts"]]
        #: :class:`MechanicalEnergy`
        self.energy = MechanicalEnergy(*found["energy"])
        self._result = result
        ends = np.cumsum(mechanism.tangents)
        friction = mechanism.friction_forces(result._answer)
        #: normal forces at the rows, J+1 values by name
        self.normal: dict[str, np.ndarray] = dict(zip(names, np.array(mechanism.normal_forces(result._answer)).T))
        #: friction on the structure along its tangents at the rows, J+1 values, or J+1 x 2 with two tangents, by name
        self.friction: dict[str, np.ndarray] = {}
        for name, end, tangents in zip(names, ends, mechanism.tangents):
            part = np.array(friction)[:, end - tangents : end]
            self.friction[name] = part[:, 0] if tangents == 1 else part

    def __getitem__(self, name: str) -> ContactSummary:
        if name not in self.contacts:
            raise Error(f"name: found {name!r}; choose from {', '.join(self.contacts)}", "name")
        return self.contacts[name]

    def __repr__(self) -> str:
        e = self.energy
        return (
            f"<bromwich.ContactReport of {', '.join(self.contacts) or 'no contacts'}: {len(self.impacts)} impacts, losses "
            f"{e.friction:.4g} by friction and {e.impacts:.4g} by impacts, energy balance to {e.error:.0e}>"
        )

    def phase_plane(self, coordinate: str | int = 0, ax: Any = None) -> Any:
        """The velocity of a coordinate over it, from the rows. Returns the axes of Matplotlib.

        Args:
            coordinate: its name, or its number from 0.
        """
        scene = self._result.scene
        names, d = scene.names["x"], scene._mechanism.coordinates
        known = [*names[:d], *range(d)]
        if coordinate not in known:
            raise Error(f"coordinate: found {coordinate!r}; choose from {', '.join(map(str, known))}", "coordinate")
        i = names.index(coordinate) if isinstance(coordinate, str) else coordinate
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.subplots(layout="constrained")[1]
        ax.plot(self._result.x[:, i], self._result.x[:, d + i])
        ax.set_xlabel(names[i])
        ax.set_ylabel(names[d + i])
        return ax

    def plot(self, ax: Any = None) -> Any:
        """Bars of all contacts over time: slip light, stick dark, impacts as ticks. Returns the axes of Matplotlib."""
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.subplots(figsize=(7, 0.6 + 0.4 * len(self.contacts)), layout="constrained")[1]
        rows = {name: i for i, name in enumerate(self.contacts)}
        for state, colour in (("slip", "0.75"), ("stick", "0.25")):
            for name, i in rows.items():
                spans = [(p.begin, p.end - p.begin) for p in self.phases if (p.contact, p.state) == (name, state)]
                ax.broken_barh(spans, (i - 0.3, 0.6), color=colour, label=state if i == 0 else None)
        ax.plot([p.t for p in self.impacts], [rows[p.contact] for p in self.impacts], "|", color="C3", label="impact")
        ax.set_yticks(range(len(rows)), list(rows))
        ax.set_ylim(-0.5, len(rows) - 0.5)
        ax.set_xlabel("t")
        ax.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
        return ax


def contact_series(result: Any) -> list[tuple[str, str, np.ndarray]]:
    """For files: name, meaning, and values at the rows; none where not all states are there."""
    mechanism = getattr(result.scene, "_mechanism", None)
    if mechanism is None:
        return []
    return [(name, meaning, np.array(values)) for name, meaning, values in mechanism.columns(result._answer)]


def report_of(result: Any) -> ContactReport:
    mechanism = getattr(result.scene, "_mechanism", None)
    if mechanism is None:
        raise Error("contacts: the scene is no structure with contacts; make it by bromwich.Structure", "contacts")
    if len(result.x_components) != result.scene.states:
        raise Error("states: were not all recorded; solve with states='all'", "states")
    return ContactReport(result, mechanism.report(result._answer))
