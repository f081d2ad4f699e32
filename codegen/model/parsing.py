"""Parser of the expression grammar, see `expressions`."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache
from typing import NoReturn

from ..elementary import TABLE
from ..wording import decimal_comma
from .expressions import Expression, canonical
from .grammar import (
    AT_LEAST,
    CHOICE,
    EXACT,
    FUNCTIONS,
    MAX_DEPTH,
    MAX_LENGTH,
    MAX_NESTING,
    MEASURED,
    ONE,
    WRITTEN_OUT,
    ZERO,
    ExpressionError,
    Tree,
    functions,
)
from .units import UnitError, unit_at

_TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z0-9_]+)*)"
    r"|(?P<operator>\*\*|[<>]=?|[-+*/%(),])"
)
_SUFFIX = re.compile(r"(?:\.[A-Za-z0-9_]+)+")
_BINARY = {"+": 1, "-": 1, "*": 2, "/": 2, "%": 2, "**": 4}
_UNARY = 3
_COMPARED = ("<", "<=", ">", ">=")
_WORDS = ("and", "or", "not")
_CONDITIONAL = ("if", "then", "else", "elif")
_CHOICE = f"a choice is written {WRITTEN_OUT['if']}"
_LEADING_ZERO = re.compile(r"0[0-9]")


def _gap(what: str, start: Tree, end: Tree, c: str) -> Tree:
    """A component of the vector from one point to another, or of its rate."""
    a, b = (
        ("name", f"{what}.{p[1]}.{c}") if p[0] == "name" else ("indexed", f"{what}.{p[1]}", p[2], f".{c}")
        for p in (start, end)
    )
    return ("-", b, a)


def _length(start: Tree, end: Tree) -> Tree:
    """The distance of two points, as a tree."""
    x, y, z = (("**", _gap("position", start, end, c), ("number", 2)) for c in "xyz")
    return ("call", "sqrt", ("+", ("+", x, y), z))


@lru_cache(maxsize=4096)
def parse(text: str) -> Expression:
    """Parse a text of the expression grammar.

    Parameters
    ----------
    text : str

    Returns
    -------
    Expression
        The expression as written; `bind` computes its numerical parts.

    Raises
    ------
    ExpressionError
        With the column, the text found there and the alternatives.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"{len(text)} characters; an expression may have {MAX_LENGTH}, give names to its parts")
    parser = _Parser(text)
    if parser.kind == "end":
        raise ExpressionError("the expression is empty; a number or an expression is needed", 1)
    tree, _ = parser.expression(1, 0)
    if parser.kind != "end":
        if parser.token == ")":
            parser.fail("a closing parenthesis without an opening one; remove it")
        if parser.token == ",":
            hint = decimal_comma(text[parser.start - 1 : parser.start + 2]) or "; remove it"
            parser.fail(f"a comma outside a function's parentheses{hint}")
        if parser.token in (*_COMPARED, *_CONDITIONAL) or text[: parser.start].split()[-1:] == ["if"]:
            parser.fail(f"{parser.token!r} follows a complete expression; {_CHOICE}")
        after_name = parser.kind == "number" and text[parser.start - 1].isalpha()
        power = f"; a power is written **, as in m**{parser.token}" if after_name else ""
        parser.fail(
            f"{parser.token!r} follows a complete expression; an operator + - * / ** is missing before it{power}"
        )
    return Expression(tree)


