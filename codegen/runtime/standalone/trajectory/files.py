"""Files of trajectories: NumPy's ``.npz`` and Apache Parquet, by suffix; names and statistics go along as JSON.

An ``.npz`` holds the arrays as they are and the JSON as bytes, in an array ``header``; nothing in it is pickled. A ``.parquet``
has a column of times and one for each series, which any reader of Parquet's understands, and the JSON, with events as bytes, in
the metadata of its schema.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..files.whole_file import suffix_among, write_whole

FORMAT, VERSION = "ordernm trajectory", 1
SUFFIXES = (".npz", ".parquet")
HEADER = "header"
KEY = b"ordernm_trajectory"
"""Of the JSON in the metadata of a Parquet schema."""

EVENTS = b"ordernm_events"
"""Of the numbers of events there, as they are in memory: JSON would not keep every NaN."""

EXTRA = {"energy": ("energy.kinetic", "energy.potential"), "closure": ("loops.closure",)}
"""Columns that only Parquet files have; no output has a dot in its name."""

DAMAGE = (
    ValueError, TypeError, EOFError, KeyError, OverflowError, MemoryError, RecursionError, zipfile.BadZipFile, zlib.error,
    NotImplementedError, SyntaxError, RuntimeError, OSError, struct.error,
)  # fmt: skip
"""What NumPy raises for archives that it did not write like that."""

Words = dict[str, Any]


class TrajectoryFileError(ValueError):
    """A file holds no trajectory, or a damaged one, or cannot hold one."""


def suffix_of(path: str | os.PathLike[str]) -> str:
    """What kind of file it is to be; an error that tells the kinds there are."""
    return suffix_among(path, SUFFIXES, TrajectoryFileError, f"trajectories are kept in files {' or '.join(SUFFIXES)}")


def need(suffix: str) -> None:
    """Raise ImportError, which tells what to install, where files of that kind cannot be handled."""
    if suffix == ".parquet":
        _arrow()


def damaged(path: str | os.PathLike[str], why: object) -> str:
    """What is said of a damaged file."""
    return f"{os.fspath(path)} is damaged or was changed: {why}; save the trajectory again"


def write(
    path: str | os.PathLike[str], words: Mapping[str, Any], arrays: Mapping[str, Array], columns: Mapping[str, Array]
) -> None:
    """Write a trajectory: its words, its arrays by name, and for Parquet its series (nt,)."""
    suffix = suffix_of(path)
    header = {"format": FORMAT, "version": VERSION, "digest": _digest(words, arrays), **words}
    if suffix == ".npz":
        text = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
        write_whole(Path(path), lambda file: np.savez(file, allow_pickle=False, **{HEADER: text}, **arrays))
        return
    arrow, parquet = _arrow()
    # p and inputs are no series; JSON gives the same floats back
    header |= {name: arrays[name].tolist() for name in ("p", "inputs") if name in arrays}
    metadata = {EVENTS: np.ascontiguousarray(arrays["events"]).tobytes()} if "events" in arrays else {}
    header |= {"extra": [name for name in EXTRA if name in arrays]}
    all_columns = {"t": arrays["t"], **columns}
    for name in header["extra"]:
        all_columns |= zip(EXTRA[name], np.atleast_2d(arrays[name].T), strict=True)
    fields = [arrow.field(name, arrow.float64()) for name in all_columns]
    table = arrow.Table.from_arrays(
        [arrow.array(np.ascontiguousarray(x), from_pandas=False) for x in all_columns.values()],
        schema=arrow.schema(fields, metadata={KEY: json.dumps(header).encode(), **metadata}),
    )
    # a dictionary of values would take one NaN for another
    write_whole(Path(path), lambda file: parquet.write_table(table, file, use_dictionary=False))


def read(path: str | os.PathLike[str]) -> tuple[Words, dict[str, Array]]:
    """Words and arrays of a trajectory, as `write` takes them."""
    if suffix_of(path) == ".npz":
        header, arrays = _read_npz(path)
    else:
        header, arrays = _read_parquet(path)
    # of Parquet's pages and schema nothing else would tell a number that was changed
    if header.pop("digest", None) != _digest(header, arrays):
        raise TrajectoryFileError(damaged(path, "its numbers or names are not those that were saved"))
    return {name: tuple(x) if isinstance(x, list) else x for name, x in header.items()}, arrays


def _digest(words: Mapping[str, Any], arrays: Mapping[str, Array]) -> str:
    found = hashlib.sha256(json.dumps(words, sort_keys=True).encode())
    for name, x in sorted(arrays.items()):
        found.update(f"{name} {x.dtype} {x.shape}".encode())
        found.update(x.tobytes())
    return found.hexdigest()[:32]


def _read_npz(path: str | os.PathLike[str]) -> tuple[Words, dict[str, Array]]:
    with open(path, "rb") as file:  # a file that is missing is a missing file; what goes wrong afterwards is damage
        try:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                archive = contextlib.nullcontext(())
            with archive as opened:
                if HEADER not in opened:
                    raise TrajectoryFileError(f"{os.fspath(path)} holds no trajectory: it is another file of NumPy's")
                _check_sizes(opened.zip)
                arrays = {name: opened[name] for name in opened.files}
        except TrajectoryFileError:
            raise
        except DAMAGE as error:
            raise TrajectoryFileError(damaged(path, error)) from None
    return _header(path, arrays.pop(HEADER).tobytes()), arrays


def _check_sizes(archive: zipfile.ZipFile) -> None:
    """Raise ValueError for an array whose shape says that it has more or fewer numbers than there are: none is made for it."""
    for member in archive.infolist():
        with archive.open(member) as file:
            version = np.lib.format.read_magic(file)
            read_header = (
                np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            )
            shape, _, kind = read_header(file)
            needed, there = math.prod(shape) * kind.itemsize, member.file_size - file.tell()
        if needed != there:
            raise ValueError(f"{member.filename} has the shape {shape}, which needs {needed} bytes, and {there} bytes")


def _read_parquet(path: str | os.PathLike[str]) -> tuple[Words, dict[str, Array]]:
    arrow, parquet = _arrow()
    try:
        with open(path, "rb") as file:
            table = parquet.read_table(file)
            metadata = table.schema.metadata or {}
            if KEY not in metadata:
                raise TrajectoryFileError(f"{os.fspath(path)} holds no trajectory: it is another file of Parquet's")
            columns = [np.array(column.to_numpy(), dtype=np.float64) for column in table.columns]
    except TrajectoryFileError:
        raise
    except (arrow.ArrowException, *DAMAGE) as error:
        # a file that is missing is a missing file; pyarrow takes OSError for damage too
        if isinstance(error, OSError) and error.errno is not None:
            raise
        first = (str(error).splitlines() or ["it cannot be read"])[0].rstrip(".")
        raise TrajectoryFileError(damaged(path, first)) from None
    header = _header(path, metadata[KEY])
    try:
        header, arrays = _unrolled(header, columns)
        if EVENTS in metadata:
            arrays["events"] = np.frombuffer(metadata[EVENTS]).reshape(len(header["events"]), -1)
        return header, arrays
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, MemoryError) as error:
        raise TrajectoryFileError(damaged(path, f"{type(error).__name__} {error}")) from None


def _unrolled(header: Words, columns: list[Array]) -> tuple[Words, dict[str, Array]]:
    """The arrays of which a Parquet file holds the columns: t, then q, u and outputs, then their derivatives by direction."""
    nt = len(columns[0])
    sizes = [len(header[f"{name}_names"]) for name in ("coordinate", "speed", "output")]
    k = len(header["sensitivity_names"])
    extra = {name: len(EXTRA[name]) for name in header.pop("extra")}
    n = sum(sizes)
    if len(columns) != 1 + (k + 1) * n + sum(extra.values()):
        raise ValueError(f"{len(columns)} columns, expected {1 + (k + 1) * n + sum(extra.values())}")
    series = np.array(columns[1 : 1 + (k + 1) * n]).reshape(k + 1, n, nt).transpose(0, 2, 1)
    parts = [np.ascontiguousarray(x) for x in np.split(series, np.cumsum(sizes)[:-1], axis=2)]
    arrays = {"t": columns[0]}
    arrays |= {name: part[0] for name, part in zip(("q", "u", "outputs"), parts, strict=True)}
    arrays |= {name: part[1:] for name, part in zip(("dq", "du", "doutputs"), parts, strict=True)}
    left = columns[1 + (k + 1) * n :]
    for name, width in extra.items():
        taken, left = left[:width], left[width:]
        arrays[name] = np.column_stack(taken) if width > 1 else taken[0]
    arrays |= {name: np.array(header.pop(name), dtype=np.float64) for name in ("p", "inputs") if name in header}
    return header, arrays


def _header(path: str | os.PathLike[str], text: bytes) -> Words:
    """The words of a file, without its format."""
    try:
        header = json.loads(text)
        seen = header.pop("format"), header.pop("version")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise TrajectoryFileError(damaged(path, f"its header cannot be read ({error})")) from None
    if seen[0] != FORMAT:
        raise TrajectoryFileError(f"{os.fspath(path)} holds no trajectory: its format is {seen[0]!r}, not {FORMAT!r}")
    if seen[1] != VERSION:
        raise TrajectoryFileError(
            f"{os.fspath(path)} is of version {seen[1]} of the format, this ordernm reads version {VERSION}; read it with the "
            f"ordernm that wrote it"
        )
    return dict(header)


def _arrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise ImportError(
            'Parquet files need pyarrow: pip install "ordernm[parquet]", or pip install pyarrow; files .npz need nothing'
        ) from error
    return pyarrow, pyarrow.parquet
