"""The report of `generate`, as data and as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .html_tables import html_of
from .wording import counted

SHOWN = 20
"""Maximum number of warnings in a report, and half the maximum number of lines about loops. The report counts the
lines left out."""


@dataclass(slots=True, repr=False)
class Report:
    """The report of `generate`: the files that it wrote, and the cost of the solver. It prints as text.

    Attributes
    ----------
    folder : Path
        The package.
    files : dict of str to int
        Bytes of every file.
    links, kinds : int
        Numbers of links and of kinds of links.
    operations : dict
        Operations by sweep; see `Solver.operations`.
    sweeps : dict of str to list of str
        Sweeps that each function runs. A sweep that runs twice is listed twice.
    passes : list of (str, dict, float)
        Operations of all blocks after every pass, and seconds.
    sweep_seconds : dict of str to float
        Time to expand and simplify each sweep.
    seconds : dict of str to float
        Time of each stage.
    errors : dict of str to float
        Largest relative errors found by the check: of ``udot``, and of its derivatives (``dudot``) if there are any.
    agreement : float
        Largest relative error that counts as agreement in the scalar type of the solver.
    remarks : list of str
        What was left out, and why.
    loops : list of str
        The choice made for closed loops: closure groups, dependent speeds, ranks, degrees of freedom.
    written : bool
        False if the folder already held the same files.
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
        """Return the number of additions, multiplications and divisions of a function.

        Parameters
        ----------
        function : str
            Name of a function of the solver.
        per : {"per_call", "per_direction"}, optional
            Count the work that all directions share, or the work of one direction.

        Returns
        -------
        int
            Number of operations.

        Examples
        --------
        >>> report = ordernm.generate("examples/double_pendulum.yaml", "counted", compile=False)
        >>> report.flops("accelerations") < 150
        True
        """
        counts = [self.operations[s][per] for s in self.sweeps[function]]
        return sum(n for of in counts for name, n in of.items() if name != "functions")

    @property
    def disagreeing(self) -> dict[str, float]:
        """The entries of `errors` above `agreement`, or not a number."""
        return {name: e for name, e in self.errors.items() if not e <= self.agreement}

    def __repr__(self) -> str:
        errors = ", ".join(f"{name} {e:.1e}" for name, e in self.errors.items())
        return (
            f"<Report {self.name}: {counted(self.bodies, 'body', 'bodies')}, {len(self.files)} files in {str(self.folder)!r}, "
            f"target {self.target}, {'compiled' if self.compiled else 'not compiled'}, "
            f"{f'errors {errors}' if errors else 'not checked'}>"
        )

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        rows = ((name, self.flops(name), self.flops(name, "per_direction")) for name in self.sweeps)
        return html_of([repr(self), *self.warnings], ("function", "operations", "per direction"), rows)

    def lines(self, verbose: bool = False, width: int | None = None) -> list[str]:
        """Return the report as lines of text.

        Parameters
        ----------
        verbose : bool, optional
            Include the operations of every sweep and after every pass, all files, all warnings, and all lines about
            loops.
        width : int, optional
            Columns. Wider tables become lists.

        Returns
        -------
        list of str
            Warnings, contents, cost, accuracy, and what was left out.

        Examples
        --------
        >>> report = ordernm.generate("examples/double_pendulum.yaml", "listed", compile=False)
        >>> report.lines()[0].split()[0]
        'double_pendulum'
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
        """Lines about the cost of accelerations and their derivatives, if the solver has these functions."""
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


def first(lines: Iterable[object], limit: int, more: str) -> list[str]:
    """The first `limit` lines, followed by a line with the number of further lines."""
    found = [str(line) for line in lines]
    return found if len(found) <= limit else [*found[:limit], more.format(len(found) - limit)]


def table(header: Sequence[str], rows: Sequence[Sequence[Any]], width: int | None = None) -> list[str]:
    """Lines of an aligned table; if the table is wider than `width`, each row becomes a list of named entries."""
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
