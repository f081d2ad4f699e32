"""Where the values of a program lie in rows of memory: decided before anything is printed."""

from __future__ import annotations

Fields = dict[str, int]
"""Places of components in a row, by their names."""


class Layout:
    """Places of the values of a program.

    Attributes
    ----------
    fields : dict of str to dict of str to int
        By region of memory (see `store.Memory`) but slots: the place of each component in a row.
    rows : dict of str to int
        By region, slots and `near` among them: how many rows there are.
    slots : dict of str to dict of str to int
        The same as `fields` for slots, by sweep: slots are used anew by every sweep.
    near : dict of str to dict of str to int
        The same for scratch shared by neighbouring links, by sweep.
    slot_forms, near_forms : dict of str to str
        By sweep: the first one with the same fields there, in the same order.
    near_size : int
        Places in a row of `near`.
    constant_fields : dict of int to dict of str to int
        By shape: index of a constant among those of its links.
    forms : dict of int to int
        By shape: the first shape with the same constants, in the same order.
    constant_offsets : dict of int to int
        By constants: where they begin.
    constants_size : int
        How many there are.
    numbers : list of float
        Constants that differ within a kind but depend on no parameter.
    angles : list of int
        Coordinates that are angles.
    driven_angles : list of int
        What of prescribed motion is an angle; these have the numbers after the others.
    added_angles : list of float
        What is added to each of both, rad.
    angles_padded : int
        How many of both there are, rounded up for vectors.
    """

    fields: dict[str, Fields]
    rows: dict[str, int]
    slots: dict[str, Fields]
    near: dict[str, Fields]
    slot_forms: dict[str, str]
    near_forms: dict[str, str]
    near_size: int
    constant_fields: dict[int, Fields]
    forms: dict[int, int]
    constant_offsets: dict[int, int]
    constants_size: int
    numbers: list[float]
    angles: list[int]
    driven_angles: list[int]
    added_angles: list[float]

    @property
    def angles_padded(self) -> int:
        return -(-len(self.added_angles) // 8) * 8


def numbered(names: list[str]) -> Fields:
    """Places of components that stand one after the other."""
    return {name: i for i, name in enumerate(names)}


def first_with(fields: dict[str, Fields]) -> dict[str, str]:
    """For each sweep, the first one with the same fields."""
    known: dict[tuple[str, ...], str] = {}
    return {sweep: known.setdefault(tuple(names), sweep) for sweep, names in fields.items()}
