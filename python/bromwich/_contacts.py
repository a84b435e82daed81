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

    def __init__(
        self,
        found: dict[str, Any],
        names: list[str],
        coordinates: tuple[list[str], np.ndarray, np.ndarray],
        normal: dict[str, np.ndarray],
        friction: dict[str, np.ndarray],
    ) -> None:
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
        self._coordinates = coordinates  # names, q and v at the rows
        #: normal forces at the rows, J+1 values by name
        self.normal = normal
        #: friction on the structure along its tangents at the rows, J+1 values, or J+1 x 2 with two tangents, by name
        self.friction = friction

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
        names, q, v = self._coordinates
        known = [*names, *range(len(names))]
        if coordinate not in known:
            raise Error(f"coordinate: found {coordinate!r}; choose from {', '.join(map(str, known))}", "coordinate")
        i = names.index(coordinate) if isinstance(coordinate, str) else coordinate
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.subplots(layout="constrained")[1]
        ax.plot(q[:, i], v[:, i])
        ax.set_xlabel(names[i])
        ax.set_ylabel(f"v_{names[i]}")
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
    names, d, answer = mechanism.contacts, mechanism.coordinates, result._answer
    forces = np.array(mechanism.friction_forces(answer))
    ends = np.cumsum(mechanism.tangents)
    friction = {}
    for name, end, tangents in zip(names, ends, mechanism.tangents):
        part = forces[:, end - tangents : end]
        friction[name] = part[:, 0] if tangents == 1 else part
    return ContactReport(
        mechanism.report(answer),
        names,
        (result.scene.names["x"][:d], result.x[:, :d], result.x[:, d : 2 * d]),
        dict(zip(names, np.array(mechanism.normal_forces(answer)).T)),
        friction,
    )


def report_of_file(result: Any, summary: dict[str, Any], columns: dict[str, np.ndarray]) -> ContactReport:
    """From the summary of a file, its rows, and its columns NAME.lt, or NAME.lt0, NAME.lt1."""
    if "contacts" not in summary:
        raise Error("contacts: the file does not say what contacts do; save a structure's result with all states", "contacts")
    given: dict[str, dict[str, Any]] = summary["contacts"]
    impacts = [(p["t"], name, p) for name, c in given.items() for p in c["impacts"]]
    found = {
        "located": summary["energy"]["located"],
        "contacts": [
            [len(c["impacts"]) if key == "impacts" else c[key] for key in ContactSummary._fields] for c in given.values()
        ],
        "phases": [(name, p["begin"], p["end"], p["state"]) for name, c in given.items() for p in c["phases"]],
        "impacts": [
            (name, t, p["normal"], p["friction"], p["loss"], p["friction_loss"])
            for t, name, p in sorted(impacts, key=lambda one: one[0])
        ],
        "energy": [summary["energy"][key] for key in MechanicalEnergy._fields],
    }
    rows = result.constraint_names
    normal = {name: result.y[:, rows.index(f"{name}.normal")] for name in given if f"{name}.normal" in rows}
    friction = {}
    for name in given:
        parts = [columns[key] for key in (f"{name}.lt", f"{name}.lt0", f"{name}.lt1") if key in columns]
        if parts:
            friction[name] = parts[0] if len(parts) == 1 else np.array(parts).T
    d = summary["coordinates"]
    coordinates = result.state_names[:d], result.x[:, :d], result.x[:, d : 2 * d]
    return ContactReport(found, list(given), coordinates, normal, friction)
