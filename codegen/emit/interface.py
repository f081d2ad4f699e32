"""The functions of the generated header: names, arguments, results, and what the model uses of them.

An argument that a model does not use does not exist: no ``inputs`` without inputs, no ``t`` without time, no ``p`` without
parameters.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

from ..mechanics.kinds import System

WIDTHS = (8, 2, 1)
"""How many directions one call of the sensitivities takes."""

OTHER_WIDTHS = (8, 1)
"""The same for all other functions: two widths less to compile, and they are called less often."""


_BALANCE = (
    "joint_forces",
    "spring_coefficients",
    "turns",
    "complete",
    "pose_tangents",
    "velocity_tangents",
    "clear_tangents",
    "spring_tangents",
    "balance_out",
    "balance_in",
    "balance_back",
)
_SPRINGS = ("spring_coefficients", "pose", "velocities", "clear", "springs")
_SPRING_TANGENTS = ("pose_tangents", "velocity_tangents", "clear_tangents", "spring_tangents")
_STATE = ("start", "rotations", "closures")
_FORWARD = (*_STATE, "joint_forces", *_SPRINGS, "kinematics", "triangularize", "back_substitute")
_MASS_TANGENT = ("turns", "clear_tangents", "balance_out", "force_tangents")
FUNCTION_SWEEPS: dict[str, tuple[str, ...]] = {
    "accelerations": _FORWARD,
    "sensitivities": _FORWARD + _BALANCE,
    "jacobians": _FORWARD + _BALANCE,
    "coordinate_rates": (*_STATE, "rates"),
    "coordinate_rate_sensitivities": (*_STATE, "turns", "complete", "rate_tangents"),
    "mass_matrix": ("start", "rotations", "mass_out", "mass_in"),
    "mass_matrix_sensitivities": ("start", "rotations", "clear", "kinematics", *_MASS_TANGENT),
    "solve_mass": ("start", "rotations", "clear", "kinematics", "triangularize", "solve_in", "balance_back"),
    "solve_mass_sensitivities": ("start", "rotations", "clear", "kinematics", "triangularize", *_MASS_TANGENT, "solve_in",
                                 "balance_back"),
    "inverse_dynamics": ("start", "rotations", *_SPRINGS, "kinematics", "newton_euler_out", "newton_euler_in", "joint_forces"),
    "inverse_dynamics_sensitivities": ("start", "rotations", *_SPRINGS, "kinematics", "turns", *_SPRING_TANGENTS, "balance_out",
                                       "force_tangents", "mass_out", "mass_in", "joint_forces"),
    "closure": (*_STATE, "residuals"),
    "newton_step": (*_STATE, "correct"),
    "reactions": _FORWARD,
    "conditions": (*_STATE, "condition_numbers"),
    "completion": _STATE,
    "completion_sensitivities": (*_STATE, "turns", "complete"),
    "closure_sensitivities": (*_STATE, "residuals", "turns", "complete", "seed_residuals"),
    "energies": _STATE,
    "energy_sensitivities": (*_STATE, "turns", "complete"),
    "initial": ("initial_values",),
    "initial_sensitivities": ("initial_values",),
    "outputs": (*_STATE, "output_formulas"),
    "output_sensitivities": (*_STATE, "turns", "complete", "output_formulas"),
}  # fmt: skip
"""Sweeps that a function runs; see `function_sweeps`. Those over directions run once for each group of columns in matrices."""


def function_sweeps(system: System, function: str) -> list[str]:
    """Sweeps that a function runs, each once."""
    of_springs = set() if system.model.springs else {*_SPRINGS, *_SPRING_TANGENTS}
    found = [s for s in FUNCTION_SWEEPS[function] if s not in of_springs] + measuring_sweeps(system, function)
    if function.startswith("coordinate_rate") and not system.model.loops:  # quaternions alone
        found.remove("start")
    if function == "reactions":
        found += ["pose", "motion", "transmitted"]
    return list(dict.fromkeys(found))


def measuring_sweeps(system: System, function: str) -> list[str]:
    """Sweeps that energies or outputs need beyond a complete state, in the order in which they run."""
    model = system.model
    if function not in ("energies", "energy_sensitivities", "outputs", "output_sensitivities"):
        return []
    wanted = (
        {"kinetic_energy", "potential_energy"} if function.startswith("energ") else {o.measure for o in model.outputs}
    )
    springs = "potential_energy" in wanted and bool(model.springs)
    found = []
    if springs or wanted & {"position", "velocity"}:
        found.append("pose")
    if wanted & {"kinetic_energy", "velocity"}:
        found.append("kinetic")
    if "potential_energy" in wanted and model.gravity is not None:
        found += ["moments", "potential_of_gravity"]
    if springs:
        found += ["spring_coefficients", "spring_energy"]
    if function.endswith("sensitivities"):
        found = [TANGENT_SWEEPS.get(sweep, sweep) for sweep in found]
    return found


TANGENT_SWEEPS = {
    "pose": "pose_tangents", "kinetic": "kinetic_tangents", "moments": "moment_tangents",
    "spring_energy": "spring_energy_tangents",
}  # fmt: skip
"""Sweeps that compute values and their tangents, by those that compute values."""


@dataclass(slots=True)
class Interface:
    """One function of the header.

    Attributes
    ----------
    name, comment : str
    arguments, seeds, results : list of str
    widths : tuple of int
        Of a function over directions; empty for the others.
    """

    name: str
    comment: str
    arguments: list[str]
    results: list[str]
    seeds: list[str]
    widths: tuple[int, ...] = ()

    def derived_names(self) -> list[str]:
        """Results that are derivatives."""
        return [r for r in self.results if self.seeds and r.startswith("d")]

    def derived(self) -> list[str]:
        """What they are the derivatives of."""
        return [r.removeprefix("d") for r in self.derived_names()]

    def signature(self, model: str, width: int | None = None) -> str:
        """C declaration, without the semicolon."""
        arguments = [f"double {a}" if a == "t" else f"const double *{a}" for a in self.arguments]
        arguments += [f"const double *{a}" for a in self.seeds]
        arguments += [f"double *{a}" for a in self.results]
        return f"int {model}_{self.symbol(width)}({', '.join([*arguments, 'double *work'])})"

    def symbol(self, width: int | None = None) -> str:
        """Name in C, without the model's."""
        return f"{self.name}_{width}" if width else self.name

    def batch_signature(self, model: str, width: int | None = None) -> str:
        """C declaration of the loop over a batch, without the semicolon: every argument has a step, in doubles."""
        arguments = [f"const double *{a}, long {a}_step" for a in [*self.arguments, *self.seeds]]
        arguments += [f"double *{r}" for r in self.results]
        return f"int {model}_{self.symbol(width)}_batch(long count, long *failed, {', '.join([*arguments, 'double *work'])})"

    def batch_lines(self, model: str, width: int | None, size: dict[str, int]) -> list[str]:
        """Body of the loop over a batch."""
        passed = [f"{a}[i*{a}_step]" if a == "t" else f"{a} + i*{a}_step" for a in [*self.arguments, *self.seeds]]
        derived = self.derived_names()
        for r in self.results:
            n = size[r.removeprefix("d")] * (width or 1) if r in derived else size[r]
            passed.append(f"{r} + i*{n}")
        return [
            "for (long i = 0; i < count; ++i) {",
            f"    const int singular = {model}_{self.symbol(width)}({', '.join([*passed, 'work'])});",
            "    if (singular) {",
            "        if (failed) *failed = i;",
            "        return singular;",
            "    }",
            "}",
            "return 0;",
        ]