class _Parser:
    """Precedence climbing over one text; `kind`, `token` and `start` describe the next token."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.end = 0
        self.advance()

    def advance(self) -> None:
        while True:
            self.start = self.end
            if self.start == len(self.text):
                self.kind, self.token = "end", ""
                return
            match = _TOKEN.match(self.text, self.start)
            if match is None:
                self.kind, self.token = "other", self.text[self.start]
                hint = {
                    ".": "; a number has digits, and is finite",
                    "^": "; a power is written **",
                    "[": "; an index is written in round parentheses: link(k)",
                    "=": "; an expression has no equals sign",
                    "'": "; an expression has no quotes",
                    '"': "; an expression has no quotes",
                    "?": f"; {_CHOICE}",
                }.get(self.token, "; an expression has numbers, names, + - * / ** ( ) and functions")
                self.fail(f"character {self.token!r}{hint}")
            self.end = match.end()
            self.kind, self.token = str(match.lastgroup), match.group()
            if self.kind != "space":
                return

    def fail(self, message: str, start: int | None = None) -> NoReturn:
        raise ExpressionError(message, (self.start if start is None else start) + 1)

    def node(self, tree: Tree, depth: int) -> tuple[Tree, int]:
        if depth > MAX_DEPTH:
            self.fail(
                f"more than {MAX_DEPTH} operations in a row or nested; "
                f"group the terms in parentheses or split the expression"
            )
        return tree, depth

    def expression(self, least: int, nesting: int) -> tuple[Tree, int]:
        """The expression here, with operators that bind at least as strongly as `least`, and the depth of its tree."""
        if nesting > MAX_NESTING:
            self.fail(f"more than {MAX_NESTING} levels of parentheses or signs; split the expression")
        if self.token in ("+", "-"):
            sign = self.token
            self.advance()
            left, depth = self.expression(_UNARY, nesting + 1)
            if sign == "-":
                left, depth = self.node(("neg", left), depth + 1)
        else:
            left, depth = self.operand(nesting)
        while _BINARY.get(self.token, 0) >= least:
            kind = self.token
            strength = _BINARY[kind]
            self.advance()
            # the operator ** groups to the right, the other operators to the left
            right, right_depth = self.expression(strength if kind == "**" else strength + 1, nesting + 1)
            left, depth = self.node((kind, left, right), max(depth, right_depth) + 1)
        return left, depth

    def operand(self, nesting: int) -> tuple[Tree, int]:
        start, token = self.start, self.token
        if self.kind == "number":
            if _LEADING_ZERO.match(token):
                self.leading_zero(token)
            self.advance()
            return (
                self.quantity(token, start)
                if self.kind == "name" and self.token not in _WORDS
                else self.number(token, start)
            ), 1
        if self.kind == "name":
            self.advance()
            if self.token == "(" and self.kind == "operator":
                return self.call(token, start, nesting)
            return self.name(token, start), 1
        if token == "(":
            self.advance()
            result = self.expression(1, nesting + 1)
            self.close(start)
            return result
        if self.kind == "end":
            self.fail("the expression ends here; a number, a name or ( is needed")
        self.fail(f"{token!r} found, but a number, a name or ( is needed")

    def close(self, opened: int) -> None:
        if self.token != ")":
            self.fail(
                "the parenthesis is not closed; inside [ ] or { } of YAML a comma ends the value, put quotes around it"
                if self.kind == "end"
                else f"{self.token!r} found, but a closing parenthesis or an operator is needed",
                opened if self.kind == "end" else None,
            )
        self.advance()

    def leading_zero(self, token: str) -> NoReturn:
        """Reports a number with a leading zero: other programs read 010 as 8 or as 10."""
        digits = token.lstrip("0")
        plain = digits if digits[:1].isdigit() else f"0{digits}"
        fraction = f", or 0.{token[1:]} with a decimal point" if token.isdigit() and digits else ""
        message = f"number {token} begins with 0; write {plain}{fraction}"
        self.fail(message if len(token) < 30 else f"number {token[:27]}... begins with 0; remove the leading zeros")

    def number(self, token: str, start: int) -> Tree:
        value = float(token)
        if math.isinf(value):
            self.fail(f"number {token if len(token) < 30 else token[:27] + '...'} is too large; up to 1.8e308", start)
        if value != 0 and abs(value) < EXACT and token.isdigit():
            return ("number", int(value))
        return ("number", canonical(value))

    def quantity(self, token: str, start: int) -> Tree:
        """A number with the unit that follows it."""
        try:
            size, dimension, end = unit_at(self.text, self.start)
        except UnitError as error:
            if self.token in _CONDITIONAL:
                self.fail(f"{self.token!r} follows a complete expression; {_CHOICE}")
            self.fail(f"an operator + - * / ** is missing between the number and {self.token!r}; {error}")
        value = float(token)
        if 0 < value < math.inf:
            try:  # digits beyond those of a float have no effect, but take time
                value = float((Fraction(token) if len(token) <= 60 else Fraction(value)) * size)
            except OverflowError:
                value = math.inf
        if math.isinf(value):
            self.fail(f"{self.text[start:end][:30]} is too large; numbers up to 1.8e308 are allowed", start)
        self.end = end
        self.advance()
        return ("quantity", canonical(value), dimension, self.text[start:end])

    def name(self, name: str, start: int) -> Tree:
        if name == "pi":
            return ("number", math.pi)
        first, dot, rest = name.partition(".")
        if dot and first in MEASURED:
            if not re.fullmatch(r"[A-Za-z_]\w*\.[xyz]", rest):
                self.fail(f"name {name}; write {first}.POINT.x, .y or .z with the name of a point or a body", start)
        elif dot and rest not in ("x", "y", "z") and (first not in ("q", "u") or rest[0].isdigit()):
            self.fail(
                f"name {name}; only coordinates q.NAME, speeds u.NAME, position.POINT.x and velocity.POINT.x have a dot, "
                f"and components NAME.x, .y and .z of vectors",
                start,
            )
        if name in ("q", "u"):
            self.fail(f"{name} alone; write {name}.NAME with the name of a joint", start)
        if name in FUNCTIONS:
            self.fail(f"function {name} without its argument; write {name}(...)", start)
        return ("name", name)

    def call(self, name: str, start: int, nesting: int) -> tuple[Tree, int]:
        if name in WRITTEN_OUT:
            return getattr(self, f"_{name}")(start, nesting)
        if name not in FUNCTIONS:
            return self.indexed(name, start, nesting)
        opened = self.start
        self.advance()
        arguments = []
        if self.token == ")":
            self.fail(f"{name} without an argument; it takes {FUNCTIONS[name]}")
        while True:
            arguments.append(self.expression(1, nesting + 1))
            if self.token != ",":
                break
            self.advance()
        self.close(opened)
        needed, many = FUNCTIONS[name], TABLE[name].many
        if len(arguments) != needed and not (many and len(arguments) > needed):
            hint = decimal_comma(self.text[opened : self.start])
            self.fail(
                f"{name} with {len(arguments)} argument{'s' * (len(arguments) > 1)}; "
                f"it takes {'at least ' * many}{needed}{hint}",
                start,
            )
        if not many:
            return self.node(("call", name, *[a for a, _ in arguments]), 1 + max(d for _, d in arguments))
        result = arguments[0]
        for tree, depth in arguments[1:]:  # min(a, b, c) becomes min(min(a, b), c), so that only two arguments occur
            result = self.node(("call", name, result[0], tree), 1 + max(result[1], depth))
        return result

    def _if(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``if(a < b, x, y)``: x if the condition holds, otherwise y."""
        opened = self.start
        self.advance()
        (holds, _), deep = self.condition(nesting + 1)
        others = []
        for _ in range(2):
            if self.token != ",":
                self.fail(f"{self.token or 'the end'!r} where a comma is needed; write {WRITTEN_OUT['if']}", start)
            self.advance()
            others.append(self.expression(1, nesting + 1))
        self.close(opened)
        (x, of_x), (y, of_y) = others
        return self.node(("call", CHOICE, holds, x, y), 1 + max(deep, of_x, of_y))

    def condition(self, nesting: int) -> tuple[tuple[Tree, Tree], int]:
        """A condition of comparisons, ``not``, ``and``, ``or``. Returns two trees: 1 and 0 if it holds, otherwise 0 and 1."""
        (holds, fails), depth = self.conjunction(nesting)
        while self.token == "or":
            self.advance()
            (other, also), deep = self.conjunction(nesting)
            depth = 1 + max(depth, deep)
            holds, fails = ("call", "max", holds, other), self.node(("*", fails, also), depth)[0]
        return (holds, fails), depth

    def conjunction(self, nesting: int) -> tuple[tuple[Tree, Tree], int]:
        (holds, fails), depth = self.comparison(nesting)
        while self.token == "and":
            self.advance()
            (other, also), deep = self.comparison(nesting)
            depth = 1 + max(depth, deep)
            holds, fails = self.node(("*", holds, other), depth)[0], ("call", "max", fails, also)
        return (holds, fails), depth

    def comparison(self, nesting: int) -> tuple[tuple[Tree, Tree], int]:
        if nesting > MAX_NESTING:
            self.fail(f"more than {MAX_NESTING} levels of parentheses or signs; split the expression")
        if self.token == "not":
            self.advance()
            (holds, fails), depth = self.comparison(nesting + 1)
            return (fails, holds), depth
        inner = self.enclosed(nesting) if self.token == "(" else None
        if inner is not None:
            return inner
        left, depth = self.expression(1, nesting)
        sign = self.token
        if sign not in _COMPARED:
            self.fail(
                f"{sign or 'the end'!r} where one of {' '.join(_COMPARED)} is needed; a condition compares two numbers"
            )
        self.advance()
        right, deep = self.expression(1, nesting)
        a, b = (left, right) if sign in (">=", "<") else (right, left)
        tree: Tree = ("call", AT_LEAST, a, b)
        self.node(tree, depth := 2 + max(depth, deep))
        rest: Tree = ("-", ONE, tree)
        return ((rest, tree) if sign in ("<", ">") else (tree, rest)), depth

    def enclosed(self, nesting: int) -> tuple[tuple[Tree, Tree], int] | None:
        """A condition in parentheses. None if the parentheses belong to a number, which is then parsed from its
        beginning."""
        here = self.end, self.start, self.kind, self.token
        self.advance()
        try:
            found = self.condition(nesting + 1)
            if self.token == ")":
                self.advance()
                if self.token in (",", ")", "and", "or"):
                    return found
        except ExpressionError:
            pass  # reported again when a number is parsed here
        self.end, self.start, self.kind, self.token = here
        return None

    def _step(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``step(x, a, b)``: 0 below a and 1 above b. Between a and b it is ``s^3 (10 - 15 s + 6 s^2)``, with two
        continuous derivatives."""
        (x, low, high), depth = self.arguments("step", 3, start, nesting)
        s = ("call", "min", ("call", "max", ("/", ("-", x, low), ("-", high, low)), ZERO), ONE)
        inner = ("+", ("-", ("number", 10), ("*", ("number", 15), s)), ("*", ("number", 6), ("**", s, ("number", 2))))
        return self.node(("*", ("**", s, ("number", 3)), inner), depth + 7)

    def _distance(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``distance(a, b)``: distance of two points, m."""
        del nesting
        one, other = self.points("distance", start)
        return _length(one, other), 6

    def _rate(self, start: int, nesting: int) -> tuple[Tree, int]:
        """``rate(a, b)``: time derivative of the distance of two points, m/s."""
        del nesting
        one, other = self.points("rate", start)
        products = [("*", _gap("position", one, other, c), _gap("velocity", one, other, c)) for c in "xyz"]
        return ("/", ("+", ("+", products[0], products[1]), products[2]), _length(one, other)), 7

    def points(self, name: str, start: int) -> tuple[Tree, Tree]:
        """The names of two points in parentheses, possibly with repeat indices."""
        found = []
        opened = self.start
        for k in range(2):
            self.advance()
            at = self.start
            tree = self.operand(0) if self.kind == "name" else (ZERO, 1)
            if tree[0][0] not in ("name", "indexed") or "." in tree[0][1]:
                self.fail(f"a point is needed, by its name or that of a body; write {WRITTEN_OUT[name]}", at)
            found.append(tree[0])
            if k == 0 and self.token != ",":
                self.fail(f"{name} with only one point; write {WRITTEN_OUT[name]}", start)
        self.close(opened)
        return found[0], found[1]

    def arguments(self, name: str, count: int, start: int, nesting: int) -> tuple[list[Tree], int]:
        """A given number of expressions in parentheses, and the depth of the deepest one."""
        opened = self.start
        found: list[tuple[Tree, int]] = []
        while not found or self.token == ",":
            self.advance()
            found.append(self.expression(1, nesting + 1))
        self.close(opened)
        if len(found) != count:
            self.fail(f"{name} with {len(found)} arguments; write {WRITTEN_OUT[name]}", start)
        return [tree for tree, _ in found], max(depth for _, depth in found)

    def indexed(self, name: str, start: int, nesting: int) -> tuple[Tree, int]:
        first, dot, rest = name.partition(".")
        measured = bool(dot) and first in MEASURED
        if (
            (dot and first not in ("q", "u", *MEASURED))
            or "." in rest
            or name in ("q", "u", "t", "pi")
            or rest[:1].isdigit()
        ):
            self.fail(f"{name}(...) is neither a function nor a name with a repeat index", start)
        indices: list[Tree] = []
        deepest = 0
        while self.token == "(":
            opened = self.start
            self.advance()
            tree, depth = self.expression(1, nesting + 1)
            if self.token == ",":
                self.fail(
                    f"{name} is not a function; {functions(name)}; in a name, two indices are written {name}(i)(j)",
                    start,
                )
            if self.token == ")" and (match := _SUFFIX.match(self.text, self.end)):
                if measured and match.group() not in (".x", ".y", ".z"):
                    self.fail(f"{name}(...){match.group()}; a component is .x, .y or .z", start)
                self.end = match.end()
                self.advance()
                return ("indexed", name, (*indices, tree), match.group()), max(deepest, depth) + 1
            self.close(opened)
            indices.append(tree)
            deepest = max(deepest, depth)
        if measured:
            self.fail(f"{name}(...) without a component; write {name}(...).x, .y or .z", start)
        return self.node(("indexed", name, tuple(indices), ""), deepest + 1)
