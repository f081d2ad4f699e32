"""How the links of loops belong together: ears, regions, and units, which is what a sweep works on one after the other."""

from __future__ import annotations

from dataclasses import field

from ...model.model import CLOSURE_ROWS, GROUND
from ...records import dataclass


@dataclass(slots=True, eq=False)
class Closure:
    """A loop as an ear sees it.

    Attributes
    ----------
    loop : int
        Index into `Model.loops`.
    paths : tuple of two tuples of int
        For the start and the end face: places among the ear's links, from the root outward, of the links that move the face.
    roots : tuple of two int
        Where the paths begin: place among the ear's roots; -1 for both where both begin at the same link.
    faces : tuple of two int
        Place of each face's link among the ear's links; minus one minus the place among its roots where it is one of those.
    gaps : bool
        The faces may be apart in dropped conditions, or be moved apart by a parameter; see `loops.partition.Ear`.
    dropped : tuple of int
        Conditions that do not count.
    terms : tuple of (int, int)
        Of a coupling, which has no paths, roots and faces: place of each link and freedom.
    """

    loop: int
    paths: tuple[tuple[int, ...], tuple[int, ...]]
    roots: tuple[int, int]
    faces: tuple[int, int]
    gaps: bool = False
    dropped: tuple[int, ...] = ()
    terms: tuple[tuple[int, int], ...] = ()

    @property
    def is_coupling(self) -> bool:
        """Whether it relates coordinates of links, and has no faces."""
        return bool(self.terms)

    def slides(self, type: str) -> bool:
        """Whether the way between the faces matters, for a joint of some type."""
        if self.is_coupling:
            return False
        linear, _ = CLOSURE_ROWS[type]
        return linear < 3 or (self.gaps and any(r not in self.dropped for r in range(linear)))


@dataclass(slots=True, eq=False)
class EarLinks:
    """An ear as links.

    Attributes
    ----------
    links : list of int
        Outward.
    parents : list of int
        For each link, the place of its parent among `links`, or minus one minus its place among `roots`.
    roots : list of int
        Links outside, or `GROUND`, that the ear's links and faces hang on.
    closures : list of Closure
    dependent : list of list of int
        For each link, which of its freedoms are dependent.
    columns : list of dict of int to int
        For each link, independent freedom to the number of its source in the region.
    length : float
        Characteristic length, m.
    """

    region: int
    links: list[int]
    parents: list[int] = field(default_factory=list)
    roots: list[int] = field(default_factory=list)
    closures: list[Closure] = field(default_factory=list)
    dependent: list[list[int]] = field(default_factory=list)
    columns: list[dict[int, int]] = field(default_factory=list)
    length: float = 1.0


@dataclass(slots=True, eq=False)
class Region:
    """Ears whose links move with the same sources.

    Attributes
    ----------
    base : int
        Link whose axes are used and that carries a rigid region, or `GROUND`.
    rigid : bool
        The loops close within the region whatever the base does: it carries the region like a rigid subtree. Otherwise the
        base's six components are sources.
    freedoms : list of (int, int)
        Sources: link and freedom of the independent speeds.
    far : list of int
        Other links that the region starts from, and `GROUND`: the six components of the motion of each, relative to a base
        that carries the region rigidly, are sources.
    """

    base: int
    rigid: bool
    ears: list[int] = field(default_factory=list)
    freedoms: list[tuple[int, int]] = field(default_factory=list)
    far: list[int] = field(default_factory=list)

    @property
    def carried(self) -> bool:
        """The base is a link."""
        return self.base != GROUND


@dataclass(slots=True)
class Unit:
    """What one call of a sweep works on: a link, an ear or a region."""

    role: str
    number: int
    links: tuple[int, ...]
