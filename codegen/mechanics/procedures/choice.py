"""Choice of the functions of a solver: all of them, or a selection."""

from __future__ import annotations

from collections.abc import Collection

from ...program.procedure import Procedure
from ...wording import nearest

GROUPS: dict[str, tuple[str, ...]] = {
    "dynamics": ("accelerations", "sensitivities", "jacobians"),
    "rates": ("coordinate_rates", "coordinate_rate_sensitivities"),
    "mass": ("mass_matrix", "mass_matrix_sensitivities", "inverse_mass_matrix", "solve_mass", "solve_mass_sensitivities"),
    "forces": ("inverse_dynamics", "inverse_dynamics_sensitivities", "driving_forces", "driving_force_sensitivities"),
    "states": ("assemble_sensitivities", "closure_sensitivities", "initial_sensitivities"),
    "frames": (
        "frames", "frame_sensitivities", "frame_accelerations", "frame_acceleration_sensitivities", "point_places",
        "point_place_sensitivities",
    ),
    "statics": (
        "accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities", "assemble_sensitivities",
    ),
    "simulate": (
        "state_rates", "state_rate_sensitivities", "closing_step", "initial_sensitivities", "assemble_sensitivities", "outputs",
        "output_sensitivities", "coordinate_rates", "accelerations",
    ),
}  # fmt: skip
GROUPS["motion"] = (
    *GROUPS["simulate"], "gradients", "coordinate_rate_gradients", "output_gradients", "assemble_gradients",
)  # fmt: skip
"""Words for groups of functions that may be selected together."""

ANYWAY = ("states",)
"""Groups that may be empty for a model without an error; in a tree, for example, no loops need closing."""

ALSO = {
    "bias_force": "inverse_dynamics", "bias_force_sensitivities": "inverse_dynamics_sensitivities", "assemble": "completion",
    "initial_state": "initial",
}  # fmt: skip
"""Methods of a solver that call a function with another name."""

METHODS = {
    **dict.fromkeys(
        ("frame_jacobians", "points", "point_sensitivities", "point_jacobians", "picture", "view"), "frames"
    ),
    **dict.fromkeys(("equilibrium", "linearize", "ode"), "statics"), "diagnose": "accelerations", "judge": "motion",
    "hessians": "hessian_products", "equilibrium_hessian_products": "hessian_products",
}  # fmt: skip
"""Methods of a solver that consist of several calls, and the function or group to select for each of them."""


NEEDED = {
    "state_rates": {"state_rate_sensitivities"},
    "closing_step": {"state_rates", "state_rate_sensitivities"},
    "initial_sensitivities": {"state_rate_sensitivities"},
    "completion_sensitivities": {"initial_sensitivities", "state_rate_sensitivities"},
    "point_places": {"frames", "frame_sensitivities"},
    "point_place_sensitivities": {"frame_sensitivities"},
}
"""For each function or group, further functions that are included with it, because it is useless without them. For
instance, a motion of closed loops must close the loops, and the derivative of a motion needs the derivative of the
initial state."""


REACTIONS = ("reactions", "reaction_sensitivities")
"""Functions that are included only on request."""


class UnknownFunctionError(ValueError):
    """A selected function does not exist for the model.

    Parameters
    ----------
    message : str
    function : str
        The function, as selected; empty if none was.
    """

    def __init__(self, message: str, function: str = "") -> None:
        super().__init__(message)
        self.function = function


def asks_reactions(functions: Collection[str] | None) -> bool:
    """Whether the selection includes reactions or their derivatives."""
    return not set(REACTIONS).isdisjoint(functions or ())


def chosen(found: tuple[Procedure, ...], functions: Collection[str]) -> tuple[Procedure, ...]:
    """The selected procedures, and those that every solver has."""
    wanted: set[str] = set()
    known = [p.called for p in found if not p.basic]
    known += [word for word, name in ALSO.items() if any(name in (p.name, p.called) for p in found)]
    called = {p.called for p in found}
    together = [word for word, names in GROUPS.items() if word in ANYWAY or not called.isdisjoint(names)]
    for word in functions:
        names = {ALSO.get(n, n) for n in GROUPS.get(word, (word,))}
        of_word = {p.name for p in found if p.name in names or p.called in names}
        if not of_word and word not in ANYWAY:
            hint = nearest(word, [*known, *together])
            if word in METHODS:
                hint = f"; {word} is a method of solvers with {METHODS[word]}: select {METHODS[word]}"
            raise UnknownFunctionError(
                f"functions: the model has no function {word!r}{hint}; available are {', '.join(known)}, and the groups "
                f"{', '.join(together)}",
                word,
            )
        wanted |= of_word | {f for f, others in NEEDED.items() if not others.isdisjoint(of_word)}
    if not functions:
        raise UnknownFunctionError(
            f"functions: none are given; available are {', '.join(known)}, and the groups {', '.join(together)}"
        )
    return tuple(p for p in found if p.basic or p.name in wanted)
