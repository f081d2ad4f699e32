"""Which files of the run time a package carries: those of the sections that its functions need, and what these import."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

STANDALONE = Path(__file__).parent / "standalone"
"""The run time: the standard library, NumPy, cffi and modules of `SHARED` is all it imports."""

SHARED = Path(__file__).parents[1]
"""What the run time imports beside itself: modules of the lowest floors, which packages carry too."""

MOTION = Path(__file__).parent / "motion"
"""The integrators, in C; what a package that can be integrated over time carries beside its own."""

CARRIED = "_runtime"
"""What it is called in a package."""

SECTIONS: dict[str, tuple[str, ...]] = {
    "Statics": ("accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities"),
    "Diagnosing": ("accelerations",), "Dynamics": (),
    "WeightedGradients": ("gradients", "coordinate_rate_gradients", "energy_gradients", "output_gradients", "assemble_gradients"),
    "Energies": ("energies", "energy_sensitivities"), "Outputs": ("outputs", "output_sensitivities"),
    "TreeForces": ("mass_matrix", "mass_matrix_sensitivities", "inverse_mass_matrix", "solve_mass", "solve_mass_sensitivities",
                   "inverse_dynamics", "inverse_dynamics_sensitivities"),
    "LoopForces": ("closure", "accelerations", "sensitivities", "energy_sensitivities"),
    "PrescribedBranches": ("branching_motion",), "FunctionalGradients": ("state_rates",),
    "DrivingForces": ("driving_forces", "driving_force_sensitivities"),
    "Reactions": ("reactions", "reaction_sensitivities"),
    "Frames": ("frames", "frame_sensitivities", "frame_accelerations", "frame_acceleration_sensitivities"),
    "Loops": ("closure",), "States": (), "Redundancy": ("opening", "dropped"), "Partitions": (),
    "Precision": (), "SinglePrecision": ("scalar",),
}  # fmt: skip
"""Sections of `Solver`, and what a manifest names, among its functions or beside them, where they are needed."""

TOGETHER = ("Statics", "LoopForces")
"""Sections that need all of what is named there, and not any."""

ANYWAY = ("WeightedGradients", "Outputs")
"""Sections of these that serve models too that have none of these functions; who chose functions without them does without."""

ALWAYS = ("errors", "state.jacobians")
"""Modules that the ``__init__.py`` of every package imports beside sections."""


def sections_of(manifest: Mapping[str, Any]) -> dict[str, str]:
    """The sections that a package needs, as classes and their modules, in the order of the classes of `Solver`."""
    parts = (manifest, *manifest.get("others", ()))
    named = {key for m in parts for key in (*m, *m.get("functions", ()))}
    named |= {f.get("member", "") for m in parts for f in m.get("functions", {}).values()}
    left = set(manifest.get("left_out", ()))

    def needed(name: str, members: tuple[str, ...]) -> bool:
        if name in TOGETHER:
            return named.issuperset(members)
        return not members or not named.isdisjoint(members) or (name in ANYWAY and left.isdisjoint(members))

    found = {name: _module(name) for name, members in SECTIONS.items() if needed(name, members)}
    if "Loops" in found:
        del found["States"]  # which it is derived from
    return found


def carried_files(manifest: Mapping[str, Any]) -> dict[str, str]:
    """The files of the run time in a package, by name."""
    modules, left = set[str](), {*ALWAYS, *sections_of(manifest).values()}
    while left:
        modules |= left
        left = set().union(*map(_imported, left)) - modules
    modules |= {f"{module.rpartition('.')[0]}.__init__".lstrip(".") for module in modules}
    found = {f"{CARRIED}/{m.replace('.', '/')}.py": carried_text(m) for m in sorted(modules)}
    found |= {
        f"{CARRIED}/{file.relative_to(STANDALONE).as_posix()}": file.read_text(encoding="utf-8")
        for file in sorted(STANDALONE.glob("*/*.c"))
    }
    if "FunctionalGradients" in sections_of(manifest):
        found |= {
            f"{MOTION.name}/{file.name}": file.read_text(encoding="utf-8") for file in sorted(MOTION.glob("*.[ch]"))
        }
    return found


@functools.cache
def _module(section: str) -> str:
    """The module of a section: TreeForces stands in ``state.tree_forces``."""
    name = "".join(f"_{c.lower()}" if c.isupper() else c for c in section).removeprefix("_")
    (file,) = STANDALONE.glob(f"*/{name}.py")
    return f"{file.parent.name}.{name}"


@functools.cache
def carried_text(module: str) -> str:
    """The text of a module of the run time in a package, where what it shares with all of ordernm stands beside it."""
    file = STANDALONE / f"{module.replace('.', '/')}.py"
    text = (file if file.is_file() else SHARED / file.name).read_text(encoding="utf-8")
    return re.sub(r"^from \.\.\.(\.?\w+) import", r"from .\1 import", text, flags=re.MULTILINE)


@functools.cache
def _imported(module: str) -> frozenset[str]:
    """Modules of the run time that one imports, at its head or within functions."""
    room = module.rpartition(".")[0]
    found = re.findall(r"^ *from \.(\.?)([\w.]+) import", carried_text(module), re.MULTILINE)
    return frozenset(name if above or not room else f"{room}.{name}" for above, name in found)


__all__ = ["CARRIED", "carried_files", "carried_text", "sections_of"]
