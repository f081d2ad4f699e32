"""Forces on the freedoms of a joint."""

from __future__ import annotations

from ...model.forces import JointForce
from ..pairs import Pair, Pairs
from .law import Law


class JointForceLaw(Law[JointForce]):
    """The values as they are."""

    def on_speeds(self, element: JointForce, pairs: Pairs) -> dict[int, Pair]:
        return {element.body: pairs.vector(element.values)}
