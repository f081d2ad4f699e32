"""What each function of a solver does, step by step.

This is the list to read for what runs when; what the sweeps compute stands in `codegen.mechanics.sweeps`. An argument that a
model does not use does not exist: no ``inputs`` without inputs, no ``t`` without time, no ``p`` without parameters.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise

from ..program.procedure import (
    AddEntry,
    Array,
    Bind,
    Check,
    Columns,
    Combine,
    Copy,
    CopyEntry,
    Formulas,
    Hold,
    Own,
    Perform,
    Prepare,
    Procedure,
    Routine,
    Run,
    Single,
    Step,
    Take,
    Tolerate,
    Zero,
    ZeroEntries,
    flat,
    over_directions,
    walk,
)
from .outputs import MEASURES, EnergyMeasure, RecordMeasure
from .quantities import COEFFICIENTS, DRIVES, ENERGIES, POSE, VELOCITY, Quantity, measured, missing, run
from .structure.system import System
from .sweeps import GRADIENT_IN, GRADIENT_IN_CLOSED, GRADIENT_OUT, SWEEPS, transpose_name, values_name

TRANSPOSED = {
    "accelerations": "sensitivities", "coordinate_rates": "coordinate_rate_sensitivities", "energies": "energy_sensitivities",
    "outputs": "output_sensitivities", "completion": "completion_sensitivities",
}  # fmt: skip
"""Functions that have a transpose, with those that give their derivatives."""

GRADIENTS = {
    "accelerations": "gradients", "coordinate_rates": "coordinate_rate_gradients", "energies": "energy_gradients",
    "outputs": "output_gradients", "completion": "assemble_gradients",
}  # fmt: skip
"""What a solver calls these transposes, by the functions of values."""

WIDTHS = (8, 2, 1)
"""How many directions one call of the sensitivities takes."""

OTHER_WIDTHS = (8, 1)
"""The same for all other functions: two widths less to compile, and they are called less often."""

FOUR = (4,)
"""Beside them, for motions with two to four directions, of the functions that integration calls."""

ALONG_MOTIONS = ("state_rate_sensitivities", "completion_sensitivities", "output_sensitivities")
"""These functions."""

CONSTANTS, ANGLES = "constants", "angles"
GROUND, GROUND_AT_REST = "ground", "ground at rest"
GROUND_TANGENT, GROUND_TANGENT_AT_REST = "tangent of the ground", "tangent of the ground at rest"
GROUND_TANGENT_TRANSPOSED, ADJOINTS = "transpose of the ground's tangent", "adjoints"
PASSING_ADJOINTS = "adjoints that are handed on"
"""What is prepared outside of the sweeps: constants from parameters; sines and cosines; what links read of the ground, which
accelerates by -g or, for the mass matrix, not at all; memory of directions, which is zero before sweeps run backwards."""

JOINT_FORCES = Formulas("joint_forces", ("tau",))
OUTPUTS = Formulas("output_formulas", ("outputs",))
INITIAL = Formulas("initial_values", ("initial_q", "initial_u"))

SHAPES: dict[str, tuple[str, ...]] = {
    "q": ("nq",), "u": ("nu",), "p": ("np",), "inputs": ("ninputs",), "t": (), "udot": ("nu",), "qdot": ("nq",),
    "M": ("nu", "nu"), "b": ("nu",), "x": ("nu",), "force": ("nu",), "energy": ("2",), "outputs": ("noutputs",),
    "J_q": ("nu", "nq"), "J_u": ("nu", "nu"), "J_p": ("nu", "np"), "J_inputs": ("nu", "ninputs"), "J_t": ("nu",),
    "position": ("nclosure",), "velocity": ("nclosure",), "condition": ("nloops",), "reaction": ("6*nlinks",),
    "loop_reaction": ("6*nloops",), "step": ("nq",), "full_q": ("nq",), "full_u": ("nu",), "tau": ("nu",),
    "masses": ("4",), "momenta": ("6",),
}  # fmt: skip
"""Axes of arguments and results."""


def arrays(system: System) -> dict[str, Array]:
    """Arguments and results by name, and the joint forces."""
    model = system.model
    counts = {
        "nq": model.nq, "nu": model.nu, "np": len(model.parameters), "ninputs": len(model.inputs), "2": 2, "4": 4, "6": 6,
        "noutputs": len(model.outputs), "nclosure": len(model.closure_names), "nloops": len(model.loops),
        "6*nlinks": 6 * len(system.links), "6*nloops": 6 * len(model.loops),
    }  # fmt: skip
    found = {}
    for name, shape in SHAPES.items():
        size = 1
        for axis in shape:
            size *= counts[axis]
        found[name] = Array(name, shape, size)
    return found


GROUPS: dict[str, tuple[str, ...]] = {
    "dynamics": ("accelerations", "sensitivities", "jacobians"),
    "rates": ("coordinate_rates", "coordinate_rate_sensitivities"),
    "mass": ("mass_matrix", "mass_matrix_sensitivities", "solve_mass", "solve_mass_sensitivities"),
    "forces": ("inverse_dynamics", "inverse_dynamics_sensitivities"),
    "states": ("assemble_sensitivities", "closure_sensitivities", "initial_sensitivities"),
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
"""Words for several functions that may be chosen together."""

ALSO = {
    "bias_force": "inverse_dynamics", "bias_force_sensitivities": "inverse_dynamics_sensitivities", "assemble": "completion",
    "initial_state": "initial",
}  # fmt: skip
"""Members of a solver, with the functions that they call beside those that they are called like."""


NEEDED = {
    "state_rates": {"state_rate_sensitivities"},
    "closing_step": {"state_rates", "state_rate_sensitivities"},
    "initial_sensitivities": {"state_rate_sensitivities"},
    "completion_sensitivities": {"initial_sensitivities", "state_rate_sensitivities"},
}
"""Functions that are there wherever others are, which are of no use without them: no motion of closed loops without closing
them, no derivatives of one without those of the state that it begins with."""


class UnknownFunctionError(ValueError):
    """A function was chosen that a solver of the model cannot have."""


def procedures(
    system: System, reactions: bool = False, functions: Collection[str] | None = None
) -> tuple[Procedure, ...]:
    """The functions that a solver has, in the order of its header.

    Parameters
    ----------
    reactions : bool
        Reactions are among them.
    functions : collection of str, optional
        Those that are wanted, by their names, by those of members of a solver, or by `GROUPS`; left out: all, without reactions.

    Raises
    ------
    UnknownFunctionError
    """
    found = _Writer(system).all(reactions or "reactions" in (functions or ()))
    if functions is not None:
        found = chosen(found, [*functions, *(["reactions"] if reactions else [])])
    if all(p.name != ALONG_MOTIONS[0] for p in found):
        return found
    return tuple(replace(p, apart=FOUR) if p.name in ALONG_MOTIONS else p for p in found)


def chosen(found: tuple[Procedure, ...], functions: Collection[str]) -> tuple[Procedure, ...]:
    """The procedures that functions name, and those that every solver has."""
    wanted: set[str] = set()
    known = [p.called for p in found if not p.basic]
    known += [word for word, name in ALSO.items() if any(name in (p.name, p.called) for p in found)]
    together = [word for word, names in GROUPS.items() if not {p.called for p in found}.isdisjoint(names)]
    for word in functions:
        names = {ALSO.get(n, n) for n in GROUPS.get(word, (word,))}
        of_word = {p.name for p in found if p.name in names or p.called in names}
        if not of_word:
            near = difflib.get_close_matches(word, [*known, *together], 1)
            raise UnknownFunctionError(
                f"functions: the model has no function {word!r}{f'; did you mean {near[0]}?' if near else ''}; it may have "
                f"{', '.join(known)}, or together {', '.join(together)}"
            )
        wanted |= of_word | {f for f, others in NEEDED.items() if not others.isdisjoint(of_word)}
    if not wanted:
        raise UnknownFunctionError(
            f"functions: none are named; the model may have {', '.join(known)}, or together {', '.join(together)}"
        )
    return tuple(p for p in found if p.basic or p.name in wanted)


def left_out(system: System, kept: tuple[Procedure, ...]) -> list[str]:
    """What users call the functions that a solver could have but for the choice, reactions apart."""
    names = {p.name for p in kept}
    return [p.called for p in _Writer(system).all(False) if p.name not in names]


class _Writer:
    """Writes the procedures of a system: routines first, then functions by what they are about."""

    def __init__(self, system: System):
        model = system.model
        self.system = system
        self.array = arrays(system)
        names = set().union(*(e.names for e in model.expressions())) if model.bodies else set()
        self.p = ["p"] if model.parameters else []
        self.rest = self.p + (["inputs"] if model.inputs else []) + (["t"] if "t" in names else [])
        self.state = ["q", "u", *self.rest]
        self.loops = bool(model.loops)
        self.forces: tuple[Formulas, ...] = (JOINT_FORCES,) if model.forces else ()
        self.elements = bool(system.elements)
        self.measures = [MEASURES[o.measure] for o in model.outputs]
        self.formula_pivots = any(isinstance(m, RecordMeasure) and m.pivots for m in self.measures)
        self._routines()

    def of(self, *names: str) -> tuple[Array, ...]:
        """Arrays by name; seeds and derivatives begin with d."""
        return tuple(self.array[n] if n in self.array else self.array[n[1:]].tangent() for n in names)

    def one(self, name: str) -> Array:
        return self.of(name)[0]

    def pair(
        self,
        names: tuple[str, str],
        docs: tuple[str, str],
        arguments: list[str],
        results: list[str],
        steps: tuple[Step, ...],
        along: tuple[Step, ...],
        widths: tuple[int, ...] = OTHER_WIDTHS,
    ) -> list[Procedure]:
        """A function and its derivative along seeds of all arguments."""
        given, found = self.of(*arguments), self.of(*results)
        return [
            Procedure(names[0], docs[0], given, found, steps),
            Procedure(
                names[1],
                docs[1],
                given,
                (*found, *(r.tangent() for r in found)),
                along,
                tuple(a.tangent() for a in given),
                widths,
            ),
        ]

    # -- what procedures share -------------------------------------------------------------------------------------

    def _routines(self) -> None:
        u, dq, du = self.of("u", "dq", "du")
        held: tuple[Step, ...] = (Hold(u, u.called("given_u")), *run("closures")) if self.loops else ()
        start = Routine(
            "start",
            "Computes what depends on no other link: constants, sines and cosines, rotation matrices.",
            (Prepare(CONSTANTS), Prepare(GROUND), Prepare(ANGLES), *run("rotations"), *held),
        )
        self.start = Perform(start)
        self.begin: tuple[Step, ...] = (self.start, Check()) if self.loops else (self.start,)
        close = Routine(
            "close",
            "Completes the seeds: those of dependent coordinates and speeds follow from the others.",
            (
                Hold(dq, dq.called("given_dq")),
                Hold(du, du.called("given_du")),
                *run("turns", "complete"),
            ),
        )
        self.along: tuple[Step, ...] = (Perform(close),) if self.loops else ()
        self.turns = () if self.loops else run("turns")  # what closes loops begins with them
        coefficients = [c for c in (COEFFICIENTS, DRIVES) if {*c.targets} & self.system.coefficient_counts.keys()]
        known = (POSE, VELOCITY)
        self.applied: tuple[Step, ...] = ()
        self.applied_tangents: tuple[Step, ...] = ()
        if self.elements:
            applied: tuple[Step, ...] = (*coefficients, *(s for x in known for s in x.values), *run("clear", "loads"))
            self.applied = (
                Perform(Routine("applied_forces", "Forces of force elements on links.", applied)),
                Check(),
            )
            tangents: list[Step] = [c.tangents() for c in coefficients]
            tangents += [s for x in known for s in x.tangents]
            tangents += run("clear_tangents", "load_tangents")
            self.applied_tangents = (
                Perform(Routine("applied_force_tangents", "Their tangents along the seeds.", tuple(tangents))),
            )
        self.forward: tuple[Step, ...] = (
            Perform(
                Routine(
                    "forward",
                    "Forward dynamics: the three sweeps.",
                    (
                        *self.forces,
                        *self.applied[:1],
                        *run("kinematics", "triangularize"),
                        Check(),
                        *run("back_substitute"),
                    ),
                )
            ),
        )
        self.ground_tangent = Perform(
            Routine("ground_tangent", "The tangent of gravity.", (Prepare(GROUND_TANGENT, True),))
        )
        self.balance = Perform(
            Routine(
                "balance",
                "From seeds to dudot, with the factors and accelerations of the forward dynamics at hand.",
                (
                    *(f.tangents() for f in self.forces),
                    self.ground_tangent,
                    *self.turns,
                    *self.applied_tangents,
                    *run("balance_out", "balance_in", "balance_back"),
                ),
            )
        )
        tau = self.one("tau")
        self.at_rest = Perform(
            Routine(
                "at_rest",
                "Takes speeds, gravity and joint forces away: what is left of the dynamics is the mass matrix.",
                (
                    Own(u),
                    Zero(u),
                    *([Zero(tau)] if self.forces else []),
                    Prepare(GROUND_AT_REST),
                    *(run("clear") if self.elements else ()),
                ),
            )
        )
        self.mass_tangent = Perform(
            Routine(
                "mass_tangent",
                "Tangent of M x along dq and dp at fixed x = udot; force becomes M x.",
                (
                    Prepare(GROUND_TANGENT_AT_REST, True),
                    *(run("clear_tangents") if self.elements else ()),
                    *run("balance_out", "force_tangents"),
                ),
            )
        )

    def measuring(
        self, quantities: list[Quantity], before: tuple[Step, ...] = (), along: tuple[Step, ...] = ()
    ) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
        """Steps for quantities, and for them with their tangents, that were not taken before.

        `before` are steps for values, `along` those over directions that follow them.
        """
        taken = set(walk(before))
        values = tuple(s for q in quantities for s in q.values if s not in taken)
        taken |= set(walk(along))
        tangents = tuple(s for q in quantities for s in q.tangents if s not in taken)
        return values, tangents

    # -- functions -------------------------------------------------------------------------------------------------

    def all(self, reactions: bool) -> tuple[Procedure, ...]:
        found = [*self.dynamics(), self.jacobians(), *self.rates(), *self.state_rates()]
        if not self.loops:
            found += [*self.mass(), *self.inverse_dynamics()]
        found += self.energies()
        if reactions:
            found.append(self.reactions())
        if self.loops:
            found += self.closing()
        if self.system.model.initial_depends_on_parameters:
            found += self.initial()
        if self.system.model.outputs:
            found += self.outputs()
        return (*found, *self.backwards(found))

    # -- functions run backwards -----------------------------------------------------------------------------------

    def backwards(self, found: list[Procedure]) -> list[Procedure]:
        """The transposes of functions over directions, for those in `TRANSPOSED`."""
        by_name = {p.name: p for p in found}
        pairs = [(by_name.get(values), by_name.get(along)) for values, along in TRANSPOSED.items()]
        both = [(values, along) for values, along in pairs if values and along]
        # outputs that read accelerations give adjoints of their own before the balance runs backwards
        once = sum(Run("balance_in", True) in flat(along.steps) for _, along in both) == 1
        return [self.transposed(values, along, once) for values, along in both]

    def transposed(self, values: Procedure, along: Procedure, once: bool) -> Procedure:
        """From weights of the derivatives of a function's results to the gradients of what they weigh.

        The weights have the names of the derivatives, the gradients those of the seeds: adjoints are kept where the directions of
        the function over directions are. `once`: no other function runs the balance backwards, so its sweeps may run as two.
        """
        steps = [s for s in flat(along.steps) if over_directions(s)]
        swept = [s.sweep for s in steps if isinstance(s, Run)]
        assert len(set(swept)) == len(swept), "a sweep that runs twice does not leave adjoints as it should"
        together = self.together(steps) if once and along.name == TRANSPOSED["accelerations"] else {}
        scalars = tuple(Run(values_name(s)) for s in swept if values_name(s) not in together)
        weights = tuple(r for r in along.results if r.lanes)
        own = [s.array for s in steps if isinstance(s, Own)]
        stored = {"dq", "du"} if together else set()
        back: list[Step] = [Zero(s) for s in along.seeds if s.name not in stored]
        back += [step for a in own if a not in along.seeds for step in (Own(a), Zero(a))]
        for step in reversed(steps):
            match step:
                case Run():
                    name = transpose_name(step.sweep)
                    back += [Run(s, True) for s in (together.get(name, name),) if s]
                case Formulas():
                    back.append(step.transpose())
                case Prepare():
                    back.append(Prepare(GROUND_TANGENT_TRANSPOSED, True))
                case Copy():
                    back.append(Combine(step.of, (step.of, step.to)))
                case CopyEntry():
                    back.append(AddEntry(step.of, step.entry, step.to, step.index))
                case Own() | Zero() | Hold() | Check():  # memory, which is zero at the beginning here
                    pass
                case _:
                    raise TypeError(f"{along.name}: a {type(step).__name__} cannot be run backwards")
        dependent: dict[str, tuple[int, ...]] = {}
        if self.loops:
            independent = dict(zip(("q", "u"), self.system.independent, strict=True))
            dependent = {
                n: tuple(sorted(set(range(self.array[n].size)) - set(free))) for n, free in independent.items()
            }
        runs = {s.sweep for s in back if isinstance(s, Run)}
        if all(link.joint.quaternion is None for link in self.system.links):
            runs.discard(transpose_name("turns"))  # has nothing to do
        back.insert(0, Prepare(PASSING_ADJOINTS if together and runs <= ALONE else ADJOINTS, True))
        for seed in along.seeds:
            if GRADIENT_IN_CLOSED in runs and seed.name in stored:
                continue
            if dependent.get(seed.name[1:]):
                back.append(ZeroEntries(seed, dependent[seed.name[1:]]))
        name = along.name.removesuffix("_sensitivities")
        return Procedure(
            f"{along.name}_transposed",
            f"{values.doc.rstrip('.')}, and gradients of their weighted sums (the transpose of {along.name}).",
            along.arguments,
            (*(r for r in along.results if not r.lanes), *along.seeds),
            (
                *values.steps,
                Perform(Routine(f"{name}_scalars", "Scalars that sweeps over directions hand on.", scalars)),
                *([Check()] if any(isinstance(s, Check) for s in steps) else []),
                Perform(
                    Routine(f"{name}_backwards", f"The steps of {along.name} over directions, backwards.", tuple(back))
                ),
                *([Check(True)] if self.formula_pivots and OUTPUTS.tangents() in steps else []),
            ),
            weights,
            OTHER_WIDTHS,
            GRADIENTS[values.name],
        )

    def together(self, steps: list[Step]) -> dict[str, str]:
        """Sweeps that run in others, with the sweep that is run at their place, if any: see `sweeps.GRADIENT_OUT`.

        The completion of seeds is among them where nothing but gravity comes between it and the balance.
        """
        runs = [s.sweep if isinstance(s, Run) else "" for s in steps if s != Prepare(GROUND_TANGENT, True)]
        closed = ("complete", "balance_out") in pairwise(runs)
        found = {
            values_name("balance_out"): "",
            values_name("balance_in"): "",
            transpose_name("balance_in"): GRADIENT_OUT,
            transpose_name("balance_out"): GRADIENT_IN_CLOSED if closed else GRADIENT_IN,
        }
        return found | ({transpose_name("complete"): ""} if closed else {})

    def dynamics(self) -> list[Procedure]:
        equations = "Eqs. 18-24, 30-56" if self.loops else "Eqs. 18-24, 42-56"
        return self.pair(
            ("accelerations", "sensitivities"),
            (
                f"Forward dynamics ({equations}).",
                "Forward dynamics and its total derivative along seeds (Eqs. 9, 10, by the balance).",
            ),
            self.state,
            ["udot"],
            (*self.begin, *self.forward),
            (*self.begin, *self.forward, *self.along, self.balance),
            WIDTHS,
        )

    def jacobians(self) -> Procedure:
        dudot = self.one("dudot")
        free = dict(zip(("q", "u"), self.system.independent, strict=True)) if self.loops else {}
        seeds = {n: self.one(f"d{n}") for n in self.state}
        if self.loops:
            seeds |= {n: seeds[n].called(f"given_d{n}") for n in ("q", "u")}
        steps: list[Step] = [*self.begin, *self.forward, Own(dudot)]
        for seed in seeds.values():
            steps += [Own(seed), Zero(seed)]
        for n, seed in seeds.items():
            among = tuple(free[n]) if n in free else None
            steps.append(Columns(seed, (*self.along, self.balance), (Take(self.one(f"J_{n}"), dudot),), among))
        results = self.of("udot", *(f"J_{n}" for n in self.state))
        doc = "Accelerations and their partial derivatives, row by row."
        return Procedure("jacobians", doc, self.of(*self.state), results, tuple(steps))

    def rates(self) -> list[Procedure]:
        begin = self.begin if self.loops else run("rotations")
        return self.pair(
            ("coordinate_rates", "coordinate_rate_sensitivities"),
            ("Time derivatives of the coordinates (Eq. 1).", "Their total derivative along seeds."),
            ["q", "u", *(self.p if self.loops else [])],
            ["qdot"],
            (*begin, *run("rates")),
            (*begin, *self.along, *self.turns, *run("rate_tangents")),
        )

    def state_rates(self) -> list[Procedure]:
        """What integration over time asks for at every stage, in one call."""
        begin = (*self.begin, *run("rates"), *self.forward)
        return self.pair(
            ("state_rates", "state_rate_sensitivities"),
            (
                "Time derivatives of coordinates and speeds, for integration over time (Eq. 1 and forward dynamics).",
                "The same and their total derivative along seeds (Eqs. 2, 3).",
            ),
            self.state,
            ["qdot", "udot"],
            begin,
            (*begin, *self.along, self.balance, *run("rate_tangents")),
        )

    def mass(self) -> list[Procedure]:
        udot, force, du, dforce, b, x = self.of("udot", "force", "du", "dforce", "b", "x")
        dM, M, dx, db, dudot = self.of("dM", "M", "dx", "db", "dudot")
        right = b.tangent("b")  # the sweeps that solve take right sides and give solutions per direction
        resting: tuple[Step, ...] = (self.start, self.at_rest, *run("kinematics"))
        factors: tuple[Step, ...] = (*resting, *run("triangularize"), Check())
        solve = run("solve_in", "balance_back")
        at_rest: tuple[Step, ...] = (Own(du), Zero(du), Own(dforce), *run("turns"))
        return [
            *self.pair(
                ("mass_matrix", "mass_matrix_sensitivities"),
                ("Mass matrix, row by row.", "Mass matrix and its total derivative along seeds."),
                ["q", *self.p],
                ["M"],
                (
                    self.start,
                    Own(right),
                    Zero(right),
                    Own(dforce),
                    Columns(right, run("mass_out", "mass_in"), (Take(M, dforce, symmetric=True),)),
                ),
                (
                    *resting,
                    Own(udot),
                    Zero(udot),
                    Own(force),
                    *at_rest,
                    Columns(udot, (self.mass_tangent,), (Take(M, force), Take(dM, dforce))),
                ),
            ),
            *self.pair(
                ("solve_mass", "solve_mass_sensitivities"),
                ("Solution of M x = b in O(n).", "Solution of M x = b and its total derivative along seeds."),
                ["q", *self.p, "b"],
                ["x"],
                (*factors, Single(solve, ((right, b),), ((dudot, x),))),
                (
                    *factors,
                    Single(solve, ((right, b),), ((dudot, x),)),
                    Bind(udot, x),
                    Own(force),
                    *at_rest,
                    self.mass_tangent,
                    Combine(dforce, (db,), (dforce,)),
                    Bind(right, dforce),
                    Bind(dudot, dx),
                    *solve,
                ),
            ),
        ]

    def inverse_dynamics(self) -> list[Procedure]:
        force, tau, dforce, dtau, dudot = self.of("force", "tau", "dforce", "dtau", "dudot")
        right, held = dudot.called("b"), dforce.called("held")
        less: tuple[Step, ...] = ()
        less_along: tuple[Step, ...] = (Combine(dforce, (held, dforce)),)
        if self.forces:
            less = (Zero(tau), JOINT_FORCES, Combine(force, (force,), (tau,)))
            less_along = (
                Zero(tau),
                Zero(dtau),
                JOINT_FORCES,
                JOINT_FORCES.tangents(),
                Combine(force, (force,), (tau,)),
                Combine(dforce, (held, dforce), (dtau,)),
            )
        begin: tuple[Step, ...] = (self.start, *self.applied, *run("kinematics"))
        return self.pair(
            ("inverse_dynamics", "inverse_dynamics_sensitivities"),
            (
                "Joint forces that udot needs beside the model's own.",
                "Those forces and their total derivative along seeds.",
            ),
            ["q", "u", "udot", *self.rest],
            ["force"],
            (*begin, *run("newton_euler_out", "newton_euler_in"), *less),
            (
                *begin,
                self.ground_tangent,
                *run("turns"),
                *self.applied_tangents,
                *run("balance_out", "force_tangents"),
                Own(held),
                Copy(held, dforce),
                Bind(right, dudot),
                *run("mass_out", "mass_in"),
                *less_along,
            ),
        )

    def energies(self) -> list[Procedure]:
        model = self.system.model
        energy, denergy = self.of("energy", "denergy")
        quantities = measured(self.system, (), range(len(ENERGIES)))
        values, tangents = self.measuring(quantities)
        read = set[str]().union(*(e.names for x in model.loads if x.has_energy for e in x.coefficients))
        more = [*(["inputs"] if read & set(model.inputs) else []), *(["t"] if "t" in read else [])]
        check = (Check(True),) if any(q.pivots for q in quantities) else ()
        return self.pair(
            ("energies", "energy_sensitivities"),
            ("Kinetic and potential energy.", "Energies and their total derivative along seeds."),
            ["q", "u", *self.p, *more],
            ["energy"],
            (Zero(energy), *self.begin, *values),
            (Zero(energy), *self.begin, Zero(denergy), *self.along, *self.turns, *tangents, *check),
        )

    def outputs(self) -> list[Procedure]:
        outputs, doutputs, energy, denergy, udot = self.of("outputs", "doutputs", "energy", "denergy", "udot")
        read: set[str] = set()
        for o, m in zip(self.system.model.outputs, self.measures, strict=True):
            if isinstance(m, RecordMeasure):
                read |= {*m.reads, *m.also(o)}
        quantities = measured(self.system, read, {m.entry for m in self.measures if isinstance(m, EnergyMeasure)})
        sums = [energy] if any(q.energy for q in quantities) else []
        sums += [self.one(name) for q in quantities for name in q.sums]
        zero = tuple(step for a in sums for step in (Own(a), Zero(a)))
        zero_along = tuple(step for a in sums for step in (Own(a.tangent()), Zero(a.tangent())))
        before: tuple[Step, ...] = self.begin
        along: tuple[Step, ...] = (*self.along, *self.turns)
        if any(q.dynamics for q in quantities):
            before = (*before, Own(udot), *self.forward)
            along = (*self.along, Own(udot.tangent()), self.balance)
        values, tangents = self.measuring(quantities, before, along)
        copies: list[Step] = []
        copies_along: list[Step] = []
        for i, measure in enumerate(self.measures):
            if isinstance(measure, EnergyMeasure):
                copies.append(CopyEntry(outputs, i, energy, measure.entry))
                copies_along.append(CopyEntry(doutputs, i, denergy, measure.entry))
        check = (Check(True),) if self.formula_pivots or any(q.pivots for q in quantities) else ()
        return self.pair(
            ("outputs", "output_sensitivities"),
            ("The outputs of the model.", "Outputs and their total derivative along seeds."),
            self.state,
            ["outputs"],
            (*zero, *before, *values, OUTPUTS, *copies),
            (
                *zero,
                *before,
                *zero_along,
                *along,
                *tangents,
                OUTPUTS,
                OUTPUTS.tangents(),
                *copies,
                *copies_along,
                *check,
            ),
        )

    def reactions(self) -> Procedure:
        wrenches = self.of("reaction", *(["loop_reaction"] if self.loops else []))
        before: tuple[Step, ...] = (*self.begin, Own(self.one("udot")), *self.forward)
        return Procedure(
            "reactions",
            "Wrenches on links at their joints and on loops' end faces: moment, force; ground frame.",
            self.of(*self.state),
            wrenches,
            (*map(Zero, wrenches[1:]), *before, *missing((POSE,), before), *run("motion", "transmitted")),
        )

    def closing(self) -> list[Procedure]:
        u, full_u, dfull_q, dfull_u, dq, du = self.of("u", "full_u", "dfull_q", "dfull_u", "dq", "du")
        position, velocity, dposition, step = self.of("position", "velocity", "dposition", "step")
        condition = self.one("condition")
        given = u.called("given_u")
        state, seeds = self.of("q", "u", *self.p), self.of("dq", "du", *(["dp"] if self.p else []))
        places = self.of("q", *self.p)
        return [
            Procedure(
                "closure",
                "Scaled residuals of all loops, of position and velocity.",
                state,
                (position, velocity),
                (Tolerate(), self.start, *run("residuals")),
                basic=True,
            ),
            Procedure(
                "conditions",
                "Condition number of the closure matrix that each loop belongs to.",
                places,
                (condition,),
                (Own(given), Zero(given), *self.begin, *run("condition_numbers")),
                basic=True,
            ),
            Procedure(
                "newton_step",
                "Newton's step of the dependent coordinates towards closure.",
                places,
                (step,),
                (Zero(step), Own(given), Zero(given), *self.begin, *run("correct")),
                basic=True,
            ),
            Procedure(
                "closing_step",
                "The same, the scaled residuals of position before it, and the condition numbers.",
                places,
                (step, position, condition),
                (
                    *(Zero(step), Own(given), Zero(given), *self.begin, Own(velocity)),
                    *run("residuals", "correct", "condition_numbers"),
                ),
            ),
            Procedure(
                "completion",
                "Speeds, the dependent ones as velocity closure asks.",
                state,
                (full_u,),
                (*self.begin, Copy(full_u, u)),
                basic=True,
            ),
            Procedure(
                "completion_sensitivities",
                "Speeds and seeds, the dependent ones as closure asks.",
                state,
                (full_u, dfull_q, dfull_u),
                (*self.begin, *self.along, Copy(full_u, u), Copy(dfull_q, dq), Copy(dfull_u, du)),
                seeds,
                OTHER_WIDTHS,
                "assemble_sensitivities",
            ),
            Procedure(
                "closure_sensitivities",
                "How far loops are open in position, and by how much complete seeds open them.",
                state,
                (position, dposition),
                (
                    *self.begin,
                    Own(velocity),
                    *run("residuals"),
                    *self.along,
                    Zero(dposition),
                    *run("seed_residuals"),
                ),
                seeds,
                OTHER_WIDTHS,
                basic=bool(self.system.partition and self.system.partition.opening),
            ),
        ]

    def initial(self) -> list[Procedure]:
        results = self.of("q", "u")
        bound: tuple[Step, ...] = tuple(Bind(r.called(f"initial_{r.name}"), r) for r in results)
        along: tuple[Step, ...] = tuple(Bind(r.tangent(f"dinitial_{r.name}"), r.tangent()) for r in results)
        values, tangents = self.pair(
            ("initial", "initial_sensitivities"),
            (
                "Initial values, as the model file gives them: loops not closed yet.",
                "Initial values and their total derivative along seeds.",
            ),
            ["p"],
            ["q", "u"],
            (*bound, INITIAL),
            (*bound, *along, INITIAL, INITIAL.tangents()),
        )
        return [replace(values, basic=True), tangents]


ALONE = {transpose_name("balance_back"), GRADIENT_OUT, GRADIENT_IN, GRADIENT_IN_CLOSED}
"""The sweeps of the balance's transpose. Where no others come after them, what they kept needs no clearing."""


