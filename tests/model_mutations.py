# ruff: noqa: E501  (tables)
"""Model files with mistakes: a seed selects a damaged text, and `judge` returns the outcome of loading it.

Where `random_models` makes good models, this makes damaged ones. Every text starts as one of the examples, one of those
of docs/model_format.md or one of the texts here (together they use every key of the format), and suffers up to four
mutations that know the grammar: values of keys are dropped, moved, exchanged or replaced by others of another type, numbers
become 0, nan, 1e308 or have 5001 digits, names are misspelt or exchanged, ranges of `repeat` grow, expressions are put
into powers and quotients, lines are shifted, tokens and characters are exchanged. What loads must be a sound model
(`nonsense`), what does not must be a `ModelError` whose every line has a place; nothing else may happen, within a time limit.
"""

from __future__ import annotations

import math
import random
import re
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from codegen.model import Model, ModelError, parse_model
from codegen.model.model import GROUND, PointCondition
from codegen.model.surfaces import COORDINATES

ROOT = Path(__file__).parents[1]
FILE = "m.yaml"
PLACE = re.compile(rf"({FILE}|parts/\w+\.yaml):[1-9]\d*:[1-9]\d*: \S")
"""Where a message says it is: the text itself, or a part that it includes."""

MECHANISM = """\
model: mechanism
gravity: [0, -g, -9.81]
constants: {g: 0.5, n: 2, side: [1, -1], big: 1e3}
parameters:
  L: {value: 0.8, unit: m, min: 0.1, max: 2}
  m: 1.5
  k: {value: 3*g, min: 0}
inputs: [pull, {repeat j in 1..n: {motor(j): }}]
bodies:
  hull: &hull
    parent: ground
    joint: {type: free, at: [0, 0, 1], rpy: [0.1, 0, L]}
    mass: 3
    com: [0.1, 0, L/9]
    inertia: {xx: 1, yy: 1.2, zz: m, xy: 0.01, xz: -0.02, yz: 1e-3}
  repeat side_ in left, right:
    hip(side_): {parent: hull, joint: {type: universal, axes: [x, [0, 1, 0]], at: [0, 0.1, 0]},
                 shape: {type: capsule, axis: z, length: L, radius: 0.03, mass: m, center: [0, 0, -L/2]}}
    repeat j in 1..n:
      leg(side_)(j):
        parent: leg(side_)(j-1)
        joint: &hinge {type: revolute, axis: "y", at: [0, 0, -L]}
        shape: {type: cylinder, axis: -z, length: L, radius: 0.02, density: 2700/j}
        first: {parent: hip(side_), joint: {at: [0, 0, -L/2]}}
        last: {shape: {length: L/2}}
  ball: {parent: leg(left)(n), joint: {type: spherical}, shape: {type: sphere, radius: 0.05, mass: side(1)}}
  box: {parent: leg_right_1, joint: {type: fixed, rotate: [{axis: [1, 1, 0], angle: pi/3}, {axis: z, angle: m}]},
        shape: {type: box, size: [0.1, 0.2, L], density: big}}
  slide: {<<: *hull, parent: box, joint: {<<: *hinge, type: prismatic}}
points:
  tip: {body: ball, at: [0, 0, "-max(L, 0.1)"]}
  repeat j in 1..n: {knee(j): {body: leg(right)(j), at: [0, 0, side(j)]}}
forces:
  drive: {type: joint, joint: leg_left_1, value: motor_1*sin(3*t) - 0.1*u.leg(left)(1)**3}
  hips: {type: joint, joint: hip_left, value: [-k*q.hip_left.1, "min(pull, k)"]}
  rope: {type: spring, from: tip, to: {body: ground, at: [0, 0, 2]}, stiffness: k*(1 + pull), damping: 2, free_length: 0.8*L}
initial:
  q: {hull: [0, 0, 1, 1, 0, 0, 0], ball.qw: 0.8, ball.qx: 0.6, repeat j in 1..n step 2: {leg(left)(j): 0.3*sin(j)}}
  u: {slide: -L, hull.wx: 1e-3}
outputs:
  height: {position: tip, axis: z}
  speed: {velocity: knee_1, axis: [1, L, 0]}
  power: {value: "motor_2*u.slide + atan2(q.slide, 1 + t**2)"}
  energy: kinetic_energy
  stored: potential_energy
"""

