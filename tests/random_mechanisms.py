"""Random mechanisms with closed loops in an assembled state, for tests at every level."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from itertools import combinations, product
from typing import Any, ClassVar, NamedTuple

import numpy as np
from random_models import _Maker, expression, random_state, vector

from codegen.loops.partition import Ear, Partition
from codegen.model.conditions import CONDITIONS
from codegen.model.expressions import Expression
from codegen.model.forces import Spring
from codegen.model.model import (
    CLOSURE_ROWS,
    GROUND,
    Face,
    Joint,
    Loop,
    Model,
    Parameter,
    Point,
    Vector,
    joint_coordinates,
)
from codegen.reference import DenseEngine
from codegen.reference.conditions import conditions
from codegen.reference.ground_frame import placement
from codegen.reference.pairs import Pair

Array = np.ndarray

LOOP_JOINTS = tuple(type for type in CLOSURE_ROWS if type not in CONDITIONS)
DRAWN = tuple(type for type in LOOP_JOINTS if type != "inline")
"""Default ingredients of a draw; they do not change, because recorded seeds of older tests depend on them."""
SCENES = ("spatial", "planar", "spherical")
TREE_JOINTS = ("fixed", "revolute", "prismatic", "universal", "spherical", "free")

RANK_LOST = 1e-9
"""A singular value below this part of the largest counts as zero."""


FAIR = 1e-5
"""The least singular value of a closure matrix whose speeds may be dependent."""


class Mechanism(NamedTuple):
    """A model and an assembled state: ``engine.accelerations(*mechanism[1:])``.

    The parameters are the model's defaults, and its initial values are q and u.
    The speeds close the loops too, and none is above 1, whichever are taken for dependent.
    """

    model: Model
    q: Array
    u: Array
    p: Array
    inputs: Array
    t: float


@dataclasses.dataclass(frozen=True)
class Discarded:
    """A draw that gave no mechanism, with the reason."""

    reason: str


def random_mechanism(
    rng: np.random.Generator,
    scene: str | None = None,
    bodies: tuple[int, int] = (3, 8),
    loops: tuple[int, int] = (1, 3),
    loop_joints: tuple[str, ...] = DRAWN,
    joints: tuple[str, ...] = TREE_JOINTS,
    parameters: bool = True,
    forces: bool = True,
    springs: bool = True,
) -> Mechanism | Discarded:
    """A random mechanism.

    Parameters
    ----------
    rng : numpy.random.Generator
    scene : {"spatial", "planar", "spherical"}, optional
        ``spatial``: loops between any two bodies of a random tree (branches, nested, neighbouring), closures of full rank.
        ``planar``: the same in a plane of any orientation, on the ground, a fixed or a free base; closures redundant.
        ``spherical``: all axes through one point, which also makes closures redundant. Left out: drawn, half are spatial.
    bodies, loops : tuple of int
        Least and largest number; a base, or bodies that bring the freedoms for a loop, may come on top.
    loop_joints, joints : tuple of str
        Types to draw from.
    parameters, forces, springs : bool
        Whether to have them.
    """
    if scene is None:
        scene = str(rng.choice(SCENES, p=(0.5, 0.35, 0.15)))
    maker = {"spatial": _Spatial, "planar": _Planar, "spherical": _Spherical}[scene](
        rng, joints, loop_joints, parameters, forces, springs
    )
    return maker.mechanism(int(rng.integers(*bodies, endpoint=True)), int(rng.integers(*loops, endpoint=True)))


def random_mechanisms(count: int, first: int = 0, **options: Any) -> Iterator[tuple[int, Mechanism]]:
    """Yields `count` pairs of a seed and its mechanism; seeds without a mechanism are skipped."""
    seed = first
    while count:
        drawn = random_mechanism(np.random.default_rng(seed), **options)
        if isinstance(drawn, Mechanism):
            yield seed, drawn
            count -= 1
        seed += 1


class PartitionMissing(ValueError):
    """Raised if no set of dependent speeds is well conditioned."""


class _Smooth(_Maker):
    """Without forces that jump: a joint that closure locks has a speed of rounding, whose sign is noise."""

    def _force(self, coordinates: list[str], speeds: list[str]) -> str:
        return next(f for f in iter(lambda: super(_Smooth, self)._force(coordinates, speeds), "") if "sign" not in f)


class _Scene:
    """A random mechanism under construction: a tree, its poses, and faces on it."""

    ranks: ClassVar[dict[str, int]]
    """Number of independent conditions of the loop joints of this scene."""

    def __init__(
        self,
        rng: np.random.Generator,
        joints: tuple[str, ...],
        loop_joints: tuple[str, ...],
        parameters: bool,
        forces: bool,
        springs: bool,
    ) -> None:
        self.rng, self.joints, self.loop_joints, self.springs = rng, joints, loop_joints, springs
        self.maker = _Smooth(rng, joints, parameters, forces)
        self.parameters: tuple[Parameter, ...] = self.maker.parameters

    def mechanism(self, n: int, loops: int) -> Mechanism | Discarded:
        model = self.tree(n)
        q, u, _, inputs, t = random_state(self.rng, model)
        p = np.array([x.value for x in model.parameters])
        poses = Poses(model, q, p)
        for i in range(loops):
            with_loop = self._with_loop(model, poses, f"loop{i}")
            if with_loop is None and i == 0:
                return Discarded("no loop found that leaves a freedom and has independent conditions")
            model = with_loop or model
        u = _closed_speeds(poses.jacobian(model.loops), u)
        model = dataclasses.replace(
            model,
            name="random_mechanism",
            loads=self._springs(model) if self.springs else (),
            initial_q=dict(zip(model.coordinate_names, map(expression, q.tolist()), strict=True)),
            initial_u=dict(zip(model.speed_names, map(expression, u.tolist()), strict=True)),
        )
        return Mechanism(model, q, u, p, inputs, t)

    def tree(self, n: int) -> Model:
        raise NotImplementedError

    # --- loops ----------------------------------------------------------------------------------------------------

    def _with_loop(self, model: Model, poses: Poses, name: str) -> Model | None:
        """The model with one more loop; None if forty draws give none, or if the scene has none of the requested joints."""
        before = poses.jacobian(model.loops)
        types = [j for j in self.loop_joints if j in self.ranks]
        for _ in range(40 if types else 0):
            start, end = (self.standing(int(x)) for x in self.rng.integers(GROUND, len(model.bodies), 2))
            type = str(self.rng.choice(types))
            path = loop_speeds(model, start, end)
            if start == end or self.ranks[type] > len(path):
                continue
            loop = self.loop(poses, name, type, start, end)
            J = np.concatenate([before, poses.jacobian((loop,))])
            if _rank(J) == model.nu or _rank(J) - _rank(before) < self.ranks[type]:
                continue
            return dataclasses.replace(model, loops=(*model.loops, loop))
        return None

    def standing(self, body: int) -> int:
        """The body itself, or another body that carries loops in its place."""
        return body

    def loop(self, poses: Poses, name: str, type: str, start: int, end: int) -> Loop:
        """A loop joint between two bodies, with the end face at the pose at which the loop is closed."""
        axes, rotation, at, between, shift = self.joint(type)
        pairs, s, e = poses.pairs, poses.frames[start], poses.frames[end]
        R_s = s.R.value @ placement(pairs, rotation).value
        x_s = s.point(pairs.vector(at))[0].value[0]
        R_e = R_s @ placement(pairs, between).value
        x_e = x_s + R_s @ shift
        place = e.R.value.T @ (x_e - e.o.value[0])
        return Loop(name, type, axes, Face(start, at, rotation), Face(end, *self.placed(place, e.R.value.T @ R_e)))

    def joint(self, type: str) -> tuple[tuple[Vector, ...], Any, Vector, Any, Array]:
        """Axes of a loop joint, rotation and origin of its start face, and the end face relative to the start face."""
        raise NotImplementedError

    def placed(self, at: Array, R: Array) -> tuple[Vector, tuple[tuple[Vector, Expression], ...]]:
        """Origin and rotation of a face as expressions that have these values at the drawn parameters."""
        axis, angle = _axis_angle(R)
        return vector(*(self._held(x) for x in at)), ((vector(*map(float, axis)), expression(self._held(angle))),)

    def _held(self, x: float) -> str:
        """An expression whose value at the drawn parameters is x."""
        x = float(x)
        if not self.parameters or self.rng.random() < 0.3:
            return repr(x)
        p = self.parameters[int(self.rng.integers(len(self.parameters)))]
        return f"{x!r}*(1 + {round(float(self.rng.uniform(0.1, 0.4)), 2)}*({p.name} - {p.value!r}))"

    def _springs(self, model: Model) -> tuple[Spring, ...]:
        rng, springs = self.rng, []
        for i in range(int(rng.integers(0, 3))):
            start, end = (int(x) for x in rng.choice(np.arange(GROUND, len(model.bodies)), 2, replace=False))
            points = [Point("", body, self.point()) for body in (start, end)]
            numbers = [
                self.maker._scaled(float(x)) for x in (rng.uniform(1, 20), rng.uniform(0, 2), rng.uniform(0.2, 1))
            ]
            springs.append(Spring(f"spring{i}", *points, *numbers))
        return tuple(springs)

    def point(self) -> Vector:
        return vector(*(self.maker._length(x) for x in self.rng.uniform(-0.7, 0.7, 3)))


class _Spatial(_Scene):
    """A tree with any joints and any loop joints; the conditions of all loops are independent."""

    ranks: ClassVar[dict[str, int]] = {type: sum(rows) for type, rows in CLOSURE_ROWS.items()}

    def tree(self, n: int) -> Model:
        """A tree of at least n bodies; with fewer than five degrees of freedom, loops would hardly leave any."""
        return next(tree for tree in map(self.maker.tree, range(n, n + 20)) if tree.nu > 4)

    def joint(self, type: str) -> tuple[tuple[Vector, ...], Any, Vector, Any, Array]:
        rng, angle = self.rng, lambda: expression(float(self.rng.uniform(-2, 2)))
        rotation = tuple((self.maker._axis(False), self.maker._scaled(float(rng.uniform(-2, 2)))) for _ in range(2))
        at, shift = self.point(), np.zeros(3)
        if type == "universal":
            first, second = self.maker._perpendicular_axes()
            return (first, second), rotation, at, ((first, angle()), (second, angle())), shift
        if type in ("fixed", "spherical"):
            between = ((self.maker._axis(True), angle()),) if type == "spherical" else ()
            return (), rotation, at, between, shift
        axis = self._constant_axis()
        a = np.array([float(x.evaluate({})) for x in axis])
        a /= np.linalg.norm(a)
        if type == "planar":
            shift = rng.uniform(-0.5, 0.5, 3)
            shift -= a * (a @ shift)
        elif type != "revolute":
            shift = a * rng.uniform(-0.5, 0.5)
        return (axis,), rotation, at, () if type == "prismatic" else ((axis, angle()),), shift

    def _constant_axis(self) -> Vector:
        """An axis without parameters."""
        return next(axis for axis in iter(lambda: self.maker._axis(False), None) if all(x.is_number for x in axis))


class _Planar(_Scene):
    """A planar mechanism: joints move along x and y of a base in any pose in space. Offsets along z cancel exactly."""

    ranks: ClassVar[dict[str, int]] = {
        "fixed": 3,
        "revolute": 2,
        "prismatic": 2,
        "universal": 2,
        "spherical": 2,
        "cylindrical": 2,
        "inline": 2,
    }

    def tree(self, n: int) -> Model:
        rng, maker = self.rng, self.maker
        base = str(rng.choice(["ground", "fixed", "free"], p=(0.2, 0.5, 0.3)))
        bodies, self.level = [], {GROUND: 0.0}
        self.in_plane = [GROUND] if base == "ground" else [0]
        if base != "ground":
            turns = tuple((maker._axis(False), maker._scaled(float(rng.uniform(-2, 2)))) for _ in range(2))
            joint = Joint(base, (), vector(0.3, -0.2, maker._length(0.4)), turns)
            bodies.append(maker._body("base", GROUND, joint, False))
            self.level[0] = 0.0
        for i in range(max(n, 3)):
            k = len(bodies)
            chain = rng.random() < 0.6 and len(self.in_plane) > 1
            parent = self.in_plane[-1] if chain else int(rng.choice(self.in_plane))
            type = str(rng.choice(["revolute", "prismatic"], p=(0.8, 0.2)))
            z = float(rng.integers(-2, 3)) / 8
            angle = float(rng.uniform(-3, 3))
            axis = (
                vector(0, 0, int(rng.choice([-1, 1])))
                if type == "revolute"
                else vector(float(np.cos(angle)), float(np.sin(angle)), 0)
            )
            joint = Joint(type, (axis,), vector(*map(maker._length, rng.uniform(-0.8, 0.8, 2)), z), self._turn())
            bodies.append(maker._body(f"b{i}", parent, joint, False))
            self.level[k] = self.level[parent] + z
            self.in_plane.append(k)
        coordinates, speeds = ([x for b in bodies for x in joint_coordinates(b.name, b.joint.type)[i]] for i in (0, 1))
        return Model(
            "planar", maker._gravity(n), maker.parameters, maker.inputs, tuple(bodies),
            forces=maker._forces(bodies, coordinates, speeds), outputs=maker._outputs(bodies, coordinates, speeds),
        )  # fmt: skip

    def _turn(self) -> tuple[tuple[Vector, Expression], ...]:
        return ((vector(0, 0, 1), self.maker._scaled(float(self.rng.uniform(-2, 2)))),) * int(self.rng.integers(0, 2))

    def joint(self, type: str) -> tuple[tuple[Vector, ...], Any, Vector, Any, Array]:
        rng = self.rng
        turned = ((vector(0, 0, 1), expression(float(rng.uniform(-2, 2)))),)
        at = vector(*map(self.maker._length, rng.uniform(-0.7, 0.7, 2)), float(rng.integers(-2, 3)) / 8)
        axes: tuple[Vector, ...] = (vector(0, 0, 1),)
        shift, between = np.zeros(3), turned
        if type == "prismatic":
            angle = float(rng.uniform(-3, 3))
            a = np.array([np.cos(angle), np.sin(angle), 0])
            axes, between, shift = (vector(*map(float, a)),), (), a * rng.uniform(-0.5, 0.5)
        elif type == "universal":
            axes = (vector(0, 0, 1), vector(1, 0, 0))
        elif type in ("cylindrical", "inline"):
            shift = np.array([0, 0, 0.25])
        elif type in ("fixed", "spherical"):
            axes, between = (), between if type == "spherical" else ()
        return axes, self._turn(), at, between, shift

    def standing(self, body: int) -> int:
        return body if body in self.in_plane else self.in_plane[0]

    def loop(self, poses: Poses, name: str, type: str, start: int, end: int) -> Loop:
        loop = super().loop(poses, name, type, start, end)
        # Offsets along z are sums of eighths: exact, in any arithmetic.
        apart = 0.25 if type in ("cylindrical", "inline") else 0
        z = self.level[start] + loop.start.at[2].evaluate({}) - self.level[end] + apart
        at = (*loop.end.at[:2], expression(z))
        return dataclasses.replace(loop, end=dataclasses.replace(loop.end, at=at))

    def placed(self, at: Array, R: Array) -> tuple[Vector, tuple[tuple[Vector, Expression], ...]]:
        angle = self._held(float(np.arctan2(R[1, 0], R[0, 0])))
        return vector(*map(self._held, at[:2]), 0), ((vector(0, 0, 1), expression(angle)),)

    def point(self) -> Vector:
        return vector(*(self.maker._length(x) for x in self.rng.uniform(-0.7, 0.7, 3)))


class _Spherical(_Scene):
    """Revolute and universal joints whose axes all pass through the origin of a base in any pose."""

    ranks: ClassVar[dict[str, int]] = {"fixed": 3, "revolute": 2, "universal": 1, "cylindrical": 2}

    def tree(self, n: int) -> Model:
        rng, maker = self.rng, self.maker
        base = str(rng.choice(["fixed", "free", "revolute"]))
        joint = Joint(base, (maker._axis(False),) if base == "revolute" else (), vector(0.3, maker._length(-0.2), 0.4))
        bodies = [maker._body("base", GROUND, joint, False)]
        for k in range(1, max(n, 4) + 1):
            parent = k - 1 if rng.random() < 0.7 else int(rng.integers(0, k))
            universal = rng.random() < 0.2
            axes = maker._perpendicular_axes() if universal else (maker._axis(True),)
            turns = ((maker._axis(False), maker._scaled(float(rng.uniform(-2, 2)))),)
            joint = Joint("universal" if universal else "revolute", axes, vector(0, 0, 0), turns)
            bodies.append(maker._body(f"b{k}", parent, joint, False))
        coordinates, speeds = ([x for b in bodies for x in joint_coordinates(b.name, b.joint.type)[i]] for i in (0, 1))
        return Model(
            "spherical", maker._gravity(n), maker.parameters, maker.inputs, tuple(bodies),
            forces=maker._forces(bodies, coordinates, speeds), outputs=maker._outputs(bodies, coordinates, speeds),
        )  # fmt: skip

    def joint(self, type: str) -> tuple[tuple[Vector, ...], Any, Vector, Any, Array]:
        axes, rotation, _, between, _ = _Spatial.joint(self, "revolute" if type == "cylindrical" else type)  # type: ignore[arg-type]
        return axes, rotation, vector(0, 0, 0), between, np.zeros(3)

    _constant_axis = _Spatial._constant_axis

    def standing(self, body: int) -> int:
        return max(body, 0)

    def placed(self, at: Array, R: Array) -> tuple[Vector, tuple[tuple[Vector, Expression], ...]]:
        return vector(0, 0, 0), super().placed(at, R)[1]


# --- what a mechanism is made with, and what tests want to know about it ---------------------------------------------


class Poses:
    """Poses of the bodies of a tree at given coordinates and parameters, without its loops."""

    def __init__(self, model: Model, q: Array, p: Array) -> None:
        self.defaults = model.defaults
        tree = dataclasses.replace(model, loops=())
        engine = DenseEngine(tree)
        state = engine._arguments(q, None, p, None, 0.0)
        self.q, self.pairs, self.u = q, state.pairs, state.u
        self.coordinates, self.slices = state.q, tree.coordinate_slices
        self.frames, self.freedoms = engine._motion(state)

    def jacobian(self, loops: tuple[Loop, ...], lengths: tuple[float, ...] | None = None) -> Array:
        """Derivatives (m, nu) of the loop conditions with respect to all speeds; linear ones are divided by the lengths."""
        if not loops:
            return np.zeros((0, len(self.u.value)))
        lengths = lengths or (1.0,) * len(loops)
        at = self.pairs, loops, lengths, self.frames, self.freedoms, self.coordinates, self.u, self.slices
        return conditions(*at, self.defaults).jacobian.value


def loop_bodies(model: Model, start: int, end: int) -> tuple[list[int], list[int]]:
    """Bodies whose joints lie between two bodies: on the start's side and on the end's side, outermost first."""
    sides = []
    for k in (start, end):
        branch = []
        while k != GROUND:
            branch.append(k)
            k = model.bodies[k].parent
        sides.append(branch)
    shared = set(sides[0]) & set(sides[1])
    return [k for k in sides[0] if k not in shared], [k for k in sides[1] if k not in shared]


def loop_speeds(model: Model, start: int, end: int) -> list[int]:
    """Indices of the speeds between two bodies, ascending."""
    bodies = [k for side in loop_bodies(model, start, end) for k in side]
    return sorted(i for k in bodies for i in range(*model.coordinate_slices[k][1].indices(model.nu)))


def random_partition(rng: np.random.Generator, model: Model, q: Array, p: Array) -> Partition:
    """A well-conditioned partition, but not the best one: random order of ears, and random dependents among acceptable ones."""
    J, n = Poses(model, q, p).jacobian(model.loops), len(model.loops)
    orders = [[(int(i),) for i in rng.permutation(n)] for _ in range(6)] + [[tuple(range(n))]]
    for waiting in orders:
        try:
            return _partition(rng, model, q, J, waiting)
        except PartitionMissing as error:
            missing = error
    raise missing


def _partition(rng: np.random.Generator, model: Model, q: Array, J: Array, waiting: list[tuple[int, ...]]) -> Partition:
    ends = np.cumsum([0, *(sum(CLOSURE_ROWS[x.type]) for x in model.loops)])
    rows = {i: list(range(ends[i], ends[i + 1])) for i in range(len(model.loops))}
    paths = {i: set(loop_speeds(model, x.start.body, x.end.body)) for i, x in enumerate(model.loops)}
    ears: list[Ear] = []

    def over(loops: Any) -> tuple[list[int], set[int]]:
        return [r for i in loops for r in rows[i]], set().union(*(paths[i] for i in loops))

    while waiting:
        loops = waiting.pop(0)
        closed_rows, closed = over([i for ear in ears for i in ear.loops])
        own_rows, path = over(loops)
        wanted = _rank(J[closed_rows + own_rows]) - _rank(J[closed_rows])
        dependent = _pick(rng, model, J[own_rows], sorted(path - closed), wanted)
        if dependent is None:  # open: close it together with those that share speeds with it
            taken: list[Ear] = []
            for ear in ears:
                if over(ear.loops)[1] & (path | set().union(*(over(x.loops)[1] for x in taken))):
                    taken.append(ear)
            if not taken:
                raise PartitionMissing(f"loops {loops}: {wanted} dependents among {sorted(path - closed)}")
            ears = [x for x in ears if x not in taken]
            waiting.insert(0, tuple(sorted({*loops, *(i for x in taken for i in x.loops)})))
            continue
        condition = float(np.linalg.cond(J[np.ix_(own_rows, dependent)])) if dependent else 1.0
        ears.append(Ear(tuple(sorted(loops)), tuple(dependent), len(own_rows), wanted, condition, 1.0))
    chosen = {i for ear in ears for i in ear.dependent}
    return Partition(tuple(ears), tuple(i for i in range(model.nu) if i not in chosen), tuple(map(float, q)))


def assemble(engine: DenseEngine, q: Any, p: Any, steps: int = 60) -> Any:
    """q with its dependent entries moved until the loops close as well as the engine's numbers allow, (nq,).

    Raises
    ------
    ArithmeticError
        Newton's method does not arrive.
    """
    q = engine.arithmetic.array(q)
    best, least = q, np.inf
    for _ in range(steps):
        state = engine._arguments(q, None, p, None, 0.0)
        known = engine._conditions(state)
        kept = engine._subset(known.jacobian.value)
        residual = known.position.value[kept]
        size = abs(residual).max(initial=0)
        if size >= least and size < 1e4 * engine.arithmetic.epsilon:
            return best
        if size < least:
            best, least = q, size
        xi = engine.arithmetic.zeros(engine.model.nu, 1)
        xi[engine.dependent] = engine.arithmetic.solve(known.jacobian.value[kept][:, engine.dependent], -residual)
        rates = engine._coordinate_rates(state.moved(engine.model, state.q, Pair(xi, state.u.tangent)))
        q = q + rates.value[:, 0]
    raise ArithmeticError(f"residual {least} after {steps} steps")


def condition(partition: Partition, model: Model, q: Array, p: Array) -> float:
    """The condition number of the closure matrix of all dependent speeds at a state."""
    lengths = {i: ear.length for ear in partition.ears for i in ear.loops}
    J = Poses(model, q, p).jacobian(model.loops, tuple(lengths[i] for i in range(len(model.loops))))
    dependent = sorted(i for ear in partition.ears for i in ear.dependent)
    return float(np.linalg.cond(J[:, dependent])) if dependent else 1.0


def _pick(rng: np.random.Generator, model: Model, J: Array, available: list[int], wanted: int) -> list[int] | None:
    """`wanted` speeds with independent columns in J: single speeds, or if necessary all speeds of a joint; None without any."""
    if not wanted:
        return []
    units = [u for u in _units(model) if set(u) <= set(available)]
    return _pick_of(rng, units, J, wanted) or _pick_of(rng, [(i,) for i in available], J, wanted)


def _pick_of(rng: np.random.Generator, units: list[tuple[int, ...]], J: Array, wanted: int) -> list[int] | None:
    whole = [u for u in units if len(u) > 1]
    found = []
    for n in range(len(whole) + 1):
        for joints, least in product(combinations(whole, n), (0.4, 1.0)):
            chosen = [speed for unit in joints for speed in unit]
            singles = [u[0] for u in units if len(u) == 1]
            while len(chosen) < wanted and singles:  # pivots fill up, not always the largest
                Q = np.linalg.qr(J[:, chosen])[0]
                left = np.linalg.norm(J[:, singles] - Q @ (Q.T @ J[:, singles]), axis=0)
                chosen.append(singles.pop(int(np.argmax(left * rng.uniform(least, 1, len(left))))))
            if len(chosen) == wanted and (sigma := np.linalg.svd(J[:, chosen], compute_uv=False))[-1] > FAIR:
                found.append((float(sigma[0] / sigma[-1]), sorted(chosen)))
    if not found:
        return None
    good = [chosen for condition, chosen in found if condition < 4 * min(found)[0]]
    return good[int(rng.integers(len(good)))]


def _units(model: Model) -> list[tuple[int, ...]]:
    """Groups of speeds that are dependent together."""
    units: list[tuple[int, ...]] = []
    for body, (_, u) in zip(model.bodies, model.coordinate_slices, strict=True):
        speeds = tuple(range(u.start, u.stop))
        units += [speeds] if body.joint.type in ("spherical", "free") else [(i,) for i in speeds]
    return units


def _rank(A: Array) -> int:
    if not A.size:
        return 0
    sigma = np.linalg.svd(A, compute_uv=False)
    return int(np.sum(sigma > RANK_LOST * max(1.0, sigma[0])))


def _closed_speeds(J: Array, u: Array) -> Array:
    """The part of the speeds u that satisfies the loop conditions J u = 0, scaled so that no speed exceeds 1."""
    V = np.linalg.svd(J)[2][: _rank(J)]
    u = u - V.T @ (V @ u)
    u = u - V.T @ (V @ u)
    return u / max(1.0, np.abs(u).max())


def _axis_angle(R: Array) -> tuple[Array, float]:
    """Axis and angle of a rotation matrix, by the largest component of its quaternion."""
    K = np.array([
        [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
        [0, R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
        [0, 0, R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1]],
        [0, 0, 0, R[2, 2] - R[0, 0] - R[1, 1]],
    ])  # fmt: skip
    e = np.linalg.eigh(K + np.triu(K, 1).T)[1][:, -1]
    length = np.linalg.norm(e[1:])
    if length < 1e-8:
        return np.array([0.0, 0.0, 1.0]), 0.0
    return e[1:] / length, float(2 * np.arctan2(length, e[0]))
