"""Mechanisms with closed loops, written by hand as models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from random_models import expression, vector

from codegen.model.model import GROUND, Body, Face, Joint, Loop, Model

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
ORIGIN = (0, 0, 0)


def body(name: str, parent: int, type: str, *axes: Any, at: Any = ORIGIN, rotation: Any = ()) -> Body:
    """A body of unit mass with its joint."""
    return Body(
        name, parent, Joint(type, tuple(vector(*a) for a in axes), vector(*at), turns(rotation)), expression(1),
        vector(0, 0, 0), tuple(expression(x) for x in (1, 1, 1, 0, 0, 0)),
    )  # fmt: skip


def turns(rotation: Any) -> tuple:
    return tuple((vector(*axis), expression(angle)) for axis, angle in rotation)


def loop(name: str, type: str, start: tuple, end: tuple, *axes: Any) -> Loop:
    """A loop joint; faces are (body, at) or (body, at, rotation)."""
    faces = [Face(f[0], vector(*f[1]), turns(f[2] if len(f) > 2 else ())) for f in (start, end)]
    return Loop(name, type, tuple(vector(*a) for a in axes), *faces)


def model(
    bodies: Sequence[Body], loops: Sequence[Loop], q: dict[str, float] | None = None, independent: Sequence[str] = ()
) -> Model:
    initial = {name: expression(float(x)) for name, x in (q or {}).items()}
    return Model("m", None, (), (), tuple(bodies), tuple(loops), initial_q=initial, independent=tuple(independent))


def four_bar(crank=1.0, coupler=2.0, rocker=1.5, base=2.2, q=(1.0, -0.8, -1.2), independent=()) -> Model:
    """Planar, about y, links along x at zero angles; the rocker hangs on the coupler, its foot closes the loop."""
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
    """A chain hanging from the ground with its tip held: hinges about y, x, y, x ..."""
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
