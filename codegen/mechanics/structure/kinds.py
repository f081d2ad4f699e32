"""Kinds: units of the same structure, which share all blocks and generated functions. Blocks are written from kinds.

Numbers equal for all units of a kind are literals in its code; the others are data of each unit (`shared_constants`).
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
    """The common properties of links of one kind, from which their blocks are written.

    Attributes
    ----------
    joint, axis
        See `Link`.
    aligned : bool
        The link's axes coincide with its parent's at q = 0.
    first : bool
        The first of its parent's children on the way inward.
    first_unit : bool
        The first unit to contribute inertia to its parent, loops and regions included.
    has_parent : bool
        Its parent is not the ground.
    carries : bool
        It carries units outside its own ear, or is coupled to some.
    closed_on : {"", "origin", "moving"}
        ``moving`` if loops of another region depend on its motion relative to the link that carries these loops;
        ``origin`` if it is the link that carries them; otherwise "".
    pulled : bool
        Force elements act on it.
    forced : tuple of bool
        For each degree of freedom, whether the model has a joint force along it.
    partners : Partners
        Coupled links of the first member; the structure is the same for all.
    moves : tuple of bool
        See `Link`.
    held : bool
        A prescribed coordinate has a joint force in the model.
    members : list of int
        Links, in outward order.
    units : list of int
        Indices of the members in the order of units, if they are units.
    of_links : bool
        Only links contribute inertia to the members; regions and partners do not.
    """

    index: int
    joint: type[LinkJoint]
    axis: int
    aligned: bool
    first: bool
    first_unit: bool
    has_parent: bool
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
        """Whether each speed of the joint, including a prescribed one, has a rotor with reflected inertia."""
        return tuple(f"rotor{j}" in self.shape.fields for j in range(self.joint.speeds()))


@dataclass(slots=True, eq=False)
class ClosureKind(SharedConstants):
    """A loop of a kind of ears; see `structure.Closure`. `axis` and `end_axis` are the indices of the joint's axis among
    the base vectors of the start face and of the end face.

    `holds`: the numbers of constrained directions; `slides`: whether the conditions contain the displacement between the
    faces; `surfaces`: the equations of a condition on a point; `turned`: whether the faces are exchanged, see
    `Model.with_turned`.
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
        """Whether the loop is a coupling of coordinates, without faces."""
        return bool(self.terms)


@dataclass(slots=True, eq=False)
class EarKind:
    """The common properties of ears of one kind, from which their blocks are written.

    Attributes
    ----------
    links : list of LinkKind
    parents, dependent, columns
        See `structure.EarLinks`.
    roots : list of str
        ``frame`` (the region's base), ``ground`` (if the base is a link), ``link`` (of the region), ``far`` (see `Region`).
    far : list of int
        For each root, its index among the region's far links; -1 if it is not a far link.
    first_at : list of bool
        For each root, whether the ear is the first, on the way inward, to contribute a force to it.
    followed : list of bool
        For each link, whether a later ear of the region starts from it.
    closures : list of ClosureKind
    sources, total : int
        Number of independent speeds of the region; number of all sources, including motion components of links.
    carried, rigid : bool
        See `structure.Region`.
    scale, per_length : Number
        One over the characteristic length, 1/m. `scale`, the factor of linear conditions, is 1 if none are angular.
    positions : bool
        Blocks need positions, because the faces of some loop joint of the region may be apart.
    partners : Partners
        See `LinkKind`.
    members : list of int
        Ears.
    form : FactorForm
        Structure of the factored closure matrix; the expansion of the closures determines it.
    locked : tuple of int
        Prescribed sources: their speeds are known, and the remainders contain their accelerations.
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
        """The value of a constant that is equal for all units of the kind."""
        owner = self._owner(store)
        return owner.number(name) if owner else None

    def alias_of(self, store: Store, name: str) -> str:
        """Name of the first constant with the same value as the given one."""
        owner = self._owner(store)
        return owner.shape.varying.get(name, name) if owner else name


@dataclass(slots=True, eq=False)
class RegionKind:
    """The common properties of regions of one kind, from which their blocks are written; `EarKind` describes the other
    attributes.

    Attributes
    ----------
    first : bool
        The region is the first, on the way inward, to contribute inertia to its base.
    far : tuple of int
        For each far link, its index among the partners; -1 for the ground.
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
        """Indices of the sources whose accelerations are unknown."""
        return [c for c in range(self.sources) if c not in self.locked]

    def number_of(self, store: Store, name: str) -> Expr | None:
        """Always None: a region has no constants."""
        return None

    def alias_of(self, store: Store, name: str) -> str:
        """The name itself, since a region has no constants."""
        return name


UnitKind = LinkKind | EarKind | RegionKind | ElementKind