def sweeps(found: tuple[Procedure, ...]) -> set[str]:
    """Sweeps that procedures run."""
    return {s.sweep for p in found for s in walk(p.steps) if isinstance(s, Run)}


def checked_backwards(found: tuple[Procedure, ...]) -> set[str]:
    """Sweeps over directions that meet pivots which values do not meet."""
    checking = [p for p in found if any(isinstance(s, Check) and s.lanes for s in p.steps)]
    return {s.sweep for p in checking for s in walk(p.steps) if isinstance(s, Run) and s.lanes}


def swept_backwards(found: tuple[Procedure, ...]) -> list[str]:
    """Sweeps whose transposes procedures run."""
    run = sweeps(found)
    if GRADIENT_OUT in run:
        run |= {transpose_name(s) for s in ("balance_out", "balance_in")}
    if GRADIENT_IN_CLOSED in run:
        run.add(transpose_name("complete"))
    return [s.name for s in SWEEPS if s.lanes and transpose_name(s.name) in run]


def swept_together(found: tuple[Procedure, ...]) -> tuple[set[str], bool]:
    """Sweeps of the balance's transpose that procedures run, and whether no others come after them."""
    run = sweeps(found)
    assert not {GRADIENT_OUT, transpose_name("balance_in")} <= run, "what runs as one is no longer there one by one"
    alone = any(s == Prepare(PASSING_ADJOINTS, True) for p in found for s in walk(p.steps))
    return run & ALONE if GRADIENT_OUT in run else set(), alone
