"""The faces of loop joints, and the constants of a loop as functions of the design parameters."""

from __future__ import annotations

from collections.abc import Sequence

from ...model.expressions import Expression
from ...model.model import GROUND, Coupling, Loop, PointCondition
from ...program.field import XYZ
from ...program.scalar import Value
from ...records import dataclass
from ..spatial import matmul, matvec, transpose
from .links import (
    BODY_FRAME,
    Carrier,
    Evaluate,
    Frame,
    Functions,
    Let,
    Link,
    NumberOf,
    Placement,
    axis_frame,
    expressions_of_steps,
    form_of_steps,
    frame_matrix,
    place,
)
from .surface_forms import SurfaceForm, forms_of


@dataclass(slots=True, eq=False)
class LoopFaces:
    """A loop joint, placed on links.

    Attributes
    ----------
    loop : Loop
    links : tuple of two int
        The links (or `GROUND`) of its faces.
    steps : tuple of two tuples of Placement
        From the body frames of those links to the faces.
    link_frames, frames : tuples of two Frame
        Frames of the links in their bodies; frames of the joint's axes in the faces.
    surfaces : tuple of SurfaceForm
        If the loop is a condition on a point: its equations.
    parts : tuple of Expression
        Subexpressions of these equations that contain no coordinate; for a distance, its length.
    """

    loop: Loop
    links: tuple[int, int]
    steps: tuple[tuple[Placement, ...], tuple[Placement, ...]]
    link_frames: tuple[Frame, Frame]
    frames: tuple[Frame, Frame]
    surfaces: tuple[SurfaceForm, ...] = ()
    parts: tuple[Expression, ...] = ()

    def expressions(self) -> list[Expression]:
        """All expressions, in a fixed order."""
        if isinstance(self.loop, Coupling):
            return [*(term.factor for term in self.loop.terms), self.loop.offset]
        found: list[Expression] = []
        for side in (0, 1):
            for frame in (self.link_frames[side], self.frames[side]):
                found += frame.vector or ()
            found += expressions_of_steps(self.steps[side])
        return [*found, *self.parts]

    def structure(self) -> tuple[object, ...]:
        """A key, equal for loops whose constants differ only in numbers and parameters."""
        related = len(self.loop.terms) if isinstance(self.loop, Coupling) else 0
        return (
            "faces", self.loop.type, related, *(f.form() for f in (*self.link_frames, *self.frames)),
            *map(form_of_steps, self.steps), *self.surfaces,
        )  # fmt: skip

    def write_constants(self, evaluate: Evaluate, functions: Functions, let: Let) -> dict[str, Value]:
        """Origins and axes of a loop joint's faces, along the links' axes.

        Returns
        -------
        dict
            ``A`` the start, ``B`` the end: ``A.r.i`` origin, m; ``A.F.ij`` link components from those of the face, one of whose
            axes is the joint's. A coupling has only ``factor0`` ... and ``offset``. A condition on a point also has ``part0`` ...
        """
        out: dict[str, Value] = {}
        if isinstance(self.loop, Coupling):
            out = {f"factor{t}": let("factor", evaluate(term.factor)) for t, term in enumerate(self.loop.terms)}
            return out | {"offset": let("offset", evaluate(self.loop.offset))}
        for side, name in enumerate("AB"):
            Q = frame_matrix(self.link_frames[side], evaluate, functions, let)
            r, R = place(self.steps[side], evaluate, functions, let)
            r = matvec(transpose(Q), r)
            half = [[let("F", e) for e in row] for row in matmul(transpose(Q), R)]
            F = matmul(half, frame_matrix(self.frames[side], evaluate, functions, let))
            for k, i in enumerate(XYZ):
                out[f"{name}.r.{i}"] = let("r", r[k])
                for n, j in enumerate(XYZ):
                    out[f"{name}.F.{i}{j}"] = let("F", F[k][n])
        return out | {f"part{i}": let("part", evaluate(part)) for i, part in enumerate(self.parts)}


def loop_faces(loop: Loop, links: Sequence[Link], carriers: Sequence[Carrier], evaluate: NumberOf) -> LoopFaces:
    """The two faces of a loop joint, each with the link that carries it."""
    on: list[int] = []
    steps: list[tuple[Placement, ...]] = []
    for face in (loop.start, loop.end):
        link, way = carriers[face.body] if face.body != GROUND else (GROUND, ())
        on.append(link)
        steps.append((*way, (face.at, face.rotation)))
    axes = [axis_frame(a, evaluate) for a in loop.axes] or [BODY_FRAME]
    frames = [BODY_FRAME if i == GROUND else links[i].frame for i in on]
    faces = LoopFaces(loop, (on[0], on[1]), (steps[0], steps[1]), (frames[0], frames[1]), (axes[0], axes[-1]))
    if isinstance(loop, PointCondition):
        faces.surfaces, faces.parts = forms_of(loop.surfaces)
        if loop.length is not None:
            faces.parts = (loop.length,)
    return faces
