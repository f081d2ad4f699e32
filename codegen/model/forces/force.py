"""A force on a body, through one of its points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from .on_body import OnBody, OnBodyEntry


@dataclass(frozen=True, slots=True, eq=False)
class Force(OnBody):
    """A force through a point of a body, N."""

    type: ClassVar[str] = "force"


class ForceOnBodyEntry(OnBodyEntry):
    misspelt: ClassVar[dict[str, str]] = {"at": "on", "point": "on", "body": "on", "force": "value"}
    units: ClassVar[Mapping[str, str]] = {"value": "N"}
    element: ClassVar[type[OnBody]] = Force

    type: Literal["force"]