LOOPS = """\
model: loops
constants: {h: 0.3}
parameters: {a: 1.0, b: 0.7}
bodies:
  one: {parent: ground, joint: {type: revolute, axis: z}, mass: 1, com: [a/2, 0, 0], inertia: {zz: 0.1}}
  two: {parent: one, joint: {type: revolute, axis: z, at: [a, 0, 0]}, mass: b, inertia: {xx: 1, yy: 1, zz: 1}}
  three: {parent: two, joint: {type: spherical, at: [b, 0, 0]}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  four: {parent: ground, joint: {type: prismatic, axis: [1, 0, h]}, mass: 1}
loops:
  hinge: {joint: {type: revolute, axis: z}, from: {body: three, at: [a, 0, 0]}, to: {body: ground, at: [b, 0, 0], rpy: [0, 0, h]}}
  point: {joint: {type: point}, from: tip, to: four}
  plane: {joint: {type: planar, normal: [0, 0, 1]}, from: {body: two, rotate: [{axis: x, angle: 0.2}]}, to: ground}
  slide: {joint: {type: cylindrical, axis: x}, from: one, to: three}
  cross: {joint: {type: universal, axes: [x, y]}, from: two, to: four}
  bar: {joint: {type: prismatic, axis: y}, from: {body: one, at: [0, h, 0]}, to: {body: four}}
  weld: {joint: {type: fixed}, from: two, to: ground}
points: {tip: {body: three, at: [0, h, 0]}}
initial: {q: {one: 0.3, two: 1.27, three: [1, 0, 0, 0]}, u: {one: 1.0}}
independent: [one, four, {repeat k in 1..0: {three(k): }}]
"""

PENDULUM = """\
model: pendulum
gravity: [0, 0, -9.81]
parameters: {L: 1.0}
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: rod, axis: z, length: L, mass: 1, center: [0, 0, -L/2]}
forces:
  friction: {type: joint, joint: rod, value: -0.01*u.rod}
"""

CHAIN = """\
model: chain
constants: {n: 30, rho: 2}
parameters: {L: 1.0}
bodies:
  repeat k in 1..n:
    link(k):
      parent: link(k-1)
      joint: {type: revolute, axis: [1 - k % 2, k % 2, 0], at: [0, 0, -L]}
      shape: {type: cylinder, axis: z, length: L, radius: 0.05, mass: rho*L/k, center: [0, 0, -L/2]}
      first: {parent: ground, joint: {at: [0, 0, 0]}}
initial:
  q: {repeat k in 1..n: {link(k): 0.3*sin(k)}}
"""

NUMBERS = (
    *("0", "-1", "1", "2", "nan", "inf", "-inf", ".nan", ".inf", "-.Inf", "NaN", "Infinity", "1e308", "-1e308", "1.8e308", "1e999"),
    *("1e-320", "5e-324", "1e200", "1e-200", "-1e-20", "1e16", "9007199254740993", "1" + 5001 * "0", "0." + 5001 * "3"),
    *("0x10", "1_000", "1,5", "1..2", "1e", "--1", "+2", "1e9", "1000000000", "2147483648", "10**10**10", "2**1e9", "-0.0", "1/3"),
    *("1j", "1%0", "5 % 3", "pi", "1.", ".5", "1e-7", "99999", "'1'", "1:30", "~", "true", "0b1", "1/0", "0/0", "1e308*10"),
)  # fmt: skip
"""What a number may become."""

