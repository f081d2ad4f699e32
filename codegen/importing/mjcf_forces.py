"""Passive forces of an MJCF: springs, dampers and rotors of joints, tendons and actuators.

An actuator acts with control 0, or with the value of its range nearest to 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from .naming import made_name
from .placement import of_quaternion
from .robot import WORLD, BodyForce, Effect, JointTerm, Mark, Place, Robot
from .words import number

_SLIDE, _HINGE = 2, 3
_TO_JOINT: Final = ("mjTRN_JOINT", "mjTRN_JOINTINPARENT")
_PARTS: Final = ("stiffness", "damping", "armature", "frictionloss")


@dataclass(slots=True)
class Length:
    """Length or angle of an actuator or a tendon, as texts with ``{}`` for names.

    Attributes
    ----------
    value, rate : str
    of : tuple of str
        Joints or marks whose names replace each ``{}``.
    factors : dict of str to float
        By joint: ratio of its force to the force along this length.
    segments : list of (str, str, float)
        For a tendon between points: for each segment both points, and the divisor of the force between them.
    """

    value: str
    rate: str
    of: tuple[str, ...]
    factors: dict[str, float]
    segments: list[tuple[str, str, float]]


class Pull(NamedTuple):
    """The force of an actuator on a tendon; ``gear`` is the factor of the tendon's length."""

    name: str
    place: Place
    length: Length
    text: str
    gear: float


def terms_of(pairs: list[tuple[float, str]], constant: float = 0.0) -> str:
    """The text of a sum, such as ``2*q.{} - q.{} + 0.5``, from factors and texts."""
    texts = [_scaled(factor, text) for factor, text in pairs if factor]
    if constant:
        texts.append(number(constant))
    return " + ".join(texts).replace("+ -", "- ") or "0"


def _scaled(factor: float, text: str) -> str:
    whole = text if factor in (1.0, -1.0) and " " not in text else f"({text})" if " " in text else text
    return f"-{whole}" if factor == -1 else whole if factor == 1 else f"{number(factor)}*{whole}"


def spring_law(factor: float, more: Any, of: str) -> str:
    """MuJoCo's spring polynomial, -x (factor + more[0] x + more[1] x^2 ...)."""
    return _law(factor, more, of, [_powered(of, k + 1) for k in range(np.size(more))])


def damper_law(factor: float, more: Any, of: str) -> str:
    """MuJoCo's damper polynomial, -x (factor + more[0] |x| + more[1] x^2 ...)."""
    powers = [_powered(f"abs({of})" if k % 2 == 0 else of, k + 1) for k in range(np.size(more))]
    return _law(factor, more, of, powers)


def _powered(text: str, power: int) -> str:
    whole = f"({text})" if " " in text and not text.startswith("abs(") else text
    return whole if power == 1 else f"{whole}**{power}"


def _law(factor: float, more: Any, of: str, powers: list[str]) -> str:
    whole = f"({of})" if " " in of else of
    parts = [number(factor)] if factor else []
    for value, power in zip(np.ravel(more), powers, strict=True):
        if value:
            parts.append(f"{number(float(value))}*{power}")
    if not parts:
        return ""
    if len(parts) == 1 and factor:
        return _scaled(-factor, of)
    return f"-{whole}*({' + '.join(parts).replace('+ -', '- ')})"


def disabled(mujoco: Any, model: Any, *words: str) -> bool:
    """Whether any of the given flags is disabled; before MuJoCo 3.3, one flag disables both springs and dampers."""
    bits = mujoco.mjtDisableBit
    both = getattr(bits, "mjDSBL_PASSIVE", 0)
    masks = (int(getattr(bits, f"mjDSBL_{w}", both if w in ("SPRING", "DAMPER") else 0)) for w in words)
    return any(int(model.opt.disableflags) & mask for mask in masks)


def row(model: Any, name: str, k: int) -> Any:
    """The numbers of one element; empty if the installed MuJoCo has no such field."""
    rows = getattr(model, name, None)
    return np.zeros(1) if rows is None or not len(rows) else np.ravel(rows[k])


