"""Steps of products with second derivatives for models with loops; see `codegen.mechanics.second_order`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ...program.procedure import (
    ADJOINT_TANGENTS,
    ADJOINT_VALUES,
    GROUND_GRADIENT,
    GROUND_TWICE,
    KEPT_ADJOINTS,
    RESTORED_ADJOINTS,
    Array,
    Bind,
    Combine,
    Copy,
    Formulas,
    Own,
    Perform,
    Prepare,
    Run,
    Single,
    Step,
    Zero,
    ZeroEntries,
)
from ..quantities import DRIVES, run
from ..second_order import varying_of_ground
from ..structure.kinds import EarKind
from ..sweeps import OF_MASS, TOGETHER, adjoint_name, along_name, back_name, backward_in_loops, mass_name
from .shared import Shared, performed

MULTIPLIERS = run("multipliers_out", "multipliers_in")
"""Sweeps that solve for multipliers of the loops' conditions."""

RESPONSE = run("response_out", "response_in", "balance_back", "response_forces", "response_multipliers")
"""Sweeps that solve for accelerations and multipliers, with right sides of the equations of motion and of the loops'
conditions."""

VIRTUAL = run("virtual_out", "virtual_in", *(s.sweep for s in RESPONSE[2:]))
"""Sweeps that solve the same equations if the right sides of the loops' conditions are zero."""

POSES = ("rotations", "pose")
"""Sweeps on which all other sweeps depend."""

KEPT, RESTORED = (Prepare(KEPT_ADJOINTS),), (Prepare(RESTORED_ADJOINTS),)
"""Steps that copy the adjoints of links and loops, and steps that copy them back."""

WITH_WRENCHES = ("clear_wrenches", "wrenches", "tree_forces")


