"""A force that is given, along a line."""

from ..line_law import Coefficient, LineLaw

LAW = LineLaw(
    "actuator",
    "A force along the line as a joint force has it with a sliding joint in its place.",
    {"force": Coefficient("N", "drives the points apart")},
    force="force",
    misspelt={"value": "force"},
)
