"""What `generate` did, as data and as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SHOWN = 20
"""Warnings that a report shows, and half the lines about loops; the others are counted."""


@dataclass(slots=True, repr=False)
class Report:
    """What `generate` did; ``print(report)`` shows it, `lines` with all operations.

    Attributes
    ----------
    folder : Path
    files : dict of str to int
        Bytes of every file.
    links, kinds : int
    operations : dict
        By sweep; see `Solver.operations`.
    sweeps : dict of str to list of str
        By function, the sweeps that it runs; a sweep that runs twice is listed twice.
    passes : list of (str, dict, float)
        Operations of all blocks after every pass, and seconds.
    sweep_seconds : dict of str to float
        Expanding and simplifying, by sweep.
    seconds : dict of str to float
        By stage.
    errors : dict of str to float
        Largest relative errors of the check: of ``udot``, and of its derivatives per direction (``dudot``) if there are any.
    agreement : float
        Errors up to which the numbers are right in the scalar type of the solver.
    remarks : list of str
        What was left out, and why.
    loops : list of str
        The choice made for closed loops, in words: ears, dependents, ranks, degrees of freedom.
    written : bool
        False: the folder held these very files already.
    """

    folder: Path
    name: str
    target: str
    layout: str
    bodies: int
    links: int
    kinds: int
    nq: int
    nu: int
    parameters: int
    files: dict[str, int]
    operations: dict[str, Any]
    sweeps: dict[str, list[str]]
    passes: list[tuple[str, dict[str, int], float]]
    sweep_seconds: dict[str, float]
    warnings: tuple[str, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    compiled: bool = False
    errors: dict[str, float] = field(default_factory=dict)
    agreement: float = 1e-9
    remarks: list[str] = field(default_factory=list)
    loops: list[str] = field(default_factory=list)
    written: bool = True

    def flops(self, function: str, per: str = "per_call") -> int:
        """Additions, multiplications and divisions of a function: once, or per direction (``per_direction``)."""
        counts = [self.operations[s][per] for s in self.sweeps[function]]
        return sum(n for of in counts for name, n in of.items() if name != "functions")

    def __repr__(self) -> str:
        errors = ", ".join(f"{name} {e:.1e}" for name, e in self.errors.items())
        return (
            f"<Report {self.name}: {counted(self.bodies, 'body', 'bodies')}, {len(self.files)} files in {str(self.folder)!r}, "
            f"target {self.target}, {'compiled' if self.compiled else 'not compiled'}, "
            f"{f'errors {errors}' if errors else 'not checked'}>"
        )

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self, verbose: bool = False, width: int | None = None) -> list[str]:
        """The report for a reader: warnings, what was made, what it costs, how exact it is, what was left out.

        Parameters
        ----------
        verbose : bool
            With the operations of every sweep and after every pass, all files, all warnings and all that is said of loops.
        width : int, optional
            Columns; tables that are wider become lists.
        """
        lines = (
            [str(w) for w in self.warnings] if verbose else first(self.warnings, SHOWN, "warning: {} more like these")
        )
        lines.append(f"{self.name}  {self.folder}{'' if self.written else '  (unchanged)'}")
        lines.append(
            f"  {counted(self.bodies, 'body', 'bodies')}, {counted(self.nq, 'coordinate')}, {counted(self.nu, 'speed')}, "
            f"{counted(self.parameters, 'parameter')}; {counted(self.links, 'link')} of {counted(self.kinds, 'kind')}, "
            f"layout {self.layout}, target {self.target}"
        )
        lines += [
            f"  {line}" for line in (self.loops if verbose else first(self.loops, 2 * SHOWN, "and {} lines more"))
        ]
        lines += self._operations()
        if verbose:
            lines += self._operation_tables(width)
            lines += [f"  {size:>9} {name}" for name, size in self.files.items()]
        lines.append("  " + ", ".join(f"{stage} {s:.2f} s" for stage, s in self.seconds.items()))
        if self.errors:
            derivatives = f", of its derivatives {self.errors['dudot']:.1e}" if "dudot" in self.errors else ""
            lines.append(
                f"  checked against the generic engine: relative error of udot {self.errors['udot']:.1e}{derivatives}"
            )
        return lines + [f"  {remark}" for remark in self.remarks]

    def _operations(self) -> list[str]:
        """What accelerations and their derivatives cost, of those that the solver has."""
        lines, n, udot = [], max(self.links, 1), 0
        if "accelerations" in self.sweeps:
            udot = self.flops("accelerations")
            counts = [self.operations[s]["per_call"] for s in self.sweeps["accelerations"]]
            divisions, functions = (sum(of[what] for of in counts) for what in ("divisions", "functions"))
            lines.append(
                f"  udot: {counted(udot, 'operation')} ({udot / n:.1f} a link, {divisions} of them divisions; {functions} sines "
                f"and other functions)"
            )
        if "sensitivities" in self.sweeps:
            shared, each = self.flops("sensitivities") - udot, self.flops("sensitivities", "per_direction")
            of_udot = f", {each / max(udot, 1):.2f} of udot" if udot else ""
            lines.append(
                f"  derivatives: {counted(shared, 'operation')} once, {each} per direction ({each / n:.1f} a link{of_udot})"
            )
        return lines

    def _operation_tables(self, width: int | None) -> list[str]:
        sweeps = []
        for sweep, parts in self.operations.items():
            once, each = parts["per_call"], parts["per_direction"]
            sweeps.append([sweep, *(once[k] for k in ("additions", "multiplications", "divisions", "functions")),
                           each["additions"], each["multiplications"], f"{self.sweep_seconds.get(sweep, 0.0):.3f}"])  # fmt: skip
        passes = [[name, *o.values(), f"{seconds:.3f}"] for name, o, seconds in self.passes]
        return [
            "  operations per call, and of each direction",
            *table(["sweep", "+", "*", "/", "functions", "+ each", "* each", "seconds"], sweeps, width),
            "  all blocks after every pass",
            *table(["pass", "+", "*", "/", "functions", "seconds"], passes, width),
        ]


def counted(n: int, one: str, many: str = "") -> str:
    """``1 body``, ``2 bodies``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def first(lines: Iterable[object], limit: int, more: str) -> list[str]:
    """The first `limit` lines, and how many more there are."""
    found = [str(line) for line in lines]
    return found if len(found) <= limit else [*found[:limit], more.format(len(found) - limit)]


def table(header: Sequence[str], rows: Sequence[Sequence[Any]], width: int | None = None) -> list[str]:
    """Rows as aligned lines; where they are wider than `width`, each row as a list of its entries by name."""
    cells = [[str(x) for x in row] for row in (header, *rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    if width is None or sum(widths) + 2 * len(widths) + 1 <= width:
        return [
            "   "
            + "  ".join([row[0].ljust(widths[0]), *(x.rjust(w) for x, w in zip(row[1:], widths[1:], strict=True))])
            for row in cells
        ]
    return [
        f"   {row[0]}: " + ", ".join(f"{h} {x}" for h, x in zip(header[1:], row[1:], strict=True)) for row in cells[1:]
    ]