VALUES = (
    *("", "~", "null", "true", "[]", "{}", '""', "' '", "3", "text", "[1, 2]", "[1, 2, 3]", "[x, y]", "[[1], [2], [3]]", "{a: 1}"),
    *("[{axis: z, angle: 1}]", "{type: revolute, axis: y}", "{type: free}", "{type: sphere, radius: 1, mass: 1}", "ground", "x", "-z"),
    *("[0, 0, 0]", "[1e308, 1e308, 1e308]", "[1e-320, 0, 0]", "[nan, 0, 0]", "{body: ground}", "{repeat k in 1..3: {a(k): 1}}", "t"),
    *("{repeat k in left, right: {a(k): 1}}", "{xx: 1}", "{xx: -1e-20}", "{xz: 1.4e-20}", "[1, 0, 0, 0]", "[1e308, 0, 0, 0]", "*hull"),
    *("!!python/object:os.system x", "|\n  text", "q.a", "u.a", "link(1)", "a(k)(j)", "1 +", "(1", "sin", "sin()", "step(1)", "ln(2)"),
    *("kinetic_energy", "[0.1, 1e200, 0, 0, 0, 0, 0]", "<<", "&x 1", "[crank, {repeat k in 1..n: {link(k): }}]", "? a", "- 1", "#"),
)  # fmt: skip
"""What a value may become."""

RANGES = ("1..0", "0..3", "1..1000000", "1..999999999", "1..10**30", "1..n**n", "-5..5", "1..3 step 0", "1..9 step -1", "a..b", "1.5..3",
          "left, right", "x", "1..n step n", "1..1e5", "n..1", "1..2..3", "1, 2", "left, left", "7", "1..30000", "1..n*1000", "")  # fmt: skip

WRAPPERS = (
    *("({})**1000000000", "({})**-1000000000", "({})**1e300", "(({})**1000)**1000", "1/({})", "log({})", "sqrt(-({}))", "({})/0", "0*({})"),
    *("({})**0.5", "2**({})", "(-8)**({})", "({})**({})", "exp(exp(exp({})))", "1e308*({})*1e308", "acos(2 + ({})**2)", "({}) % 2", "0/({})"),
    *("-" * 99 + "{}", "(" * 60 + "{}" + ")" * 60, " + ".join(["({})"] * 30), "tan({})", "sign({})", "max({}, 1, 2)", "step({})", "abs({})"),
    *("({})**10**10", "({}).x", "{}{}", "{} {}", "({})**7/1e-300", "asin({})", "sinh(1000*({}))", "'{}'", '"{}"', "{}**1e7", "{}**12345678"),
)  # fmt: skip

NAMES = ("t", "q", "u", "pi", "ground", "sin", "x", "y", "k", "n", "nan", "inf", "q.a", "u.hull.wx", "q.leg(left)(1)", "repeat", "first",
         "last", "class", "while", "__import__", "os.system", "L", "kinetic_energy", "type", "parent", "null", "ö", "9a", "a.b", "link(k-1)",
         "link(0)", "link(k)(k)", "link(1.5)", "link(1e400)", "revolute", "fixed", "prismatic", "free", "spherical", "universal")  # fmt: skip

PIECES = ("[", "]", "{", "}", ": ", ", ", "\n", "\n  ", "  ", "\t", "#", "*", "&a ", "'", '"', "|", "- ", "? ", "<<: *hull", "(", ")", "**",
          "%", "..", "repeat k in 1..3:", "first: {parent: ground}", "\x00", "\ufeff", "é", "\u2028", "...", "---", "!!", "@", "`", "-", "/", "0")  # fmt: skip

_TOKEN = re.compile(
    r"(?P<number>(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w.]))"
    r"|(?P<name>[A-Za-z_]\w*(?:\.\w+)*)|(?P<range>(?<= in )[^:{}\n]+(?=:))|(?P<indent>(?<=\n) +)|(?P<other>\*\*|\S)"
)


class Base(NamedTuple):
    """A good text, where its mappings' pairs and its values stand, and its anchors."""

    text: str
    pairs: list[tuple[int, int, int, int]]
    values: list[tuple[int, int]]
    scalars: list[tuple[int, int]]