class WithLoops:
    """The steps for the Hessian of ``w . udot`` in models with loops; `adjoints` and `along` return them in running order.

    The Lagrangian is ``w . udot + z . (r + E^T W) + y . (acceleration conditions) + n . (velocity conditions) + k . (position
    conditions)``. Multipliers z and y make it stationary in udot and the wrenches W, n in dependent speeds, k in dependent
    coordinates.
    """

    def __init__(
        self,
        w: Shared,
        formulas: list[Formulas],
        bars: list[Array],
        ends: tuple[Array, ...] = (),
        of: str = "",
        driving: bool = False,
    ):
        """`ends`: result arrays for the gradient with respect to each argument; empty if the gradient is no result.

        `of`: suffix of the names of the routines. If it is not empty, contributions of outputs to gradients and to adjoints
        of formulas have been computed before. `driving`: whether forces of prescribed motion have weights.
        """
        self.w, self.formulas, self.bars, self.ends = w, formulas, bars, ends
        self.of, self.driving = of, driving
        # formulas that read coordinates or speeds: loops move dependent ones, so their gradients enter the multipliers
        self.forces = (*w.forces, *(c for c in w.coefficients if c is DRIVES), *(w.held if driving else ()))
        quaternions = any(link.joint.quaternion is not None for link in w.system.links)
        self.sweeps = [
            *(["rotations"] if quaternions else []),
            *("pose", "velocities"),
            *(["clear", "loads"] if w.elements else []),
            *("tree_motion", *WITH_WRENCHES),
        ]
        self.of_values = [*self.sweeps]
        self.sweeps += [*(["driving_in_loops"] if driving else []), "acceleration_gaps", "rate_gaps", "gaps"]
        self.of_mass = (*(["driving_in_loops"] if driving else []), *OF_MASS)
        self.b, self.udot, self.dudot, self.force = w.of("b", "udot", "dudot", "force")
        self.right, self.force_bar = self.b.tangent("b"), self.force.called("force_bar")
        position = w.one("position")
        self.multiplier = position.called("multiplier")
        self.found = self.multiplier.tangent()
        self.gap_right = position.tangent("gap_b")
        self.gaps = [position.called(f"{name}_bar") for name in ("acceleration_gap", "rate_gap", "gap")]
        self.gradient = dict(zip(w.state if ends else ("q", "u"), w.of(*(f"g{n}" for n in w.state)), strict=False))
        """Arrays to which adjoints of blocks add, by the name of the argument; those of formulas are not among them."""
        self.gq, self.gu = self.gradient["q"], self.gradient["u"]
        self.udot_bar = self.udot.called("udot_bar")
        self.multiplier_bar = position.called("multiplier_bar")
        self.along_coordinates = self.udot.called("coordinate_force")
        self.side = self.udot.called("side")
        closures = [c for kind in w.system.unit_kinds if isinstance(kind, EarKind) for c in kind.closures]
        self.moved_by_velocities = w.elements or any(c.slides for c in closures)
        """Whether forces or conditions in acceleration depend on the velocities of links."""
        again = ("q", *(("u", "p") if ends else ()))
        self.propagated = [*(self.gradient[n] for n in again if n in self.gradient)]
        self.propagated += [b for b in bars if b.name == "prescribed_bar"]
        """Arrays to which adjoints of velocities and poses add."""
        self.sweeps_of_accelerations = [s for s in self.sweeps if s not in (*POSES, "velocities", "rate_gaps", "gaps")]

    # -- values ----------------------------------------------------------------------------------------------------

    def adjoints(self, weights: Array, virtual: Array) -> list[Step]:
        """Steps for the multipliers and adjoints of one vector of weights.

        Adjoints of velocities and of poses add up from link to link. The sweeps that propagate them run first without the
        multipliers of conditions on velocities or positions, which follow from the result. Then the adjoints are reset
        from a copy, and the sweeps run again with these multipliers.
        """
        force_bar = self.force_bar
        solved = self.multiplier.called("response_multiplier")
        acceleration_gap, rate_gap, gap = self.gaps
        motion = [*map(Own, (solved, virtual)), *self._virtual_motion(weights, virtual, solved)]
        return [
            *(motion if self.of else self.values(motion)),
            Combine(force_bar, (), (virtual,)),
            Combine(acceleration_gap, (), (solved,)),
            *([] if self.of else self._no_gradient()),
            *(Own(a.called(f"kept_{a.name}")) for a in self.propagated),
            self._back("accelerations", self.sweeps_of_accelerations, (Prepare(ADJOINT_VALUES),)),
            *self._formula_gradients(),
            *([*self.kept, self._back("loads", ["velocities"], KEPT)] if self.moved_by_velocities else []),
            *self._single(self.gu, rate_gap),
            *(self.restored if self.moved_by_velocities else ()),
            self._back("velocities", ["rate_gaps", "velocities"], RESTORED if self.moved_by_velocities else (), KEPT),
            *self.kept,
            self._back("poses", POSES),
            *run("coordinate_forces"),
            *self._single(self.along_coordinates, gap),
            *self.restored,
            self._back("values", ["gaps", *POSES], RESTORED),
            *self._rest_of_gradient(),
        ]

    def values(self, first: Iterable[Step] = ()) -> list[Step]:
        """The steps `first`, then steps for motions, forces and wrenches of the tree with the loops cut."""
        return [
            *map(Own, (self.multiplier, self.force, self.force_bar, self.side, self.along_coordinates, *self.gaps)),
            *run("multiplier_gains"),
            *first,
            performed(
                "tree_values",
                "Motions of the links, and joint forces of the tree with the loops cut.",
                run("tree_outward", "tree_forces"),
            ),
            *self._single(self.force, self.multiplier),
            performed("tree_wrenches", "Wrenches of the loops, and the joint forces with them.", run(*WITH_WRENCHES)),
        ]

    def _virtual_motion(self, weights: Array, virtual: Array, solved: Array) -> list[Step]:
        """Steps for the virtual motion and its multipliers, for weights of udot and, with `driving`, of the wrenches."""
        right, found = ((self.right, weights),), ((self.dudot, virtual), (self.found, solved))
        if self.driving:
            return [Single(RESPONSE, (*right, (self.gap_right, self.multiplier_bar)), found)]
        return [Single(VIRTUAL, right, found)]

    def _no_gradient(self) -> list[Step]:
        """Steps that set the gradient and the adjoints of formulas to zero before blocks add to them."""
        return [
            *map(Own, self.bars),
            *(map(Bind, self.gradient.values(), self.ends) if self.ends else map(Own, self.gradient.values())),
            *map(Zero, (*self.gradient.values(), *self.bars)),
        ]

    def _single(self, of: Array, to: Array) -> list[Step]:
        """Steps for multipliers `to` that balance the forces `of` along the dependent degrees of freedom."""
        return [Combine(self.side, (), (of,)), Single(MULTIPLIERS, ((self.right, self.side),), ((self.found, to),))]

    def _back(
        self, which: str, sweeps: Iterable[str], before: tuple[Step, ...] = (), after: tuple[Step, ...] = ()
    ) -> Perform:
        """The step that runs the adjoints of some sweeps, between the steps `before` and `after`."""
        back = (Run(adjoint_name(s)) for s in reversed(self.sweeps) if s in sweeps)
        doc = f"Adjoints of the inverse dynamics and of the loops' conditions, up to {which}."
        return performed(f"adjoints_of_{which}{self.of}", doc, (*before, *back, *after))

    @property
    def kept(self) -> tuple[Step, ...]:
        """Steps that copy the arrays `propagated` before the sweeps that run twice add to them for the first time."""
        return tuple(Copy(a.called(f"kept_{a.name}"), a) for a in self.propagated)

    @property
    def restored(self) -> tuple[Step, ...]:
        """Steps that reset the arrays `propagated` from the copies."""
        return tuple(Copy(a, a.called(f"kept_{a.name}")) for a in self.propagated)

    def _formula_gradients(self) -> list[Step]:
        """Adds the contributions of `forces` to the gradient; each has arrays of its own, as `transposed` may assign."""
        found: list[Step] = []
        for f in self.forces:
            into = {n: self.w.one(n).called(f"{f.targets[0]}_g{n}") for n in self.w.state}
            found += [step for a in into.values() for step in (Own(a), Zero(a))]
            found += transposed(self.w, [f], self.bars, tuple(into.values()))
            found += [Combine(a, (a, into[n])) for n, a in self.gradient.items()]
        return found

    def _rest_of_gradient(self) -> list[Step]:
        """Adds the contributions of all other formulas and of gravity, if the function has the gradient as a result.

        Entries of dependent coordinates are not set to zero: tangents of `coordinate_forces` read them.
        """
        if not self.ends:
            return []
        rest = [f for f in self.formulas if f not in self.forces]
        return [*transposed(self.w, rest, self.bars, tuple(self.gradient.values())), *ground_gradient(self.w)]

    # -- along directions ------------------------------------------------------------------------------------------

    def along(self, gradient: tuple[Array, ...], given: tuple[Array, ...] = ()) -> list[Step]:
        """Steps for the tangents of all multipliers and adjoints: the change of the gradient.

        `given`: tangents of the weights and of udot, if they are arguments of the function.
        """
        coordinates, (_, *dgaps) = self.along_coordinates.tangent(), [a.tangent() for a in self.gaps]
        dgq, dgu = gradient[:2]
        rotations = [along_name(adjoint_name(s)) for s in self.sweeps if s == "rotations"]
        rest = tuple(replace(f, lanes=True, twice=True) for f in self.formulas if f not in self.forces)
        forces = tuple(replace(f, lanes=True, twice=True) for f in self.forces)
        return [
            *self._tangents(given),
            *self._no_gradient_along(gradient),
            performed(
                f"tangents_of_adjoints{self.of}",
                "Tangents of the adjoints for the multipliers known so far: the change of the gradient.",
                (*self._quadratic(), *forces),
            ),
            *self._solved(dgu, dgaps[0]),
            performed(
                "tangents_of_poses",
                "Adds the change with the multipliers of conditions on velocities, and tangents of the adjoints of poses.",
                (
                    *(Run(s, True) for s in (back_name("rate_gaps"), "poses_inward", *rotations)),
                    Prepare(GROUND_TWICE, True),
                ),
            ),
            *run_along("coordinate_forces"),
            *self._solved(coordinates, dgaps[1]),
            changed("positions", "gaps", *(s for s in reversed(POSES) if s in self.sweeps)),
            *rest,
            *run_along("tangential_gradients"),
            *(ZeroEntries(a, e) for a, e in zip((dgq, dgu), self._dependent(), strict=True) if e),
        ]

    def _no_gradient_along(self, gradient: tuple[Array, ...]) -> list[Step]:
        """Steps that set the tangents of the gradient and of adjoints of formulas to zero before blocks add to them."""
        return [] if self.of else [Zero(a) for a in (*gradient, *(a.tangent() for a in self.bars))]

    def _quadratic(self) -> tuple[Run, ...]:
        """Tangents of the adjoints of all sweeps except the sweeps of poses."""
        names = [along_name(adjoint_name(s)) for s in backward_in_loops(self.sweeps) if s not in POSES]
        if not self.w.elements:
            names = [*(n for n in names if n not in TOGETHER["adjoints_inward"]), "adjoints_inward"]
        return tuple(Run(s, True) for s in names)

    def _values_along(self) -> tuple[Step, ...]:
        """Steps for tangents of values at fixed multipliers, and of ``M z + E^T y`` and ``E z`` at fixed z and y."""
        zero = tuple(Zero(a.tangent()) for a in (self.udot_bar, self.multiplier_bar))
        if self.w.elements:  # loads depend on velocities, and accelerations on loads
            names = [*map(along_name, self.of_values), *map(mass_name, self.of_mass)]
        else:
            rotations = [along_name(s) for s in self.of_values if s == "rotations"]
            joined = {*TOGETHER["tangents_outward"], *TOGETHER["tangents_inward"]}
            driving, of_mass = self.of_mass[: -len(OF_MASS)], map(mass_name, OF_MASS)
            of_loops = [along_name("wrenches"), *(n for n in of_mass if n not in joined)]
            names = [*map(mass_name, driving), *rotations, "tangents_outward", *of_loops, "tangents_inward"]
        return (Prepare(ADJOINT_TANGENTS, True), *zero, *(Run(s, True) for s in names))

    @property
    def solution(self) -> tuple[Run, ...]:
        """Steps that solve for the virtual motion and its multipliers, with ``b`` and ``gap_b`` as right sides."""
        return RESPONSE

    def _tangents(self, given: tuple[Array, ...]) -> list[Step]:
        """Tangents of values, of the wrenches, and of the virtual motion."""
        found_dudot = self.dudot.called("found_dudot")
        of_mass, of_gaps = self.udot_bar.tangent(), self.multiplier_bar.tangent()
        dforce, dforce_bar = self.force.tangent(), self.force_bar.tangent()
        gap_side, coordinates = self.gap_right.called("dgap_side"), self.along_coordinates.tangent()
        dgaps = [a.tangent() for a in self.gaps]
        return [
            *self._found_along(given),
            *(Own(a) for a in (self.side.tangent(), gap_side, dforce, dforce_bar, of_mass, of_gaps, coordinates)),
            *map(Own, (self.wrench, *dgaps)),
            Zero(self.wrench),
            *(() if self.of else (Own(a.tangent()) for a in self.bars)),
            Bind(self.found, self.wrench),
            performed(
                f"tangents_of_values{self.of}",
                "Tangents of the tree's inverse dynamics, with multipliers held; of M z + E^T y and E z, with z and y held.",
                self._values_along(),
            ),
            *self._solved(dforce, self.wrench),
            performed(
                "tangents_of_wrenches",
                "Tangents of the wrenches of the loops, and of the joint forces with them.",
                tuple(Run(along_name(s), True) for s in WITH_WRENCHES),
            ),
            *self._right_sides(given),
            Bind(self.right, self.side.tangent()),
            Bind(self.gap_right, gap_side),
            Bind(self.dudot, dforce_bar),
            Bind(self.found, dgaps[0]),
            *self.solution,
            Bind(self.dudot, found_dudot),
            Bind(self.found, self.wrench),
        ]

    def _found_along(self, given: tuple[Array, ...]) -> list[Step]:
        """Steps that complete the directions and compute the tangents of udot."""
        w, found_dudot = self.w, self.dudot.called("found_dudot")
        if given:
            return [*w.along, Bind(self.dudot, found_dudot), w.seeded]
        return [*w.along, Own(found_dudot), Bind(self.dudot, found_dudot), w.balance]

    def _right_sides(self, given: tuple[Array, ...]) -> list[Step]:
        """Steps for the right sides of the equations for the tangents of the virtual motion and its multipliers."""
        of_mass, of_gaps = self.udot_bar.tangent(), self.multiplier_bar.tangent()
        side, gap_side = self.side.tangent(), self.gap_right.called("dgap_side")
        return [Combine(side, (), (of_mass, *given[:1])), Combine(gap_side, (), (of_gaps,))]

    @property
    def wrench(self) -> Array:
        """The array of the tangents of the loops' wrenches."""
        return self.multiplier.tangent("found_dmultiplier")

    def _solved(self, of: Array, to: Array) -> list[Step]:
        """Steps for tangents of multipliers: those that balance tangents of forces along dependent degrees of freedom."""
        side = self.side.tangent()
        solution: list[Step] = [Combine(side, (), (of,)), Bind(self.right, side), Bind(self.found, to), *MULTIPLIERS]
        return [*solution, Bind(self.found, self.wrench)]

    def _dependent(self) -> list[tuple[int, ...]]:
        """Indices of dependent coordinates, and of dependent speeds."""
        sizes = (self.w.one("q").size, self.w.one("u").size)
        free = self.w.system.independent
        return [tuple(sorted(set(range(n)).difference(of))) for n, of in zip(sizes, free, strict=True)]


