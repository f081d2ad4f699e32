"""Mechanisms with closed loops, written by hand as models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from loop_closure import closure_matrix
from random_models import expression, vector

from codegen.loops.closure import body_frames
from codegen.loops.geometry import Geometry, padded
from codegen.model.model import GROUND, Body, Face, Joint, Loop, Model

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
ORIGIN = (0, 0, 0)


def body(name: str, parent: int, type: str, *axes: Any, at: Any = ORIGIN, rotation: Any = ()) -> Body:
    """A body of unit mass with its joint."""
    return Body(
        name, parent, Joint(type, tuple(vector(*floats(a)) for a in axes), vector(*floats(at)), turns(rotation)),
        expression(1),
        vector(0, 0, 0), tuple(expression(x) for x in (1, 1, 1, 0, 0, 0)),
    )  # fmt: skip


def turns(rotation: Any) -> tuple:
    return tuple((vector(*floats(axis)), expression(float(angle))) for axis, angle in rotation)


def loop(name: str, type: str, start: tuple, end: tuple, *axes: Any) -> Loop:
    """A loop joint; faces are (body, at) or (body, at, rotation)."""
    faces = [Face(f[0], vector(*floats(f[1])), turns(f[2] if len(f) > 2 else ())) for f in (start, end)]
    return Loop(name, type, tuple(vector(*floats(a)) for a in axes), *faces)


def model(
    bodies: Sequence[Body], loops: Sequence[Loop], q: dict[str, float] | None = None, independent: Sequence[str] = ()
) -> Model:
    initial = {name: expression(float(x)) for name, x in (q or {}).items()}
    return Model("m", None, (), (), tuple(bodies), tuple(loops), initial_q=initial, independent=tuple(independent))


def four_bar(crank=1.0, coupler=2.0, rocker=1.5, base=2.2, q=(1.0, -0.8, -1.2), independent=()) -> Model:
    """A planar four-bar about y, links along x at zero angles. The rocker is carried by the coupler; its foot closes the loop."""
    return model(
        [body("crank", GROUND, "revolute", Y), body("coupler", 0, "revolute", Y, at=(crank, 0, 0)),
         body("rocker", 1, "revolute", Y, at=(coupler, 0, 0))],
        [loop("foot", "revolute", (2, (rocker, 0, 0)), (GROUND, (base, 0, 0)), Y)],
        dict(zip(("crank", "coupler", "rocker"), q, strict=True)), independent,
    )  # fmt: skip


def ladder(n: int, tilt=np.pi / 3, wrong=0.0, order=1) -> Model:
    """n loops: n + 1 rungs of 1 m hinged to the ground a metre apart, n rails of 1 m from tip to tip, all about y."""
    bodies, loops, q = [], [], {}
    for k in range(n + 1):
        bodies.append(body(f"rung{k}", GROUND, "revolute", Y, at=(k, 0, 0)))
        q[f"rung{k}"] = -tilt + wrong * np.sin(3 * k)
        if k < n:
            bodies.append(body(f"rail{k}", 2 * k, "revolute", Y, at=(1, 0, 0)))
            q[f"rail{k}"] = tilt + wrong * np.cos(5 * k)
            loops.append(loop(f"loop{k}", "revolute", (2 * k + 1, (1, 0, 0)), (2 * k + 2, (1, 0, 0)), Y))
    return model(bodies, loops[::order], q)


def pinned(n: int) -> Model:
    """A chain of n links on the ground whose tip is held by the loop; its hinges are about y, x, y, x, ..."""
    bodies = [body(f"link{k}", k - 1, "revolute", X if k % 2 else Y, at=(0, 0, -1) if k else ORIGIN) for k in range(n)]
    tip = loop("tip", "spherical", (n - 1, (0, 0, -1)), (GROUND, (0.5 * n, 0.1, -0.3 * n)))
    return model(bodies, [tip], {f"link{k}": 0.3 * np.sin(k + 1) for k in range(n)})


def bricard() -> Model:
    """Six hinges at the corners of a cube, five rods of 1 m between them: benchmark A04 of the IFToMM collection."""
    points = np.array([(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)])
    axes = [Y, Z, X, Y, Z, X]
    bodies = [
        body(f"rod{i + 1}", i - 1, "revolute", axes[i], at=tuple(points[i] - points[i - 1]) if i else ORIGIN)
        for i in range(5)
    ]
    end = loop("end", "revolute", (4, tuple(points[5] - points[4])), (GROUND, tuple(points[5])), axes[5])
    return model(bodies, [end])


def slider_crank() -> Model:
    """A crank of 0.5 m, a rod of 1.3 m, both about y, and a slide along x; the loop joint is the hinge of rod and slide."""
    bodies = [
        body("crank", GROUND, "revolute", Y),
        body("rod", 0, "revolute", Y, at=(0.5, 0, 0)),
        body("slide", GROUND, "prismatic", X),
    ]
    return model(bodies, [loop("pin", "revolute", (1, (1.3, 0, 0)), (2, ORIGIN), Y)], {"crank": -0.7, "slide": 1.5})


def chain_ladder(n: int, type="revolute") -> Model:
    """A ladder whose rails are one chain: rail k + 1 is a child of rail k, rungs are children of rails, feet close loops."""
    axes = (Y,) if type == "revolute" else (Y, X)
    bodies = [body("rung0", GROUND, type, *axes)]
    loops, q = [], {}
    suffix = "" if type == "revolute" else ".1"
    tilt = np.pi / 3
    q[f"rung0{suffix}"] = -tilt
    for k in range(n):
        bodies.append(body(f"rail{k}", 2 * k - 1 if k else 0, type, *axes, at=(1, 0, 0)))
        bodies.append(body(f"rung{k + 1}", 2 * k + 1, type, *axes, at=(1, 0, 0)))
        q[f"rail{k}{suffix}"] = 0.0 if k else tilt
        q[f"rung{k + 1}{suffix}"] = np.pi - tilt
        loops.append(loop(f"foot{k + 1}", type, (2 * k + 2, (1, 0, 0)), (GROUND, (k + 1, 0, 0)), *axes))
    return model(bodies, loops, q)


def three_rrr(independent=()) -> Model:
    """Planar parallel robot: three legs of two links about z, a triangular platform on the first, two loops to the others."""
    angles = np.pi / 2 + 2 * np.pi / 3 * np.arange(3)
    base = [(1.2 * np.cos(a), 1.2 * np.sin(a), 0) for a in angles]
    corner = [np.array((0.4 * np.cos(a), 0.4 * np.sin(a), 0)) for a in angles]
    bodies, q = [], {}
    for i in range(3):
        bodies.append(body(f"base{i + 1}", GROUND, "revolute", Z, at=base[i]))
        bodies.append(body(f"elbow{i + 1}", 2 * i, "revolute", Z, at=(0.7, 0, 0)))
        q |= {f"base{i + 1}": angles[i] + np.pi + 0.5, f"elbow{i + 1}": -1.0}
    bodies.append(body("platform", 1, "revolute", Z, at=(0.7, 0, 0)))
    q["platform"] = -(q["base1"] + q["elbow1"])
    loops = [
        loop(f"wrist{i + 1}", "revolute", (2 * i + 1, (0.7, 0, 0)), (6, tuple(corner[i] - corner[0])), Z)
        for i in (1, 2)
    ]
    return model(bodies, loops, q, independent)


def stewart(platform="free") -> Model:
    """Six legs, each a universal joint at the base and a slide, with a ball at the platform 1 m above."""
    a = np.repeat(2 * np.pi / 3 * np.arange(3), 2)
    low = [(np.cos(x), np.sin(x), 0) for x in a + np.tile([-0.2, 0.2], 3)]
    high = [(0.6 * np.cos(x), 0.6 * np.sin(x), 0) for x in a + np.tile([-0.7, 0.7], 3)]
    bodies = [body("platform", GROUND, "free")]
    loops = []
    for i in range(6):
        bodies.append(body(f"leg{i}", GROUND, "universal", X, Y, at=low[i]))
        bodies.append(body(f"rod{i}", 1 + 2 * i, "prismatic", Z, at=(0, 0, 1)))
        loops.append(loop(f"ball{i}", "spherical", (2 + 2 * i, ORIGIN), (0, high[i])))
    return model(bodies, loops, {"platform.pz": 1.1, "platform.px": 0.05, "platform.qw": 1.0})


def nested() -> Model:
    """Two loops within one: a four-bar whose coupler and rocker are themselves joined by a two-link chain."""
    bodies = [
        body("crank", GROUND, "revolute", Y),
        body("coupler", 0, "revolute", Y, at=(1, 0, 0)),
        body("rocker", 1, "revolute", Y, at=(2, 0, 0)),
        body("link", 1, "revolute", Y, at=(0.8, 0, 0.3)),
        body("strut", 3, "revolute", Y, at=(0.7, 0, 0)),
    ]
    loops = [
        loop("inner", "revolute", (4, (0.8, 0, 0)), (2, (0.6, 0, 0.2)), Y),
        loop("outer", "revolute", (2, (1.5, 0, 0)), (GROUND, (2.2, 0, 0)), Y),
    ]
    q = {"crank": 1.0, "coupler": -0.8, "rocker": -1.2, "link": -0.5, "strut": 0.9}
    return model(bodies, loops, q)


class RandomMechanism:
    """A random tree with loops that are closed at known coordinates."""

    TREE = ("revolute", "revolute", "revolute", "prismatic", "universal", "spherical", "free")
    LOOPS = ("fixed", "revolute", "prismatic", "universal", "spherical", "cylindrical", "planar")

    def __init__(self, rng: np.random.Generator, n: int, loops: Sequence[str], tree: Sequence[str] = TREE) -> None:
        self.rng = rng
        bodies = []
        for k in range(n):
            type = str(rng.choice(tree))
            axes = {"universal": 2, "spherical": 0, "free": 0}.get(type, 1)
            a = np.linalg.qr(rng.normal(size=(3, 3)))[0].T[:axes]
            parent = int(rng.integers(max(-1, k - 3), k))
            rotation = ((tuple(rng.normal(size=3)), float(rng.uniform(-2, 2))),)
            bodies.append(body(f"b{k}", parent, type, *a, at=rng.uniform(-1, 1, 3), rotation=rotation))  # fmt: skip
        tree_model = model(bodies, [])
        self.q = rng.uniform(-1.5, 1.5, tree_model.nq)
        for b, (place, _) in zip(bodies, tree_model.coordinate_slices, strict=True):
            if b.joint.type in ("spherical", "free"):
                e = rng.normal(size=4)
                self.q[place.stop - 4 : place.stop] = e / np.linalg.norm(e)
        geometry = Geometry(tree_model)
        R, o = body_frames(geometry, padded(self.q))
        self.R, self.o = R[0], o[0]
        made = [self._loop(f"loop{i}", type, n) for i, type in enumerate(loops)]
        initial = dict(zip(tree_model.coordinate_names, self.q, strict=True))
        self.model = model(bodies, made, initial)

    def _loop(self, name: str, type: str, n: int) -> Loop:
        rng = self.rng
        start, end = (int(k) for k in rng.choice(n + 1, 2, replace=False))
        axis, other, _ = np.linalg.qr(rng.normal(size=(3, 3)))[0].T
        at, turn_s = rng.uniform(-1, 1, 3), rng.normal(size=3)
        # what the joint leaves free, in the start face: a turn, then a displacement
        turn, shift = np.zeros(3), np.zeros(3)
        angle, slide, across = rng.uniform(-2, 2), rng.uniform(-1, 1), rng.uniform(-1, 1)
        if type in ("revolute", "cylindrical", "planar"):
            turn = angle * axis
        if type in ("prismatic", "cylindrical"):
            shift = slide * axis
        if type == "planar":
            shift = slide * other + across * np.cross(axis, other)
        if type == "spherical":
            turn = rng.normal(size=3)
        D = rotation_matrix(turn)
        if type == "universal":
            D = rotation_matrix(angle * axis) @ rotation_matrix(slide * other)
        F_s = rotation_matrix(turn_s)
        F_e = self.R[end].T @ self.R[start] @ F_s @ D
        x = self.o[start] + self.R[start] @ (at + F_s @ shift)
        at_e = self.R[end].T @ (x - self.o[end])
        axes = {"fixed": (), "spherical": (), "universal": (axis, other)}.get(type, (axis,))
        bodies = [k if k < n else GROUND for k in (start, end)]
        return loop(
            name, type, (bodies[0], at, axis_angle(F_s)), (bodies[1], at_e, axis_angle(F_e)), *axes,
        )  # fmt: skip


def floats(a: Any) -> tuple[float, ...]:
    return tuple(float(x) for x in a)


def rotation_matrix(v: Any) -> np.ndarray:
    """The rotation matrix of a rotation vector."""
    angle = np.linalg.norm(v)
    if not angle:
        return np.eye(3)
    x, y, z = np.asarray(v) / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def axis_angle(R: np.ndarray) -> tuple:
    """A rotation matrix as axis and angle, in the form that models use."""
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return ((floats(v), float(np.arctan2(np.linalg.norm(v), np.trace(R) - 1))),)


def turned(model_: Model, rotation: tuple) -> Model:
    """The same mechanism in other world axes: a rotated body that is fixed to the ground carries everything on the ground."""
    frame = body("frame", GROUND, "fixed", at=(0.3, -0.2, 0.5), rotation=(rotation,))
    moved = [replace(b, parent=b.parent + 1) for b in model_.bodies]
    loops = [
        replace(x, start=replace(x.start, body=x.start.body + 1), end=replace(x.end, body=x.end.body + 1))
        for x in model_.loops
    ]
    return replace(model_, bodies=(frame, *moved), loops=tuple(loops))


def on_free_body(model_: Model) -> Model:
    """The same mechanism on a free body."""
    result = turned(model_, (X, 0.4))
    return replace(result, bodies=(body("float", GROUND, "free"), *result.bodies[1:]))


def jacobian(model_: Model, q: Any, p: Any = None) -> np.ndarray:
    """Closure matrices of all loops over all speeds, ``(m, nu)``."""
    blocks = []
    for i in range(len(model_.loops)):
        speeds, E = closure_matrix(model_, i, q, p)
        block = np.zeros((len(E), model_.nu))
        block[:, list(speeds)] = E
        blocks.append(block)
    return np.concatenate(blocks)


def rank_of(J: np.ndarray) -> int:
    s = np.linalg.svd(J, compute_uv=False)
    return int(np.sum(s > 1e-8 * s[0]))


def rssr() -> Model:
    """A spatial four-bar: crank and rocker on hinges, coupler and rocker carried by ball joints, the rocker's hinge a loop."""
    return model(
        [body("crank", GROUND, "revolute", Z), body("coupler", 0, "spherical", at=(0.4, 0, 0)),
         body("rocker", 1, "spherical", at=(0, 0, 1.1))],
        [loop("hinge", "revolute", (2, (0, -0.8, 0)), (GROUND, (1.2, 0.5, 0.6)), X)],
        {"crank": 0.6, "coupler.qw": 0.9, "coupler.qy": 0.4},
    )  # fmt: skip


def three_rods(on_platform: bool) -> Model:
    """A free body held by three rods with balls at both ends; the rods hang on the ground or on the body."""
    angles = (0.2, 2.1, 4.4)
    ground = [(np.cos(a), np.sin(a), 0.1 * i) for i, a in enumerate(angles)]
    platform = [(0.5 * np.cos(a), 0.5 * np.sin(a), 0.05 * i) for i, a in enumerate(angles)]
    bodies, loops = [body("float", GROUND, "free")], []
    for i in range(3):
        parent, (carried, closed) = (0, (platform, ground)) if on_platform else (GROUND, (ground, platform))
        bodies.append(body(f"rod{i}", parent, "spherical", at=carried[i]))
        loops.append(loop(f"ball{i}", "spherical", (i + 1, (0, 0, 1.1)), (GROUND if on_platform else 0, closed[i])))
    q = {"float.pz": -0.9 if on_platform else 0.9, "float.px": 0.05, "float.qw": 1.0, "float.qx": 0.1, "float.qz": -0.2}
    return model(bodies, loops, q)
