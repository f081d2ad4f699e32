"""The glossary of the documentation: the words of the mechanics, and every field that blocks keep for each other.

``python -m codegen.mechanics.glossary > docs/glossary.md`` writes it anew.
"""

from __future__ import annotations

import re

from .fields import FIELDS

WORDS = {
    "link": "A rigid part that moves: a body, what is fixed to it, and a joint of one kind. "
    "A universal or planar joint makes two.",
    "unit": "What one call of a block works on: a link, an ear, a region or a force element.",
    "kind": "Units of equal structure. They share every block and every generated function.",
    "block": "A short straight-line program for one kind and one sweep.",
    "sweep": "One pass over all units, outward (from the ground to the tips) or inward.",
    "ear": "Links that the dependent joints of one loop move, resolved together; of several loops that are tangled, a cluster. "
    "Without any loop: one link of a region whose joint is independent.",
    "region": "Ears whose links all move with the same few sources.",
    "source": "What the links of a region move with: an independent speed, or one of the six components of the motion of a link "
    "that is resolved elsewhere.",
    "root": "A link that an ear starts from, or the ground.",
    "member": "A link of an ear, as a block of the ear sees it.",
    "condition": "One of the numbers that the joint of a loop holds at zero.",
    "base": "The link whose axes a region uses and that, where the loops close whatever it does, carries the region.",
    "far link": "A root outside the region other than the base. Its motion against the base is six sources.",
    "partner": "A link that a unit is coupled to when it is eliminated.",
    "coupling": "A 6x6 inertia that stands between two links.",
    "pivot": "The inertia along a freedom or a source, by which is divided when it is eliminated.",
    "dependent": "A freedom (coordinate, speed) that the loops determine; the others are independent.",
    "record": "Memory of a link, an ear or a region for one call, one number a component.",
    "slot": "Memory per direction that only neighbours need, while one sweep passes; reused.",
    "lanes": "Memory per direction that is kept between sweeps; also the directions themselves: one, two or eight at a time.",
    "store": "What a block calls memory: whose it is and of which sort (`ME`, `UP`, `REGION`, ...).",
    "field": "What is kept in a store: a scalar, a vector, a matrix, six components.",
    "seed": "A direction of derivatives: dq, du, dp, dinputs, dt.",
    "primitive": "The derivative of a statement with respect to one of its own operands.",
    "origin": "Of the motion of links that loops close on: the link that carries all of the loop, or the ground.",
}


def glossary() -> str:
    """The page, in Markdown."""
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
        "What blocks keep for each other: the name in the memory of generated code (`me->omega_y`), with `{}` for numbers;",
        "the short name, of which local variables are made there (`up_w_y`); the name in `codegen/mechanics/fields.py`;",
        "shape, unit and the axes of components. In units, u is what a freedom is measured in, rad or m, and brackets hold",
        "the units of angular and linear parts.",
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