@functools.lru_cache(maxsize=1)
def uses(system: System) -> dict[str, bool]:
    """What the model has, for leaving out what it has not."""
    model = system.model
    names = set().union(*(e.names for e in model.expressions())) if model.bodies else set()
    return {
        "loops": bool(model.loops),
        "parameters": bool(model.parameters),
        "inputs": bool(model.inputs),
        "time": "t" in names,
        "forces": bool(model.forces),
        "springs": bool(model.springs),
        "gravity": model.gravity is not None,
        "quaternions": any(link.joint in ("spherical", "free") for link in system.links),
        "outputs": bool(model.outputs),
        "initial": model.initial_depends_on_parameters,
    }


def interfaces(system: System, reactions: bool = False) -> list[Interface]:
    """The functions that a solver has; reactions where they are asked for."""
    use = uses(system)
    p = ["p"] if use["parameters"] else []
    rest = p + (["inputs"] if use["inputs"] else []) + (["t"] if use["time"] else [])

    def seeds(names: list[str]) -> list[str]:
        return [f"d{n}" for n in names]

    result: list[Interface] = []

    def pair(
        name: str, derivative: str, comment: str, arguments: list[str], results: list[str], comment_d: str
    ) -> None:
        result.append(Interface(name, comment, arguments, results, []))
        result.append(
            Interface(derivative, comment_d, arguments, [*results, *seeds(results)], seeds(arguments),
                      WIDTHS if derivative == "sensitivities" else OTHER_WIDTHS)
        )  # fmt: skip

    state = ["q", "u", *rest]
    pair(
        "accelerations",
        "sensitivities",
        "Forward dynamics (Eqs. 18-24, 30-56)." if use["loops"] else "Forward dynamics (Eqs. 18-24, 42-56).",
        state,
        ["udot"],
        "Forward dynamics and its total derivative along seeds (Eqs. 9, 10, by the balance).",
    )
    jacobians = [f"J_{n}" for n in state]
    result.append(
        Interface(
            "jacobians", "Accelerations and their partial derivatives, row by row.", state, ["udot", *jacobians], []
        )
    )
    pair(
        "coordinate_rates",
        "coordinate_rate_sensitivities",
        "Time derivatives of the coordinates (Eq. 1).",
        ["q", "u", *(p if use["loops"] else [])],
        ["qdot"],
        "Their total derivative along seeds.",
    )
    if not use["loops"]:
        pair(
            "mass_matrix",
            "mass_matrix_sensitivities",
            "Mass matrix, row by row.",
            ["q", *p],
            ["M"],
            "Mass matrix and its total derivative along seeds.",
        )
        pair(
            "solve_mass",
            "solve_mass_sensitivities",
            "Solution of M x = b in O(n).",
            ["q", *p, "b"],
            ["x"],
            "Solution of M x = b and its total derivative along seeds.",
        )
        pair(
            "inverse_dynamics",
            "inverse_dynamics_sensitivities",
            "Joint forces that udot needs beside the model's own.",
            ["q", "u", "udot", *rest],
            ["force"],
            "Those forces and their total derivative along seeds.",
        )
    pair(
        "energies",
        "energy_sensitivities",
        "Kinetic and potential energy.",
        ["q", "u", *p, *_read_by_springs(system)],
        ["energy"],
        "Energies and their total derivative along seeds.",
    )
    if reactions:
        wrenches = ["reaction", *(["loop_reaction"] if use["loops"] else [])]
        result.append(
            Interface("reactions", "Wrenches on links at their joints and on loops' end faces: moment, force; ground frame.",
                      state, wrenches, [])
        )  # fmt: skip
    if use["loops"]:
        result.append(
            Interface(
                "closure", "Scaled residuals of all loops, of position and velocity.", ["q", "u", *p],
                ["position", "velocity"], [],
            )
        )  # fmt: skip
        result.append(
            Interface(
                "conditions",
                "Condition number of the closure matrix that each loop belongs to.",
                ["q", *p],
                ["condition"],
                [],
            )
        )
        result.append(
            Interface(
                "newton_step", "Newton's step of the dependent coordinates towards closure.", ["q", *p], ["step"], []
            )
        )
        result.append(
            Interface(
                "completion", "Speeds, the dependent ones as velocity closure asks.", ["q", "u", *p], ["full_u"], []
            )
        )
        result.append(
            Interface(
                "completion_sensitivities", "Speeds and seeds, the dependent ones as closure asks.", ["q", "u", *p],
                ["full_u", "dfull_q", "dfull_u"], ["dq", "du", *(["dp"] if p else [])], OTHER_WIDTHS,
            )
        )  # fmt: skip
    if use["loops"]:
        result.append(
            Interface(
                "closure_sensitivities", "How far loops are open in position, and by how much complete seeds open them.",
                ["q", "u", *p], ["position", "dposition"], ["dq", "du", *(["dp"] if p else [])], OTHER_WIDTHS,
            )
        )  # fmt: skip
    if use["initial"]:
        result.append(Interface("initial", "Initial values, as the model file gives them: loops not closed yet.",
                                ["p"], ["q", "u"], []))  # fmt: skip
        result.append(Interface("initial_sensitivities", "Initial values and their total derivative along seeds.",
                                ["p"], ["q", "u", "dq", "du"], ["dp"], OTHER_WIDTHS))  # fmt: skip
    if use["outputs"]:
        pair(
            "outputs",
            "output_sensitivities",
            "The outputs of the model.",
            state,
            ["outputs"],
            "Outputs and their total derivative along seeds.",
        )
    return result


