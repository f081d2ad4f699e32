"""Arguments, results and formulas of procedures, and numbers of directions."""

from __future__ import annotations

from ...program.procedure import (
    Array,
    Formulas,
)
from ..structure.system import System

OTHER_WIDTHS = (8, 1)
"""Numbers of directions per call of rarely used functions; they are fewer than `WIDTHS` to save compile time."""

JOINT_FORCES = Formulas("joint_forces", ("tau",))
OUTPUTS = Formulas("output_formulas", ("outputs",))
HELD_FORCES = Formulas("held_forces", ("held_force",))
MOTIONS = Formulas("prescribed_motion", ("prescribed",))
INITIAL = Formulas("initial_values", ("initial_q", "initial_u"))
SWITCHES = Formulas("switch_formulas", ("switches",))
FRAMES = Formulas("body_frames", ("frames",))
FRAME_ACCELERATIONS = Formulas("accelerations_of_frames", ("frame_accelerations",))
PLACES = Formulas("places_of_points", ("point_places",))

SHAPES: dict[str, tuple[str, ...]] = {
    "q": ("nq",), "u": ("nu",), "p": ("np",), "inputs": ("ninputs",), "t": (), "udot": ("nu",), "qdot": ("nq",),
    "M": ("nu", "nu"), "inverse_M": ("nu", "nu"), "b": ("nu",), "x": ("nu",),
    "force": ("nu",), "energy": ("2",), "outputs": ("noutputs",),
    "J_q": ("nu", "nq"), "J_u": ("nu", "nu"), "J_p": ("nu", "np"), "J_inputs": ("nu", "ninputs"), "J_t": ("nu",),
    "position": ("nclosure",), "velocity": ("nclosure",), "condition": ("nloops",), "reaction": ("6*nlinks",),
    "loop_reaction": ("6*nloops",), "step": ("nq",), "full_q": ("nq",), "full_u": ("nu",), "tau": ("nu",),
    "frames": ("18*nbodies",), "frame_accelerations": ("6*nbodies",),
    "point_places": ("3*npoints",),
    "masses": ("4",), "momenta": ("6",),
    "force_weights": ("nu",), "energy_weights": ("2",), "output_weights": ("noutputs",),
    "rate_weights": ("nq",), "switch_weights": ("nswitches",), "q_weights": ("nq",), "u_weights": ("nu",),
    "modes": ("nswitches",), "switches": ("nswitches",),
    "gq": ("nq",), "gu": ("nu",), "gudot": ("nu",), "gp": ("np",), "ginputs": ("ninputs",), "gt": (),
    "prescribed": ("3*nprescribed",), "driving": ("nprescribed",), "actuation": ("nprescribed",), "held_force": ("nprescribed",),
}  # fmt: skip
"""Axes of arguments and results, by the name of the array."""


def arrays(system: System) -> dict[str, Array]:
    """Arguments, results and joint forces by name."""
    model = system.model
    counts = {
        "nq": model.nq, "nu": model.nu, "np": len(model.parameters), "ninputs": len(model.inputs), "2": 2, "4": 4, "6": 6,
        "noutputs": len(model.outputs), "nclosure": len(model.closure_names), "nloops": len(model.loops),
        "6*nlinks": 6 * len(system.links), "6*nloops": 6 * len(model.loops),
        "18*nbodies": 18 * len(model.bodies), "6*nbodies": 6 * len(model.bodies), "3*npoints": 3 * len(model.points),
        "nswitches": len(model.switches.found), "nprescribed": len(model.prescribed), "3*nprescribed": 3 * len(model.prescribed),
    }  # fmt: skip
    found = {}
    for name, shape in SHAPES.items():
        size = 1
        for axis in shape:
            size *= counts[axis]
        found[name] = Array(name, shape, size)
    return found
