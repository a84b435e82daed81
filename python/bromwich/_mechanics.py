"""Linear structures with contacts, friction and impacts as scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from . import _core
from ._arrays import compressed, is_sparse, listed, matrix, multiple, number, vector, whole, whole_number, word
from ._errors import Error
from ._model import parameters_of
from ._scene import Scene
from ._sources import on_this_host, source


class MechanicalScene(Scene):
    """A structure with contacts as a scene, made by :meth:`Structure.scene`. Its states are the coordinates q, the velocities
    ``v_q0``, ..., and the forces of Jenkins elements; y and w have rows of the contacts by name, ``r["c0.normal"]``.
    """

    _mechanism: Any

    @property
    def contacts(self) -> list[str]:
        """Names of the contacts."""
        return list(self._mechanism.contacts)

    @property
    def uniqueness(self) -> str:
        """Whether friction leaves one solution: ``unique``; ``unique-motion``, forces may be several; ``unknown``: there may be
        several solutions or none; ``not-tested``: more than eight contacts, or friction in space."""
        return self._mechanism.uniqueness()

    @classmethod
    def _structured(cls, **given: Any) -> MechanicalScene:
        parameters, T = given["parameters"], given["T"]
        M = given["M"]
        d = M[0]

        def function(value: Any, name: str, width: int) -> _core.Source | None:
            return source(value, name, width, T, parameters)

        contacts = []
        for i, c in enumerate(given["contacts"]):
            where = f"contacts[{i}]."
            tangents = 0 if c["tangent"] is None else len(c["tangent"])
            contacts.append(
                (
                    c["name"],
                    c["normal"],
                    c["tangent"],
                    function(c["gap"], where + "gap", 1),
                    function(c["velocity"], where + "velocity", max(tangents, 1)),
                    function(c["bound"], where + "bound", 1),
                    c["numbers"],
                    c["facets"],
                )
            )
        model, mechanism = _core.structure(
            given["name"],
            M,
            given["C"],
            given["K"],
            function(given["f"], "f", d),
            given["q0"],
            given["v0"],
            given["periodic"],
            T,
            given["names"],
            contacts,
        )
        model.steps = given["steps"]
        made = cls._of(model, parameters, {}, ("_structured", (), given))
        made._mechanism = mechanism
        return made


class Contact:
    """A contact of a :class:`Structure`, with the gap ``gn = Hn q + g(t)`` and the sliding velocity ``vt = Ht q' - V(t)``.

    Args:
        normal: Hn, a number for each coordinate; opening is positive. None: friction of a given ``bound`` alone.
        tangent: Ht, likewise; two rows in space. None: no friction.
        gap: g, a source as :class:`Scene` takes them; None: 0.
        velocity: V of the other body, a source; None: 0.
        mu: coefficient of friction, \\|lt\\| <= mu ln.
        restitution: e of Newton's law of impact, 0 to 1.
        kn: stiffness of a compliant contact; None: rigid.
        kt: stiffness of a spring in series with the friction (a Jenkins element); None: rigid.
        bound: R(t) in place of mu ln: friction of a given normal force, a source.
        facets: in space, the number of directions of friction, even; 0: a circle, \\|lt\\| <= mu ln.
        name: of its rows; by default c0, c1, ... by its place.

    Example:
        >>> Contact(normal=[0, 1], tangent=[1, 0], velocity=0.4, mu=0.4, restitution=0.5)
    """

    def __init__(
        self,
        *,
        normal: Any = None,
        tangent: Any = None,
        gap: Any = None,
        velocity: Any = None,
        mu: float = 0,
        restitution: float = 0,
        kn: float | None = None,
        kt: float | None = None,
        bound: Any = None,
        facets: int = 0,
        name: str = "",
    ) -> None:
        for key, stiffness in (("kn", kn), ("kt", kt)):
            if stiffness is not None and not number(stiffness, key) > 0:
                raise Error(f"{key}: found {stiffness!r}; give a positive stiffness, or None for a rigid contact", key)
        numbers = {"mu": mu, "restitution": restitution, "kn": kn or 0.0, "kt": kt or 0.0}
        self._given: dict[str, Any] = {
            "name": word(name, "name"),
            "normal": None if normal is None else vector(normal, "normal").copy(),
            "tangent": None if tangent is None else matrix(tangent, "tangent").copy(),
            "gap": on_this_host(gap, "gap"),
            "velocity": on_this_host(velocity, "velocity"),
            "bound": on_this_host(bound, "bound"),
            "numbers": [number(value, key) for key, value in numbers.items()],
            "facets": whole(facets, "facets", 0),
        }


class Structure:
    """A linear structure ``M q'' + C q' + K q = f(t)`` with contacts; :meth:`scene` makes it a scene.

    Args:
        M: mass matrix, symmetric and positive definite; NumPy or SciPy, or a number for one coordinate.
        C, K: damping and stiffness; a number is that multiple of the identity, None 0.
        f: forces, a source of a value for each coordinate, as :class:`Scene` takes them; None: 0.
        contacts: :class:`Contact` objects.
        q0, v0: the state at t = 0; None: 0.
        parameters: names and values for expressions.
        names: of the coordinates; None: q0, q1, ...
        name: for messages.

    Example:
        >>> belt = Contact(normal=[0, 1], tangent=[1, 0], velocity=0.4, mu=0.4)
        >>> s = Structure(M=np.eye(2), K=[[2, -0.6], [-0.6, 1.5]], f=["0.3*sin(2.1*t)", "-1"], contacts=[belt])
        >>> r = solve(s.scene(T=20), tol=1e-6)
    """

    def __init__(
        self,
        *,
        M: Any,
        C: Any = None,
        K: Any = None,
        f: Any = None,
        contacts: Contact | Iterable[Contact] = (),
        q0: Any = None,
        v0: Any = None,
        parameters: Mapping[str, float] | None = None,
        names: Iterable[str] = (),
        name: str = "",
    ) -> None:
        d = M.shape[0] if is_sparse(M) else len(matrix(M, "M"))

        def square(value: Any, key: str) -> tuple | None:
            return None if value is None else compressed(value if is_sparse(value) else multiple(value, d, key), key)

        all_contacts = [contacts] if isinstance(contacts, Contact) else listed(contacts, "contacts")
        for i, c in enumerate(all_contacts):
            if not isinstance(c, Contact):
                key = f"contacts[{i}]"
                raise Error(f"{key}: is a {type(c).__name__}; give bromwich.Contact", key)
        self._given: dict[str, Any] = {
            "M": square(M, "M"),
            "C": square(C, "C"),
            "K": square(K, "K"),
            "f": on_this_host(f, "f"),
            "q0": None if q0 is None else vector(q0, "q0").copy(),
            "v0": None if v0 is None else vector(v0, "v0").copy(),
            "names": [word(n, "names") for n in listed(names, "names")],
            "name": word(name, "name"),
            "parameters": parameters_of(parameters),
            "contacts": [c._given for c in all_contacts],
        }

    def scene(self, T: float, *, steps: int | None = None, periodic: bool = False, **parameters: float) -> MechanicalScene:
        """The scene on [0, T].

        Args:
            T: final time.
            steps: of a solve that names neither steps nor ``tol``.
            periodic: the state with q(0) = q(T) and q'(0) = q'(T), in place of q0 and v0.
            parameters: replace values of ``parameters``.

        Raises:
            Error: names the argument, of a contact as ``contacts[0].mu``.
        """
        values = dict(self._given["parameters"])
        for key, value in parameters.items():
            if key not in values:
                raise Error(f"{key}: is no parameter of the structure; choose from {', '.join(values) or 'none'}", key)
            values[key] = number(value, key)
        T = number(T, "T")
        if not (T > 0 and np.isfinite(T)):
            raise Error(f"T: is {T:g}; give a positive finite number", "T")
        return MechanicalScene._structured(
            **{**self._given, "parameters": values},
            T=T,
            steps=0 if steps is None else whole_number(steps, "steps"),
            periodic=bool(periodic),
        )
