"""Switching functions: functions at whose zeros expressions of a model change their branch.

Examples are a comparison, a sign, an absolute value, the larger or smaller of two numbers, and `atan2` at half a turn. Each is
smooth except where a *switching function* of coordinates, speeds, parameters, inputs and time is zero. The sign of that function
is the *mode* of the switch. An expression with held modes is smooth everywhere, as a step of an integrator requires; modes
change between steps.

A function of the grammar with branches needs its switching function in `codegen.elementary`, and its held form in
`codegen.program.functions`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from ..elementary import TABLE, named, tree_of
from .axes import Vector
from .expressions import COMBINED, Expression
from .grammar import AT_LEAST, WRAPPED, Number, Tree
from .places import Face, Point
from .products import HELD, is_positive
from .singular import singular_functions, singular_in
from .trees import nodes, parts, replaced

MODE: Final = "mode."
"""Prefix of the names of modes in trees: ``mode.0``, ``mode.1`` and so on."""

KINDS: Final = ("sign", "power", "root", "turn", "point")
"""Meaning of the mode of a switch.

- ``sign``: the sign of the switching function.
- ``power``: the sign of the base of a power such as ``max(0, x)**1.5``, whose higher derivatives are unbounded at zero.
- ``root``: the sign of such a base if the first derivative may be unbounded at zero, as for ``sqrt(max(0, x))``.
- ``turn``: the switching function is an angle; the mode is an angle less than half a turn away from it.
- ``point``: no mode. A singular function is zero where an expression, or the direction of a force, may have no value.
"""

BRANCHES: Final = (AT_LEAST, *named("name", lambda e: e.branches))
"""Functions of the grammar that have branches."""

PARTLY_DEFINED: Final = named("name", lambda e: e.domain is not None)
"""Functions with a bounded domain. A switch in the argument is held if the argument is inside the domain when the
branch changes. Otherwise the held branch would have no value or an infinite slope there, as in ``sqrt(max(0, x))``;
such a switch is only located."""


def switching(function: str, arguments: Sequence[Tree]) -> Tree | None:
    """The switching function of a function of some arguments; None for a smooth one."""
    like = TABLE.get({AT_LEAST: "max", WRAPPED: "mod"}.get(function, function))
    return tree_of(like.switching, arguments, COMBINED) if like is not None and like.switching is not None else None


def branching(tree: Tree, varies: Callable[[str], bool]) -> list[Tree]:
    """Calls in a tree of functions with branches whose switching functions contain a varying name.

    Parameters
    ----------
    tree : tuple
        Tree of the bound expression.
    varies : callable (str) -> bool
        Whether a name changes during a motion.

    Returns
    -------
    list of tuple
        Inner calls before the calls that contain them, each once.
    """
    found: dict[Tree, None] = {}
    for part in _inner_first(tree):
        if _has_branches(part, varies):
            found[part] = None
    return list(found)


def _has_branches(tree: Tree, varies: Callable[[str], bool]) -> bool:
    """Whether a tree calls a function that changes its branch. `atan2` changes its branch if its first argument may
    pass zero while the second is not positive."""
    if tree[0] != "call" or tree[1] not in BRANCHES:
        return False
    if tree[1] == "atan2":
        return not is_positive(tree[3]) and any(varies(n) for n in Expression(tree[2]).names)
    return any(varies(n) for n in Expression(tree).names)


def _inner_first(tree: Tree) -> Iterator[Tree]:
    for part in parts(tree):
        yield from _inner_first(part)
    yield tree


def varies_in_motion(inputs: Collection[str]) -> Callable[[str], bool]:
    """A function that tests whether a name changes during a motion of a model with these inputs."""
    known = frozenset((*inputs, "t"))
    return lambda name: name in known or name.startswith(("q.", "u.", "position.", "velocity."))


def has_modes(expression: Expression) -> bool:
    """Whether an expression contains held branches."""
    return any(n.startswith(MODE) for n in expression.names)


@dataclass(slots=True, eq=False)
class Switch:
    """A switching function of a model.

    Attributes
    ----------
    number : int
        Index among all switches of the model.
    call : tuple
        The tree of the first function with this switching function.
    value : tuple
        The tree of the switching function with the modes of other switches held; empty for an angle between bodies.
    kind : str
        A name of `KINDS`.
    element : str
        The force element whose angle jumps at half a turn, or whose ends pass each other; otherwise empty.
    places : list of str
        Paths in the model file.
    drives : bool
        Whether it is in a force, or in prescribed motion.
    moves : bool
        Whether it is in prescribed motion.
    outputs : set of int
        Indices of the outputs that contain it.
    direction : tuple of float
        Direction of the line of a force element whose ends pass each other, not normalised.
    ends : tuple of Point or Face
        For a singular function of a force element or of a distance, which has no tree: two points that may coincide, or two
        faces that may be half a turn apart.
    axis : tuple of Expression, optional
        An axis of the faces: only half a turn about a line across it is singular. Without it any half turn is.
    """

    number: int
    call: Tree
    value: Tree
    kind: str = "sign"
    element: str = ""
    places: list[str] = field(default_factory=list)
    drives: bool = False
    moves: bool = False
    outputs: set[int] = field(default_factory=set)
    direction: tuple[Number, ...] = ()
    ends: tuple[Point | Face, ...] = ()
    axis: Vector | None = None

    @property
    def words(self) -> str:
        """The changing condition, for messages: ``sign(u.slope)``, ``q.band > s``."""
        if self.ends:
            turned = f"half a turn{' across the axis' if self.axis is not None else ''}"
            return turned if isinstance(self.ends[1], Face) else "ends that coincide"
        if self.kind == "point":
            return f"{Expression(self.value)} = 0"
        if self.element:
            what = "angle of {}, at half a turn," if self.kind == "turn" else "line of {}, whose ends coincide,"
            return f"the {what.format(self.element)}"
        if self.call[1] != "at_least":
            return str(Expression(self.call))
        a, b = self.call[2:]
        return f"{Expression(a)} >= {Expression(b)}"


class Switches:
    """The switches of a model's prescribed motion, forces and outputs.

    Parameters
    ----------
    inputs : collection of str
        Names of the model's inputs.

    Attributes
    ----------
    found : list of Switch
        The switches whose modes are held within a step, and the singular functions.
    """

    def __init__(self, inputs: Collection[str]):
        self.found: list[Switch] = []
        self._varies = varies_in_motion(inputs)
        self._by_value: dict[Tree, Switch] = {}
        self._by_ends: dict[tuple[object, ...], Switch] = {}
        self._held: dict[tuple[Tree, bool], Tree] = {}
        self._within: dict[Tree, frozenset[int]] = {}
        self._located: dict[Tree, list[int]] = {}

    def add(self, tree: Tree, place: str, output: int | None = None, moves: bool = False) -> None:
        """Find the switches in an expression: of prescribed motion if it `moves`, of a force, or of an output."""
        held = self.hold(tree, moves)
        singular = [] if moves else [self._point(of).number for of in self._singular(tree)]
        located = {n for part in _inner_first(tree) for n in self._located.get(part, ())} if self._located else set()
        for number in sorted(self._numbers(held) | located.union(singular)):
            switch = self.found[number]
            if place not in switch.places:
                switch.places.append(place)
            switch.moves |= moves
            if output is None:
                switch.drives = True
            else:
                switch.outputs.add(output)

    @property
    def have_modes(self) -> bool:
        """Whether any switch holds a branch; singular functions do not."""
        return any(s.kind != "point" for s in self.found)

    def add_turn(self, element: str) -> None:
        """Add the angle between two bodies, which jumps at half a turn."""
        self.found.append(Switch(len(self.found), (), (), "turn", element, [f"forces.{element}"], drives=True))

    def add_line(self, element: str, length: Tree, direction: tuple[Number, ...]) -> None:
        """Add the line between two points that move along it; the direction of the line reverses when the points pass
        each other."""
        self.found.append(
            Switch(
                len(self.found), (), length, "sign", element, [f"forces.{element}"], drives=True, direction=direction
            )
        )

    def add_ends(
        self, ends: tuple[Point | Face, ...], axis: Vector | None, place: str, output: int | None = None
    ) -> None:
        """Add the ends of a force element, or of a distance in an output, whose direction may not be determined."""
        key = tuple((end.body, *(e.tree for e in end.at)) for end in ends)
        of_points = not any(isinstance(end, Face) for end in ends)
        switch = self._by_ends.get(key) if of_points else None
        if switch is None:
            switch = Switch(len(self.found), (), (), "point", ends=ends, axis=axis)
            self.found.append(switch)
            if of_points:
                self._by_ends[key] = switch
        switch.places.append(place)
        if output is None:
            switch.drives = True
        else:
            switch.outputs.add(output)

    def direction_of(self, element: str) -> tuple[Number, ...]:
        """The direction, not normalised, of the line between the ends of a force element, if it is constant."""
        return next((s.direction for s in self.found if s.element == element), ())

    def mode_of(self, element: str) -> tuple[Tree, ...]:
        """The mode of a force element's angle or line, if there is one; for a line, also the direction of the line."""
        found = (s for s in self.found if s.element == element)
        return next(((("name", f"{MODE}{s.number}"), *(("number", v) for v in s.direction)) for s in found), ())

    def hold(self, tree: Tree, moves: bool = False) -> Tree:
        """The tree in which functions with branches are replaced by held functions.

        In prescribed motion (`moves`), steps and cubic tables are held as well, since the equations contain its second
        derivative; in a force they are smooth enough. The argument of a periodic table is held at the seam, in forces
        and in prescribed motion.
        """
        if tree[0] in ("number", "name"):
            return tree
        if (tree, moves) not in self._held:
            self._held[tree, moves] = self._hold(tree, moves)
        return self._held[tree, moves]

    def _hold(self, tree: Tree, moves: bool) -> Tree:
        kind = tree[0]
        if moves and tree[:2] == ("call", WRAPPED):
            tree = (kind, "mod", *tree[2:])
        if kind == "**" and not _is_whole(tree[2]) and self._locate(tree, tree[1]):
            return (kind, tree[1], self.hold(tree[2], moves))
        if kind == "call" and tree[1] in PARTLY_DEFINED and self._locate(tree, tree[2]):
            return tree
        clamp = None if moves else _clamp_of_step(tree)
        if clamp is not None:
            of, (first, second) = clamp[3], clamp[2][2:]
            inner = ("call", "max", self.hold(first), self.hold(second))
            return replaced(tree, clamp, ("call", "min", inner, self.hold(of)))
        if kind != "call":
            return (kind, *(self.hold(a, moves) for a in tree[1:]))
        arguments = tuple(self.hold(a, moves) for a in tree[2:])
        if not _has_branches(tree, self._varies):
            return (kind, tree[1], *arguments)
        return (kind, HELD + tree[1], *arguments, ("name", f"{MODE}{self._switch(tree, arguments).number}"))

    def _switch(self, call: Tree, arguments: tuple[Tree, ...]) -> Switch:
        """The switch of a function of some arguments; made at the first call."""
        value = switching(call[1], arguments)
        assert value is not None
        switch = self._by_value.get(value)
        if switch is None:
            switch = self._by_value[value] = Switch(len(self.found), call, value)
            self.found.append(switch)
        return switch

    def _singular(self, tree: Tree) -> list[Tree]:
        """Singular functions, except bases of roots and powers for which a switch exists at the zeros of the base."""
        return singular_functions(
            tree, self._varies, lambda part, of: part in self._located and self._without_factors(of)[0] == "call"
        )

    def _without_factors(self, tree: Tree) -> Tree:
        """The only varying factor of a product, which has the same zeros as the product; the product itself if several
        factors vary."""
        while True:
            tree = _may_be_absolute(tree)
            if tree[0] == "neg" or (tree[0] in ("*", "/") and not self._has_varying(tree[2])):
                tree = tree[1]
            elif tree[0] == "*" and not self._has_varying(tree[1]):
                tree = tree[2]
            else:
                return tree

    def _has_varying(self, tree: Tree) -> bool:
        return any(map(self._varies, Expression(tree).names))

    def _point(self, value: Tree) -> Switch:
        """The switch, without a mode, of a singular function."""
        switch = self._by_value.get(("point", value))
        if switch is None:
            switch = self._by_value["point", value] = Switch(len(self.found), (), value, "point")
            self.found.append(switch)
        return switch

    def _locate(self, tree: Tree, inner: Tree) -> bool:
        """Find switches in the argument of a function with a bounded domain; returns whether any is zero at a bound of
        the domain."""
        inner = _may_be_absolute(inner)
        if tree not in self._located:
            if not _changes_at_bounds(tree, inner, self._varies):
                return False
            found = [
                self._switch(call, tuple(self.hold(a) for a in call[2:])) for call in branching(inner, self._varies)
            ]
            is_power = tree[0] == "**" and tree[2][0] == "number" and tree[2][1] > 1
            for switch in found:
                switch.kind = "power" if is_power and switch.kind != "root" else "root"
            self._located[tree] = [switch.number for switch in found]
        return True

    def _numbers(self, tree: Tree) -> frozenset[int]:
        """Indices of the switches whose modes a tree contains."""
        if tree not in self._within:
            names = Expression(tree).names
            self._within[tree] = frozenset(int(n.removeprefix(MODE)) for n in names if n.startswith(MODE))
        return self._within[tree]


