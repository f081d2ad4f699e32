"""What can go wrong, as classes: compiling, damaged packages, singular joints and loops, loops that do not close."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


class CompileError(RuntimeError):
    """The C compiler refused the generated source; the message says where source and log are kept."""


class PackageError(ValueError):
    """A folder holds no package, or one that is not as generate wrote it: cut short, edited, with a file gone."""


class FlagsError(CompileError, ValueError):
    """A variable of the environment, such as ``ORDERNM_CFLAGS``, cannot be used."""


class NoCompilerError(RuntimeError):
    """There is nothing to compile C with, or nothing to call it through."""


class _Remembering(Exception):
    """An error with attributes beside its message, which a pool of processes returns as it was raised."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), str(self)), self.__dict__


def _again(kind: type[Exception], message: str) -> Exception:
    return kind.__new__(kind, message)


class SingularJointError(_Remembering, np.linalg.LinAlgError):
    """Nothing outboard of a joint has inertia about it, so its acceleration is not determined.

    Attributes
    ----------
    link : str
        The link whose joint it is.
    """

    def __init__(self, link: str, where: str = "", message: str = "") -> None:
        joint, _, axis = link.rpartition(".")
        turned = (
            f"; or this pose alone is to blame (gimbal lock: joint {joint} has turned what it carries into line with this axis), "
            f"which a spherical joint passes"
        )
        super().__init__(
            message
            or f"nothing outboard of joint {link} has inertia about it{where}, so its acceleration is not determined; "
            f"give its body, or one that it carries, mass or inertia{turned if joint and axis == '1' else ''}"
        )
        self.link = link


class SingularLoopError(SingularJointError):
    """A loop, or a coupling, has lost rank: its dependent speeds are not determined by the independent ones.

    Attributes
    ----------
    link : str
        The loop, or the coupling.
    """

    def __init__(self, loop: str, where: str = "", coupled: bool = False) -> None:
        said = (
            f"coupling {loop} has lost rank{where}: its dependent coordinate is multiplied by zero there, or the loops "
            f"that share it leave it no way, so its speed is not determined; change the ratio, step off this configuration, "
            f"or choose other independent coordinates"
            if coupled
            else f"loop {loop} has lost rank{where}: its dependent joints move nothing of their own there (a dead point, a "
            f"flattened linkage), so their speeds are not determined; step off this configuration, or choose other independent "
            f"coordinates"
        )
        super().__init__(loop, where, said)


class SingularForceError(SingularJointError):
    """A force element has no direction, since its ends coincide or the like.

    Attributes
    ----------
    link : str
        The force element.
    """

    def __init__(self, element: str, reason: str, where: str = "") -> None:
        super().__init__(element, where, f"{reason}{where}; step off this configuration")


def singular_forces(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The force elements of a package, and what is said of each where it has no direction."""
    said = manifest.get("singular_elements", {})
    named = zip(manifest.get("elements", ()), manifest.get("element_types", ()), strict=True)
    return [(name, f"{type_} {name}: {said.get(type_, 'it has no direction')}") for name, type_ in named]


class SingularOutputError(SingularJointError):
    """An output, such as a distance, has a value but no derivative.

    Attributes
    ----------
    link : str
        The output.
    """

    def __init__(self, output: str, where: str = "") -> None:
        super().__init__(
            output,
            where,
            f"the points of output {output} coincide{where}, so it has no derivative there; step off this configuration, or take "
            f"the relative position of the points",
        )


class AssemblyError(_Remembering, ValueError):
    """A loop cannot be closed, or a coupling not be met.

    Attributes
    ----------
    loop : str
        The loop, or the coupling.
    residual : float
        What is left of its largest condition, in parts of the loop's characteristic length, or radians.
    """

    def __init__(
        self, loop: str, residual: float, where: str = "", coupled: bool = False, why: str = "", tolerance: float = 0.0
    ) -> None:
        if why:
            message = (
                f"{'coupling' if coupled else 'loop'} {loop} cannot be {'met' if coupled else 'closed'}{where}: {why}"
            )
        elif coupled:
            message = (
                f"coupling {loop} cannot be met{where}: {residual:.3g} is left of its condition with the independent coordinates "
                f"kept and the loops closed that share coordinates with it; check its ratios and offset, or begin nearer "
                f"to a state that meets it"
            )
        else:
            message = (
                f"loop {loop} cannot be closed{where}: {residual:.3g} is left of its conditions (in parts of its characteristic "
                f"length, or radians) with the independent coordinates kept; check lengths, or begin nearer to a closed state"
            )
        if tolerance:
            message += f"; conditions that follow from others may stay open by {tolerance:g}, ten times loop_tolerance"
        super().__init__(message)
        self.loop = loop
        self.residual = residual


class EquilibriumError(_Remembering, ValueError):
    """No state of rest was found.

    Attributes
    ----------
    residual : float
        The largest acceleration that is left at the best state, rad/s^2 or m/s^2.
    coordinate : str
        The independent speed that has it.
    q : (nq,) array
        That state.
    """

    def __init__(self, residual: float, coordinate: str, q: Any) -> None:
        super().__init__(
            f"no equilibrium was found: at the best state {coordinate} still accelerates by {residual:.3g} (rad/s^2 or m/s^2); "
            f"begin nearer to one, or see whether something holds {coordinate} at all (the state is in the error's q)"
        )
        self.residual = residual
        self.coordinate = coordinate
        self.q = q


class TargetsDifferError(ArithmeticError):
    """The compiled C and the NumPy module of one package compute different numbers."""


class SimulationError(_Remembering, ArithmeticError):
    """A motion cannot go on; the message says when and why.

    Attributes
    ----------
    trajectory : Trajectory
        Everything before it.
    """

    def __init__(self, message: str, trajectory: Any) -> None:
        super().__init__(message)
        self.trajectory = trajectory
