"""Where the expressions of a model change their branch: switching functions.

A comparison, a sign, an absolute value, the larger or smaller of two numbers, `atan2` at half a turn: each is smooth but
where a *switching function* of coordinates, speeds, parameters, inputs and time is zero. The sign of that function is the
*mode* of the switch. An expression whose modes are held is smooth everywhere, which is what a step of an integrator needs;
between steps modes change.

A function of the grammar that has branches needs its switching function in `codegen.elementary`, and its held form in
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
from .trees import nodes, parts

MODE: Final = "mode."
"""Begins the names of modes in trees: ``mode.0``, ``mode.1`` and so on."""

KINDS: Final = ("sign", "power", "root", "turn", "point")
"""What the mode of a switch is.

- ``sign``: the sign of the switching function.
- ``power``: the same, of the base of a power such as ``max(0, x)**1.5``, whose higher derivatives are unbounded at zero.
- ``root``: the same, where the first derivative may be unbounded, as that of ``sqrt(max(0, x))``.
- ``turn``: the angle near which the function, itself an angle, is measured.
- ``point``: nothing, of a singular function, which is zero where an expression, or the direction of a force, may have no value.
"""

BRANCHES: Final = (AT_LEAST, *named("name", lambda e: e.branches))
"""Functions that have branches."""

PARTLY_DEFINED: Final = named("name", lambda e: e.domain is not None)
"""Functions whose argument has bounds. Switches in it are held if it is within them where its branch changes; else the branch
that is held has no value there or an infinite slope, as in ``sqrt(max(0, x))``, and they are only located."""


def switching(function: str, arguments: Sequence[Tree]) -> Tree | None:
    """What is zero where a function of some arguments may not be smooth; None for one that is smooth."""
    like = TABLE.get({AT_LEAST: "max", WRAPPED: "mod"}.get(function, function))
    return tree_of(like.switching, arguments, COMBINED) if like is not None and like.switching is not None else None


def branching(tree: Tree, varies: Callable[[str], bool]) -> list[Tree]:
    """Calls in a tree of functions that have branches, with a switching function that a varying name is in.

    Parameters
    ----------
    tree : tuple
        Of a bound expression.
    varies : callable (str) -> bool
        Whether a name changes during a motion.

    Returns
    -------
    list of tuple
        Inner calls before those that they are in, each once.
    """
    found: dict[Tree, None] = {}
    for part in _inner_first(tree):
        if _has_branches(part, varies):
            found[part] = None
    return list(found)


def _has_branches(tree: Tree, varies: Callable[[str], bool]) -> bool:
    """Whether a tree is a call of a function that changes its branch; `atan2` does where its first argument may pass zero with a
    second one that is not positive."""
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
    """Whether a name changes during a motion of a model with these inputs."""
    known = frozenset((*inputs, "t"))
    return lambda name: name in known or name.startswith(("q.", "u.", "position.", "velocity."))


def has_modes(expression: Expression) -> bool:
    """Whether branches are held in an expression."""
    return any(n.startswith(MODE) for n in expression.names)


@dataclass(slots=True, eq=False)
class Switch:
    """A switching function of a model.

    Attributes
    ----------
    number : int
        Among all of the model.
    call : tuple
        The tree of the first function that it is of.
    value : tuple
        The tree of the switching function, in which the modes of other switches are held; of an angle of bodies none.
    kind : str
        A name of `KINDS`: what its mode is.
    element : str
        The force element whose angle jumps at half a turn, or whose ends pass each other; nothing for others.
    places : list of str
        Paths in the model file.
    drives : bool
        It is in a force, or in prescribed motion.
    moves : bool
        It is in prescribed motion.
    outputs : set of int
        Outputs that it is in.
    direction : tuple of float
        Of the line of a force element whose ends pass each other, of any length.
    ends : tuple of Point or Face
        Of a singular function of a force element or of a distance, which has no tree: two points that may meet, or two faces that
        may be half a turn apart.
    axis : tuple of Expression, optional
        Of the faces: half a turn across it is singular, instead of any half turn.
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
        """What changes its branch, for messages: ``sign(u.slope)``, ``q.band > s``."""
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
        Those whose modes are held within a step, and singular functions.
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
        """Find the switches of an expression of prescribed motion, which `moves`, of a force, or of an output."""
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
        """Whether any of them holds a branch; singular functions do not."""
        return any(s.kind != "point" for s in self.found)

    def add_turn(self, element: str) -> None:
        """The angle between two bodies, which jumps at half a turn."""
        self.found.append(Switch(len(self.found), (), (), "turn", element, [f"forces.{element}"], drives=True))

    def add_line(self, element: str, length: Tree, direction: tuple[Number, ...]) -> None:
        """The line between two points that move along it, which turns over where they pass each other."""
        self.found.append(
            Switch(
                len(self.found), (), length, "sign", element, [f"forces.{element}"], drives=True, direction=direction
            )
        )

    def add_ends(
        self, ends: tuple[Point | Face, ...], axis: Vector | None, place: str, output: int | None = None
    ) -> None:
        """Two ends of a force element, or of an output that is a distance, where it may have no direction."""
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
        """The direction, of any length, of the line between the ends of a force element, if it is always the same."""
        return next((s.direction for s in self.found if s.element == element), ())

    def mode_of(self, element: str) -> tuple[Tree, ...]:
        """The mode of the angle or the line of a force element, if it has one; then the direction of the line."""
        found = (s for s in self.found if s.element == element)
        return next(((("name", f"{MODE}{s.number}"), *(("number", v) for v in s.direction)) for s in found), ())

    def hold(self, tree: Tree, moves: bool = False) -> Tree:
        """The tree with held functions in the place of those that have branches.

        Of prescribed motion, which `moves`, the second derivative acts: steps and cubic tables, which are smooth in a force, are
        held there.
        """
        if tree[0] in ("number", "name"):
            return tree
        if (tree, moves) not in self._held:
            self._held[tree, moves] = self._hold(tree, moves)
        return self._held[tree, moves]

    def _hold(self, tree: Tree, moves: bool) -> Tree:
        kind = tree[0]
        if kind == "**" and not _is_whole(tree[2]) and self._locate(tree, tree[1]):
            return (kind, tree[1], self.hold(tree[2], moves))
        if kind == "call" and tree[1] in PARTLY_DEFINED and self._locate(tree, tree[2]):
            return tree
        if _is_smooth_step(tree) and not moves:
            return tree
        if kind != "call":
            return (kind, *(self.hold(a, moves) for a in tree[1:]))
        arguments = tuple(self.hold(a, moves) for a in tree[2:])
        if not _has_branches(tree, self._varies):
            return (kind, tree[1], *arguments)
        return (kind, HELD + tree[1], *arguments, ("name", f"{MODE}{self._switch(tree, arguments).number}"))

    def _switch(self, call: Tree, arguments: tuple[Tree, ...]) -> Switch:
        """The switch of a function of some arguments, which is made if it is the first."""
        value = switching(call[1], arguments)
        assert value is not None
        switch = self._by_value.get(value)
        if switch is None:
            switch = self._by_value[value] = Switch(len(self.found), call, value)
            self.found.append(switch)
        return switch

    def _singular(self, tree: Tree) -> list[Tree]:
        """Singular functions, but for bases of roots and powers at whose zeros a switch is."""
        return singular_functions(
            tree, self._varies, lambda part, of: part in self._located and self._without_factors(of)[0] == "call"
        )

    def _without_factors(self, tree: Tree) -> Tree:
        """A part of a product that is zero where the product is, if other factors do not vary."""
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
        """The switch of a singular function."""
        switch = self._by_value.get(("point", value))
        if switch is None:
            switch = self._by_value["point", value] = Switch(len(self.found), (), value, "point")
            self.found.append(switch)
        return switch

    def _locate(self, tree: Tree, inner: Tree) -> bool:
        """Find switches in the argument of a function with a domain; whether there are any at its bounds."""
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
        """The switches in a held tree."""
        if tree not in self._within:
            names = Expression(tree).names
            self._within[tree] = frozenset(int(n.removeprefix(MODE)) for n in names if n.startswith(MODE))
        return self._within[tree]


