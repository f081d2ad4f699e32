"""Random tree models, states and seeds for tests at every level: well scaled, but general."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from codegen.model.binding import bind
from codegen.model.expressions import Expression
from codegen.model.joints import JOINTS
from codegen.model.model import (
    GROUND,
    Body,
    Joint,
    JointForce,
    Model,
    Output,
    Parameter,
    Point,
    Vector,
    joint_coordinates,
)
from codegen.model.parsing import parse

ALL = ("fixed", "revolute", "prismatic", "universal", "spherical", "free")
"""Default ingredients of a draw; they do not change, because recorded seeds of older tests depend on them."""
EVERY = tuple(name for name, kind in JOINTS.items() if kind.carries)
SINGLE = ("fixed", "revolute", "prismatic")

Array = np.ndarray


class RandomState(NamedTuple):
    """Arguments of `accelerations` in their order: ``engine.accelerations(*random_state(rng, model))``."""

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: float


def random_tree(
    rng: np.random.Generator,
    n: int,
    joints: tuple[str, ...] = ALL,
    parameters: bool = True,
    forces: bool = True,
) -> Model:
    """A random tree of n bodies.

    Parameters
    ----------
    rng : numpy.random.Generator
    n : int
        Number of bodies, at least 1.
    joints : tuple of str
        Joint types to draw from; a fixed joint is drawn less often.
    parameters : bool
        Design parameters, shared among the bodies, in geometry, mass properties, axes, angles and gravity.
    forces : bool
        Joint forces as expressions of parameters, inputs, t, coordinates and speeds.

    Returns
    -------
    Model
        Chains and branching, exact axes (x, -z) and general ones, rotated joint frames, dense inertias, mass centres off
        the joint, massless bodies in the middle, files that name a child before its parent, gravity or none, and a few
        outputs of every measure.
    """
    return _Maker(rng, joints, parameters, forces).tree(n)


def random_state(rng: np.random.Generator, model: Model) -> RandomState:
    """A state near the default parameters; quaternions of any length between 0.5 and 2."""
    q = rng.uniform(-1.2, 1.2, model.nq)
    for body, (rows, _) in zip(model.bodies, model.coordinate_slices, strict=True):
        for place in body.joint.kind.quaternions:
            e = rng.normal(size=4)
            q[rows][place] = rng.uniform(0.5, 2) * e / np.linalg.norm(e)
    p = np.array([x.value for x in model.parameters]) * rng.uniform(0.95, 1.05, len(model.parameters))
    return RandomState(
        q, rng.uniform(-1, 1, model.nu), p, rng.uniform(-1, 1, len(model.inputs)), float(rng.uniform(0.1, 2))
    )


def random_seeds(rng: np.random.Generator, model: Model, k: int) -> dict[str, Array]:
    """Seeds along k random directions, each of which changes everything: dq, du, dp, dinputs, dt."""
    sizes = {"dq": model.nq, "du": model.nu, "dp": len(model.parameters), "dinputs": len(model.inputs)}
    seeds = {name: rng.uniform(-1, 1, (k, size)) for name, size in sizes.items()}
    return seeds | {"dt": rng.uniform(-1, 1, k)}


def relative_error(x: Array, reference: Array, floor: float = 1e-3) -> float:
    """The largest relative error of any direction, max_i abs(x_i - ref_i) / max_i abs(ref_i).

    Parameters
    ----------
    x, reference : (n,) or (k, n) array
        Directions first; floats or mpf numbers. Differences are taken in the reference's numbers.
    floor : float
        The least denominator: a direction whose reference is zero or rounding is judged absolutely.
    """
    x, reference = np.atleast_2d(x), np.atleast_2d(reference)
    assert x.shape == reference.shape, f"shapes {x.shape} and {reference.shape}"
    if not x.size:
        return 0.0
    differences = np.abs(x - reference).astype(float).max(axis=-1)
    return float((differences / np.maximum(np.abs(reference).astype(float).max(axis=-1), floor)).max())


def expression(text: object) -> Expression:
    """The expression that a model file with this text or number would contain."""
    return bind(parse(f"{text!r}" if isinstance(text, float) else str(text)), {})


def vector(*texts: object) -> Vector:
    x, y, z = texts
    return expression(x), expression(y), expression(z)


class _Maker:
    """A random model under construction."""

    def __init__(self, rng: np.random.Generator, joints: tuple[str, ...], parameters: bool, forces: bool) -> None:
        self.rng, self.joints, self.forces = rng, joints, forces
        count = int(rng.integers(1, 5)) if parameters else 0
        self.parameters = tuple(Parameter(f"p{i}", round(float(rng.uniform(0.6, 1.4)), 3)) for i in range(count))
        self.inputs = tuple(f"motor{i}" for i in range(int(rng.integers(1, 3)))) if forces else ()

    def tree(self, n: int) -> Model:
        rng = self.rng
        chainlike = rng.random() < 0.5
        types = [self._type() for _ in range(n)]
        if set(types) == {"fixed"} and set(self.joints) != {"fixed"}:  # something has to move
            types[-1] = next(j for j in self.joints if j != "fixed")
        parents = [GROUND]
        for k in range(1, n):
            near = chainlike and rng.random() < 0.8
            parents.append(k - 1 if near else int(rng.integers(GROUND, k)))
        massless = self._massless(types, parents)
        axis_follows_massless = {k for k in range(n) if parents[k] in massless}

        # The file's order: usually parents first, sometimes shuffled.
        order = list(rng.permutation(n)) if rng.random() < 0.3 else list(range(n))
        place = {old: new for new, old in enumerate(order)} | {GROUND: GROUND}
        bodies = []
        for k in order:
            joint = self._joint(types[k], general=k in axis_follows_massless)
            bodies.append(self._body(f"b{k}", place[parents[k]], joint, k in massless))
        coordinates = [x for b in bodies for x in joint_coordinates(b.name, b.joint.type)[0]]
        speeds = [x for b in bodies for x in joint_coordinates(b.name, b.joint.type)[1]]
        return Model(
            name="random_tree",
            gravity=self._gravity(n),
            parameters=self.parameters,
            inputs=self.inputs,
            bodies=tuple(bodies),
            forces=self._forces(bodies, coordinates, speeds),
            outputs=self._outputs(bodies, coordinates, speeds),
        )

    # --- parts ----------------------------------------------------------------------------------------------------

    def _type(self) -> str:
        if "fixed" in self.joints and len(self.joints) > 1:
            moving = [j for j in self.joints if j != "fixed"]
            return "fixed" if self.rng.random() < 0.1 else str(self.rng.choice(moving))
        return str(self.rng.choice(self.joints))

    def _massless(self, types: list[str], parents: list[int]) -> set[int]:
        """Massless bodies with which M is still regular: bodies in the middle of the tree with a heavy child."""
        massless: set[int] = set()
        for k, type in enumerate(types):
            children = [c for c, parent in enumerate(parents) if parent == k]
            carried = any(types[c] in SINGLE for c in children) and parents[k] not in massless
            if type in (*SINGLE, "universal") and carried and self.rng.random() < 0.3:
                massless.add(k)
        return massless

    def _joint(self, type: str, general: bool) -> Joint:
        rng = self.rng
        kind = JOINTS[type]
        axes: tuple[Vector, ...] = ()
        if len(kind.axis_keys) == 1:
            axes = (self._axis(general),)
        elif kind.axis_keys:
            axes = self._perpendicular_axes()
        axes = kind.axes_of_motion(axes, {x.name: x.value for x in self.parameters})
        at = vector(*(self._length(x) for x in rng.uniform(-0.8, 0.8, 3)))
        if rng.random() < 0.15:
            at = vector(0, 0, self._length(float(rng.choice([0.5, -1.0]))))
        rotation = tuple(
            (self._axis(False), self._scaled(float(rng.uniform(-2, 2)))) for _ in range(int(rng.choice([0, 0, 1, 2])))
        )
        factors = tuple(self._scaled(float(rng.uniform(-0.5, 0.5))) for _ in kind.factor_keys)
        return Joint(type, axes, at, rotation, factors)

    def _body(self, name: str, parent: int, joint: Joint, massless: bool) -> Body:
        rng = self.rng
        if massless:
            return Body(name, parent, joint, expression(0), vector(0, 0, 0), (expression(0),) * 6)
        # The second moments of the mass about its centre, positive in every direction, give an inertia that a body can have.
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        moments = turn @ np.diag(rng.uniform(0.02, 0.3, 3)) @ turn.T
        inertia = np.trace(moments) * np.eye(3) - moments
        entries = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        # One factor for the six entries keeps the inertia possible for every value of the parameters.
        factor = self._factor()
        central = [expression(f"{float(x)!r}*({factor})" if factor else float(x)) for x in entries]
        mass = self._scaled(float(rng.uniform(0.3, 2)))
        com = vector(*(self._length(x) for x in rng.uniform(-0.5, 0.5, 3)))
        if rng.random() < 0.1:
            com = vector(0, 0, 0)
        xx, yy, zz, xy, xz, yz = central
        return Body(name, parent, joint, mass, com, (xx, yy, zz, xy, xz, yz))

    def _axis(self, general: bool) -> Vector:
        exact = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, 0, -1)]
        if not general and self.rng.random() < 0.6:
            return vector(*exact[int(self.rng.integers(len(exact)))])
        x, y, z = (float(c) for c in self.rng.normal(size=3))
        if self.parameters and self.rng.random() < 0.2:
            return vector(x, f"{y!r} + {self._parameter()}", z)
        return vector(x, y, z)

    def _perpendicular_axes(self) -> tuple[Vector, Vector]:
        if self.rng.random() < 0.5:
            return vector(0, 1, 0), vector(1, 0, 0)
        a, b = np.linalg.qr(self.rng.normal(size=(3, 2)))[0].T
        return vector(*(float(x) for x in a)), vector(*(float(x) for x in 1.7 * b))

    def _gravity(self, n: int) -> Vector | None:
        kind = self.rng.random()
        if kind < 0.15 and n > 2:  # one or two bodies without gravity hardly accelerate: nothing to compare
            return None
        if kind < 0.5 or not self.parameters:
            return vector(0, 0, -9.81)
        return vector("-0.5", f"{self._parameter()}*0.3", f"-9.81*{self._parameter()}")

    def _parameter(self) -> str:
        return self.parameters[int(self.rng.integers(len(self.parameters)))].name

    def _factor(self) -> str:
        """The text of a positive smooth factor of order one that depends on parameters, or an empty text."""
        if not self.parameters or self.rng.random() < 0.4:
            return ""
        a, b = self._parameter(), self._parameter()
        forms = [f"{a}", f"{a}**2", f"sqrt({a})", f"exp({a} - {b})", f"1 + 0.3*sin({a})", f"{a}/{b}", f"{a}**{b}",
                 f"1/(0.5 + {a}*{b})", f"1.2 - cos({a})/3", f"cosh(0.3*{a})", f"1 + atan2({a}, {b})/2"]  # fmt: skip
        return forms[int(self.rng.integers(len(forms)))]

    def _scaled(self, x: float) -> Expression:
        factor = self._factor()
        return expression(f"{x!r}*({factor})" if factor else x)

    def _length(self, x: float) -> str:
        x = float(x)
        if not self.parameters or self.rng.random() < 0.4:
            return repr(x)
        return f"{x!r}*{self._parameter()}" if self.rng.random() < 0.5 else f"{x!r} + 0.2*({self._parameter()} - 1)"

    def _forces(self, bodies: list[Body], coordinates: list[str], speeds: list[str]) -> tuple[JointForce, ...]:
        forces = []
        for k, body in enumerate(bodies):
            n = len(joint_coordinates(body.name, body.joint.type)[1])
            if self.forces and n and self.rng.random() < 0.6:
                values = tuple(expression(self._force(coordinates, speeds)) for _ in range(n))
                forces.append(JointForce(f"f{k}", k, values))
        return tuple(forces)

    def _force(self, coordinates: list[str], speeds: list[str]) -> str:
        rng = self.rng
        q, u = f"q.{rng.choice(coordinates)}", f"u.{rng.choice(speeds)}"
        motor = str(rng.choice(self.inputs))
        c = round(float(rng.uniform(-2, 2)), 3)
        p = self._parameter() if self.parameters else "0.7"
        forms = [f"{motor}", f"{c}*{q} - 0.2*{u}", f"{motor}*sin(3*t) - {p}*{u}", f"-{p}*{q}**3", f"{c}*tanh({u}/{p})",
                 f"{motor}*cos({q}) + {c}*{u}*abs({u})", f"{c}*atan2({q}, {p})", f"{p}*exp(-{q}**2)*{motor}",
                 f"max({q}, {p}) - min({u}, {c})", f"log(2 + {q}**2)*{c}", f"sign({u})*{c}*t", f"{c}*sqrt(1 + {u}**2)",
                 f"asin({q}/3) + acos({u}/4)*{p} - atan({motor})", f"sinh({q}/2) - tan({u}/3)", "0"]  # fmt: skip
        return forms[int(rng.integers(len(forms)))]

    def _outputs(self, bodies: list[Body], coordinates: list[str], speeds: list[str]) -> tuple[Output, ...]:
        tip = Point("tip", len(bodies) - 1, vector(self._length(0.3), self._length(-0.2), self._length(0.7)))
        outputs = [
            Output("height", "position", (tip,), vector(0, 0, 1)),
            Output("speed", "velocity", (tip,), self._axis(True)),
            Output("kinetic", "kinetic_energy"),
            Output("potential", "potential_energy"),
        ]
        if coordinates:
            motor = f" + {self.inputs[0]}*t" if self.inputs else ""
            text = f"q.{coordinates[-1]}*u.{speeds[0]}{motor}"
            outputs.append(Output("value", "value", expression=expression(text)))
        return tuple(outputs)
