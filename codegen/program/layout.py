"""Layout: the place of each value of a program in its row of memory, decided before printing."""

from __future__ import annotations

Fields = dict[str, int]
"""Places of components in a row, by name."""


class Layout:
    """Places of all values of a program.

    Attributes
    ----------
    fields : dict of str to dict of str to int
        By region of memory (see `store.Memory`), slots excepted: the place of each component in a row.
    rows : dict of str to int
        By region, including slots and `near`: the number of rows.
    slots : dict of str to dict of str to int
        Like `fields`, for slots, by sweep: every sweep reuses the slots.
    near : dict of str to dict of str to int
        Like `fields`, for the scratch that neighbouring links share, by sweep.
    slot_forms, near_forms : dict of str to str
        By sweep: the first sweep with the same fields in the same order.
    near_size : int
        Number of places in a row of `near`.
    constant_fields : dict of int to dict of str to int
        By shape: place of each constant among the constants of a link.
    forms : dict of int to int
        By shape: the first shape with the same constants, in the same order.
    constant_offsets : dict of int to int
        By index of `Constants`: the first place.
    constants_size : int
        Total number of constants.
    numbers : list of float
        Constants that differ between units of a kind but do not depend on design parameters.
    angles : list of int
        Coordinates that are angles.
    driven_angles : list of int
        Prescribed coordinates that are angles, numbered after those of `angles`.
    added_angles : list of float
        Constant offset of each angle of both lists, rad.
    angles_padded : int
        Number of angles of both lists, rounded up to the vector width.
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
    """Consecutive places in a row, one for each component."""
    return {name: i for i, name in enumerate(names)}


def first_with(fields: dict[str, Fields]) -> dict[str, str]:
    """For each sweep, the first one with the same fields."""
    known: dict[tuple[str, ...], str] = {}
    return {sweep: known.setdefault(tuple(names), sweep) for sweep, names in fields.items()}
