"""Directions of derivatives: seeds, checked and broadcast with the arguments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .arguments import Arguments, broadcast
from .arrays import Array, Shape


def take_directions(
    arguments: Arguments, given: Mapping[str, Any], arrays: Mapping[str, Any], batch: Shape
) -> tuple[dict[str, Array], int, Shape]:
    """Checked seeds (k, ..., n) with as many batch axes as the batch; k; the batch with theirs.

    `arrays` are the checked arguments, and `batch` the shape they make.
    """
    seeds: dict[str, Array] = {}
    for name, value in given.items():
        if value is None:
            continue
        of = name[1:]
        seed = arguments.array(name, value, of)
        if of == "t":
            seed = seed[..., None]
        seeds[name] = seed[None] if seed.ndim == 1 else seed
    if not seeds:
        raise ValueError(f"no seed given; give at least one of {', '.join(given)}, directions first: dq (k, ..., nq)")
    counts = {name: len(seed) for name, seed in seeds.items()}
    k = next(iter(counts.values()))
    if any(c != k for c in counts.values()):
        seen = ", ".join(f"{name} {c}" for name, c in counts.items())
        raise ValueError(
            f"the seeds have different numbers of directions: {seen}; the first axis of all counts the same ones"
        )
    for seed in seeds.values():
        if seed.shape[1:-1] != batch:
            batch = broadcast(batch, seed.shape[1:-1], {**arrays, **seeds})
    for name, seed in seeds.items():
        missing = len(batch) - (seed.ndim - 2)
        if missing:
            seeds[name] = seed.reshape(k, *(1,) * missing, *seed.shape[1:])
    return seeds, k, batch
