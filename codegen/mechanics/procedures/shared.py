"""Steps and routines shared by the procedures of one system."""

from __future__ import annotations

from ...program.procedure import (
    ANGLES,
    CONSTANTS,
    GROUND,
    GROUND_AT_REST,
    GROUND_TANGENT,
    GROUND_TANGENT_AT_REST,
    Array,
    Check,
    Formulas,
    Hold,
    Own,
    Perform,
    Prepare,
    Procedure,
    Routine,
    Step,
    Zero,
    ZeroEntries,
    walk,
)
from ..outputs import MEASURES, RecordMeasure
from ..quantities import COEFFICIENTS, DRIVES, POSE, VELOCITY, Quantity, run
from ..structure.system import System
from .words import HELD_FORCES, JOINT_FORCES, MOTIONS, OTHER_WIDTHS, arrays


class Shared:
    """The arrays of a system, and the routines that its procedures call."""

    def __init__(self, system: System):
        model = system.model
        self.system = system
        self.array = arrays(system)
        names = set().union(*(e.names for e in model.expressions())) if model.bodies else set()
        rest = [*(["inputs"] if model.inputs else []), *(["t"] if "t" in names else [])]
        given = ["p"] if model.parameters else []
        read = set[str]().union(*(x.value.names for x in model.prescribed))
        of_motion = {"inputs": not read.isdisjoint(model.inputs), "t": "t" in read}
        self.p = given + [n for n in rest if of_motion[n]]
        """Arguments other than coordinates on which poses depend: parameters, and the inputs or time of prescribed
        motion."""
        self.rest = given + rest
        self.state = ["q", "u", *self.rest]
        self.loops = bool(model.loops)
        self.forces: tuple[Formulas, ...] = (JOINT_FORCES,) if model.forces else ()
        self.held: tuple[Formulas, ...] = (HELD_FORCES,) if system.held else ()
        self.motions: tuple[Formulas, ...] = (MOTIONS,) if model.prescribed else ()
        self.elements = bool(system.elements)
        self.measures = [MEASURES[o.measure] for o in model.outputs]
        self.formula_pivots = any(isinstance(m, RecordMeasure) and m.pivots for m in self.measures)
        self._begin()
        self._apply()
        self._solve()
        self._rest()

    def of(self, *names: str) -> tuple[Array, ...]:
        """The arrays with the given names; names of seeds and derivatives begin with d."""
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
        """A function, and the function for its derivative along seeds of all arguments."""
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

    # -- steps that procedures share -------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Steps that run before the sweeps, and steps that run before sweeps over directions."""
        u, dq, du = self.of("u", "dq", "du")
        held: tuple[Step, ...] = (Hold(u, u.called("given_u")), *run("closures")) if self.loops else ()
        motions = tuple(m.tangents() for m in self.motions)
        self.start = performed(
            "start",
            "Computes quantities of single links: constants, sines and cosines, rotation matrices.",
            (Prepare(CONSTANTS), Prepare(GROUND), *self.motions, Prepare(ANGLES), *run("rotations"), *held),
        )
        self.begin: tuple[Step, ...] = (self.start, Check()) if self.loops else (self.start,)
        close = performed(
            "close",
            "Completes the seeds: entries of dependent coordinates and speeds follow from the others.",
            (Hold(dq, dq.called("given_dq")), Hold(du, du.called("given_du")), *motions, *run("turns", "complete")),
        )
        self.along: tuple[Step, ...] = (close,) if self.loops else ()
        # the completion of seeds begins with these sweeps
        self.turns: tuple[Step, ...] = () if self.loops else (*motions, *run("turns"))
        self.ground_tangent = performed("ground_tangent", "The tangent of gravity.", (Prepare(GROUND_TANGENT, True),))

    def _apply(self) -> None:
        """Steps that apply the forces of force elements."""
        counts = self.system.coefficient_counts
        coefficients = self.coefficients = [c for c in (COEFFICIENTS, DRIVES) if {*c.targets} & counts.keys()]
        known = (POSE, VELOCITY)
        applied: tuple[Step, ...] = (*coefficients, *(s for x in known for s in x.values), *run("clear", "loads"))
        tangents: tuple[Step, ...] = (*(c.tangents() for c in coefficients), *(s for x in known for s in x.tangents))
        self.applied: tuple[Step, ...] = ()
        self.applied_tangents: tuple[Step, ...] = ()
        if self.elements:
            self.applied = (performed("applied_forces", "Forces of force elements on links.", applied), Check())
            tangents = (*tangents, *run("clear_tangents", "load_tangents"))
            self.applied_tangents = (performed("applied_force_tangents", "Their tangents along the seeds.", tangents),)

    def _solve(self) -> None:
        """Routines for forward dynamics and for its derivative."""
        forces = (*self.forces, *self.held)
        sweeps: tuple[Step, ...] = (*run("kinematics", "triangularize"), Check(), *run("back_substitute"))
        steps: tuple[Step, ...] = (*forces, *self.applied[:1], *sweeps)
        self.forward: tuple[Step, ...] = (performed("forward", "Forward dynamics: the three sweeps.", steps),)
        before: tuple[Step, ...] = (
            *(f.tangents() for f in forces),
            self.ground_tangent,
            *self.turns,
            *self.applied_tangents,
        )
        self.seeded = performed(
            "seeded", "Tangents of forces and of other quantities that udot does not enter.", before
        )
        self.balance = performed(
            "balance",
            "Computes dudot from the seeds, with the factors and accelerations of the forward dynamics.",
            (*before, *run("balance_out", "balance_in", "balance_back")),
        )
        udot = self.one("udot")
        self.solved: tuple[Step, ...] = (*self.begin, Own(udot), *self.forward)
        """Steps that compute accelerations in separate memory; `solved_along` contains the steps for their
        derivatives."""
        self.solved_along: tuple[Step, ...] = (*self.along, Own(udot.tangent()), self.balance)

    def _rest(self) -> None:
        """Routines that reduce the dynamics to ``M udot``, and the tangent of this product."""
        u, tau, motion = self.of("u", "tau", "prescribed")
        moving = tuple(i for i in range(motion.size) if i % 3)  # rates and accelerations of prescribed coordinates
        stopped = (ZeroEntries(motion, moving),) if moving else ()
        stopped_along = (ZeroEntries(motion.tangent(), moving),) if moving else ()
        forces: tuple[Step, ...] = (*((Zero(tau),) if self.forces else ()), Prepare(GROUND_AT_REST))
        self.at_rest = performed(
            "at_rest",
            "Sets speeds, gravity and applied forces to zero, so that the joint forces are M udot.",
            (Own(u), Zero(u), *stopped, *forces, *(run("clear") if self.elements else ())),
        )
        cleared: tuple[Step, ...] = (
            Prepare(GROUND_TANGENT_AT_REST, True),
            *(run("clear_tangents") if self.elements else ()),
        )
        self.mass_tangent = performed(
            "mass_tangent",
            "Tangent of M x along dq and dp at fixed x = udot; the result force is M x.",
            (*stopped_along, *cleared, *run("inverse_out", "force_tangents")),
        )

    def measuring(
        self, quantities: list[Quantity], before: tuple[Step, ...] = (), along: tuple[Step, ...] = ()
    ) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
        """Steps that compute quantities, without and with tangents, except steps that have run already.

        `before`: steps that have computed values already; `along`: steps over directions that have run already.
        """
        taken = set(walk(before))
        values = tuple(s for q in quantities for s in q.values if s not in taken)
        taken |= set(walk(along))
        tangents = tuple(s for q in quantities for s in q.tangents if s not in taken)
        return values, tangents


def performed(name: str, doc: str, steps: tuple[Step, ...]) -> Perform:
    """A step that runs a routine of the given steps."""
    return Perform(Routine(name, doc, steps))
