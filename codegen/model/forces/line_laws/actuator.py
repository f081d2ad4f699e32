"""A force along a line, given by an expression."""

from ..line_law import Coefficient, LineLaw

LAW = LineLaw(
    "actuator",
    "A force along the line, given as in a joint force on a prismatic joint.",
    {"force": Coefficient("N", "drives the points apart")},
    force="force",
    misspelt={"value": "force"},
)
