"""What computes: the compiled C or the NumPy module of a package, opened, and compared where both are asked for."""

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
    """One partition of a package, opened; a call uses the same from beginning to end.

    Attributes
    ----------
    folder : Path
        The package.
    package : dict
        Its manifest.
    number : int
        The partition.
    manifest : dict
        Of the partition: that of the package, or its part about another one.
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
    """Open the code of a partition, on the target that is wanted, or on NumPy where C cannot be compiled.

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
            warn(f"{package['name']}: {error}. The NumPy target (target='numpy') serves instead: same numbers, slower")
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
    """The compiled code of a partition.

    Raises
    ------
    PackageError, NoCompilerError, CompileError
    """
    check_files(folder, package, (".c", ".h"))
    return CTarget(folder, manifest, functions, shapes, package.get("seal", ""), first=manifest is package)


def partitions_of(package: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """What a manifest says of each partition."""
    return [package, *package.get("others", ())]