def bar_of(w: Shared, formulas: Formulas) -> Array:
    """The array of the adjoints of some formulas."""
    (target,) = formulas.targets
    return Array(f"{target}_bar", (), w.system.arrays.get(target) or w.one(target).size)


def transposed(
    w: Shared, formulas: Iterable[Formulas], bars: Iterable[Array], into: tuple[Array, ...]
) -> tuple[Step, ...]:
    """Steps that add the contributions of formulas to the gradient; in NumPy, they assign these contributions."""
    seeds = tuple(zip((w.one(f"d{n}") for n in w.state), into, strict=True))
    found = {b.name: b for b in bars}
    return tuple(
        Single((f.transpose(),), ((bar.tangent(f"d{f.targets[0]}"), bar),), seeds)
        for f in formulas
        for bar in (found[f"{f.targets[0]}_bar"],)
    )


def ground_gradient(w: Shared) -> tuple[Step, ...]:
    """The step that adds the contributions of gravity to the gradient."""
    if not varying_of_ground(w.system):
        return ()
    return (
        performed("ground_gradient", "The gradient with respect to gravity's parameters.", (Prepare(GROUND_GRADIENT),)),
    )


def changed(of: str, *sweeps: str) -> Perform:
    """The step that adds the change of the adjoints due to the multipliers of one type of conditions."""
    doc = f"Adds the change of the adjoints with the multipliers of conditions on {of}."
    return performed(f"multipliers_of_{of}", doc, tuple(Run(back_name(s), True) for s in sweeps))


def run_along(sweep: str) -> tuple[Run, ...]:
    """The step that runs the tangent of a sweep."""
    return (Run(along_name(sweep), True),)