@cache
def bases() -> tuple[Base, ...]:
    """The texts that are damaged."""
    page = (ROOT / "docs" / "model_format.md").read_text(encoding="utf-8")
    examples = [p.read_text(encoding="utf-8") for p in sorted((ROOT / "examples").glob("*.yaml"))]
    texts = [*examples, *re.findall(r"```yaml\n(.*?)```", page, re.DOTALL), MECHANISM, LOOPS, PENDULUM, CHAIN]
    return tuple(_base(text) for text in texts)


def _base(text: str) -> Base:
    pairs, values, scalars = [], [], []
    waiting = [yaml.compose(text, yaml.CSafeLoader)]
    seen: set[int] = set()
    while waiting:
        node = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        start, end = node.start_mark.index, node.end_mark.index
        end = start + len(text[start:end].rstrip())
        values.append((start, end))
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.start_mark.index < value.end_mark.index:  # not the target of an alias or merge, further up
                    pairs.append(
                        (key.start_mark.index, key.end_mark.index, value.start_mark.index, value.end_mark.index)
                    )
                waiting += [value, key]
        elif isinstance(node, yaml.SequenceNode):
            waiting += node.value
        else:
            scalars.append((start, end))
    return Base(text, sorted(pairs), sorted(values), sorted(scalars))


def mutated(seed: int) -> str:
    """The damaged text of a seed."""
    rng = random.Random(seed)
    base = rng.choice(bases())
    text = _structural(rng, base) if rng.random() < 0.6 else base.text
    for _ in range(rng.choice((0, 1, 1, 2, 3)) if text != base.text else rng.choice((1, 1, 2, 3, 4))):
        text = rng.choice(_LOCAL)(rng, text)
    return text


def _structural(rng: random.Random, base: Base) -> str:
    """Exchange whole keys and values, once or twice, in the tree of the base text."""
    edits: list[tuple[int, int, str]] = []

    def edit(start: int, end: int, new: str) -> None:
        if all(end <= a or b <= start for a, b, _ in edits):
            edits.append((start, end, new))

    def some_value() -> str:
        other = base if rng.random() < 0.7 else rng.choice(bases())
        start, end = rng.choice(other.values[1:])
        return other.text[start:end]

    for _ in range(rng.choice((1, 1, 2))):
        kind = rng.randrange(8)
        key, key_end, start, end = rng.choice(base.pairs)
        end = start + len(base.text[start:end].rstrip())
        if kind == 0:  # a key dropped, with the comma or line that went with it
            tail = re.compile(r"\s*,?[ ]*").match(base.text, end)
            edit(key, tail.end() if tail else end, "")
        elif kind == 1:  # a value of another type
            edit(start, end, rng.choice(VALUES))
        elif kind == 2:  # a value from elsewhere
            edit(start, end, some_value())
        elif kind == 3:  # two values exchanged
            a, b = sorted(rng.sample(base.values[1:], 2))
            if a[1] <= b[0]:
                edit(*a, base.text[b[0] : b[1]])
                edit(*b, base.text[a[0] : a[1]])
        elif kind == 4:  # a key renamed, or exchanged with another
            other = rng.choice(base.pairs)
            edit(key, key_end, rng.choice((base.text[other[0] : other[1]], rng.choice(NAMES))))
        elif kind == 5:  # an expression wrapped
            a, b = rng.choice(base.scalars)
            edit(a, b, rng.choice(WRAPPERS).replace("{}", base.text[a:b]))
        elif kind == 6:  # a pair from elsewhere put before this one
            other = rng.choice(base.pairs)
            piece = base.text[other[0] : other[3]].rstrip()
            indent = key - base.text.rfind("\n", 0, key) - 1
            flow = "\n" not in piece and base.text[:key].rstrip(" ").endswith(("{", ","))
            edit(key, key, f"{piece}, " if flow else f"{piece}\n{' ' * indent}")
        else:
            a, b = rng.choice(base.scalars)
            edit(a, b, rng.choice((*NUMBERS, *NAMES, "")))
    text = base.text
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _tokens(text: str, *kinds: str) -> list[tuple[int, int]]:
    return [m.span() for m in _TOKEN.finditer(text) if not kinds or m.lastgroup in kinds]


