"""The glossary of the documentation: terms of the mechanics, and every field that blocks store for other blocks.

``python -m codegen.mechanics.glossary > docs/glossary.md`` updates it.
"""

from __future__ import annotations

import re

from .fields import FIELDS

WORDS = {
    "link": "A moving rigid part: a body with everything that is fixed to it, on a joint of one kind. A universal or planar "
    "joint makes two links.",
    "unit": "A link, an ear, a region or a force element. One call of a block computes one unit.",
    "kind": "Units of equal structure. They share every block and every generated function.",
    "block": "A short straight-line program for one kind and one sweep.",
    "sweep": "One pass over all units, outward (from the ground to the tips) or inward.",
    "ear": "Links whose motion is computed together: those that the dependent joints of one loop, or of a cluster, move; or "
    "one link of a region whose joint is independent. The word comes from the ear decomposition of graphs (H. Whitney, 1932).",
    "cluster": "Several loops that cannot be closed one after the other.",
    "region": "Ears whose links all move with the same few sources.",
    "source": "A variable with which the links of a region move: an independent speed, or one of the six components of the "
    "motion of a link outside the region.",
    "root": "A link from which an ear starts, or the ground.",
    "member": "A link of an ear, in the blocks of this ear.",
    "condition": "A number that is zero when a loop is closed; the joint of the loop enforces it.",
    "base": "The link along whose axes a region has its components. It carries the region if the loops close for any motion of "
    "that link.",
    "far link": "A root outside the region other than the base. Its motion relative to the base gives six sources.",
    "partner": "A link that is coupled to a unit when the unit is eliminated.",
    "coupling": "A 6x6 block of inertia between two links. In a model file: a linear relation of coordinates, such as a gear.",
    "pivot": "The inertia along a degree of freedom or a source; its elimination divides by the pivot.",
    "dependent": "Determined by the loops (a coordinate, a speed); all others are independent.",
    "record": "Memory of a link, an ear or a region for one call.",
    "slot": "Memory per direction for values that only neighbours need during one sweep; it is reused.",
    "lanes": "SIMD lanes, which hold one, two or eight directions (in motions also four), or several states. Also memory per "
    "direction that is kept between sweeps.",
    "store": "Memory that a block accesses, named by its owner and its sort (`ME`, `UP`, `REGION`, ...).",
    "field": "An entry of a store: a scalar, a vector, a matrix or six components.",
    "seed": "A direction of differentiation: dq, du, dp, dinputs, dt.",
    "primitive": "The derivative of a statement with respect to one of its operands.",
    "origin": "The link that carries a whole group of loops, or the ground; motions in these loops are relative to it.",
}


def glossary() -> str:
    """The text of the glossary page, in Markdown."""
    ending = re.compile(r"_[xyz]{1,2}$|(?<=_)\d\d$")
    lines = [
        "# Glossary",
        "",
        "Written by `python -m codegen.mechanics.glossary`; a test compares.",
        "",
        "## Words",
        "",
        "| word | meaning |",
        "| --- | --- |",
        *(f"| {word} | {meaning} |" for word, meaning in WORDS.items()),
        "",
        "## Fields",
        "",
        "Values that blocks store for other blocks: the name in the memory of generated code (`me->omega_y`), with `{}` for",
        "numbers; the short name, as in local variables (`up_w_y`); the name in `codegen/mechanics/fields.py`; shape, unit and",
        "axes of the components. In units, u is the unit of a degree of freedom, rad or m, and brackets contain the units of the",
        "angular and linear parts.",
        "",
        "| in generated code | short | in the generator | shape | unit | axes of | meaning |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, field in FIELDS.items():
        shown = ", ".join(f"`{n}`" for n in field.shown)
        called = ", ".join(f"`{n}`" for n in dict.fromkeys(ending.sub("", i) for i in field.identifiers))
        lines.append(
            f"| {called} | {shown} | `{name}` | {field.shape} | {field.unit} | {field.frame or '-'} | {field.meaning} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    print(glossary(), end="")
