"""Files of trajectories: NumPy's ``.npz`` and Apache Parquet, selected by suffix; names and statistics are stored as JSON.

An ``.npz`` file contains the arrays, and the JSON as bytes in an array ``header``; nothing is pickled. A ``.parquet`` file has a
column of times and one for each series, which any Parquet reader understands. The JSON, and events as bytes, are in the metadata
of its schema.
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
"""Key of the JSON in the metadata of a Parquet schema."""

EVENTS = b"ordernm_events"
"""Metadata key, in a Parquet schema, of the rows of events. They are stored as bytes, because JSON cannot store every NaN."""

EXTRA = {"energy": ("energy.kinetic", "energy.potential"), "closure": ("loops.closure",)}
"""Columns of Parquet files only; names of outputs contain no dot."""

DAMAGE = (
    ValueError, TypeError, EOFError, KeyError, OverflowError, MemoryError, RecursionError, zipfile.BadZipFile, zlib.error,
    NotImplementedError, SyntaxError, RuntimeError, OSError, struct.error,
)  # fmt: skip
"""Exceptions that NumPy raises for archives with unexpected content."""

Words = dict[str, Any]


class TrajectoryFileError(ValueError):
    """Raised if a file contains no trajectory or a damaged one, or if its format cannot store the trajectory."""


def suffix_of(path: str | os.PathLike[str]) -> str:
    """The suffix of a trajectory file; raises an error with the allowed suffixes for any other."""
    return suffix_among(path, SUFFIXES, TrajectoryFileError, f"trajectories are kept in files {' or '.join(SUFFIXES)}")


def need(suffix: str) -> None:
    """Raises ImportError with installation instructions if the package for files with this suffix is missing."""
    if suffix == ".parquet":
        _arrow()


def damaged(path: str | os.PathLike[str], why: object) -> str:
    """The message for a damaged trajectory file."""
    return f"{os.fspath(path)} is damaged or was changed: {why}; save the trajectory again"


def write(
    path: str | os.PathLike[str], words: Mapping[str, Any], arrays: Mapping[str, Array], columns: Mapping[str, Array]
) -> None:
    """Writes a trajectory: header entries, arrays by name and, for Parquet, its series (nt,)."""
    suffix = suffix_of(path)
    header = {"format": FORMAT, "version": VERSION, "digest": _digest(words, arrays), **words}
    if suffix == ".npz":
        text = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
        write_whole(Path(path), lambda file: np.savez(file, allow_pickle=False, **{HEADER: text}, **arrays))
        return
    arrow, parquet = _arrow()
    # p and inputs are not series; JSON preserves the floats
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
    # with a dictionary encoding, different NaNs would become equal
    write_whole(Path(path), lambda file: parquet.write_table(table, file, use_dictionary=False))


def read(path: str | os.PathLike[str]) -> tuple[Words, dict[str, Array]]:
    """Header entries and arrays of a trajectory, in the form that `write` takes."""
    if suffix_of(path) == ".npz":
        header, arrays = _read_npz(path)
    else:
        header, arrays = _read_parquet(path)
    # Parquet itself does not detect every changed number
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
    with open(path, "rb") as file:  # a missing file raises its own error; later errors mean damage
        if file.read(2) not in (b"PK", b"\x93N"):  # a ZIP archive, or a single NumPy array
            raise TrajectoryFileError(damaged(path, "it does not begin like a file .npz"))
        file.seek(0)
        try:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                archive = contextlib.nullcontext(())
            with archive as opened:
                if HEADER not in opened:
                    raise TrajectoryFileError(f"{os.fspath(path)} contains no trajectory: it is another NumPy file")
                _check_sizes(opened.zip)
                arrays = {name: opened[name] for name in opened.files}
        except TrajectoryFileError:
            raise
        except DAMAGE as error:
            raise TrajectoryFileError(damaged(path, error)) from None
    return _header(path, arrays.pop(HEADER).tobytes()), arrays


def _check_sizes(archive: zipfile.ZipFile) -> None:
    """Raises ValueError before memory is allocated, if the shape of an array does not match its number of bytes."""
    for member in archive.infolist():
        with archive.open(member) as file:
            version = np.lib.format.read_magic(file)
            read_header = (
                np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            )
            shape, _, kind = read_header(file)
            needed, there = math.prod(shape) * kind.itemsize, member.file_size - file.tell()
        if needed != there:
            raise ValueError(
                f"{member.filename} has shape {shape}, which needs {needed} bytes, but contains {there} bytes"
            )


def _read_parquet(path: str | os.PathLike[str]) -> tuple[Words, dict[str, Array]]:
    arrow, parquet = _arrow()
    try:
        with open(path, "rb") as file:
            table = parquet.read_table(file)
            metadata = table.schema.metadata or {}
            if KEY not in metadata:
                raise TrajectoryFileError(f"{os.fspath(path)} contains no trajectory: it is another Parquet file")
            columns = [np.array(column.to_numpy(), dtype=np.float64) for column in table.columns]
    except TrajectoryFileError:
        raise
    except (arrow.ArrowException, *DAMAGE) as error:
        # a system error, such as a missing file, has a number; pyarrow's OSError for a damaged file has none
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
    """Arrays from the columns of a Parquet file: t, then q, u and outputs, then the derivatives of these, by
    direction."""
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
    """The header entries of a file, without format and version."""
    try:
        header = json.loads(text)
        seen = header.pop("format"), header.pop("version")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise TrajectoryFileError(damaged(path, f"its header cannot be read ({error})")) from None
    if seen[0] != FORMAT:
        raise TrajectoryFileError(
            f"{os.fspath(path)} contains no trajectory: its format is {seen[0]!r}, not {FORMAT!r}"
        )
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