def _replaced(text: str, span: tuple[int, int], new: str) -> str:
    return text[: span[0]] + new + text[span[1] :]


def _number(rng: random.Random, text: str) -> str:
    spans = _tokens(text, "number")
    return _replaced(text, rng.choice(spans), rng.choice(NUMBERS)) if spans else text


def _exchange(rng: random.Random, text: str) -> str:
    """Exchange two tokens of one kind, or of any kinds."""
    spans = _tokens(text, *rng.choice((("number",), ("name",), ("other",), ())))
    if len(spans) < 2:
        return text
    a, b = sorted(rng.sample(spans, 2))
    return text[: a[0]] + text[b[0] : b[1]] + text[a[1] : b[0]] + text[a[0] : a[1]] + text[b[1] :]


def _drop(rng: random.Random, text: str) -> str:
    spans = _tokens(text)
    return _replaced(text, rng.choice(spans), "") if spans else text


def _rename(rng: random.Random, text: str) -> str:
    """Misspell or replace a name, once or everywhere."""
    spans = _tokens(text, "name")
    if not spans:
        return text
    span = rng.choice(spans)
    old = text[span[0] : span[1]]
    other = rng.choice(spans)
    new = rng.choice((old[:-1] or "z", old + "x", text[other[0] : other[1]], rng.choice(NAMES), old.upper()))
    if rng.random() < 0.3:
        return re.sub(rf"(?<![\w.]){re.escape(old)}(?![\w.])", lambda _: new, text)
    return _replaced(text, span, new)


def _range(rng: random.Random, text: str) -> str:
    spans = [m.span(1) for m in re.finditer(r"repeat \w+ in ([^:{}\n]+):", text)]
    return _replaced(text, rng.choice(spans), rng.choice(RANGES)) if spans else _number(rng, text)


def _indent(rng: random.Random, text: str) -> str:
    """Shift a line, or all lines from one to another."""
    lines = text.split("\n")
    first = rng.randrange(len(lines))
    last = first + rng.choice((1, 1, 1, 3, 10))
    shift = rng.choice((-2, -1, 1, 2, 4, "\t"))
    for i in range(first, min(last, len(lines))):
        if isinstance(shift, str):
            lines[i] = shift + lines[i]
        else:
            lines[i] = " " * shift + lines[i] if shift > 0 else re.sub(f"^ {{0,{-shift}}}", "", lines[i])
    return "\n".join(lines)