def _changes_at_bounds(tree: Tree, inner: Tree, varies: Callable[[str], bool]) -> bool:
    """Whether a branch may change at a bound of the function's domain, tested at a few places."""
    bounds = [Expression(of) for of in singular_in(tree)]
    for call in branching(inner, varies):
        value = switching(call[1], call[2:])
        assert value is not None
        for n in range(1, 4):
            values = {
                name: 0.3 + (0.61803398875 * n * i) % 1.7 for i, name in enumerate(sorted(Expression(tree).names), 1)
            }
            if not _solve(Expression(value), values):
                return True
            try:
                if any(abs(of.evaluate(values)) < 1e-6 for of in bounds):
                    return True
            except (ArithmeticError, ValueError):
                return True
    return False


def _solve(e: Expression, values: dict[str, float]) -> bool:
    """Change the value of one name so that an expression is zero, by bisection between -4 and 4; returns whether this
    succeeds."""
    for name in sorted(e.names):
        first = values[name]
        ends: list[tuple[float, float]] = []
        for x in (0.125 * i + 0.001 for i in range(-32, 32)):
            try:
                found = e.evaluate(values | {name: x})
            except (ArithmeticError, ValueError):
                continue
            if ends and ends[-1][1] * found <= 0.0:
                low, high, at_low = ends[-1][0], x, ends[-1][1]
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if e.evaluate(values | {name: middle}) * at_low > 0.0:
                        low = middle
                    else:
                        high = middle
                values[name] = high
                return True
            ends.append((x, found))
        values[name] = first
    return False


