"""Kinds: units of equal structure, which share every block and every generated function. Blocks are written from kinds.

Numbers that are equal for all units of a kind are literals in its code; the others are data of each unit (`shared_constants`).
`grouping` finds the units of each kind.
"""

from __future__ import annotations

from dataclasses import field

from ...model.joints import Closure
from ...program.algebra import Expr, Number
from ...program.store import CONSTANT, Store
from ...records import dataclass
from ..joints import LinkJoint
from ..stores import CONSTANTS, LINK
from .element_kinds import ElementKind
from .elimination_order import NOBODY, Partners
from .factor_form import NO_FORM, FactorForm
from .shared_constants import SharedConstants
from .surface_forms import SurfaceForm


@dataclass(slots=True, eq=False)
class LinkKind(SharedConstants):
    """What the blocks of a kind of links are written from.

    Attributes
    ----------
    joint, axis
        See `Link`.
    aligned : bool
        The link's axes are its parent's at q = 0.
    first : bool
        The first child of its parent on the way inward.
    first_unit : bool
        The first of all that hands inertia to its parent, loops and regions included.
    carried_on : bool
        It has a parent other than the ground.
    carries : bool
        Something that is not of its own ear hangs on it, or is coupled to it.
    closed_on : {"", "origin", "moving"}
        Whether a loop that is closed elsewhere depends on its motion: against the ground, or against the link that carries
        all of the loop, which is then the origin.
    pulled : bool
        Force elements act on it.
    forced : tuple of bool
        Which freedoms have a force of the model.
    partners : Partners
        Coupled links, of the first member; the structure is that of all.
    moves : tuple of bool
        See `Link`.
    held : bool
        A coordinate that is prescribed has a force of the model.
    members : list of int
        Links, in outward order.
    units : list of int
        Their places in the order of units, where they are units themselves.
    of_links : bool
        Only links hand inertia to them, no region and no partner.
    """

    index: int
    joint: type[LinkJoint]
    axis: int
    aligned: bool
    first: bool
    first_unit: bool
    carried_on: bool
    carries: bool
    closed_on: str
    pulled: bool
    forced: tuple[bool, ...]
    partners: Partners = NOBODY
    moves: tuple[bool, ...] = ()
    held: bool = False
    members: list[int] = field(default_factory=list)
    units: list[int] = field(default_factory=list)
    of_links: bool = True

    role = "link"
    store = CONSTANTS

    @property
    def geared(self) -> tuple[bool, ...]:
        """Which of the joint's speeds, a prescribed one too, have the reflected inertia of a rotor."""
        return tuple(f"rotor{j}" in self.shape.fields for j in range(self.joint.speeds()))


@dataclass(slots=True, eq=False)
class ClosureKind(SharedConstants):
    """A loop of a kind of ears: see `structure.Closure`; `axis` and `end_axis` are those of the joint among the faces' axes.

    `holds`: how many directions the joint holds; `slides`: the way between the faces matters; `surfaces`: the equations of a
    condition on a point; `turned`: its faces are exchanged, see `Model.with_turned`.
    """

    holds: Closure
    axis: int
    end_axis: int
    paths: tuple[tuple[int, ...], tuple[int, ...]]
    roots: tuple[int, int]
    faces: tuple[int, int]
    gaps: bool
    dropped: tuple[int, ...]
    slides: bool
    terms: tuple[tuple[int, int], ...] = ()
    surfaces: tuple[SurfaceForm, ...] = ()
    is_distance: bool = False
    turned: bool = False

    @property
    def is_coupling(self) -> bool:
        """Whether it relates coordinates of links, and has no faces."""
        return bool(self.terms)


@dataclass(slots=True, eq=False)
class EarKind:
    """What the blocks of a kind of ears are written from.

    Attributes
    ----------
    links : list of LinkKind
    parents, dependent, columns
        See `structure.EarLinks`.
    roots : list of str
        ``frame`` (the region's base), ``ground`` (where the base is a link), ``link`` (of the region), ``far`` (see `Region`).
    far : list of int
        For each root, its place among the region's far links; -1 for the others.
    first_at : list of bool
        Whether the ear is the first, on the way inward, to hand a force to that root.
    followed : list of bool
        Which links later ears of the region start from.
    closures : list of ClosureKind
    sources, total : int
        Independent speeds of the region; with the six components of a base whose motion the loops close on, or of far links.
    carried, rigid : bool
        See `structure.Region`.
    scale, per_length : Number
        One over the characteristic length; the former 1 where there are no angular conditions to weigh linear ones against.
    positions : bool
        The faces of some joint of the region may be apart, so positions are needed.
    partners : Partners
        See `LinkKind`.
    members : list of int
        Ears.
    form : FactorForm
        Of the factored closure matrix; the expansion of the closures gives it.
    locked : tuple of int
        Sources that are prescribed: their speeds are known, and their accelerations are in the remainders.
    """

    index: int
    links: list[LinkKind]
    parents: list[int]
    roots: list[str]
    far: list[int]
    first_at: list[bool]
    followed: list[bool]
    closures: list[ClosureKind]
    dependent: list[list[int]]
    columns: list[dict[int, int]]
    sources: int
    total: int
    carried: bool
    rigid: bool
    scale: Number
    per_length: Number
    positions: bool
    partners: Partners = NOBODY
    members: list[int] = field(default_factory=list)
    units: list[int] = field(default_factory=list)
    form: FactorForm = NO_FORM
    locked: tuple[int, ...] = ()

    role = "ear"

    def _owner(self, store: Store) -> SharedConstants | None:
        if store.memory is not CONSTANT or store.place is None:
            return None
        return self.links[store.place] if store.owner is LINK else self.closures[store.place]

    def number_of(self, store: Store, name: str) -> Expr | None:
        """Constants that are the same number for the whole kind."""
        owner = self._owner(store)
        return owner.number(name) if owner else None

    def alias_of(self, store: Store, name: str) -> str:
        """The first constant of equal value."""
        owner = self._owner(store)
        return owner.shape.varying.get(name, name) if owner else name


@dataclass(slots=True, eq=False)
class RegionKind:
    """What the blocks of a kind of regions are written from; see `EarKind`.

    Attributes
    ----------
    first : bool
        The region is the first, on the way inward, to hand inertia to its base.
    far : tuple of int
        For each far link, its place among the partners; -1 for the ground.
    """

    index: int
    sources: int
    total: int
    carried: bool
    rigid: bool
    first: bool
    far: tuple[int, ...] = ()
    partners: Partners = NOBODY
    locked: tuple[int, ...] = ()
    members: list[int] = field(default_factory=list)
    units: list[int] = field(default_factory=list)

    role = "region"

    @property
    def free(self) -> list[int]:
        """Sources whose accelerations are unknown."""
        return [c for c in range(self.sources) if c not in self.locked]

    def number_of(self, store: Store, name: str) -> Expr | None:
        """A region has no constants."""
        return None

    def alias_of(self, store: Store, name: str) -> str:
        """Nor any of equal value."""
        return name


UnitKind = LinkKind | EarKind | RegionKind | ElementKind
