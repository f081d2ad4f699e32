"""Errors: compilation, damaged packages, singular joints and loops, loops that do not close, motions that cannot continue."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


class CompileError(RuntimeError):
    """Raised if the C compiler rejects the generated source; the message gives the paths of the source and the log."""


class PackageError(ValueError):
    """Raised if a folder contains no package, or a package that was changed after `generate` wrote it."""


class FlagsError(CompileError, ValueError):
    """Raised if an environment variable, such as ``ORDERNM_CFLAGS``, has an invalid value."""


class NoCompilerError(RuntimeError):
    """Raised if there is no C compiler, or no way to call C."""


class _Remembering(Exception):
    """An error that keeps all its attributes when it is pickled, as in a pool of processes."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), str(self)), self.__dict__


def _again(kind: type[Exception], message: str) -> Exception:
    return kind.__new__(kind, message)


class SingularJointError(_Remembering, np.linalg.LinAlgError):
    """A joint's acceleration is not determined, because nothing outboard has inertia along the joint's degree of freedom.

    Attributes
    ----------
    link : str
        The link that this joint moves.
    """

    def __init__(self, link: str, where: str = "", message: str = "") -> None:
        joint, _, axis = link.rpartition(".")
        turned = (
            f"; or only this pose is singular (gimbal lock: joint {joint} has aligned the inertia outboard with this axis); "
            f"a spherical joint avoids this"
        )
        super().__init__(
            message
            or f"nothing outboard of joint {link} has positive inertia about it{where}, so its acceleration is not determined; "
            f"give its body, or one outboard of it, mass or inertia{turned if joint and axis == '1' else ''}"
        )
        self.link = link


class SingularLoopError(SingularJointError):
    """A loop, or a coupling, has lost rank: its dependent speeds are not determined by the independent ones.

    Attributes
    ----------
    link : str
        The loop or the coupling.
    """

    def __init__(self, loop: str, where: str = "", coupled: bool = False) -> None:
        message = (
            f"coupling {loop} has lost rank{where}: its dependent coordinate is multiplied by zero there, or the loops "
            f"that share it block it, so its speed is not determined; change the ratio, step off this configuration, "
            f"or choose other independent coordinates"
            if coupled
            else f"loop {loop} has lost rank{where}: its dependent joints do not move it independently (a dead point or a "
            f"flattened linkage), so their speeds are not determined; step off this configuration, or choose other independent "
            f"coordinates"
        )
        super().__init__(loop, where, message)


class SingularForceError(SingularJointError):
    """The direction of a force element is not defined, for example because its attachment points coincide.

    Attributes
    ----------
    link : str
        The force element.
    """

    def __init__(self, element: str, reason: str, where: str = "") -> None:
        super().__init__(element, where, f"{reason}{where}; step off this configuration")


def singular_forces(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The force elements of a package, each with the error message for an undefined direction."""
    reasons = manifest.get("singular_elements", {})
    named = zip(manifest.get("elements", ()), manifest.get("element_types", ()), strict=True)
    return [(name, f"{type_} {name}: {reasons.get(type_, 'it has no direction')}") for name, type_ in named]


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
    """A loop cannot be closed, or a coupling cannot be satisfied.

    Attributes
    ----------
    loop : str
        The loop or the coupling.
    residual : float
        Largest residual of its conditions, in radians or in units of the loop's characteristic length.
    """

    def __init__(
        self, loop: str, residual: float, where: str = "", coupled: bool = False, why: str = "", tolerance: float = 0.0
    ) -> None:
        if why:
            message = f"{'coupling' if coupled else 'loop'} {loop} cannot be {'satisfied' if coupled else 'closed'}{where}: {why}"
        elif coupled:
            message = (
                f"coupling {loop} cannot be satisfied{where}: its residual is {residual:.3g}, with the independent coordinates "
                f"unchanged and all loops closed that share coordinates with it; check its ratios and offset, or give a guess "
                f"nearer to a state that satisfies it"
            )
        else:
            message = (
                f"loop {loop} cannot be closed{where}: its residual is {residual:.3g} (rad, or characteristic lengths), "
                f"with the independent coordinates unchanged; check lengths, or give a guess nearer to a closed state"
            )
        if tolerance:
            message += f"; redundant conditions may stay open by {tolerance:g}, ten times loop_tolerance"
        super().__init__(message)
        self.loop = loop
        self.residual = residual


class EquilibriumError(_Remembering, ValueError):
    """No equilibrium was found.

    Attributes
    ----------
    residual : float
        The largest remaining acceleration at the best state found, rad/s^2 or m/s^2.
    coordinate : str
        The independent speed with this acceleration.
    q : (nq,) array
        The best state found.
    """

    def __init__(self, residual: float, coordinate: str, q: Any) -> None:
        super().__init__(
            f"no equilibrium was found: at the best state {coordinate} still accelerates by {residual:.3g} (rad/s^2 or m/s^2); "
            f"give a guess nearer to one, or check that some force holds {coordinate} (the error's attribute q is the state)"
        )
        self.residual = residual
        self.coordinate = coordinate
        self.q = q


class TargetsDifferError(ArithmeticError):
    """Raised if the compiled C and the NumPy module of a package return different numbers."""


class SimulationError(_Remembering, ArithmeticError):
    """A motion cannot be continued; the message gives the time and the reason.

    Attributes
    ----------
    trajectory : Trajectory
        The motion before the error.
    """

    def __init__(self, message: str, trajectory: Any) -> None:
        super().__init__(message)
        self.trajectory = trajectory