def _may_be_absolute(tree: Tree) -> Tree:
    """The absolute value of the base of an even power such as ``x**2``, with the same zeros; other trees are unchanged."""
    return ("call", "abs", tree[1]) if tree[0] == "**" and _is_whole(tree[2]) and tree[2][1] % 2 == 0 else tree


def _is_whole(tree: Tree) -> bool:
    """Whether an exponent is an integer, so that a negative base has a power."""
    return bool(tree[0] == "number") and float(tree[1]).is_integer()


def _clamp_of_step(tree: Tree) -> Tree | None:
    """The clamped argument of a part of a cubic table or of the function ``step``, whose second derivatives are
    continuous; None for another tree.

    Such parts are polynomials ``s*(a + s*(b + c*s))`` and ``s**3*(10 - 15*s + 6*s**2)`` of ``s = min(max(..), ..)``; in
    a table, s is this minimum minus a number.
    """
    if tree[0] != "*":
        return None
    first, rest = tree[1], tree[2]
    s = first[1] if first[0] == "**" and first[2] == ("number", 3) else first
    part: Tree = s[1] if s[0] == "-" and s[2][0] == "number" else s
    is_clamp = part[:2] == ("call", "min") and part[2][:2] == ("call", "max")
    return part if is_clamp and s in nodes(rest) else None
