"""sympy loads and actuators as gravity and forces of a model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .naming import free_name, made_name
from .sympy_system import GROUND, Frame, SympySystem, Trouble, components, moves

_AT_ORIGIN = ["0"] * 3


def read_loads(found: SympySystem, loads: Iterable[Any], actuators: Iterable[Any]) -> None:
    """Fill the sections ``gravity`` and ``forces`` of the model."""
    rest = [_as_load(load) for load in loads]
    gravity = _gravity(found, rest)
    if gravity is not None:
        found.sections["gravity"] = [found.text(c) for c in gravity]
    for number, load in enumerate(rest, 1):
        _reported(found, f"loads.{load.location}", _load, f"load_{number}", load)
    for number, actuator in enumerate(actuators, 1):
        kind = type(actuator).__name__
        _reported(found, f"actuators.{kind} {number}", _actuator, _spelled(kind) + f"_{number}", actuator)


def _as_load(load: Any) -> Any:
    """A load as a force or torque object; in older sympy versions it is a pair of a point or frame, and a vector."""
    from sympy.physics.mechanics import Force, ReferenceFrame, Torque

    if hasattr(load, "location"):
        return load
    return Torque(*load) if isinstance(load[0], ReferenceFrame) else Force(*load)


def _reported(found: SympySystem, where: str, read: Any, *what: Any) -> None:
    """Call a reader of a load, and report its errors."""
    try:
        read(found, *what)
    except Trouble as error:
        found.report(where, str(error))
    except ValueError as error:  # raised by sympy for points and frames that nothing connects
        found.report(where, f"{error}")


def _spelled(kind: str) -> str:
    """The name of a class in lower case: ``LinearSpring`` as ``linear_spring``."""
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in kind).lstrip("_")


def _add(found: SympySystem, name: str, **keys: Any) -> None:
    """Add an entry to the section ``forces``."""
    forces = found.sections.setdefault("forces", {})
    forces[free_name(made_name(name), forces)] = {k.rstrip("_"): v for k, v in keys.items()}


def _gravity(found: SympySystem, loads: list[Any]) -> list[Any] | None:
    """The acceleration that forces at all mass centres have in common; these forces are removed from the loads. None if
    there is no such acceleration."""
    import sympy

    ground = next(f for f in found.frames.values() if f.name == GROUND)
    weights: dict[int, Any] = {}
    common = None
    for body, frame in found.frames.items():
        if frame.name == GROUND or body.mass == 0:
            continue
        for load in loads:
            if load.location is body.masscenter and hasattr(load, "force") and id(body) not in weights:
                here = [sympy.cancel(c / body.mass) for c in components(load.vector, ground.axes)]
                if any(moves(c) for c in here) or (common is not None and here != common):
                    continue
                common, weights[id(body)] = here, load
        if id(body) not in weights:
            return None
    at_rest = {id(b.masscenter) for b, f in found.frames.items() if f.name == GROUND}
    taken = {id(load) for load in weights.values()}
    loads[:] = [load for load in loads if id(load) not in taken and id(load.location) not in at_rest]
    return common if common is not None and any(common) else None


def _load(found: SympySystem, name: str, load: Any) -> None:
    """Add a force on a point, or a torque on a frame."""
    if load.vector == 0:
        return
    if hasattr(load, "force"):
        body, place = found.body_of_point(load.point)
        on: Any = body.name if place == _AT_ORIGIN else {"body": body.name, "at": place}
    else:
        body = found.body_of_frame(load.frame)
        on = body.name
    if body.name == GROUND:
        return
    value, axes = _components(found, load.vector, body)
    _add(found, name, type="force" if hasattr(load, "force") else "torque", on=on, value=value, **axes)


def _components(found: SympySystem, vector: Any, body: Frame) -> tuple[list[str], dict[str, str]]:
    """Components of a vector, as text, in the ground's or the body's frame, whichever takes fewer operations."""
    import sympy

    ground = next(f for f in found.frames.values() if f.name == GROUND)
    choices = [(components(vector, ground.axes), {}), (components(vector, body.axes), {"axes": "body"})]
    value, keys = min(choices, key=lambda choice: sum(sympy.count_ops(c) for c in choice[0]))
    return [found.text(c) for c in value], keys


def _actuator(found: SympySystem, name: str, actuator: Any) -> None:
    """Add an actuator: as the equivalent force element of the model, otherwise as its loads."""
    kind = type(actuator).__name__
    if kind == "TorqueActuator" and _in_joint(found, name, actuator):
        return
    path: Any = getattr(actuator, "pathway", None)
    if type(path).__name__ == "LinearPathway" and _along_line(found, name, kind, actuator, path.attachments):
        return
    for number, load in enumerate(actuator.to_loads(), 1):
        _load(found, f"{name}_{number}", load)


def _in_joint(found: SympySystem, name: str, actuator: Any) -> bool:
    """Add a torque that acts between the two bodies of a revolute joint about its axis; returns False for other torques."""
    import sympy

    if actuator.reaction_frame is None:
        return False
    target, reaction = (found.body_of_frame(f) for f in (actuator.target_frame, actuator.reaction_frame))
    for outer, inner, sign in ((target, reaction, 1), (reaction, target, -1)):
        joint = outer.joint
        if (
            type(joint).__name__ != "PinJoint"
            or found.frames[(joint.parent, joint.child)[:: outer.sign][0]] is not inner
        ):
            continue
        axes = joint.parent_interframe
        along, axis = (sympy.Matrix(components(v, axes)) for v in (actuator.axis, joint.joint_axis))
        if not any(moves(c) for c in along) and along.cross(axis).applyfunc(sympy.simplify).is_zero_matrix:
            length = sympy.simplify(along.dot(axis) / axis.norm())
            value = found.text(sign * outer.sign * length * actuator.torque)
            _add(found, name, type="joint", joint=outer.name, value=value)
            return True
    return False


def _along_line(found: SympySystem, name: str, kind: str, actuator: Any, ends: Sequence[Any]) -> bool:
    """Add a force element along the line between two points; False if none is equivalent."""
    if kind == "LinearSpring" and actuator.equilibrium_length == 0:  # a bushing is also defined if the points coincide
        keys = {"type": "bushing", "stiffness": actuator.stiffness}
    elif kind == "LinearSpring":
        keys = {"type": "spring", "stiffness": actuator.stiffness, "free_length": actuator.equilibrium_length}
    elif kind == "LinearDamper":
        keys = {"type": "spring", "stiffness": 0, "damping": actuator.damping}
    elif kind == "DuffingSpring":
        keys = {"type": "hardening_spring", "stiffness": actuator.linear_stiffness,
                "hardening": actuator.nonlinear_stiffness, "free_length": actuator.equilibrium_length}  # fmt: skip
    else:
        keys = {"type": "actuator", "force": actuator.force}
    if keys["type"] != "actuator" and any(_reads_motion(found, v) for k, v in keys.items() if k != "type"):
        keys = {"type": "actuator", "force": actuator.force}
    places = [found.body_of_point(p) for p in ends]
    if places[0][0] is places[1][0]:
        return True  # both ends are on one body: no effect
    points = [b.name if at == _AT_ORIGIN else {"body": b.name, "at": at} for b, at in places]
    written: dict[str, Any] = {k: v if k == "type" else found.text(v) for k, v in keys.items()}
    if keys["type"] == "bushing":
        written["stiffness"] = [written["stiffness"]] * 3
    _add(found, name, **{"type": written.pop("type"), "from_": points[0], "to": points[1], **written})
    return True


def _reads_motion(found: SympySystem, value: Any) -> bool:
    """Whether a coefficient depends on coordinates or speeds."""
    import sympy
    from sympy.core.function import AppliedUndef

    moving = {s for s, name in found.symbols.items() if name.startswith(("q.", "u."))}
    return bool(sympy.sympify(value).atoms(AppliedUndef) & moving)
