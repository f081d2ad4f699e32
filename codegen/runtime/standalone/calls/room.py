"""Base class of the parts of a solver that combine generated functions: frames, gradients, motions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..arrays import Shape
from .functions import Function
from .package import Package
from .targets import Opened


class Room:
    """Gives a part of a solver access to this solver: names, sizes, calls, and the partition in use.

    Parameters
    ----------
    package : Package
        The solver.
    """

    def __init__(self, package: Package):
        self.package = package
        self.name, self.folder = package.name, package.folder
        self.nq, self.nu, self.np = package.nq, package.nu, package.np
        self.ninputs, self.noutputs = package.ninputs, package.noutputs
        self.coordinate_names, self.speed_names = package.coordinate_names, package.speed_names
        self.parameter_names, self.input_names = package.parameter_names, package.input_names
        self.signal_names, self.moving_inputs = package.signal_names, package.moving_inputs
        self.output_names, self.closure_names = package.output_names, package.closure_names
        self.prescribed_names = package.prescribed_names
        self._shapes, self._arguments = package._shapes, package._arguments
        self._call, self._find, self._open = package._call, package._find, package._open
        self._in_c, self._why_not, self._left_out = package._in_c, package._why_not, package._left_out

    @property
    def _manifest(self) -> Mapping[str, Any]:
        return self.package._manifest

    @property
    def _opened(self) -> Opened:
        return self.package._opened

    @property
    def _functions(self) -> Mapping[str, Function]:
        return self.package._opened.functions

    @property
    def _watched(self) -> bool:
        return self.package._watched

    @property
    def independent_names(self) -> tuple[str, ...]:
        return self.package.independent_names

    @property
    def independent_speed_names(self) -> tuple[str, ...]:
        return self.package.independent_speed_names


def alone(batch: Shape) -> None:
    """Raises ValueError if the arguments form a batch."""
    if batch:
        raise ValueError(
            f"the arguments are a batch of shape {batch}, expected one state; call the method once per state"
        )
