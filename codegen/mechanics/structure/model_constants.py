"""The constants of a model: of its links, of the faces of its loops, and gravity. Equal ones are found once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ...model.expressions import Expression
from ...program.block import Expansion
from ...program.functions import SYMBOLIC
from ...program.scalar import Value
from ...program.shape import Constants, Shape
from .constants import Leaf, Slots, Statements
from .folded import make_constants
from .links import NUMERIC, Link, LoopFaces, NumberOf, face_constants, form_of_steps, keep, link_constants


class ModelConstants:
    """Constants as they are found, each once.

    Attributes
    ----------
    shapes : dict of object to Shape
        By form.
    found : list of Constants
    """

    def __init__(self, evaluate: NumberOf):
        self.evaluate = evaluate
        self.shapes: dict[object, Shape] = {}
        self.found: list[Constants] = []
        self._by_key: dict[object, Constants] = {}

    def of_link(self, link: Link) -> Constants:
        """Of a link."""
        key = link.key()
        found = self._by_key.get(key)
        if found is None:
            structure = (
                link.parent_frame.form(), link.frame.form(), form_of_steps(link.steps),
                tuple(form_of_steps(steps) for _, steps in link.members), len(link.factors), link.aligned,
                link.geared(),
            )  # fmt: skip
            found = self._by_key[key] = make_constants(
                self.shapes, structure, partial(_visit_link, link), partial(_write_link, link),
                partial(link_constants, link, self.evaluate, NUMERIC, keep), len(self.found),
            )  # fmt: skip
            self.found.append(found)
        return found

    def of_faces(self, faces: LoopFaces) -> Constants:
        """Of the faces of a loop joint."""
        key = (faces.structure(), *map(id, faces.expressions()))
        found = self._by_key.get(key)
        if found is None:
            found = self._by_key[key] = make_constants(
                self.shapes, faces.structure(), partial(_visit_faces, faces), partial(_write_faces, faces),
                partial(face_constants, faces, self.evaluate, NUMERIC, keep), len(self.found),
            )  # fmt: skip
            self.found.append(found)
        return found

    def of_gravity(self, g: Sequence[Expression]) -> Constants:
        """Minus gravity."""

        def write(x: Expansion, leaf: Leaf, slots: Slots) -> dict[str, Value]:
            statements = Statements(x, leaf)
            return {f"a.{i}": x.let("a", -statements.write(slots.tree(g[k]))) for k, i in enumerate("xyz")}

        found = make_constants(
            self.shapes, ("gravity",), lambda slots: [slots.tree(e) for e in g], write,
            lambda: {f"a.{i}": -self.evaluate(g[k]) for k, i in enumerate("xyz")}, len(self.found),
        )  # fmt: skip
        self.found.append(found)
        return found


def _write_link(link: Link, x: Expansion, leaf: Leaf, slots: Slots) -> dict[str, Value]:
    """Write the constants of a link as statements."""
    statements = Statements(x, leaf)
    return link_constants(link, lambda e: statements.write(slots.tree(e)), SYMBOLIC, x.let)


def _visit_link(link: Link, slots: Slots) -> None:
    """Bring all expressions of a link into slots, in a fixed order."""
    for frame in (link.parent_frame, link.frame):
        if frame.vector is not None:
            for e in frame.vector:
                slots.tree(e)
    for steps in (link.steps, *(steps for _, steps in link.members)):
        for at, rotation in steps:
            for e in at:
                slots.tree(e)
            for axis, angle in rotation:
                for e in (*axis, angle):
                    slots.tree(e)
    for body, _ in link.members:
        for e in (body.mass, *body.com, *body.inertia):
            slots.tree(e)
    for e in (*link.factors, *link.armature):
        slots.tree(e)


def _visit_faces(faces: LoopFaces, slots: Slots) -> None:
    for e in faces.expressions():
        slots.tree(e)


def _write_faces(faces: LoopFaces, x: Expansion, leaf: Leaf, slots: Slots) -> dict[str, Value]:
    """Write the constants of a loop's faces as statements."""
    statements = Statements(x, leaf)
    return face_constants(faces, lambda e: statements.write(slots.tree(e)), SYMBOLIC, x.let)
