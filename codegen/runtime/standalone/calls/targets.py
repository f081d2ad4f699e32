"""Opens a target of a package: the compiled C, the NumPy module, or both with a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..arrays import Shape
from ..errors import NoCompilerError
from ..files.manifest import check_files
from ..warning import warn
from .c_target import CTarget
from .comparison import compare
from .functions import Function, functions_of
from .numpy_target import NumpyTarget
from .task import Target


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """An open partition of a package. A call uses the same object throughout.

    Attributes
    ----------
    folder : Path
        The package.
    package : dict
        Manifest of the package.
    number : int
        Index of the partition.
    manifest : dict
        Manifest of the partition: the package's own, or an entry of "others" in it.
    functions : dict of str to Function
    target : Target
    """

    folder: Path
    package: Mapping[str, Any]
    number: int
    manifest: Mapping[str, Any]
    functions: dict[str, Function]
    target: Target


def open_partition(
    folder: Path, package: Mapping[str, Any], number: int, wanted: str, shapes: Mapping[str, Shape]
) -> Opened:
    """Opens the code of a partition for the requested target, or NumPy if C cannot be compiled.

    Raises
    ------
    PackageError, CompileError, TargetsDifferError
    """
    if wanted not in ("c", "numpy", "both"):
        raise ValueError(f"target is {wanted!r}; allowed are 'c', 'numpy' and 'both'")
    manifest = partitions_of(package)[number]
    functions = functions_of(manifest, shapes)

    def plain() -> NumpyTarget:
        check_files(folder, package, ("_numpy.py",))
        return NumpyTarget(folder, manifest)

    def compiled() -> Target:
        try:
            target = c_target(folder, package, manifest, functions, shapes)
        except NoCompilerError as error:
            warn(f"{package['name']}: {error}. The NumPy target (target='numpy') is used instead; it is slower")
            return plain()
        if wanted == "both":
            compare(manifest, functions, shapes, target, plain())
        return target

    return Opened(folder, package, number, manifest, functions, plain() if wanted == "numpy" else compiled())


def c_target(
    folder: Path,
    package: Mapping[str, Any],
    manifest: Mapping[str, Any],
    functions: dict[str, Function],
    shapes: Mapping[str, Shape],
) -> CTarget:
    """Opens the compiled code of a partition.

    Raises
    ------
    PackageError, NoCompilerError, CompileError
    """
    check_files(folder, package, (".c", ".h"))
    return CTarget(folder, manifest, functions, shapes, package.get("seal", ""), first=manifest is package)


def partitions_of(package: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The manifests of all partitions of a package."""
    return [package, *package.get("others", ())]
