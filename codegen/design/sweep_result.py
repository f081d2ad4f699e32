"""Result of a sweep: a row for every case, as columns, a pandas table, or a file."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..html_tables import html_of
from ..runtime.standalone.files.whole_file import suffix_among, write_whole
from .sweep_cases import Case

SUFFIXES = (".csv", ".parquet")
FAILURE = "failure"
"""Name of the column with the reasons of failures."""


@dataclass(slots=True, eq=False)
class Sweep(Sequence[Case | None]):
    """Results of a sweep; ``found["time"]`` is a column, ``found[3]`` the results of one case.

    Attributes
    ----------
    cases : list of dict
        The cases in their order.
    values : list of (dict or None)
        Results; None for a case that failed or was not computed.
    failures : dict of int to str
        Reasons by the index of the case, from 0.
    left : list of int
        Cases that were not computed, because of Ctrl-C or since the executor died.
    from_journal : int
        Number of cases that were found in the journal.
    """

    cases: list[Case]
    values: list[Case | None]
    failures: dict[int, str]
    left: list[int]
    from_journal: int = 0

    def __len__(self) -> int:
        return len(self.cases)

    def __iter__(self) -> Iterator[Case | None]:
        return iter(self.values)

    def __getitem__(self, at: Any) -> Any:
        """The results of the i-th case; for a slice, of several; for a name, its column, see `column`."""
        return self.column(at) if isinstance(at, str) else self.values[at]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the results of all cases."""
        return tuple(dict.fromkeys(name for row in self.values if row is not None for name in row))

    @property
    def succeeded(self) -> Any:
        """Whether each case was measured, array of bool (n,)."""
        return np.array([row is not None for row in self.values], bool)

    def column(self, name: str) -> Any:
        """Return a column of `columns`.

        Parameters
        ----------
        name : str
            Name of the column.

        Returns
        -------
        ndarray (n,)
            Its values; NaN for missing numbers, None for missing words.

        Raises
        ------
        KeyError
            If there is no such column.

        Examples
        --------
        >>> found = ordernm.sweep(solver, {"x": [1, 2, 3]}, lambda solver, case: {"square": case["x"] ** 2})
        >>> found.column("square")
        array([1, 4, 9])
        """
        places = self._places()
        if name not in places:
            raise KeyError(f"the sweep has no {name!r}; it has {', '.join(places) or 'no names'}")
        rows, inner = places[name]
        found = [None if row is None else row.get(inner) for row in rows]
        seen = {type(x) for x in found if x is not None}
        if None not in found and seen in ({bool}, {int}):
            return np.array(found)
        if seen <= {int, float, bool}:
            return np.array([np.nan if x is None else x for x in found], float)
        return np.array(found, object)

    def columns(self) -> dict[str, Any]:
        """Return cases, results and failures as columns.

        A result with the name of a value of the cases gets the prefix ``measured.``.

        Returns
        -------
        dict of str to ndarray (n,)
            The columns; ``failure`` has the reasons.

        Examples
        --------
        >>> found = ordernm.sweep(solver, {"x": [1, 2, 3]}, lambda solver, case: {"square": case["x"] ** 2})
        >>> list(found.columns())
        ['x', 'square', 'failure']
        """
        reasons = {**self.failures, **dict.fromkeys(self.left, "not computed")}
        failures = np.array([reasons.get(i, "") for i in range(len(self))], object)
        return {name: self.column(name) for name in self._places()} | {FAILURE: failures}

    def _places(self) -> dict[str, tuple[Sequence[Case | None], str]]:
        """The source of each column, and the column's name in this source."""
        found: dict[str, tuple[Sequence[Case | None], str]] = {
            name: (self.cases, name) for name in (self.cases[0] if self.cases else ())
        }
        for name in self.names:
            found[f"measured.{name}" if name in found else name] = self.values, name
        return found

    def to_dataframe(self) -> Any:
        """Return a pandas table with a row for each case.

        Returns
        -------
        pandas.DataFrame
            The columns of `columns`.

        Raises
        ------
        ImportError
            If pandas is not installed.

        Examples
        --------
        >>> found = ordernm.sweep(solver, {"x": [1, 2, 3]}, lambda solver, case: {"square": case["x"] ** 2})
        >>> found.to_dataframe().shape
        (3, 3)
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError(
                'to_dataframe needs pandas: pip install "ordernm[dataframe]", or pip install pandas'
            ) from error
        return pandas.DataFrame(self.columns())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a table with a row for each case, as a whole or not at all.

        Parameters
        ----------
        path : path
            A name that ends in ``.csv``, or ``.parquet``, which needs pyarrow.

        Raises
        ------
        ValueError
            If the name has another ending.
        ImportError
            If pyarrow is needed and not installed.

        Examples
        --------
        >>> found = ordernm.sweep(solver, {"x": [1, 2, 3]}, lambda solver, case: {"square": case["x"] ** 2})
        >>> found.save("squares.csv")
        """
        if suffix_among(path, SUFFIXES, ValueError, f"sweeps are kept in files {' or '.join(SUFFIXES)}") == ".parquet":
            self._write_parquet(Path(path))
            return
        columns = self.columns()
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(x.tolist() for x in columns.values()), strict=True))
        write_whole(Path(path), lambda file: file.write(text.getvalue().encode()))

    def _write_parquet(self, path: Path) -> None:
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError as error:
            raise ImportError(
                'Parquet files need pyarrow: pip install "ordernm[parquet]", or pip install pyarrow; .csv files need no package'
            ) from error
        table = pyarrow.table({name: pyarrow.array(x.tolist()) for name, x in self.columns().items()})
        write_whole(path, lambda file: pyarrow.parquet.write_table(table, file))

    def __repr__(self) -> str:
        measured = f", measured: {', '.join(self.names)}" if self.names else ""
        journal = f", {self.from_journal} from the journal" if self.from_journal else ""
        lines = [f"{len(self)} cases, {len(self.failures)} failed, {len(self.left)} not computed{journal}{measured}"]
        lines += [f"  {i} {self.cases[i]}: {why}" for i, why in list(self.failures.items())[:5]]
        if len(self.failures) > 5:
            lines.append(f"  and {len(self.failures) - 5} more")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        columns = self.columns()
        rows = zip(*(x.tolist() for x in columns.values()), strict=True)
        return html_of(repr(self).splitlines()[:1], tuple(columns), rows)


__all__ = ["Sweep"]