def _changes_at_bounds(tree: Tree, inner: Tree, varies: Callable[[str], bool]) -> bool:
    """Whether an argument is, or may be, at the bounds of its function where a branch of it changes: at a few such places."""
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
    """Change the value of one name so that an expression is zero; whether that is found, by bisection between -4 and 4."""
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
    """An argument as the absolute value of another, if it is an even power, such as ``x**2``."""
    return ("call", "abs", tree[1]) if tree[0] == "**" and _is_whole(tree[2]) and tree[2][1] % 2 == 0 else tree


def _is_whole(tree: Tree) -> bool:
    """Whether an exponent is a whole number: then a negative base has a power."""
    return bool(tree[0] == "number") and float(tree[1]).is_integer()


def _is_smooth_step(tree: Tree) -> bool:
    """Whether a tree is a part of a cubic table, or of the function ``step``, whose second derivatives are continuous.

    Both are polynomials of ``s = min(max(..), ..)``: ``s*(a + s*(b + c*s))`` and ``s**3*(10 - 15*s + 6*s**2)``.
    """
    if tree[0] != "*":
        return False
    first, rest = tree[1], tree[2]
    s = first[1] if first[0] == "**" and first[2] == ("number", 3) else first
    return bool(s[0] == "call" and s[1] == "min" and s[2][:2] == ("call", "max")) and s in nodes(rest)