def _read_by_springs(system: System) -> list[str]:
    """Whether the coefficients of springs read inputs and time."""
    model = system.model
    names = set().union(*(e.names for s in model.springs for e in (s.stiffness, s.damping, s.free_length)))
    return [*(["inputs"] if names & set(model.inputs) else []), *(["t"] if "t" in names else [])]


def sizes(system: System) -> dict[str, int]:
    """Number of entries of every argument and result."""
    model = system.model
    nq, nu, n_p, ninputs = model.nq, model.nu, len(model.parameters), len(model.inputs)
    return {
        "q": nq, "u": nu, "p": n_p, "inputs": ninputs, "t": 1, "udot": nu, "qdot": nq, "M": nu * nu, "b": nu, "x": nu,
        "force": nu, "energy": 2, "outputs": len(model.outputs), "J_q": nu * nq, "J_u": nu * nu, "J_p": nu * n_p,
        "J_inputs": nu * ninputs, "J_t": nu, "position": len(model.closure_names), "velocity": len(model.closure_names),
        "condition": len(model.loops), "reaction": 6 * len(system.links), "loop_reaction": 6 * len(model.loops),
        "step": nq, "full_q": nq, "full_u": nu,
    }  # fmt: skip


def manifest(
    system: System, workspace: int, operations: Any, assembled: tuple[float, ...] = (), reactions: bool = False
) -> dict[str, Any]:
    """What ``model.json`` says for the run time."""
    model = system.model
    defaults = model.defaults
    q0, u0 = [], []
    quaternions = []
    for i, name in enumerate(model.coordinate_names):
        if name.endswith(".qw"):
            quaternions.append(i)
        given = model.initial_q.get(name)
        q0.append(float(given.evaluate(defaults)) if given is not None else float(name.endswith(".qw")))
    for name in model.speed_names:
        given = model.initial_u.get(name)
        u0.append(float(given.evaluate(defaults)) if given is not None else 0.0)
    functions: dict[str, Any] = {}
    independent_q, independent_u = system.independent
    for f in interfaces(system, reactions):
        sweeps = [s for s in function_sweeps(system, f.name) if s in operations]
        functions[f.name] = {"arguments": f.arguments, "results": f.results, "sweeps": sweeps}
        if f.widths:
            functions[f.name] |= {"seeds": f.seeds, "widths": list(f.widths)}
    return {
        "name": model.name,
        "coordinate_names": list(model.coordinate_names),
        "speed_names": list(model.speed_names),
        "parameter_names": list(model.parameter_names),
        "parameters": [p.value for p in model.parameters],
        "parameter_units": [p.unit for p in model.parameters],
        "input_names": list(model.inputs),
        "output_names": [o.name for o in model.outputs],
        "closure_names": list(model.closure_names),
        "independent_names": [model.coordinate_names[i] for i in independent_q],
        "independent_speed_names": [model.speed_names[i] for i in independent_u],
        "prescribed_names": [],
        "initial": {"q": list(assembled) or q0, "u": u0},
        "quaternions": quaternions,
        "links": [link.name for link in system.links],
        "loops": [loop.name for loop in model.loops],
        "springs": [spring.name for spring in model.springs],
        "joint_links": [_joint_link(system, k) for k in range(len(model.bodies))],
        "workspace": workspace,
        "widths": list(WIDTHS),
        "functions": functions,
        "operations": operations,
        **_redundancy(system),
    }


def _redundancy(system: System) -> dict[str, Any]:
    """Conditions that were dropped and parameters that open others, where there are any."""
    chosen, model = system.partition, system.model
    if chosen is None:
        return {}
    dropped, opening = list(chosen.dropped_conditions(model)), list(chosen.opening)
    return ({"loop_tolerance": model.loop_tolerance, "dropped": dropped} if dropped else {}) | (
        {"opening": opening} if opening else {}
    )


def _joint_link(system: System, body: int) -> int:
    """The link whose joint carries a body: -1 for a body that is fixed to what carries it."""
    link, steps = system.carriers[body]
    return -1 if steps else int(link)
