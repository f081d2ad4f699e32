"""sympy constraints that hold a point of a body in a plane fixed to the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from .sympy_system import GROUND, Frame, SympySystem, components

_SAMPLES: Final = 40
_EQUATIONS: Final = 12
_AGREES: Final = 1e-9


class Closure(NamedTuple):
    """The condition normal . x + offset = 0 on a point of a body.

    Attributes
    ----------
    body : str
    point : list of sympy.Expr
        The point in the body's frame.
    normal : list of int
        Components -1, 0 or 1, in the ground's frame.
    offset : sympy.Expr
    """

    body: str
    point: list[Any]
    normal: list[int]
    offset: Any


def closure_of(found: SympySystem, constraint: Any, used: Sequence[Any]) -> Closure | None:
    """The closure that is equivalent to a constraint; None if there is none.

    Parameters
    ----------
    found : SympySystem
    constraint : sympy.Expr
    used : sequence of sympy.Function
        The coordinates in the constraint.
    """
    ground = next(f for f in found.frames.values() if f.name == GROUND)
    for frame in found.all_frames():
        if frame.name == GROUND:
            continue
        place = components(frame.origin.pos_from(ground.origin), ground.axes)
        turned = ground.axes.dcm(frame.axes)
        if not _depends_on(found, [*place, *turned], used):
            continue
        closure = _fitted(frame, constraint, used, place, turned)
        if closure is not None:
            return closure
    return None


def _depends_on(found: SympySystem, values: Sequence[Any], used: Sequence[Any]) -> bool:
    """Whether the values depend on exactly the given coordinates."""
    return {q for q in found.scalars if any(v.has(q) for v in values)} == set(used)


def _fitted(frame: Frame, constraint: Any, used: Sequence[Any], place: Sequence[Any], turned: Any) -> Closure | None:
    """The closure of a point of a body that equals a constraint; None if there is none.
    The equality and the symbolic solution are checked at random samples."""
    import sympy

    free = sorted({x for e in (constraint, *place, *turned) for x in e.free_symbols}, key=str)
    rng = np.random.default_rng(0)
    at = dict(zip(free, rng.uniform(0.5, 1.5, len(free)), strict=True))
    values = sympy.lambdify([*used, *free], [constraint, *place, *turned], "numpy")

    def sampled() -> np.ndarray:
        rows = [values(*rng.uniform(-2, 2, len(used)), *at.values()) for _ in range(_SAMPLES)]
        return np.array(rows, dtype=float)

    rows = sampled()
    of = np.column_stack([np.ones(_SAMPLES), rows[:, 1:]])
    solution, *_ = np.linalg.lstsq(of, rows[:, 0], rcond=None)
    scale = np.abs(rows[:, 0]).max()
    normal = [round(float(c)) for c in solution[1:4]]
    exact = np.abs(of @ solution - rows[:, 0]).max() <= _AGREES * scale
    if not exact or not any(normal) or np.abs(solution[1:4] - normal).max() > _AGREES or max(map(abs, normal)) > 1:
        return None
    point, offset = _solved(constraint, used, place, turned, normal)
    if point is None:
        return None
    x = [p + sum(turned[i, j] * point[j] for j in range(3)) for i, p in enumerate(place)]
    difference = constraint - offset - sum(n * c for n, c in zip(normal, x, strict=True))
    apart = sympy.lambdify([*used, *free], difference, "numpy")
    for _ in range(_SAMPLES):
        if abs(apart(*rng.uniform(-2, 2, len(used)), *at.values())) > _AGREES * scale:
            return None
    return Closure(frame.name, point, normal, offset)


def _solved(
    constraint: Any, used: Sequence[Any], place: Sequence[Any], turned: Any, normal: Sequence[int]
) -> tuple[list[Any] | None, Any]:
    """The point and the offset as expressions of parameters, from the constraint at some coordinates."""
    import sympy

    unknown = sympy.symbols("r:3 c", cls=sympy.Dummy)
    equations = []
    quarters = [0, sympy.pi / 2, sympy.pi]
    rng = np.random.default_rng(0)
    for _ in range(_EQUATIONS):
        at = {q: quarters[rng.integers(3)] for q in used}
        along = sum(n * p for n, p in zip(normal, place, strict=True))
        across = sum(normal[i] * turned[i, j] * unknown[j] for i in range(3) for j in range(3))
        equations.append((along + across + unknown[3] - constraint).subs(at).expand())
    solution = sympy.solve([e for e in dict.fromkeys(equations) if e != 0], unknown, dict=True)
    if not solution:
        return None, None
    none = dict.fromkeys(unknown, 0)
    *point, offset = (sympy.sympify(solution[0].get(x, x)).subs(none) for x in unknown)
    return point, offset
