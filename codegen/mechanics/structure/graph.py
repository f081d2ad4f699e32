"""Graph of a model's loops: ears (of the ear decomposition, Whitney 1932), regions, and the units of a sweep."""

from __future__ import annotations

from dataclasses import field

from ...model.model import CLOSURE_ROWS, GROUND
from ...records import dataclass


@dataclass(slots=True, eq=False)
class Closure:
    """A loop of an ear.

    Attributes
    ----------
    loop : int
        Index into `Model.loops`.
    paths : tuple of two tuples of int
        For the start and the end face: the links of the ear that move the face, by index, from the root outward.
    roots : tuple of two int
        For each path, the index of its root among the ear's roots; -1 for both if the paths start from the same link.
    faces : tuple of two int
        For each face, n if it is on link n of the ear, and -1 - n if it is on root n.
    gaps : bool
        Parameters may separate the faces, or they are apart in dropped conditions; see `loops.partition.Ear`.
    dropped : tuple of int
        Conditions that are not used.
    terms : tuple of (int, int)
        For a coupling, which has no paths, roots or faces: index of each link, and its coupled degree of freedom.
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
        """Whether the loop is a coupling of coordinates, without faces."""
        return bool(self.terms)

    def slides(self, type: str) -> bool:
        """Whether the conditions of this type of joint contain the displacement between the faces."""
        if self.is_coupling:
            return False
        linear, _ = CLOSURE_ROWS[type]
        return linear < 3 or (self.gaps and any(r not in self.dropped for r in range(linear)))


@dataclass(slots=True, eq=False)
class EarLinks:
    """An ear in terms of links.

    Attributes
    ----------
    links : list of int
        In outward order.
    parents : list of int
        For each link, n if its parent is link n of the ear, and -1 - n if its parent is root n.
    roots : list of int
        Links outside the ear, or `GROUND`, that carry its links and faces.
    closures : list of Closure
    dependent : list of list of int
        For each link, its dependent degrees of freedom.
    columns : list of dict of int to int
        For each link, maps independent degrees of freedom to source numbers in the region.
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
    """A region: ears whose links move with the same sources.

    Attributes
    ----------
    base : int
        Link whose axes the region uses and that carries it, or `GROUND`.
    rigid : bool
        The loops close for any motion of the base, which carries the region like a rigid subtree. Otherwise the six components
        of the base's motion are sources.
    freedoms : list of (int, int)
        Link and degree of freedom of the independent speeds, which are sources.
    far : list of int
        Other links from which the region starts, and `GROUND`. The six components of the motion of each relative to the base are
        sources; the base then carries the region rigidly.
    """

    base: int
    rigid: bool
    ears: list[int] = field(default_factory=list)
    freedoms: list[tuple[int, int]] = field(default_factory=list)
    far: list[int] = field(default_factory=list)

    @property
    def carried(self) -> bool:
        """Whether a link carries the region, so that its base is not the ground."""
        return self.base != GROUND


@dataclass(slots=True)
class Unit:
    """The object that one step of a sweep processes: a link, an ear or a region."""

    role: str
    number: int
    links: tuple[int, ...]
