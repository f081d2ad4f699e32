"""The generated package: sizes, kinds, operations, code, and the time of generation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..model import Model
    from ..runtime import Solver
    from ..summary import Report

SOURCES = (".c", ".h")


def generated(model: Model, made: Report, solver: Solver) -> dict[str, Any]:
    """Sizes and costs of a generated package.

    Returns
    -------
    dict
        ``bodies``, ``links``, ``loops``, ``coordinates``, ``speeds``, ``freedoms`` (independent speeds), ``parameters``,
        ``inputs``, ``outputs``, ``kinds``, ``layout``; ``operations`` by function, each with its sweeps; ``code_bytes``,
        ``code_lines``, ``library_bytes``; ``seconds`` by stage of generation; ``choice``, the decisions about loops, in words.
    """
    sources = {
        p.name: p for p in sorted(Path(made.folder).rglob("*")) if p.suffix in SOURCES and "motion" not in p.parts
    }
    libraries = list(Path(made.folder).rglob("*.so*"))
    return {
        "bodies": len(model.bodies), "links": made.links, "loops": len(model.loops), "coordinates": model.nq, "speeds": model.nu,
        "freedoms": len(solver.independent_speed_names), "parameters": len(model.parameters), "inputs": len(model.inputs),
        "outputs": len(solver.output_names), "kinds": made.kinds, "layout": made.layout,
        "operations": solver.operations,
        "code_bytes": sum(p.stat().st_size for p in sources.values()),
        "code_lines": sum(len(p.read_text(encoding="utf-8").splitlines()) for p in sources.values()),
        "library_bytes": sum(p.stat().st_size for p in libraries),
        "seconds": dict(made.seconds), "choice": list(made.loops), "remarks": list(made.remarks),
    }  # fmt: skip
