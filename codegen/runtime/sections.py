"""Selects the files of the run time that a package contains: those that its `Solver` needs, with their imports."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

STANDALONE = Path(__file__).parent / "standalone"
"""The run time; it imports only the standard library, NumPy, cffi and modules of `SHARED`."""

SHARED = Path(__file__).parents[1]
"""Folder of the modules of the lowest layers that the run time imports and that packages therefore contain."""

MOTION = Path(__file__).parent / "motion"
"""The integrators in C, for packages with functions for integration over time."""

CARRIED = "_runtime"
"""Name of the folder with the run time in a package."""

ON_INDEPENDENTS = ("closure", "accelerations", "sensitivities", "energy_sensitivities")
"""Functions from which a solver composes mass matrix and inverse dynamics for mechanisms with loops."""

SECTIONS: dict[str, tuple[str, ...]] = {
    "dynamics": (), "consistent states": (), "partitions": (),
    "statics": ("accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities"),
    "first-order equations": ("accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities"),
    "diagnosis": ("accelerations",),
    "weighted gradients": (
        "gradients", "coordinate_rate_gradients", "energy_gradients", "output_gradients", "assemble_gradients",
    ),
    "second derivatives": (
        "hessian_products", "output_hessian_products", "energy_hessian_products", "inverse_dynamics_hessian_products",
        "coordinate_rate_hessian_products", "assemble_hessian_products",
    ),
    "second derivatives of equilibria": (
        "accelerations", "sensitivities", "coordinate_rates", "coordinate_rate_sensitivities", "hessian_products",
    ),
    "energies": ("energies", "energy_sensitivities"), "outputs": ("outputs", "output_sensitivities"),
    "forces": ("mass_matrix", "mass_matrix_sensitivities", "inverse_dynamics", "inverse_dynamics_sensitivities"),
    "inverse of the mass matrix": ("inverse_mass_matrix", "solve_mass", "solve_mass_sensitivities"),
    "driving forces": ("driving_forces", "driving_force_sensitivities"),
    "reactions": ("reactions", "reaction_sensitivities"),
    "frames": ("frames", "frame_sensitivities", "frame_accelerations", "frame_acceleration_sensitivities"),
    "views": ("display",), "motions": ("state_rates",), "precision": (),
}  # fmt: skip
"""Sections of `standalone.solver.Solver`, each with the functions or other keys of a manifest that require it."""

PARTS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("assembly.loops", "assembly.open_states", "trust.exact_loops"), ("closure",)),
    "state.negative_masses": ("masses",), "assembly.redundancy": ("opening", "dropped"), "state.loop_forces": ON_INDEPENDENTS,
    "motion.prescribed_branches": ("branching_motion",), "trust.single_precision": ("scalar",),
    "calls.on_threads": ("over_states",), "display.views": ("display",),
}  # fmt: skip
"""Modules and C files that a package contains only if its manifest contains one of these keys."""

TOGETHER = ("statics", "first-order equations", "second derivatives of equilibria", "state.loop_forces")
"""Entries of both tables whose keys must all occur in the manifest."""

ANYWAY = ("weighted gradients", "outputs")
"""Sections that a package contains even if its manifest lacks their functions, except a package of selected functions."""

ALWAYS = ("errors", "state.derivatives")
"""Modules that the ``__init__.py`` of every package imports in addition to its solver."""

_HEAD = re.compile(r"^    # -- (.+?) -+\n", re.MULTILINE)


def sections_of(manifest: Mapping[str, Any]) -> list[str]:
    """The sections of `Solver` that a package needs, in their order in the class."""
    found = _needed(manifest, SECTIONS)
    if "forces" not in found and _needed(manifest, {"state.loop_forces": ON_INDEPENDENTS}):
        found.insert(0, "forces")
    return found


def _needed(manifest: Mapping[str, Any], parts: Mapping[str, tuple[str, ...]]) -> list[str]:
    of_partitions = (manifest, *manifest.get("others", ()))
    named = {key for m in of_partitions for key in (*m, *m.get("functions", ()))}
    named |= {f.get("member", "") for m in of_partitions for f in m.get("functions", {}).values()}
    left = set(manifest.get("left_out", ()))

    def needed(name: str, members: tuple[str, ...]) -> bool:
        if name in TOGETHER:
            return named.issuperset(members)
        return not members or not named.isdisjoint(members) or (name in ANYWAY and left.isdisjoint(members))

    return [name for name, members in parts.items() if needed(name, members)]


def carried_files(manifest: Mapping[str, Any]) -> dict[str, str]:
    """The files of the run time in a package, by name."""
    sections = sections_of(manifest)
    texts, left = {"solver": solver_text(sections)}, set(ALWAYS)
    left |= _imported("solver", texts["solver"])
    without = PARTS.keys() - {*_needed(manifest, PARTS)}
    while left := left - texts.keys() - without:
        texts |= {module: carried_text(module) for module in left}
        left = set().union(*(_imported(module, texts[module]) for module in left))
    for room in {module.rpartition(".")[0] for module in texts}:
        texts[f"{room}.__init__".lstrip(".")] = carried_text(f"{room}.__init__".lstrip("."))
    found = {f"{CARRIED}/{module.replace('.', '/')}.py": texts[module] for module in sorted(texts)}
    found |= {
        f"{CARRIED}/{file.relative_to(STANDALONE).as_posix()}": file.read_text(encoding="utf-8")
        for file in sorted(STANDALONE.glob("*/*.[ch]"))
        if f"{file.parent.name}.{file.stem}" not in without
    }
    return found | (motion_files() if "motions" in sections else {})


def motion_files() -> dict[str, str]:
    """The files of the integrators by name; their scalar type is that of the target."""
    from ..emit.c.motion import scalar_header

    texts = {file.name: file.read_text(encoding="utf-8") for file in MOTION.glob("*.[ch]")} | {
        "scalar.h": scalar_header()
    }
    return {f"{MOTION.name}/{name}": texts[name] for name in sorted(texts)}


@functools.cache
def carried_text(module: str) -> str:
    """The text of a module of the run time as in a package, where shared modules are in the same folder."""
    file = STANDALONE / f"{module.replace('.', '/')}.py"
    text = (file if file.is_file() else SHARED / file.name).read_text(encoding="utf-8")
    return re.sub(r"^from \.\.\.(\.?\w+) import", r"from .\1 import", text, flags=re.MULTILINE)


def solver_text(sections: Iterable[str]) -> str:
    """`Solver` with selected sections and only the imports that these use."""
    start, *parts = _HEAD.split(carried_text("solver"))
    rules, wanted = _HEAD.finditer(carried_text("solver")), {*sections}
    kept = [r[0] + body for r, body in zip(rules, parts[1::2], strict=True) if r[1] in wanted]
    imports, mark, start = start.partition("\nclass Solver")
    body = f"{mark}{start}{''.join(kept)}".rstrip() + "\n"
    used = {*re.findall(r"\w+", re.sub(r'""".*?"""', "", body, flags=re.DOTALL)), "annotations"}

    def with_names_that_are_used(line: re.Match[str]) -> str:
        names = [name for name in line[2].split(", ") if name.rpartition(" as ")[2] in used]
        return f"{line[1]}{', '.join(names)}\n" if names else ""

    imports = re.sub(r"^((?:from \S+ )?import )(.+)\n", with_names_that_are_used, imports, flags=re.MULTILINE)
    return re.sub(r"\n{3,}", "\n\n", imports) + body


def is_carried(module: str, text: str) -> bool:
    """Whether this version of ordernm writes a module with this text into any package."""
    return text == (solver_text(m[1] for m in _HEAD.finditer(text)) if module == "solver" else carried_text(module))


def _imported(module: str, text: str) -> set[str]:
    """Modules of the run time that a module imports, also within functions."""
    room = module.rpartition(".")[0]
    found = re.findall(r"^ *from \.(\.?)([\w.]+) import", text, re.MULTILINE)
    return {name if above or not room else f"{room}.{name}" for above, name in found}


__all__ = [
    "CARRIED",
    "ON_INDEPENDENTS",
    "carried_files",
    "carried_text",
    "is_carried",
    "motion_files",
    "sections_of",
    "solver_text",
]
