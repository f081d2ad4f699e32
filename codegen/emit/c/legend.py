"""The text at the beginning of a C header and of its source, which explains the names."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from ...model.model import Model
from ...program.procedure import Procedure
from ..function import COMMENT


def legend(model: Model, links: int, numbers: str, singular_outputs: bool, functions: Iterable[Procedure]) -> list[str]:
    """Lines that describe the arguments and results of the functions."""
    arrays = {a.name: a for f in functions for a in (*f.arguments, *f.seeds, *f.results)}

    def some(names: Sequence[str]) -> str:
        return " ".join(names[:12]) + (" ..." if len(names) > 12 else "") or "none"

    nq, nu, outputs = model.nq, model.nu, [o.name for o in model.outputs]
    lines = [
        f"  q[{nq}]     coordinates: {some(model.coordinate_names)}",
        f"  u[{nu}]     speeds: {some(model.speed_names)}",
    ]
    if "udot" in arrays:
        lines.append(f"  udot[{nu}]  their time derivatives")
    if model.parameters:
        where = f"{model.name}_model.h has defaults, initial state and indices"
        lines.append(f"  p[{len(model.parameters)}]     design parameters; {where}:")
        for p in model.parameters[:64]:
            unit = p.unit.replace("*/", "* /").replace("/*", "/ *") if p.unit else ""
            lines.append(f"             {p.name}{f' [{unit}]' if unit else ''}")
    if model.inputs:
        lines.append(f"  inputs[{len(model.inputs)}]: {' '.join(model.inputs)}")
    if "t" in arrays:
        lines.append("  t         time, s")
    if "outputs" in arrays:
        lines.append(f"  outputs[{len(outputs)}]: {some(outputs)}")
    if model.switches.have_modes:
        lines.append(
            f"  modes[{len(model.switches.found)}]: of switches, for functions whose name has _in_modes, which integrators call:"
        )
        lines.append("            a number for each, or NULL if the arguments select the branches; see motion/motion.h")
    if "energy" in arrays:
        lines.append("  energy[2]  kinetic and potential energy, J")
    if any(len(a.shape) > 1 for a in arrays.values()):
        lines.append(f"  M[{nu}*{nu}] and J_x[{nu}*n] are stored row by row.")
    if any(a.lanes for a in arrays.values()):
        lines += [
            "A function whose name ends in _8, _2 or _1 works on 8, 2 or 1 directions at once: seeds (dq, du, ...) and",
            f"derivatives have the direction as last index, dq[{nq}][8].",
        ]
    lines += [
        f"work: {model.name.upper()}_WORKSPACE {numbers} of the caller's. Nothing in it is kept between calls; functions are "
        f"re-entrant.",
        "Functions return 0, or the number (from 1) of a link without outboard inertia about its joint.",
    ]
    if model.loops:
        lines.append(f"Numbers above {links}, the number of links: a loop has lost rank.")
    if any(e.singular for e in model.loads):
        lines.append(f"Numbers above {links + len(model.loops)}: a force element has no direction.")
    if singular_outputs:
        above = links + len(model.loops) + len(model.loads)
        lines.append(f"Numbers above {above}: an output has a value there, but no derivative; in their order.")
    return lines


def about_names(loops: bool) -> list[str]:
    """The text about the pointers in functions of links, at the head of the file."""
    several = "; functions of loops have several links (me0, me1), their roots, their region and its base"
    text = (
        f"Functions of links are called by sweeps: me is the link, up its parent, c its constants{several if loops else ''}. "
        "Names with near point to scratch memory that neighbouring links share during one sweep; lme, lup, lane and names "
        'with d hold one value per direction. "in" and "out" list what a function reads and writes.'
    )
    return textwrap.wrap(text, COMMENT)
