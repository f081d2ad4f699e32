"""``model.json``, the manifest of a package: its seal, its content, and the digests of the other files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import PackageError

ALLOWED = 10.0
"""Factor on the model's `loop_tolerance`. Redundant conditions may keep residuals up to the product in a closed loop. Warnings
report dropped conditions whose residual, or its derivative with respect to a parameter, is larger."""

SEAL = ',\n "seal": "'


def seal(text: str) -> str:
    """The text of ``model.json`` whose last entry is a digest of the text, which detects damage."""
    body = text.rstrip().removesuffix("}").rstrip()
    return f'{body}{SEAL}{hashlib.sha256(body.encode()).hexdigest()}"\n}}\n'


def refuse_another(folder: Path, sealed: str) -> None:
    """Raises `PackageError` if the package has been generated again since it was opened, because its C code may differ.

    Parameters
    ----------
    folder : Path
    sealed : str
        The ``seal`` of the manifest when the package was opened; if empty, nothing is compared.
    """
    if not sealed:
        return
    try:
        text = (folder / "model.json").read_text(encoding="utf-8")
    except (OSError, ValueError):
        text = ""
    if sealed not in text[text.rfind(SEAL) :]:
        raise PackageError(f"{folder} was generated again, or removed, after this solver was opened; load it again")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Reads ``model.json`` of a package.

    Raises
    ------
    PackageError
        If the file is missing, damaged, or not from ordernm.
    """
    model = "MODEL.yaml"
    first = "remove the damaged folder, then "  # generate refuses folders that it does not recognise as its own
    try:
        text = (folder / "model.json").read_text(encoding="utf-8")
        if SEAL in text and seal(text[: text.rindex(SEAL)] + "}") == text:
            manifest: dict[str, Any] = unrolled(json.loads(text))
            return manifest
        damaged = json.loads(text)
    except (FileNotFoundError, NotADirectoryError):
        seen, first = "no model.json in it", ""
        if folder.is_file() and folder.suffix in (".yaml", ".yml"):
            seen, first, model = "it is a model file, and a solver is a folder", "", folder.name
        elif not folder.is_dir():
            seen, first = "it is a file" if folder.exists() else "there is no such folder", ""
    except OSError as error:
        seen = f"its model.json cannot be read ({error.strerror or error})"
    except (ValueError, RecursionError) as error:
        seen = f"its model.json is not valid JSON ({error})"
    else:
        if isinstance(damaged, dict) and damaged.get("generator") == "ordernm":
            seen = "its model.json is damaged: it has changed since it was generated"
        else:
            seen, first = "its model.json is not one that generate wrote", ""
    raise PackageError(
        f"{folder} contains no complete generated solver: {seen}; {first}create one with: generate {model} -o FOLDER"
    )


def check_files(folder: Path, manifest: Mapping[str, Any], suffixes: tuple[str, ...]) -> None:
    """Compares files of a package with the digests in its manifest.

    Raises
    ------
    PackageError
        If a file is missing or changed; the message names it.
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
    """The digest of a file, as the manifest stores it."""
    return hashlib.sha256(content).hexdigest()[:16]


def unrolled(value: Any) -> Any:
    """Expands the repeated entries of lists in ``model.json``; see `codegen.emit.repetition`."""
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