def _lines(rng: random.Random, text: str) -> str:
    """Delete or repeat a line, or exchange it with another."""
    lines = text.split("\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(3)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return "\n".join(lines)


def _insert(rng: random.Random, text: str) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(PIECES) + text[at:]


def _cut(rng: random.Random, text: str) -> str:
    start = rng.randrange(len(text) + 1)
    return text[:start] + text[start + rng.choice((1, 2, 5, 20, 200)) :]


def _wrap(rng: random.Random, text: str) -> str:
    """Put a name or a number of an expression into another expression."""
    spans = _tokens(text, "number", "name")
    if not spans:
        return text
    span = rng.choice(spans)
    return _replaced(text, span, rng.choice(WRAPPERS).replace("{}", text[span[0] : span[1]]))


_LOCAL: tuple[Callable[[random.Random, str], str], ...] = (
    *(
        _number,
        _number,
        _exchange,
        _exchange,
        _drop,
        _drop,
        _rename,
        _rename,
        _rename,
        _range,
        _indent,
        _lines,
        _insert,
        _cut,
        _wrap,
    ),
)


# --- what becomes of a text -----------------------------------------------------------------------------------------


@dataclass(slots=True)
class Verdict:
    """Outcome of a text."""

    kind: str
    seconds: float
    why: str = ""
    model: Model | None = field(default=None, repr=False)


class TooLong(BaseException):
    """The time limit is exceeded; this is not an Exception, so that nothing catches it on the way."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `TooLong` in the main thread after a number of CPU seconds of this process."""

    def stop(*_: Any) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def judge(text: str, limit: float = 10.0) -> Verdict:
    """Load a text. Correct outcomes are a model or a ModelError within `limit` seconds; all others are failures."""
    start = time.process_time()
    try:
        with warnings.catch_warnings(), time_limit(limit):
            warnings.simplefilter("error")
            model = parse_model(text, FILE, ROOT / "examples")
    except ModelError as error:
        seconds = time.process_time() - start
        bad = [line for line in str(error).split("\n") if not PLACE.match(line)]
        if bad or not error.problems:
            return Verdict("failed", seconds, f"a message without a place: {bad[:1]}")
        long = [line for line in str(error).split("\n") if len(line) > 2000]
        return (
            Verdict("failed", seconds, f"a message of {len(long[0])} characters")
            if long
            else Verdict("refused", seconds)
        )
    except TooLong:
        return Verdict("failed", time.process_time() - start, f"not read within {limit:g} s")
    except Exception as error:
        seconds = time.process_time() - start
        place = traceback.extract_tb(error.__traceback__)[-1]
        return Verdict(
            "failed", seconds, f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error}"[:300]
        )
    seconds = time.process_time() - start
    wrong = nonsense(model)
    return Verdict("failed", seconds, f"nonsense: {wrong}") if wrong else Verdict("model", seconds, model=model)


def nonsense(model: Model) -> str:
    """A description of the first property of checked models that this model lacks; empty if it has all."""
    defaults = {p.name: p.value for p in model.parameters}
    for p in model.parameters:
        if not all(math.isfinite(x) for x in (p.value, *(y for y in (p.min, p.max) if y is not None))):
            return f"parameter {p.name} is not finite"
    n = len(model.bodies)
    if not n or not model.nu:
        return "nothing that moves"
    names = [b.name for b in model.bodies] + [loop.name for loop in model.loops]
    if len(set(names)) < len(names):
        return "a name stands twice"
    depth = sorted(model.outward)
    if depth != list(range(n)):
        return "the bodies are no tree"
    known = {*defaults, *model.inputs, "t"}
    known |= {f"q.{q}" for q in model.coordinate_names} | {f"u.{u}" for u in model.speed_names}
    measured = {
        e: {f"{what}.{point.name}.{axis}" for point in load.measured for what in ("position", "velocity") for axis in "xyz"}
        for load in model.loads for e in load.coefficients
    }  # fmt: skip
    measured |= {
        e: set(COORDINATES) for loop in model.loops if isinstance(loop, PointCondition) for e in loop.equations
    }
    seen = set()
    for e in model.expressions():
        if e in seen:
            continue
        seen.add(e)
        if not e.names <= known | measured.get(e, set()):
            return f"{e} has unknown names"
        if e.names <= defaults.keys():
            try:
                value = e.evaluate(defaults)
            except (ArithmeticError, ValueError) as error:
                if any(e in f.values for f in model.forces) or any(o.expression is e for o in model.outputs):
                    continue  # may be meant for other parameters
                return f"{e} has no value: {error}"
            if not math.isfinite(value):
                return f"{e} is {value}"
    for group, of in ((model.initial_q, model.coordinate_names), (model.initial_u, model.speed_names)):
        for name, e in group.items():
            if name not in of:
                return f"an initial value for {name}"
            if not math.isfinite(e.evaluate(defaults)):
                return f"the initial value of {name} is not finite"
    references = [place.body for load in model.loads for place in (*load.ends, *load.measured)]
    references += [face.body for loop in model.loops for face in (loop.start, loop.end)]
    references += [body for o in model.outputs for body in o.on]
    if not all(GROUND <= r < n for r in references):
        return "a reference to no body"
    return ""
