"""Second derivatives of the forward dynamics: blocks that follow from those of the inverse dynamics.

Let ``f = w . udot``, and let r be the missing joint forces of the inverse dynamics, zero for the udot of forward dynamics.
With the virtual motion ``M z = -w``, the gradient of f is that of ``z . r`` at fixed z and udot. Along a direction:

    M dudot = -dr at fixed udot        M dz = -d(M z) at fixed z        d(gradient) = tangent of the adjoint, with dudot and dz

No tangent of an articulated inertia occurs: both solutions use the factors of forward dynamics. The adjoint of udot is ``M z``.

Every sweep of values gives four more (`sweeps.TWICE`): its tangent, its adjoint, the tangent of its adjoint, and the part of
this tangent from which ``d(M z)`` follows. See `codegen.program.second_order`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from functools import partial

from ..program import algebra
from ..program.algebra import Expr, Symbol
from ..program.block import Block, Component, Expansion, Statement
from ..program.derivatives import of_symbols
from ..program.fusion import fused
from ..program.passes import drop_dead, propagate_copies
from ..program.second_order import Further, Primitives, adjoint, along, nothing, transpose
from ..program.store import Memory, Store
from ..program.transpose import always
from ..records import dataclass
from . import fields
from .adjoint_memory import exchange_in_scratch, merge_equal
from .first_contributions import assign_first
from .patterns import GROUND_KIND, Patterns, Place
from .second_order_poses import attitudes, rotation
from .second_order_stores import (
    GRADIENTS,
    READ_BY_FORMULAS,
    READ_BY_LOOPS,
    READ_BY_SOLUTIONS,
    adjoint_of,
    adjoint_tangent_of,
    along_of_adjoint,
    base_of,
    in_memory,
    mass_tangent_of,
    tangent_of,
)
from .stores import (
    ADJOINT,
    ADJOINT_LANE,
    CE_DP,
    CE_PARAMETER,
    CHANGE_LANE,
    CL_DP,
    CL_PARAMETER,
    CONSTANTS,
    DDRIVING,
    DFORCE,
    DKINETIC,
    DMULTIPLIER_BAR,
    DP,
    DPOTENTIAL,
    DQDOT,
    DUDOT_BAR,
    ELEMENT_CONSTANTS,
    LME,
    LOOP_CONSTANTS,
    LUP,
    MASS_LANE,
    ME,
    PARAMETER,
    RECORD,
    TANGENT,
    TRIG,
    TURNS,
    UP,
)
from .structure.element_kinds import ElementKind
from .structure.kinds import EarKind, LinkKind, UnitKind
from .structure.system import System
from .sweeps import (
    DIFFERENTIATED_TWICE,
    OF_MASS,
    SWEEP,
    TOGETHER,
    Sweep,
    adjoint_name,
    along_name,
    back_name,
    backward_in_loops,
    mass_name,
    parts_of,
)

ACCELERATIONS = "link_accelerations"
"""The sweep that computes accelerations for outputs."""

CHANGES = (ADJOINT_LANE, CHANGE_LANE)
"""Memory of tangents of adjoints, and of their changes when multipliers of loops change."""


@dataclass(slots=True, eq=False)
class Original:
    """A block that computes all of its values itself; the printed block loads some of them from earlier blocks.

    Attributes
    ----------
    block : Block
    equal : dict of Symbol to Expr
        See `second_order.along`.
    recalled, stored_before
        See `Expansion`.
    """

    block: Block
    equal: dict[Symbol, Expr]
    recalled: dict[Symbol, Component]
    stored_before: list[tuple[Store, str, Expr]]

    @classmethod
    def of(cls, x: Expansion) -> Original:
        """The block of an expansion that is not finished yet."""
        b = x.block
        return cls(
            Block(b.name, b.title, dict(b.loads), list(b.statements)), dict(x.equal), dict(x.recalled), x.stored_before
        )

    def finished(self, block: Block) -> Original:
        """This block with the stores of the finished block, and with values that an earlier block has stored."""
        self.block.stores = [*block.stores, *self.stored_before]
        return self


class SecondOrder:
    """Derives the blocks of the sweeps for second derivatives (`sweeps.TWICE`) from those of the inverse dynamics.

    Parameters
    ----------
    patterns : Patterns
    originals : mapping of str to mapping of int to Original
        Blocks of the inverse dynamics, by sweep and kind.
    wanted : set of str
        Names of the sweeps that run.
    given : set of Place
        Adjoints to which formulas that read records contribute.
    alone : bool
        Whether only one function runs the sweeps.
    gradients : bool
        Whether blocks store the gradient besides its tangents.
    """

    def __init__(
        self, patterns: Patterns, originals: Mapping[str, Mapping[int, Original]], wanted: Set[str], given: Set[Place],
        alone: bool, gradients: bool,
    ):  # fmt: skip
        self.patterns, self.system = patterns, patterns.system
        self.originals, self.wanted, self.given, self.parts = originals, wanted, given, parts_of(wanted)
        self.sweeps = [SWEEP[s] for s in DIFFERENTIATED_TWICE if s in originals]
        loops = bool(self.system.model.loops)
        self.read = (*READ_BY_FORMULAS, *(READ_BY_LOOPS if loops else ()), *(GRADIENTS if gradients else ()))
        """Stores of adjoints that are read after the sweeps."""
        self.solved = (DUDOT_BAR, DMULTIPLIER_BAR)
        """Stores of the right sides for the tangents of udot and of the multipliers."""
        self.transposes: dict[tuple[str, int], Block] = {}
        self.forward = mass_name("missing_forces") in self.parts
        """Whether some function computes second derivatives of the forward dynamics of a tree."""
        inverse = "given_accelerations" in wanted if loops else "tree_motion" in originals
        self.dropped = () if inverse else (DUDOT_BAR, DMULTIPLIER_BAR)
        driven = not {"driving", "driving_in_loops"}.isdisjoint(originals)
        self.solving = self.sweeps if driven else [s for s in self.sweeps if s.name == ACCELERATIONS]
        """Sweeps whose adjoints, for outputs, store right sides of the equation of the virtual motion."""
        alone = alone and not self.solving
        self.one_of_trees = alone and not loops and (self.forward or inverse)
        """Whether the model is a tree, only one function runs the sweeps, and no formula contributes: first contributions
        are then known."""
        self.one_of_loops = alone and loops and mass_name("tree_forces") in self.parts
        self.unread = (DKINETIC, DPOTENTIAL, DQDOT, DDRIVING, *(() if loops else (DFORCE,)))
        self.sums: set[Place] = set()
        """Values of links to which several blocks add."""
        for sweep in self.sweeps:
            for kind in self._kinds(sweep):
                block = originals[sweep.name][kind.index].block
                read = set(block.loads.values())
                for store, name, _ in block.stores:
                    if store.memory is RECORD and (store.adds or (store, name) in read):
                        self.sums |= self._places(kind, sweep, store.plain, name)
        self.nonzero: set[Place] = {((TANGENT, ""), GROUND_KIND, n) for n in varying_of_ground(patterns.system)} | given
        """Tangents and adjoints that can differ from zero."""

    def blocks(self) -> dict[str, dict[int, Block]]:
        """The blocks by sweep and kind."""
        tangents: dict[str, dict[int, Block]] = {}
        known = -1
        while known != len(self.nonzero):
            known = len(self.nonzero)
            for sweep in self.sweeps:
                tangents[sweep.name] = {k.index: self._tangent(sweep, k) for k in self._kinds(sweep)}
        read = self._read_by_tangents(tangents)
        backs = self._adjoints(read)
        found: dict[str, dict[int, Block]] = {}
        for sweep in self.sweeps:
            name = sweep.name
            for made in (along_name(name), adjoint_name(name), mass_name(name), along_name(adjoint_name(name))):
                found[made] = {}
            for kind in self._kinds(sweep):
                k, tangent = kind.index, tangents[name][kind.index]
                found[along_name(name)][k] = _storing(tangent, lambda a: a.memory is TANGENT or a not in self.unread)
                if back_name(name) in self.parts:
                    title = SWEEP[back_name(name)].title
                    turned = transpose(read[name][k], f"{back_name(name)}_{k}", title, along_of_adjoint, always)
                    found.setdefault(back_name(name), {})[k] = _changing(turned, name)
                if k not in backs[name]:
                    continue
                back = backs[name][k]
                stored = self.read + (READ_BY_SOLUTIONS if sweep in self.solving else ())
                found[adjoint_name(name)][k] = _storing(back, partial(_among, (ADJOINT,), stored))
                mass = self._along_adjoint(sweep, kind, back, mass_name(name), mass_tangent_of)
                if not self.system.model.loops:  # one block computes both
                    mass.stores += found[adjoint_name(name)][k].stores
                kept = partial(_among, (MASS_LANE, ADJOINT), (*self.solved, *stored))
                found[mass_name(name)][k] = _storing(mass, kept)
                whole = self._along_adjoint(sweep, kind, back, along_name(adjoint_name(name)), adjoint_tangent_of)
                if name != ACCELERATIONS:
                    whole = _storing(whole, lambda a: base_of(a) not in self.dropped)
                found[along_name(adjoint_name(name))][k] = whole
        self._drop_zeros(found)
        runs = [
            (found[sweep.name][kind.index], partial(self._places, kind, sweep))
            for sweep in (SWEEP[name] for name in found if name in self.parts)
            for kind in sweep.kinds(self.system)
            if kind.index in found[sweep.name]
        ]
        for memory in (ADJOINT, ADJOINT_LANE, MASS_LANE):
            merge_equal(memory, runs)
        if self.one_of_trees:
            self._assign_first(found)
            outside = {n for _, _, n in read_outside(self.system)}
            for memory in (ADJOINT_LANE, MASS_LANE):
                blocks = [(name, b) for name in found if name in self.parts for b in found[name].values()]
                exchange_in_scratch({in_memory(memory, ME): LME, in_memory(memory, UP): LUP}, blocks, outside)
        if self.one_of_loops:
            self._assign_first_in_loops(found)
        return found | {name: self._together(name, found) for name in TOGETHER if name in self.wanted}

    def _together(self, name: str, found: Mapping[str, Mapping[int, Block]]) -> dict[int, Block]:
        """For each kind, one block that joins the blocks of several sweeps."""
        made: dict[int, Block] = {}
        for kind in SWEEP[name].kinds(self.system):
            parts = [found[part][kind.index] for part in TOGETHER[name] if kind.index in found[part]]
            title = "; ".join(part.title for part in parts)
            made[kind.index] = fused(f"{name}_{kind.index}", title, parts, lambda store, name: False)
        return made

    def _assign_first(self, found: dict[str, dict[int, Block]]) -> None:
        """Assign the first contributions to adjoints and to their tangents; see `codegen.mechanics.first_contributions`."""
        of_values = mass_name if self.forward else adjoint_name
        for memory, name_of in (
            (ADJOINT, of_values),
            (ADJOINT_LANE, lambda name: along_name(adjoint_name(name))),
            (MASS_LANE, mass_name),
        ):
            self._assign_first_of(memory, [name_of(s.name) for s in reversed(self.sweeps)], found)

    def _assign_first_in_loops(self, found: dict[str, dict[int, Block]]) -> None:
        """In models with loops, let the first contribution to each tangent of an adjoint assign it; `WithLoops` has the
        order of the contributions."""
        order = backward_in_loops(s.name for s in self.sweeps)
        poses = [s for s in order if s in ("pose", "rotations")]
        names = [
            *(along_name(adjoint_name(s)) for s in order if s not in poses),
            *map(back_name, ("rate_gaps", "velocities")),
            *(along_name(adjoint_name(s)) for s in poses),
        ]
        self._assign_first_of(ADJOINT_LANE, names, found)
        self._assign_first_of(MASS_LANE, [*map(mass_name, OF_MASS)], found)

    def _assign_first_of(self, memory: Memory, names: list[str], found: dict[str, dict[int, Block]]) -> None:
        outside = {n for (of, _), _, n in read_outside(self.system) if of is memory}
        runs = [(SWEEP[n], found[n]) for n in names if n in found]
        assign_first(self.system, memory, runs, in_memory(memory, ME), outside)

    def _drop_zeros(self, found: dict[str, dict[int, Block]]) -> None:
        """Simplify the transposes of tangents: a component is zero if none of them stores a nonzero value in it."""
        nonzero: set[Place] = set()
        known = -1
        transposes = [(s, k) for s in reversed(self.sweeps) for k in self._kinds(s) if back_name(s.name) in found]
        while known != len(nonzero):
            known = len(nonzero)
            for sweep, kind in transposes:
                block = found[back_name(sweep.name)][kind.index]
                zeros = {
                    s
                    for s, (a, n) in block.loads.items()
                    if (a.memory in CHANGES and nonzero.isdisjoint(self._places(kind, sweep, a, n)))
                    or base_of(a) in self.solved
                }
                zero = [Statement(s, algebra.ZERO) for s in sorted(zeros, key=str)]
                loads = {s: at for s, at in block.loads.items() if s not in zeros}
                made = propagate_copies(
                    Block(block.name, block.title, loads, [*zero, *block.statements], list(block.stores))
                )
                made.stores = [
                    (a, n, e)
                    for a, n, e in made.stores
                    if e is not algebra.ZERO and base_of(a.plain) not in self.solved
                ]
                for store, n, _ in made.stores:
                    if store.memory in CHANGES:
                        nonzero |= self._places(kind, sweep, store.plain, n)
                self.transposes[back_name(sweep.name), kind.index] = drop_dead(made)
        for (name, k), block in self.transposes.items():
            found[name][k] = block

    def _read_by_tangents(self, tangents: dict[str, dict[int, Block]]) -> dict[str, dict[int, Block]]:
        """The blocks of tangents, without stores on which no result depends. Their adjoints would not be needed."""
        of = [(s, k, tangents[s.name][k.index]) for s in reversed(self.sweeps) for k in reversed(self._kinds(s))]
        found: dict[str, dict[int, Block]] = {s.name: {} for s in self.sweeps}
        read: set[Place] = {((TANGENT, ""), k, n) for _, k, n in self.given}
        known = -1
        while known != len(read):
            known = len(read)
            for sweep, kind, block in of:
                stores = [
                    (a, n, e)
                    for a, n, e in block.stores
                    if a.memory is not TANGENT or not read.isdisjoint(self._places(kind, sweep, a.plain, n))
                ]
                kept = drop_dead(Block(block.name, block.title, block.loads, block.statements, stores))
                found[sweep.name][kind.index] = kept
                for a, n in kept.loads.values():
                    if a.memory is TANGENT:
                        read |= self._places(kind, sweep, a, n)
        return found

    def _adjoints(self, tangents: dict[str, dict[int, Block]]) -> dict[str, dict[int, Block]]:
        """The adjoints of all blocks; notes which components can differ from zero."""
        found: dict[str, dict[int, Block]] = {s.name: {} for s in self.sweeps}
        known = -1
        while known != len(self.nonzero):
            known = len(self.nonzero)
            for sweep in reversed([s for s in self.sweeps if {adjoint_name(s.name), mass_name(s.name)} & self.parts]):
                for kind in self._kinds(sweep):
                    found[sweep.name][kind.index] = self._adjoint(sweep, kind, tangents[sweep.name][kind.index])
        return found

    def _adjoint(self, sweep: Sweep, kind: UnitKind, tangent: Block) -> Block:
        def nonzero(store: Store, name: str) -> bool:
            return store.memory is not TANGENT or not self.nonzero.isdisjoint(
                self._places(kind, sweep, adjoint_of(store), name)
            )

        made = adjoint_name(sweep.name)
        found = adjoint(tangent, f"{made}_{kind.index}", SWEEP[made].title, adjoint_of, nonzero)
        for store, name, e in found.stores:
            if store.memory is ADJOINT and e is not algebra.ZERO:
                self.nonzero |= self._places(kind, sweep, store.plain, name)
        return found

    def _kinds(self, sweep: Sweep) -> list[UnitKind]:
        return [k for k in sweep.kinds(self.system) if k.index in self.originals[sweep.name]]

    def _places(self, kind: UnitKind, sweep: Sweep, store: Store, name: str) -> set[Place]:
        found = self.patterns.reach.of(kind, sweep, store)
        assert found is not None
        return {(found[0], k, name) for k in found[1]}

    def _expansion(self, sweep: Sweep, kind: UnitKind, made: str, block: Block) -> Expansion:
        def nonzero(store: Store, name: str) -> bool:
            if store.memory in (ADJOINT, ADJOINT_LANE, MASS_LANE):
                store = in_memory(ADJOINT, store)
            if store.memory in (TANGENT, ADJOINT):
                return not self.nonzero.isdisjoint(self._places(kind, sweep, store, name))
            return self.patterns.is_nonzero(kind, sweep, store, name)

        x = Expansion(
            f"{made}_{kind.index}",
            SWEEP[made].title,
            nonzero,
            partial(self.patterns.number, kind, sweep),
            kind.alias_of,
        )
        return x.resume(block)

    def _tangent(self, sweep: Sweep, kind: UnitKind) -> Block:
        of = self.originals[sweep.name][kind.index]
        x = self._expansion(sweep, kind, along_name(sweep.name), of.block)
        further: Further = partial(rotation, kind) if isinstance(kind, LinkKind) and sweep.name == "pose" else nothing
        recalled = of.recalled | self._stored(sweep, kind, of)
        found = along(x, tangent_of, partial(_primitives, kind), of.equal, recalled, further=further)
        for store, name, e in found.stores:
            if store.memory is TANGENT and e is not algebra.ZERO:
                self.nonzero |= self._places(kind, sweep, store.plain, name)
        return found

    def _stored(self, sweep: Sweep, kind: UnitKind, of: Original) -> dict[Symbol, Component]:
        """Values that the undifferentiated sweep stores in records; tangents load them instead of computing them again."""
        computed = {s.target for s in of.block.statements}
        found: dict[Symbol, Component] = {}
        for store, name, e in of.block.stores:
            if not (isinstance(e, Symbol) and e in computed) or store.memory is not RECORD or store.adds:
                continue
            if self.sums.isdisjoint(self._places(kind, sweep, store, name)):
                found.setdefault(e, (store, name))
        return found

    def _along_adjoint(
        self, sweep: Sweep, kind: UnitKind, back: Block, made: str, place: Callable[[Store, str], Component | None]
    ) -> Block:
        of = self.originals[sweep.name][kind.index]
        known = {e: (a, n) for a, n, e in of.block.stores if isinstance(e, Symbol) and e in of.equal}
        assert known.keys() == of.equal.keys()
        return along(self._expansion(sweep, kind, made, back), place, partial(_primitives, kind), known=known)


def varying_of_ground(system: System) -> list[str]:
    """Components of the ground's record that depend on design parameters."""
    g = system.gravity
    return [] if g is None else [n for n, of in system.fields_of_gravity.items() if of in g.shape.varying]