class PassiveForces:
    """Adds to a robot the passive forces of a compiled model's tendons and actuators.

    Parameters
    ----------
    mujoco : module
    model : mujoco.MjModel
    robot : Robot
    links, joints : list of str
        Names by MuJoCo's indices.
    origin : callable
        Returns MuJoCo's body frame in the frame of its link.
    place : callable
        Returns the place in the file of an element, by kind and name.
    """

    def __init__(
        self, mujoco: Any, model: Any, robot: Robot, links: list[str], joints: list[str], origin: Any, place: Any
    ):
        self.mujoco = mujoco
        self.model = model
        self.off = partial(disabled, mujoco, model)
        """Whether at least one of the given flags of the model is disabled."""
        self.robot = robot
        self.links = links
        self.joints = joints
        self.origin = origin
        self.place = place
        self.lengths: dict[int, Length | None] = {}
        self.limited = {joints[j]: j for j in np.flatnonzero(model.jnt_actfrclimited)}
        self.driven: dict[str, list[JointTerm]] = {joint: [] for joint in self.limited}
        """Forces of actuators on joints that limit the sum of these forces."""
        self.pulled: dict[int, list[Pull]] = {}
        """Forces of actuators on tendons that limit the sum of these forces."""

    def read(self) -> None:
        """Add all passive forces of the model to the robot."""
        for t in range(int(self.model.ntendon)):
            self.tendon(t)
        for a in range(len(self.model.actuator_trntype)):
            self.actuator(a)
        for t, pulls in self.pulled.items():
            self.clamp_tendon(t, pulls)
        self.clamp()
        self.lift()

    def clamp(self) -> None:
        """Adds the actuator forces on joints that limit the sum of these forces."""
        for joint, terms in self.driven.items():
            if terms:
                low, high = (number(float(v)) for v in self.model.jnt_actfrcrange[self.limited[joint]])
                text = " + ".join(term.text for term in terms).replace("+ -", "- ")
                of = tuple(name for term in terms for name in term.of)
                self.robot.terms.append(JointTerm(joint, f"min(max({text}, {low}), {high})", of))

    def clamp_tendon(self, t: int, pulls: list[Pull]) -> None:
        """Add the actuator forces of a tendon that limits their sum. The limit applies to the forces before they are
        multiplied by the gears. MuJoCo scales all forces by the same factor, which gives the clamped sum only if all
        gears are equal.
        """
        model = self.model
        if len({pull.gear for pull in pulls}) > 1:
            why = "its actuators have different gears"
            for pull in pulls:
                self.robot.leave_out("actuatorfrcrange of a tendon", pull.place, Effect.DIFFERS, why)
                self.act(pull.name, pull.length, pull.text, 1.0, driven=True)
            return
        low, high = (number(float(v)) for v in model.tendon_actfrcrange[t])
        text = " + ".join(pull.text for pull in pulls).replace("+ -", "- ")
        first = pulls[0]
        name = first.name if len(pulls) == 1 else f"{model.tendon(t).name or f'tendon_{t}'}_actuators"
        self.act(name, first.length, f"min(max({text}, {low}), {high})", 1.0, driven=True)

    def lift(self) -> None:
        """List joints whose gravity compensation by actuators differs in the model: the compensation is limited, or no
        actuator acts."""
        model = self.model
        if self.off("GRAVITY") or (self.off("SPRING") and self.off("DAMPER")) or not np.any(model.body_gravcomp):
            return
        acts = len(model.actuator_trntype) > 0 and not self.off("ACTUATION")
        for j in np.flatnonzero(getattr(model, "jnt_actgravcomp", ())):
            if not acts or self.joints[j] in self.limited:
                why = "only within the range of the actuators" if acts else "without effect, since no actuator acts"
                place = self.place("joint", model.joint(j).name, int(j))
                self.robot.leave_out("actuatorgravcomp of a joint", place, Effect.DIFFERS, f"in MuJoCo {why}")

    # ---- lengths -------------------------------------------------------------------------------------------------------

    def of_joint(self, k: int, gear: float) -> Length:
        """Length of an actuator on a hinge or slide joint."""
        zero = gear * float(self.model.qpos0[self.model.jnt_qposadr[k]])
        name = self.joints[k]
        return Length(terms_of([(gear, "q.{}")], zero), terms_of([(gear, "u.{}")]), (name,), {name: gear}, [])

    def of_tendon(self, t: int) -> Length | None:
        """Length of a tendon; None if it wraps around geoms."""
        if t not in self.lengths:
            model, wrap = self.model, self.mujoco.mjtWrap
            first, count = int(model.tendon_adr[t]), int(model.tendon_num[t])
            kinds = {int(k) for k in model.wrap_type[first : first + count]}
            if kinds <= {int(wrap.mjWRAP_JOINT)}:
                self.lengths[t] = self.of_joints(first, count)
            elif kinds <= {int(wrap.mjWRAP_SITE), int(wrap.mjWRAP_PULLEY)}:
                self.lengths[t] = self.of_sites(t, first, count)
            else:
                self.lengths[t] = None
        return self.lengths[t]

    def of_joints(self, first: int, count: int) -> Length:
        """Length of a fixed tendon: a linear combination of coordinates."""
        model, zero = self.model, 0.0
        factors: dict[str, float] = {}
        for w in range(first, first + count):
            k, factor = int(model.wrap_objid[w]), float(model.wrap_prm[w])
            name = self.joints[k]
            factors[name] = factors.get(name, 0.0) + factor
            zero += factor * float(model.qpos0[model.jnt_qposadr[k]])
        factors = {name: factor for name, factor in factors.items() if factor}
        value, rate = ([(factor, f"{c}.{{}}") for factor in factors.values()] for c in "qu")
        return Length(terms_of(value, zero), terms_of(rate), tuple(factors), factors, [])

    def of_sites(self, t: int, first: int, count: int) -> Length:
        """Length of a spatial tendon: a path of straight segments between points."""
        model, wrap = self.model, self.mujoco.mjtWrap
        divisor, before, constant = 1.0, -1, 0.0
        segments: list[tuple[str, str, float]] = []
        for w in range(first, first + count):
            site = int(model.wrap_objid[w])
            if int(model.wrap_type[w]) == int(wrap.mjWRAP_PULLEY):
                divisor, before = float(model.wrap_prm[w]), -1
                continue
            if before >= 0:
                bodies = [int(model.body_weldid[model.site_bodyid[s]]) for s in (before, site)]
                if bodies[0] == bodies[1]:
                    constant += self.apart(before, site) / divisor
                else:
                    segments.append((self.mark(before), self.mark(site), divisor))
            before = site
        of = tuple(m for segment in segments for m in segment[:2])
        value, rate = ([(1 / d, f"{f}({{}}, {{}})") for _, _, d in segments] for f in ("distance", "rate"))
        return Length(terms_of(value, constant), terms_of(rate), of, {}, segments)

    def apart(self, a: int, b: int) -> float:
        """The distance between two sites of the same rigid body."""
        ends = []
        for site in (a, b):
            body, at = int(self.model.site_bodyid[site]), self.model.site_pos[site]
            while body != int(self.model.body_weldid[body]):
                turn = of_quaternion(*map(float, self.model.body_quat[body]))
                at, body = self.model.body_pos[body] + turn @ at, int(self.model.body_parentid[body])
            ends.append(at)
        return float(np.linalg.norm(ends[0] - ends[1]))

    def mark(self, site: int) -> str:
        """The point of a site; it is added to the model if it is new."""
        name = self.model.site(site).name or f"site_{site}"
        if all(mark.name != name for mark in self.robot.marks):
            body = int(self.model.site_bodyid[site])
            at = self.origin(body).point(self.model.site_pos[site])
            self.robot.marks.append(Mark(name, self.links[body] if body else WORLD, at))
        return name

    # ---- elements ------------------------------------------------------------------------------------------------------

    def tendon(self, t: int) -> None:
        """Add the spring, damper and rotor of a tendon."""
        model, robot = self.model, self.robot
        name = model.tendon(t).name
        place = self.place("tendon", name, t)
        named = name or f"tendon_{t}"
        stiffness, damping, armature, friction = (float(row(model, f"tendon_{p}", t)[0]) for p in _PARTS)
        springs, dampers = (row(model, f"tendon_{p}poly", t) for p in ("stiffness", "damping"))
        has_spring = bool(stiffness or np.any(springs)) and not self.off("SPRING")
        has_damper = bool(damping or np.any(dampers)) and not self.off("DAMPER")
        robot.leave_out("<tendon>", place, Effect.NONE, "its spring and damper are read; its path is not drawn")
        if friction and not self.off("FRICTIONLOSS", "CONSTRAINT"):
            robot.leave_out("frictionloss of a tendon", place, Effect.DIFFERS, "dry friction")
        if np.any(model.tendon_limited[t]):
            robot.leave_out("range of a tendon", place, Effect.STOPS)
        if has_spring and np.any(row(model, "tendon_springyield", t)):
            robot.leave_out("springyield of a tendon", place, Effect.DIFFERS, "here the spring is elastic")
        if armature:
            self.rotor(self.of_tendon(t), armature, "armature of a tendon", place)
        if not has_spring and not has_damper:
            return
        length = self.of_tendon(t)
        if length is None:
            robot.leave_out("spring or damper of a tendon that wraps around geoms", place, Effect.DIFFERS)
            return
        if has_spring:
            low, high = (float(v) for v in model.tendon_lengthspring[t])
            beyond, below = (terms_of([(1.0, length.value)], -v) if v else length.value for v in (high, low))
            stretch = beyond if low == high else f"max({beyond}, 0) + min({below}, 0)"
            end = "_spring" if has_damper and length.segments else ""
            self.act(f"{named}{end}", length, spring_law(stiffness, springs, stretch), 1.0)
        if has_damper:
            end = "_damper" if has_spring and length.segments else ""
            self.act(f"{named}{end}", length, damper_law(damping, dampers, length.rate), 1.0)

    def rotor(self, length: Length | None, armature: float, what: str, place: Place) -> None:
        """Add the inertia of a rotor whose angle is a given length; the length must depend on one joint only."""
        if length is None or len(length.factors) != 1:
            self.robot.leave_out(what, place, Effect.DIFFERS, "it couples the inertias of several joints")
            return
        ((name, factor),) = length.factors.items()
        joint = self.robot.joints[name]
        before = joint.armature[0] if joint.armature else 0.0
        self.robot.give_armature(joint, (before + armature * factor * factor,), place)

    def act(self, name: str, length: Length, text: str, factor: float, driven: bool = False) -> None:
        """Adds a force along a length, on joints or between points; if `driven` by an actuator, joint force limits
        apply."""
        if not text:
            return
        count = text.count("{}")
        of = length.of * (count // len(length.of)) if length.of else ()
        for joint, own in length.factors.items():
            terms = self.driven.get(joint, self.robot.terms) if driven else self.robot.terms
            terms.append(JointTerm(joint, _scaled(factor * own, text), of))
        for k, (start, end, divisor) in enumerate(length.segments):
            whole = _scaled(factor / divisor, text)
            own_name = made_name(name) if len(length.segments) == 1 else f"{made_name(name)}_{k + 1}"
            entry = f'type: actuator, from: {{}}, to: {{}}, force: "{whole}"'
            self.robot.forces.append(BodyForce(own_name, entry, (start, end, *of)))

    # ---- actuators -----------------------------------------------------------------------------------------------------

    def actuator(self, a: int) -> None:
        """Adds the force that an actuator exerts without control."""
        model, robot, mujoco = self.model, self.robot, self.mujoco
        name = model.actuator(a).name
        place = self.place("actuator", name, a)
        robot.leave_out("<actuator>", place, Effect.DRIVEN, "--motors adds inputs; forces without control are read")
        kind, target = int(model.actuator_trntype[a]), int(model.actuator_trnid[a][0])
        gear = float(model.actuator_gear[a][0])
        to_joint = kind in [int(getattr(mujoco.mjtTrn, word)) for word in _TO_JOINT]
        if to_joint and int(model.jnt_type[target]) in (_SLIDE, _HINGE):
            length: Length | None = self.of_joint(target, gear)
        elif kind == int(mujoco.mjtTrn.mjTRN_TENDON):
            length = self.of_tendon(target)
            if length is not None and gear != 1:
                value, rate = (_scaled(gear, text) for text in (length.value, length.rate))
                factors = {joint: gear * own for joint, own in length.factors.items()}
                segments = [(start, end, divisor / gear) for start, end, divisor in length.segments] if gear else []
                length = Length(value, rate, length.of, factors, segments)
        else:
            length = None
        self.reflected(a, place, length, target if to_joint else -1)
        if self.off("ACTUATION") or self.is_off(a):
            return
        law_ = self.affine(a)
        if law_ is None:
            robot.leave_out("force of an actuator without control", place, Effect.DIFFERS, "its type is not supported")
            return
        constant, by_length, by_rate = law_
        if not (constant or by_length or by_rate):
            return
        if length is None:
            what = "force of an actuator without control"
            robot.leave_out(what, place, Effect.DIFFERS, "read on hinges, slides, and tendons that wrap around no geom")
            return
        text = terms_of([(by_length, length.value), (by_rate, length.rate)], constant)
        if model.actuator_forcelimited[a]:
            low, high = (number(float(v)) for v in model.actuator_forcerange[a])
            text = f"min(max({text}, {low}), {high})"
        of_tendon = kind == int(mujoco.mjtTrn.mjTRN_TENDON)
        if of_tendon and np.any(row(model, "tendon_actfrclimited", target)):
            self.pulled.setdefault(target, []).append(Pull(name or f"actuator_{a}", place, length, text, gear))
        else:
            self.act(name or f"actuator_{a}", length, text, 1.0, driven=True)
        if length.segments and self.limited:
            robot.leave_out("actuatorfrcrange of joints that a tendon pulls", place, Effect.DIFFERS)

    def is_off(self, a: int) -> bool:
        """Whether the group of an actuator is disabled."""
        group = int(self.model.actuator_group[a])
        return 0 <= group <= 30 and bool(int(getattr(self.model.opt, "disableactuator", 0)) >> group & 1)

    def affine(self, a: int) -> tuple[float, float, float] | None:
        """The force without control: constant, coefficients of the length and of its rate; None for any other law."""
        model, mujoco = self.model, self.mujoco
        bias, gain, dynamics = (int(getattr(model, f"actuator_{word}type")[a]) for word in ("bias", "gain", "dyn"))
        control = 0.0
        if model.actuator_ctrllimited[a] and not self.off("CLAMPCTRL"):
            low, high = (float(v) for v in model.actuator_ctrlrange[a])
            control = min(max(0.0, low), high)
        if bias not in (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)):
            return None
        b = [float(v) for v in model.actuator_biasprm[a][:3]] if bias else [0.0, 0.0, 0.0]
        if getattr(model, "actuator_plugin", np.full(a + 1, -1))[a] >= 0:
            return None
        if control == 0:
            return (b[0], b[1], b[2]) if gain <= int(mujoco.mjtGain.mjGAIN_MUSCLE) else None
        if dynamics != int(mujoco.mjtDyn.mjDYN_NONE):
            return None
        g = [float(v) for v in model.actuator_gainprm[a][:3]]
        if gain == int(mujoco.mjtGain.mjGAIN_FIXED):
            g = [g[0], 0.0, 0.0]
        elif gain != int(mujoco.mjtGain.mjGAIN_AFFINE):
            return None
        first, second, third = (x + control * y for x, y in zip(b, g, strict=True))
        return first, second, third

    def reflected(self, a: int, place: Place, length: Length | None, joint: int) -> None:
        """Adds the armature and the damping of the rotor of an actuator."""
        model = self.model
        armature, damping = (float(row(model, f"actuator_{p}", a)[0]) for p in ("armature", "damping"))
        more = row(model, "actuator_dampingpoly", a)
        is_damped = bool(damping or np.any(more)) and not self.off("DAMPER")
        if armature:
            self.rotor(length, armature, "armature of an actuator", place)
        if is_damped and length is not None and (joint >= 0 or not np.any(more)):
            if joint >= 0:  # MuJoCo's polynomial is in the joint's own speed
                gear = float(model.actuator_gear[a][0])
                own = self.of_joint(joint, 1.0)
                self.act("", own, damper_law(damping, more, own.rate), gear * gear)
            else:
                self.act(
                    f"{model.actuator(a).name or f'actuator_{a}'}_damper",
                    length,
                    damper_law(damping, [], length.rate),
                    1.0,
                )
        elif is_damped:
            self.robot.leave_out("damping of an actuator", place, Effect.DIFFERS)
