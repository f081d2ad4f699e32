"""sympy rotations as the key ``rotate`` of the model format."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def rotation_keys(turned: Any, text: Callable[[Any], str]) -> dict[str, Any]:
    """The key ``rotate`` for a rotation; empty if the frames are parallel.

    Parameters
    ----------
    turned : (3, 3) Matrix
        Its columns are the axes of the rotated frame.
    text : callable (expression) -> str
        Writes an angle as text.
    """
    import sympy

    exact = turned.applyfunc(lambda e: e.simplify())
    if exact == sympy.eye(3):
        return {}
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if exact[i, i] == 1:
            return {"rotate": [{"axis": "xyz"[i], "angle": text(_angle(exact[k, j], exact[j, j]))}]}
    across = sympy.sqrt(exact[0, 0] ** 2 + exact[1, 0] ** 2)
    yaw, pitch = _angle(exact[1, 0], exact[0, 0]), _angle(-exact[2, 0], across)
    roll = _angle(exact[2, 1], exact[2, 2])
    if across.simplify() == 0:
        yaw, pitch, roll = _angle(-exact[0, 1], exact[1, 1]), _angle(-exact[2, 0], sympy.Integer(0)), sympy.Integer(0)
    turns = [("z", yaw), ("y", pitch), ("x", roll)]
    return {"rotate": [{"axis": axis, "angle": text(angle)} for axis, angle in turns if angle != 0]}


def _angle(sine: Any, cosine: Any) -> Any:
    """The angle of a given sine and cosine, or of positive multiples of both."""
    import sympy

    if isinstance(cosine, sympy.cos) and sine in (sympy.sin(cosine.args[0]), -sympy.sin(cosine.args[0])):
        return cosine.args[0] if sine == sympy.sin(cosine.args[0]) else -cosine.args[0]
    return sympy.atan2(sine, cosine)