def read_outside(system: System) -> set[Place]:
    """Adjoints of the ground's record. The gradient with respect to parameters of gravity follows from them."""
    return {((memory, ""), GROUND_KIND, n) for memory in (ADJOINT, ADJOINT_LANE) for n in varying_of_ground(system)}


def _changing(block: Block, sweep: str) -> Block:
    """The transpose of a tangent, applied to multipliers of loops. Results that later transposes read move to
    `CHANGE_LANE`; all others add to the tangents of adjoints, whose sweeps follow.

    For conditions on velocities, the results that move are the adjoints of velocities; for all others, every adjoint.
    """
    of_velocities = sweep in ("rate_gaps", "velocities")

    def moved(store: Store, name: str) -> Store:
        if store.memory is not ADJOINT_LANE or (of_velocities and name not in fields.applied_twist.components):
            return store
        found = in_memory(CHANGE_LANE, store.plain)
        return found.sum if store.adds else found

    loads = {s: (moved(a, n), n) for s, (a, n) in block.loads.items()}
    return Block(block.name, block.title, loads, block.statements, [(moved(a, n), n, e) for a, n, e in block.stores])


def _storing(block: Block, kept: Callable[[Store], bool]) -> Block:
    """A block reduced to the stores that `kept` selects, and to the statements that they need."""
    return drop_dead(
        Block(block.name, block.title, block.loads, block.statements, [s for s in block.stores if kept(s[0].plain)])
    )


