"""Description of a model's regions for users: the base link of each region, and the reason for it."""

from __future__ import annotations

from ...loops.errors import listed
from ...loops.partition import Partition
from ...model.expressions import Expression
from ...model.model import GROUND, Model
from .graph import Region
from .links import Link, links_of
from .region_work import FEW_SOURCES
from .regions import Regions, find_regions
from .system import in_order_of_units

_ALONE = (
    f"a region of one ear, since its loops share links with more than {FEW_SOURCES} independent speeds and a common region would "
    f"not save enough operations (docs/theory.md, 4.3)"
)
LINES = 12
"""Maximum number of regions that are described; of other regions, only the number is given."""


def describe_regions(model: Model, partition: Partition) -> list[str]:
    """One line for each region: its loops, its base and the reason for it, and the sources of its motion."""
    defaults = model.defaults

    def evaluate(e: Expression) -> float:
        value: float = e.evaluate(defaults)
        return value

    links, carriers = links_of(model, evaluate)
    links, carriers = in_order_of_units(links, carriers, find_regions(model, links, carriers, partition))
    regions = find_regions(model, links, carriers, partition)
    lines = [_line(model, links, regions, region) for region in regions.regions[:LINES]]
    more = len(regions.regions) - len(lines)
    return lines + ([f"and {more} more region{'s' * (more > 1)}"] if more else [])


def _line(model: Model, links: list[Link], regions: Regions, region: Region) -> str:
    ears = [regions.ears[e] for e in region.ears]
    loops = listed([model.loops[c.loop].name for ear in ears for c in ear.closures])
    names = [model.released.speed_names[links[i].speed + j] for i, j in region.freedoms]
    sources = [f"{len(names)} independent speed{'s' * (len(names) > 1)} ({listed(names)})"] if names else []
    base = _name(links, region.base)
    if region.far:
        hanging = [ear.roots[-1 - p] for ear in ears for p in ear.parents if p < 0]
        counts = ", ".join(f"{hanging.count(i)} on {_name(links, i)}" for i in (region.base, *region.far))
        why = (
            f"{_ALONE}; the base is the moving link that carries most links of the region, or the first of several such "
            f"links: {counts}"
        )
        sources.append(f"the motion of {listed([_name(links, i) for i in region.far])} relative to the base")
    elif not region.rigid:
        why = (
            f"{_ALONE}; the base is the only moving link that carries links of the region or faces of its loops; the "
            f"ground carries the others"
        )
        sources.append("the motion of the base")
    else:
        couplings = all(model.loops[c.loop].is_coupling for ear in ears for c in ear.closures)
        what = "coupled joints" if couplings else "faces of its loops"
        why = f"where the paths inward from the {what} meet"
    moved = listed([_name(links, i) for ear in ears for i in ear.links])
    return (
        f"region of {loops} (links {moved}): base {base}, {why}; moves with {' and '.join(sources) or 'nothing else'}"
    )


def _name(links: list[Link], i: int) -> str:
    return "ground" if i == GROUND else links[i].name
