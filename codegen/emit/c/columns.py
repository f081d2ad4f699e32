"""Columns of matrices computed all at once, in C: the column groups of each link, seeds, and destinations.

Four columns form a group. For each link, the bits of an integer say which groups its function processes. If all columns fit into
memory, these integers are constants; otherwise each call computes them for its columns.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import accumulate, pairwise

from ...program.procedure import AllColumns, Array, Primitives, Procedure, walk
from ..function import in_lines
from ..target import Scalar
from .libraries import guard

GROUP = 4
"""Number of columns in a group."""

MASKS = ("own", "below", "path", "still", "fresh")
"""Names of the sets of column groups that are known for every link; see `mechanics.sweeps.Sweep.groups`."""

Written = Callable[[Array], str]
"""A function that returns the C expression of an array."""


class ColumnsInC:
    """Data shared by all functions that compute columns of matrices."""

    masks, group = MASKS, GROUP

    def __init__(self, procedures: tuple[Procedure, ...], scalar: Scalar):
        self.scalar = scalar
        found = [s for p in procedures for s in walk(p.steps)]
        self.steps = list(dict.fromkeys(s for s in found if isinstance(s, AllColumns)))
        self.primitives = list(dict.fromkeys(s for s in found if isinstance(s, Primitives)))
        self.width = max((s.width for s in self.steps), default=0)
        self.weighted_whole = any(s.weighted and fits(s) for s in self.steps)
        self.weighted_apart = any(s.weighted and not fits(s) for s in self.steps)
        self.taken = any(s.into and not s.symmetric for s in self.steps)
        self.found_anew = not all(map(fits, self.steps))
        self.guard = " || ".join(
            dict.fromkeys(guard(p.name) for p in procedures if any(isinstance(s, AllColumns) for s in walk(p.steps)))
        )
        self.regular = all(map(one_by_link, self.steps))
        symmetric = [in_blocks(s) for s in self.steps if into_symmetric(s)]
        self.in_blocks, self.symmetric = any(symmetric), not all(symmetric)
        self.serial = all(s.parents == tuple(range(-1, len(s.parents) - 1)) for s in self.steps)

    @property
    def parent(self) -> str:
        """The C expression of the parent of link i, used in a macro."""
        return "((i) - 1)" if self.serial else "parent_of[i]"

    @property
    def entry(self) -> str:
        """C expression, for a macro, of the index in u of the speed to which column j belongs. It is j if the links are in
        the order of their speeds."""
        symmetric = [s for s in self.steps if s.symmetric]
        return "(j)" if all(i == j for s in symmetric for j, (_, i) in enumerate(s.units)) else "ENTRY(of, j)"

    @property
    def files(self) -> list[str]:
        """Names of the template files of the computations over columns."""
        wanted = {
            "regular": self.regular, "irregular": not self.regular, "groups": self.found_anew, "take": self.taken,
            "symmetric": self.symmetric, "blocks": self.in_blocks, "weighted": self.weighted_whole,
            "weighted_apart": self.weighted_apart,
        }  # fmt: skip
        return [f"c/columns_{name}.c.jinja" for name, needed in wanted.items() if needed]

    def regions(self, fields: int, links: int) -> list[tuple[str, bool, int]]:
        """Regions of memory: values of links per column, rows of seeds and results, groups of links, weights."""
        if not self.steps:
            return []
        rows = max(sum(a.size for a in (*(() if fits(s) else s.seeds), s.of)) for s in self.steps)
        return [
            ("column_rows", False, rows * self.width),
            ("masks", False, 0 if all(map(fits, self.steps)) else len(MASKS) * links),
            ("inverse", False, max((s.of.size**2 for s in self.steps if s.weighted and fits(s)), default=0)),
            ("weights", False, max((len(s.weighted) for s in self.primitives), default=0)),
            ("columns", True, -(-fields * links * self.width // 8)),
        ]

    def members(self) -> list[tuple[str, str]]:
        """Types and names of the other members of the C struct of a call over columns."""
        return (
            [*(("const groups *", f"{name}_groups") for name in MASKS), ("groups ", "all_groups")] if self.steps else []
        )

    def tables(self) -> list[tuple[str, list[str]]]:
        """Tables of constants in C: declarations and lines."""
        found: dict[str, list[str]] = {}
        for step in self.steps:
            name = name_of(step)
            if reads_starts(step) and not self.regular:
                _add(found, f"{name}_starts", list(step.starts))
            if fits(step):
                for mask, values in groups_of_links(step).items():
                    head = f"static const groups {name}_{mask}[{len(values)}]"
                    found[head] = in_lines([f"{v:#x}" for v in values], 12)
                places, at = {}, 0
                for a in step.seeds:
                    places[a] = at
                    at += a.size
                ones = {places[a] + i: ["0"] * j + [self.scalar.literal("1.0")] for j, (a, i) in enumerate(step.units)}
                rows = [f"{{{', '.join(ones.get(row, '0'))}}}" for row in range(at)]
                found[f"static const number {name}_units[{at}][{step.width}]"] = in_lines(rows, 4)
                if in_blocks(step):
                    known = known_rows(step)
                    head = f"static const unsigned char {known_of(step)}[{len(known)}]"
                    found[head] = in_lines(list(map(str, known)), 16)
            elif not self.serial:
                _add(found, "parent_of", list(step.parents))
            if not self.regular and not in_blocks(step):
                arrays = step.seeds
                _add_rows(found, f"{name}_columns", [(arrays.index(a), i) for a, i in step.units])
            if step.weighted:
                matrices = step.matrices
                counts = Counter(w.entry for w in step.weighted)
                _add(found, "weighted_starts", [*accumulate((counts[i] for i in range(step.of.size)), initial=0)])
                _add_rows(found, "weighted", [(matrices.index(w.into), w.column) for w in step.weighted])
        for of in self.primitives:
            units, seeds = _units(of)
            _add_rows(found, "primitive_units", [(seeds.index(seed), entry, d) for seed, entry, d in units])
            _add_rows(found, "primitives", [(w.entry, w.direction) for w in of.weighted])
        return list(found.items())


def _add(tables: dict[str, list[str]], name: str, values: list[int]) -> None:
    tables[f"static const int {name}[{len(values)}]"] = in_lines(list(map(str, values)), 16)


def _add_rows(tables: dict[str, list[str]], name: str, rows: list[tuple[int, ...]]) -> None:
    head = f"static const int {name}[{len(rows)}][{len(rows[0])}]"
    tables[head] = in_lines([f"{{{', '.join(map(str, row))}}}" for row in rows], 8)


def reads_starts(step: AllColumns) -> bool:
    """Whether the call needs the first column of each link."""
    return (step.symmetric and not in_blocks(step)) or not fits(step)


def one_by_link(step: AllColumns) -> bool:
    """Whether each link i has exactly one entry, entry i, in each array, so that columns need no tables."""
    links = range(len(step.parents))
    return step.units == tuple((a, i) for i in links for a in step.seeds)


def fits(step: AllColumns) -> bool:
    """Whether all columns fit into memory at once, so that the groups of each link are constants."""
    return step.starts[-1] <= step.width


def groups_of_links(step: AllColumns) -> dict[str, list[int]]:
    """For each mask, a list with one integer per link, whose bits are the groups of columns that the link's function
    processes; see `mechanics.sweeps.Sweep.groups`."""
    every = (1 << -(-step.starts[-1] // GROUP)) - 1
    found: dict[str, list[int]] = {mask: [] for mask in MASKS}
    for parent, begin, end in zip(step.parents, step.starts, step.starts[1:], strict=False):
        before = (1 << begin // GROUP) - 1
        own = ((1 << -(-end // GROUP)) - 1) & ~before if begin < end else 0
        inboard = found["path"][parent] if parent >= 0 else 0
        found["own"].append(own)
        found["below"].append(own)
        found["path"].append(own | inboard)
        found["fresh"].append(own & ~inboard)
        found["still"].append(every & ~(before if step.symmetric else own | inboard))
    for i in reversed(range(len(step.parents))):
        if step.parents[i] >= 0:
            found["below"][step.parents[i]] |= found["below"][i]
    return found


def into_symmetric(step: AllColumns) -> bool:
    """Whether the columns are written into a symmetric matrix."""
    return bool(step.symmetric and step.into) or bool(step.weighted and fits(step))


def in_blocks(step: AllColumns) -> bool:
    """Whether a symmetric matrix is filled in square blocks; this requires all columns at once, in the order of the rows."""
    return into_symmetric(step) and fits(step) and all(i == j for j, (_, i) in enumerate(step.units))


def known_of(step: AllColumns) -> str:
    """Name of the table that `known_rows` returns."""
    return f"{name_of(step)}_{step.groups}_known"


def known_rows(step: AllColumns) -> list[int]:
    """For each block on or above the diagonal of a symmetric matrix, row by row: the rows that are computed, as bits."""
    worked = groups_of_links(step)[step.groups]
    by_row = [worked[i] for i, (begin, end) in enumerate(pairwise(step.starts)) for _ in range(begin, end)]
    count = -(-len(by_row) // GROUP)
    return [
        sum((rows >> column & 1) << k for k, rows in enumerate(by_row[GROUP * row : GROUP * (row + 1)]))
        for row in range(count)
        for column in range(row, count)
    ]


def name_of(step: AllColumns) -> str:
    """Prefix of the names of the tables of a step; it consists of the names of its seeds, such as ``dq_du``."""
    return "_".join(a.name for a in step.seeds)


def all_columns(step: AllColumns, array: Written, scalar: Scalar) -> list[str]:
    """Lines that compute columns and store them in their destinations."""
    width, count, name, once = step.width, step.starts[-1], name_of(step), fits(step)
    lines = [f"call_{width} e;", f"open_{width}(&e, &c, work);"]
    at = 0
    for a in step.seeds:
        rows = f"{name}_units" if once else "c.column_rows"
        lines.append(f"e.{a.name} = (lanes_{width} *){rows} + {at};")
        at += a.size
    lines.append(f"e.{step.of.name} = (lanes_{width} *)c.column_rows{'' if once else f' + {at}'};")
    if once:
        lines += [f"e.{mask}_groups = {name}_{mask};" for mask in MASKS]
        lines.append(f"e.all_groups = FIRST_GROUPS({-(-count // GROUP)});")
    matrices = step.matrices
    if not once:
        lines.append(f"lanes_{width} *const units[] = {{{', '.join(f'e.{a.name}' for a in step.seeds)}}};")
    lines += [
        f"{scalar.word} *const matrices[] = {{{', '.join(map(array, matrices))}}};",
        f"static const long sizes[] = {{{', '.join(str(a.size // step.of.size) for a in matrices)}}};",
    ]
    if not in_blocks(step):
        starts = f"{name}_starts" if reads_starts(step) else "0"
        lines += ["columns_of of;", f"SET_COLUMNS(of, {len(step.seeds)}, {starts}, {name}_columns);"]
    body = [f"const int m = {count} - j < {width} ? {count} - j : {width};"]
    if not once:
        body.append(f"groups_of_links(&e, of, j, {int(step.symmetric)});")
        body.append("unit_columns(&e, units, of, j);")
    body += [
        *(f"{s.sweep}_{width}(&e);" for s in step.steps if s.sweep not in step.by_turns),
    ]
    rows = f"(const {scalar.word} *)e.{step.of.name}"
    mask = f"e.{step.groups}_groups"
    if into_symmetric(step):
        into = f"c.inverse, {step.of.size}" if step.weighted else "matrices[0], sizes[0]"
        of_blocks = f"take_blocks({rows}, {known_of(step)}, {count}, {into});"
        body.append(of_blocks if in_blocks(step) else f"take_symmetric({rows}, {mask}, of, j, m, {into});")
        if step.weighted:
            body.append(f"add_weighted(c.inverse, {step.of.size}, c.weights, matrices, sizes);")
    elif step.weighted:
        body.append(f"weigh_columns({rows}, {mask}, of, j, m, c.weights, matrices, sizes);")
    else:
        body.append(f"take_columns({rows}, {step.of.size}, of, j, m, matrices, sizes);")
    if in_blocks(step):
        lines += body[1:]
    elif once:
        lines += [f"const int j = 0, m = {count};", *body[1:]]
    else:
        lines += [f"for (int j = 0; j < {count}; j += {width}) {{", *(f"    {line}" for line in body), "}"]
    return ["{", *(f"    {line}" for line in lines), "}"]


def _units(step: Primitives) -> tuple[list[tuple[Array, int, int]], list[Array]]:
    """Entries of seeds whose value is 1, each with its direction, and the seeds themselves."""
    units = list(dict.fromkeys((w.seed, w.column, w.direction) for w in step.weighted))
    return units, list(dict.fromkeys(seed for seed, _, _ in units))


def primitives(step: Primitives, array: Written, call: str, scalar: Scalar) -> list[str]:
    """Lines that compute the weights: derivatives of all formulas, along as few directions as possible. Formulas with
    different arguments share directions."""
    units, seeds = _units(step)
    n, of = len(units), "primitive_units[i]"
    entry = f"seeds[{of}[0]] + {of}[1]"
    lines = [
        f"LANES *const seeds[] = {{{', '.join(map(array, seeds))}}};",
        f"for (int i = 0; i < {n}; ++i) *component({entry}, {of}[2]) = {scalar.literal('1.0')};",
        call,
        f"for (int i = 0; i < {len(step.weighted)}; ++i)",
        f"    c.weights[i] = *component({array(step.of)} + primitives[i][0], primitives[i][1]);",
        f"for (int i = 0; i < {n}; ++i) *({entry}) = NOTHING;",
    ]
    return ["{", *(f"    {line}" for line in lines), "}"]