def _among(memories: tuple[Memory, ...], stores: tuple[Store, ...], store: Store) -> bool:
    return store.memory in memories or base_of(store) in stores


def _primitives(kind: UnitKind, x: Expansion) -> tuple[Primitives, dict[Symbol, Expr]]:
    """The transparent symbols of a block, and the tangents of rotations and of the design parameters."""
    if isinstance(kind, EarKind):
        return _primitives_of_loops(kind, x)
    transparent, roots = attitudes(x)
    loads = list(x.block.loads.items())
    if isinstance(kind, LinkKind) and any(a is TRIG for _, (a, _) in loads):
        joint = kind.joint(x, kind)
        transparent |= of_symbols(joint.transparent())
        roots |= {
            s: algebra.expression(kind.joint.turn_seed(x, n)) for s, (a, n) in [*x.block.loads.items()] if a is TURNS
        }
    assert isinstance(kind, LinkKind | ElementKind)
    of = (ELEMENT_CONSTANTS, CE_PARAMETER, CE_DP) if isinstance(kind, ElementKind) else (CONSTANTS, PARAMETER, DP)
    constants, parameter, dp = of
    roots |= {x.symbol(parameter, j): x.entry(dp, j) for j in range(kind.parameters)}
    for symbol, (store, name) in loads:
        if store is constants:
            inner = {j: x.component(constants, f"{name}/{j}") for j in range(kind.parameters)}
            if "/" in name:
                transparent[symbol] = {x.symbol(parameter, j): d for j, d in inner.items() if d is not algebra.ZERO}
            else:  # fewer operations than a tangent for each parameter and each value
                roots[symbol] = x.let(
                    f"d_{name}", algebra.add(*(d * x.entry(dp, j) for j, d in inner.items())), "d", True
                )
    return transparent, roots


def _primitives_of_loops(kind: EarKind, x: Expansion) -> tuple[Primitives, dict[Symbol, Expr]]:
    """The transparent symbols of an ear's block: constants of its loops, and the design parameters on which these
    depend."""
    transparent, roots = attitudes(x)
    loads = list(x.block.loads.items())
    for c, closure in enumerate(kind.closures):
        parameters = range(closure.parameters)
        roots |= {x.symbol(CL_PARAMETER[c], j): x.entry(CL_DP[c], j) for j in parameters}
        for symbol, (store, name) in loads:
            if store is LOOP_CONSTANTS[c]:
                inner = {j: x.component(store, f"{name}/{j}") for j in parameters}
                transparent[symbol] = {
                    x.symbol(CL_PARAMETER[c], j): d for j, d in inner.items() if d is not algebra.ZERO
                }
    return transparent, roots
