"""Input signals over time from files: a table of numbers with names (CSV), or named arrays (NPZ)."""

from __future__ import annotations

import csv
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .runtime.standalone.arrays import Array
from .wording import DECIMAL_POINT, decimal_comma

SUFFIXES = (".csv", ".npz")
TIMES = ("t", "time")
"""Names that a column or array of times may have."""


class SignalFileError(ValueError):
    """Raised if a file contains no valid signals; the message gives place, finding and expectation."""


def is_signal_file(text: str) -> bool:
    """Whether a command-line argument is a file name rather than ``NAME=VALUE``."""
    return Path(text).suffix.lower() in SUFFIXES


def read_signals(path: str) -> tuple[Array, dict[str, Array]]:
    """Read increasing times (n,), and signals (n,) by name, from a file.

    Raises
    ------
    SignalFileError
    """
    columns = _read_csv(path) if Path(path).suffix.lower() == ".csv" else _read_npz(path)
    times = [name for name in columns if name in TIMES]
    if len(times) != 1:
        found = ", ".join(columns) or "nothing"
        raise SignalFileError(f"{path}: has {found}; one of them must be the times, named t or time, s")
    t = columns.pop(times[0])
    if not columns:
        raise SignalFileError(f"{path}: has times but no signal; add one column or array for each input, with its name")
    if not t.size:
        raise SignalFileError(
            f"{path}: has names but no numbers; give at least one time, with a number for each signal"
        )
    for name, x in ((times[0], t), *columns.items()):
        if x.shape != t.shape or t.ndim != 1:
            raise SignalFileError(f"{path}: {name} has shape {x.shape}, expected ({t.size},): one number for each time")
        if not np.isfinite(x).all():
            i = int(np.argmin(np.isfinite(x)))
            raise SignalFileError(f"{path}: {name}[{i}] is {x[i]}, expected finite numbers")
    if len(t) > 1 and (np.diff(t) <= 0).any():
        i = int(np.argmax(np.diff(t) <= 0))
        raise SignalFileError(f"{path}: time {t[i + 1]:g} follows {t[i]:g}; times must increase")
    return t, columns


def _read_csv(path: str) -> dict[str, Array]:
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [(i, row) for i, row in enumerate(csv.reader(file), 1) if any(x.strip() for x in row)]
    except OSError as error:
        raise SignalFileError(f"{path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise SignalFileError(f"{path}: not a text table: {error}") from None
    if not rows:
        raise SignalFileError(f"{path}: is empty; the first line must contain names, such as t,motor")
    names = [x.strip() for x in rows[0][1]]
    if any(_number(x) is not None for x in names) or not all(names):
        raise SignalFileError(
            f"{path}:{rows[0][0]}: {','.join(names)}: the first line must contain names, such as t,motor"
        )
    if any(";" in name for name in names):
        raise SignalFileError(
            f"{path}:{rows[0][0]}: {','.join(names)}: names and values are separated by commas, not by semicolons{DECIMAL_POINT}"
        )
    if len(set(names)) < len(names):
        raise SignalFileError(f"{path}:{rows[0][0]}: {', '.join(names)}: each name may be given once")
    found = np.empty((len(rows) - 1, len(names)))
    for i, (line, row) in enumerate(rows[1:]):
        if len(row) != len(names):
            hint = decimal_comma(",".join(row)) if len(row) > len(names) else ""
            raise SignalFileError(f"{path}:{line}: {len(row)} values, expected {len(names)}: {', '.join(names)}{hint}")
        for k, text in enumerate(row):
            number = _number(text)
            if number is None:
                raise SignalFileError(f"{path}:{line}: {names[k]} is {text.strip()!r}, expected a finite number")
            found[i, k] = number
    return {name: found[:, k] for k, name in enumerate(names)}


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _read_npz(path: str) -> dict[str, Array]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name].astype(float, casting="same_kind") for name in archive.files}
    except OSError as error:
        raise SignalFileError(f"{path}: {error.strerror or error}") from None
    except (ValueError, TypeError, EOFError, MemoryError, KeyError, AttributeError, zipfile.BadZipFile) as error:
        raise SignalFileError(f"{path}: not an archive of numerical arrays: {error}") from None


def joined(
    signals: Mapping[str, tuple[Array, Array]], between: Mapping[str, str], otherwise: str
) -> dict[str, tuple[Any, ...]]:
    """Signals as arguments of `Solver.simulate`, each with its kind of interpolation."""
    return {name: (t, x, between.get(name, otherwise)) for name, (t, x) in signals.items()}


__all__ = ["SignalFileError", "is_signal_file", "joined", "read_signals"]
