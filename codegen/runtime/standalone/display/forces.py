"""Forces that arrows show: reactions, and forces of force elements, computed from their laws in `model.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..calls.formulas import value_of
from .poses import Arrows, Poses
from .scene import GROUND, Scene

KINDS = {"reactions": "#d55e00", "forces": "#009e73", "torques": "#aa4499"}
"""Colours of arrows: reactions of joints and loops, N; forces of force elements, N; their torques, N m."""


def arrows_of(found: Sequence[tuple[Array, Array]], poses: Poses) -> Arrows:
    """Arrows from several pairs of places and vectors, both (nt, 3) or (nt, n, 3)."""
    shape = (len(poses.t), -1, 3)
    places, vectors = (np.concatenate([x[k].reshape(shape) for x in found], axis=1) for k in (0, 1))
    finite = np.isfinite(places).all(axis=-1) & np.isfinite(vectors).all(axis=-1)
    return Arrows(np.where(finite[..., None], places, 0.0), np.where(finite[..., None], vectors, 0.0))


def applied_kinds(display: Mapping[str, Any]) -> list[str]:
    """Kinds of arrows of the force elements in an entry ``display`` of `model.json`."""
    elements, joints = display["elements"], display.get("joint_forces", ())
    types = [x["type"] if "components" in x else "force" for x in elements if "components" in x or "force" in x]
    slides = [display["bodies"][x["body"]]["joint"]["type"] == "prismatic" for x in joints]
    return ["forces"] * ("force" in types or any(slides)) + ["torques"] * ("torque" in types or not all(slides))


class AppliedForces:
    """The forces of the force elements of a model during a motion.

    Parameters
    ----------
    manifest : mapping
        Content of `model.json`, with the entry ``display``.
    p, inputs : ndarray (np,), (nt, ninputs) or (ninputs,)
    q, u : ndarray (nt, nq), (nt, nu)
    poses : Poses
        Poses with twists at the same times.
    """

    def __init__(
        self, manifest: Mapping[str, Any], scene: Scene, p: Array, inputs: Array, q: Array, u: Array, poses: Poses
    ):
        self.given, self.scene, self.poses = manifest["display"], scene, poses
        self.known: dict[str, Any] = {"t": poses.t}
        every = (
            ("parameter_names", p, ""),
            ("input_names", inputs, ""),
            ("coordinate_names", q, "q."),
            ("speed_names", u, "u."),
        )
        for names, values, prefix in every:
            self.known |= {f"{prefix}{name}": values[..., i] for i, name in enumerate(manifest[names])}
        for name, pair in self.given.get("prescribed", {}).items():
            self.known |= {f"{prefix}.{name}": value_of(x, self.known) for prefix, x in zip("qu", pair, strict=True)}
        places = [(mark.name, mark.body, mark.at) for mark in scene.points]
        places += [(name, k, np.zeros(3)) for k, name in enumerate(scene.names)]
        for name, body, at in places:
            x, v = self._point(body, at)
            for i, c in enumerate("xyz"):
                self.known |= {f"position.{name}.{c}": x[:, i], f"velocity.{name}.{c}": v[:, i]}

    def found(self) -> dict[str, Arrows]:
        """Arrows of forces and of torques, of the kinds that the model has."""
        forces: list[tuple[Array, Array]] = []
        torques: list[tuple[Array, Array]] = []
        ends = iter(self.scene.ends)
        for element in self.given["elements"]:
            at = next(ends)
            if "force" in element:
                forces += self._along(element, at)
            elif "components" in element:
                (forces if element["type"] == "force" else torques).append(self._on_body(element, at[0]))
        for joint in self.given.get("joint_forces", ()):
            axis = self.scene.axes[joint["body"]]
            along = self.poses.turns(axis.body) @ axis.direction
            value = self._number(joint["value"])[:, None] * along
            (forces if axis.type == "prismatic" else torques).append(
                (self._point(joint["body"], np.zeros(3))[0], value)
            )
        both = {"forces": forces, "torques": torques}
        return {kind: arrows_of(x, self.poses) for kind, x in both.items() if x}

    def _along(self, element: Mapping[str, Any], ends: Sequence[tuple[int, Array]]) -> list[tuple[Array, Array]]:
        """The forces of an element on both of its ends; those on the ground are left out."""
        (start, start_speed), (end, end_speed) = (self._point(*x) for x in ends)
        line = end - start
        length = np.linalg.norm(line, axis=1)
        with np.errstate(all="ignore"):
            along = line / length[:, None]
            rate = np.einsum("ij,ij->i", along, end_speed - start_speed)
            measures = {"distance": length, "rate": rate}
            coefficients = {key: value_of(x, self.known) for key, x in element["coefficients"].items()}
            push = along * np.reshape(value_of(element["force"], measures | coefficients), (-1, 1))
        both = ((ends[0][0], start, -push), (ends[1][0], end, push))
        return [(at, f) for body, at, f in both if body != GROUND]

    def _on_body(self, element: Mapping[str, Any], end: tuple[int, Array]) -> tuple[Array, Array]:
        vector = np.stack([self._number(x) for x in element["components"]], axis=1)
        if element["axes"] == "body":
            vector = np.einsum("tij,tj->ti", self.poses.turns(end[0]), vector)
        return self._point(*end)[0], vector

    def _number(self, x: Any) -> Array:
        """The value of an expression at all times, (nt,)."""
        return np.broadcast_to(value_of(x, self.known), self.poses.t.shape)

    def _point(self, body: int, at: Array) -> tuple[Array, Array]:
        """Positions, m, and velocities, m/s, of a point of a body at all times, (nt, 3)."""
        poses = self.poses
        if body == GROUND:
            return np.tile(at, (len(poses.t), 1)), np.zeros((len(poses.t), 3))
        arm = poses.rotation[:, body] @ at
        assert poses.twist is not None
        twist = poses.twist[:, body]
        return poses.position[:, body] + arm, twist[:, 3:] + np.cross(twist[:, :3], arm)
