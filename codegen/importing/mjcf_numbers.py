"""Checks the numbers of a compiled MuJoCo model, since MuJoCo accepts ``nan`` and ``inf``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from ..model.errors import Problem
from ..model.positions import shortened
from .robot import Place

LARGEST: Final = 1e75
"""Largest number that is accepted; the product of four such numbers is still finite."""

_POWERS: Final = "stiffness stiffnesspoly damping dampingpoly armature"
_READ: Final = {
    ("body", "body"): "pos quat mass inertia ipos iquat gravcomp",
    ("joint", "jnt"): f"pos axis {_POWERS}",
    ("joint", "dof"): _POWERS,
    ("site", "site"): "pos quat",
    ("tendon", "tendon"): _POWERS,
    ("actuator", "actuator"): f"gear biasprm gainprm {_POWERS}",
    ("equality", "eq"): "data",
}
"""Fields that the import reads, by kind of element and prefix of MuJoCo's arrays."""


def problems_of_numbers(model: Any, file: str, place: Callable[[str, str, int | None], Place]) -> list[Problem]:
    """Errors for numbers of an `mujoco.MjModel` that are not finite or too large, with name and line of the element."""
    found = []
    if not _are_numbers(model.opt.gravity).all():
        found.append(Place(file).problem(f"gravity is {_shown(model.opt.gravity)}; finite numbers in m/s^2 are needed"))
    for kind, key, values, owners in (numbers for numbers in _numbers(model) if len(numbers[-1])):
        for row in np.flatnonzero(~_are_numbers(np.reshape(values, (len(owners), -1))).all(axis=1)):
            i = int(owners[row])
            if kind == "equality" and not model.eq_active0[i]:
                continue
            name = getattr(model, kind)(i).name
            message = f"{key} of {kind} {shortened(name) if name else i} is {_shown(values[row])}"
            message += f"; finite numbers of less than {LARGEST:g} are needed"
            found.append(place(kind, name, i).problem(message))
    return list(dict.fromkeys(found))


def _numbers(model: Any) -> Iterator[tuple[str, str, Any, Any]]:
    """For each field: kind of element, key, values of all elements, and the element of each row."""
    for (kind, start), keys in _READ.items():
        for key in keys.split():
            values = getattr(model, f"{start}_{key}", None)
            if values is not None:
                yield kind, key, values, model.dof_jntid if start == "dof" else np.arange(len(values))
    of_q = np.searchsorted(model.jnt_qposadr, np.arange(model.nq), "right") - 1
    yield "joint", "ref", model.qpos0, of_q
    yield "joint", "springref", model.qpos_spring, of_q
    yield "tendon", "springlength", model.tendon_lengthspring, np.arange(model.ntendon)
    yield "tendon", "coef", model.wrap_prm, np.searchsorted(model.tendon_adr, np.arange(model.nwrap), "right") - 1


def _are_numbers(values: Any) -> Any:
    return np.abs(np.asarray(values, dtype=float)) < LARGEST


def _shown(values: Any) -> str:
    wrong = np.ravel(values)[~_are_numbers(np.ravel(values))]
    return f"{float(wrong[0]):g}"
