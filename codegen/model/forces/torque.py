"""A torque on a body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from .on_body import OnBody, OnBodyEntry


@dataclass(frozen=True, slots=True, eq=False)
class Torque(OnBody):
    """A torque on a body, N m; where on the body makes no difference."""

    type: ClassVar[str] = "torque"


class TorqueEntry(OnBodyEntry):
    misspelt: ClassVar[dict[str, str]] = {"body": "on", "torque": "value", "moment": "value"}
    units: ClassVar[Mapping[str, str]] = {"value": "N*m"}
    element: ClassVar[type[OnBody]] = Torque

    type: Literal["torque"]
