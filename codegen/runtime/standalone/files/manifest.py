"""``model.json``, the manifest of a package: sealed, read, and the digests of the other files compared."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import PackageError

ALLOWED = 10.0
"""Tolerances of the model: a larger residual of a dropped condition, or change of it by a unit of a parameter, is reported; and a
loop whose redundant conditions cannot all be met is closed if no more is left of them."""

SEAL = ',\n "seal": "'


def seal(text: str) -> str:
    """The text of ``model.json`` with a digest of itself as its last entry, so that a damaged one is known."""
    body = text.rstrip().removesuffix("}").rstrip()
    return f'{body}{SEAL}{hashlib.sha256(body.encode()).hexdigest()}"\n}}\n'


def refuse_another(folder: Path, sealed: str) -> None:
    """Raise `PackageError` if a package is not the one any more that was opened: its C would be that of another model.

    Parameters
    ----------
    folder : Path
    sealed : str
        The ``seal`` of the manifest that was read when it was opened; nothing is compared where it is empty.
    """
    if not sealed:
        return
    try:
        text = (folder / "model.json").read_text(encoding="utf-8")
    except (OSError, ValueError):
        text = ""
    if sealed not in text[text.rfind(SEAL) :]:
        raise PackageError(f"{folder} was generated anew, or removed, since this solver was opened; load it again")


def read_manifest(folder: Path) -> dict[str, Any]:
    """What ``model.json`` of a package says.

    Raises
    ------
    PackageError
        There is none, it is one of something else, or it is damaged.
    """
    first = "remove what is left of it, and "  # generate writes into no folder that it does not know as its own
    try:
        text = (folder / "model.json").read_text(encoding="utf-8")
        if SEAL in text and seal(text[: text.rindex(SEAL)] + "}") == text:
            manifest: dict[str, Any] = unrolled(json.loads(text))
            return manifest
        damaged = json.loads(text)
    except (FileNotFoundError, NotADirectoryError):
        seen, first = "no model.json in it", ""
    except OSError as error:
        seen = f"its model.json cannot be read ({error.strerror or error})"
    except (ValueError, RecursionError) as error:
        seen = f"its model.json is no JSON ({error})"
    else:
        if isinstance(damaged, dict) and damaged.get("generator") == "ordernm":
            seen = "its model.json is damaged: it is not as generate wrote it"
        else:
            seen, first = "its model.json is not one that generate wrote", ""
    raise PackageError(
        f"{folder} holds no generated solver that is whole: {seen}; {first}make one with: generate MODEL.yaml -o FOLDER"
    )


def check_files(folder: Path, manifest: Mapping[str, Any], suffixes: tuple[str, ...]) -> None:
    """Compare files of a package with the digests in its manifest.

    Raises
    ------
    PackageError
        Names the file that is gone or changed.
    """
    for name, digest in manifest.get("digests", {}).items():
        if not name.endswith(suffixes):
            continue
        try:
            seen = "was changed" if file_digest((folder / name).read_bytes()) != digest else ""
        except FileNotFoundError:
            seen = "is missing"
        except OSError as error:
            seen = f"cannot be read ({error.strerror or error})"
        if seen:
            raise PackageError(
                f"{folder} is damaged: its {name} {seen} since it was generated; generate it again: "
                f"generate MODEL.yaml -o FOLDER"
            )


def file_digest(content: bytes) -> str:
    """Digest of a file for the manifest."""
    return hashlib.sha256(content).hexdigest()[:16]


def unrolled(value: Any) -> Any:
    """Data of ``model.json`` with its long lists as lists again; see `codegen.emit.repetition`."""
    if isinstance(value, dict):
        return {key: unrolled(v) for key, v in value.items()}
    if not isinstance(value, list):
        return value
    found: list[Any] = []
    for item in value:
        if not (isinstance(item, dict) and "repeat" in item):
            found.append(unrolled(item))
            continue
        start, step = item.get("from", []), item.get("step", [])
        for i in range(item["repeat"]):
            at = [a + i * b for a, b in zip(start, step, strict=True)]
            found += [
                at[x[0]] if isinstance(x, list) else x.format(*at) if isinstance(x, str) else x for x in item["of"]
            ]
    return found
