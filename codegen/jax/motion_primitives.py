"""JAX primitives of motions: results, derivatives along directions, and gradients of weighted sums, computed outside of XLA.

======  ========================================  ===================
kind    operands after the variables x (k,)       results
======  ========================================  ===================
value                                             (*shape) for each
pushed  directions (*batch, k)                    (*batch, *shape)
pulled  weights (*batch, *shape) for each         gradients (*batch, k)
======  ========================================  ===================
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from ..differentiable_motions import DifferentiableMotion

KINDS = ("value", "pushed", "pulled")

PRIMITIVES = {kind: Primitive(f"ordernm_motion_{kind}") for kind in KINDS}


def bind(kind: str, *given: Any, motion: DifferentiableMotion, ahead: bool = False) -> list[Any]:
    found: list[Any] = PRIMITIVES[kind].bind(*given, motion=motion, kind=kind, ahead=ahead)
    return found


def _shapes(motion: DifferentiableMotion, kind: str, given: Sequence[Any]) -> list[tuple[int, ...]]:
    """Shapes of the results."""
    if kind == "value":
        return list(motion.shapes)
    lead = given[1].shape[: given[1].ndim - (1 if kind == "pushed" else len(motion.shapes[0]))]
    return [(*lead, *s) for s in motion.shapes] if kind == "pushed" else [(*lead, len(motion.names))]


def _abstract(*avals: Any, motion: DifferentiableMotion, kind: str, ahead: bool) -> list[Any]:
    return [avals[0].update(shape=s, weak_type=False) for s in _shapes(motion, kind, avals)]


def _computed(*given: Any, motion: DifferentiableMotion, kind: str, ahead: bool) -> list[Any]:
    """The callback of a primitive."""

    def run(x: Any, *rest: Any) -> list[Any]:
        if kind == "value":
            return list(motion.values(x, ahead))
        return list(motion.pushed(x, *rest)) if kind == "pushed" else [motion.pulled(x, rest)]

    results = [jax.ShapeDtypeStruct(s, "float64") for s in _shapes(motion, kind, given)]
    return list(jax.pure_callback(run, results, *given))


def _jvp(primals: Any, tangents: Any, *, motion: DifferentiableMotion, kind: str, ahead: bool) -> Any:
    moved, linear = tangents[0], tangents[1:]
    if kind == "value":
        out = bind(kind, *primals, motion=motion, ahead=True)
        return out, bind("pushed", primals[0], ad.instantiate_zeros(moved), motion=motion)
    if type(moved) is not ad.Zero:
        raise NotImplementedError(motion.no_second())
    out = bind(kind, *primals, motion=motion)
    return out, bind(kind, primals[0], *map(ad.instantiate_zeros, linear), motion=motion)


def _transpose(cts: Any, x: Any, *linear: Any, motion: DifferentiableMotion, kind: str, ahead: bool) -> Any:
    if all(type(c) is ad.Zero for c in cts):
        return [None, *(ad.Zero(a.aval) for a in linear)]
    back = "pulled" if kind == "pushed" else "pushed"
    return [None, *bind(back, x, *map(ad.instantiate_zeros, cts), motion=motion)]


def _batched(args: Any, dims: Any, **params: Any) -> Any:
    """Directions or weights of one motion are processed in one call; several motions run one after another."""
    moved = [a if d is None else jnp.moveaxis(a, d, 0) for a, d in zip(args, dims, strict=True)]
    if dims[0] is None:
        size = next(a.shape[0] for a, d in zip(moved, dims, strict=True) if d is not None)
        whole = [jnp.broadcast_to(a, (size, *a.shape)) if d is None else a
                 for a, d in zip(moved[1:], dims[1:], strict=True)]  # fmt: skip
        out = bind(params["kind"], args[0], *whole, motion=params["motion"])
        return out, [0] * len(out)

    def one(mapped: Any) -> Any:
        rest = iter(mapped)
        return bind(params["kind"], *(a if d is None else next(rest) for a, d in zip(args, dims, strict=True)),
                    motion=params["motion"], ahead=params["ahead"])  # fmt: skip

    out = jax.lax.map(one, [a for a, d in zip(moved, dims, strict=True) if d is not None])
    return out, [0] * len(out)


@functools.lru_cache(maxsize=256)
def _compiled(kind: str, motion: DifferentiableMotion, ahead: bool) -> Any:
    return jax.jit(functools.partial(PRIMITIVES[kind].bind, motion=motion, kind=kind, ahead=ahead))


def _register(kind: str) -> None:
    primitive = PRIMITIVES[kind]
    primitive.multiple_results = True
    primitive.def_impl(lambda *args, motion, kind, ahead: _compiled(kind, motion, ahead)(*args))
    primitive.def_abstract_eval(_abstract)
    mlir.register_lowering(primitive, mlir.lower_fun(_computed, multiple_results=True))
    ad.primitive_jvps[primitive] = _jvp
    batching.primitive_batchers[primitive] = _batched
    if kind != "value":
        ad.primitive_transposes[primitive] = _transpose


for _kind in KINDS:
    _register(_kind)
