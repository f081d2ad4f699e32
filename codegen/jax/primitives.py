"""JAX primitives of a solver's functions: values, products with Jacobian and transpose, and second derivatives.

All arrays have a last axis of entries. Arguments are (n,), shared by all states, or (*batch, n); seeds and weights of
products with first derivatives have an axis of directions in front: (k, n) or (k, *batch, n).

=========  ==================================  ==========================================
kind       operands after the arguments        results
=========  ==================================  ==========================================
value                                          (*batch, m)
along      seeds (k, ..., n)                   (k, *batch, m)
against    weights (k, ..., m)                 gradients (k, *batch, n), one per argument
curved     weights (..., m), seeds (k, ..., n)  changes of gradients (k, *batch, n)
crossed    two directions (..., n)             second derivative (*batch, m) along both
=========  ==================================  ==========================================
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from ..operators import Operator
from .plans import TARGET, attributes

Given = Mapping[str, Any]

KINDS = ("value", "along", "against", "curved", "crossed")


def _primitive(kind: str) -> Primitive:
    made = Primitive(f"ordernm_{kind}")
    made.multiple_results = True
    return made


PRIMITIVES = {kind: _primitive(kind) for kind in KINDS}


# ---- operands of the primitives --------------------------------------------------------------------------------------


def _rest(of: Operator, kind: str, seeds: Sequence[str]) -> list[tuple[str, bool]]:
    """Operands after the arguments: their names in C, and whether they have an axis of directions."""
    along = [(f"d{n}", True) for n in seeds]
    if kind == "crossed":
        return [(f"d{n}", False) for n in seeds]
    weights = {"against": [(of.derived.weights, True)], "curved": [(of.derived.curving, False)]}
    return weights.get(kind, []) + along


def _operands(of: Operator, kind: str, seeds: Sequence[str]) -> tuple[tuple[str, bool], ...]:
    return tuple([(n, False) for n in of.names] + _rest(of, kind, seeds))


def _function(of: Operator, kind: str) -> str:
    """The generated function of a primitive."""
    d = of.derived
    return {"value": of.name, "along": d.along, "against": d.against, "curved": d.curved}[kind]


def _results(of: Operator, kind: str) -> tuple[str, ...]:
    """Results in C that a primitive returns."""
    if kind in ("value", "crossed"):
        return (of.derived.result,)
    if kind == "along":
        return (f"d{of.derived.result}",)
    mark = "d" if kind == "against" else "dg"
    return tuple(f"{mark}{n}" for n in of.names if f"{mark}{n}" in of.function(_function(of, kind)).results)


def _gives(of: Operator, kind: str) -> tuple[str, ...]:
    """Arguments with respect to which `against` or `curved` returns gradients; the other gradients are zero."""
    mark = 1 if kind == "against" else 2
    return tuple(r[mark:] for r in _results(of, kind))


def _batch(operands: Sequence[tuple[str, bool]], shapes: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """The batch shape of operands."""
    for (_, along), shape in zip(operands, shapes, strict=True):
        if len(shape) > 1 + along:
            return tuple(shape[along:-1])
    return ()


def _directions(operands: Sequence[tuple[str, bool]], shapes: Sequence[tuple[int, ...]]) -> int:
    return next((shape[0] for (_, along), shape in zip(operands, shapes, strict=True) if along), 1)


def _abstract(*avals: Any, of: Operator, kind: str, seeds: tuple[str, ...]) -> list[Any]:
    operands, shapes = _operands(of, kind, seeds), [a.shape for a in avals]
    batch, k = _batch(operands, shapes), _directions(operands, shapes)
    if kind in ("value", "crossed"):
        made = [(*batch, of.size)]
    elif kind == "along":
        made = [(k, *batch, of.size)]
    else:
        made = [(k, *batch, of.sizes[n]) for n in _gives(of, kind)]
    return [avals[0].update(shape=shape, weak_type=False) for shape in made]


# ---- the mathematics, on named arrays --------------------------------------------------------------------------------


def bind(of: Operator, kind: str, given: Sequence[Any], seeds: Sequence[str] = ()) -> list[Any]:
    found: list[Any] = PRIMITIVES[kind].bind(*given, of=of, kind=kind, seeds=tuple(seeds))
    return found


def value(of: Operator, x: Sequence[Any]) -> Any:
    """The function at arguments x."""
    return bind(of, "value", x)[0]


def along(of: Operator, x: Sequence[Any], seeds: Given) -> Any:
    """Derivatives (k, *batch, m) of the function along seeds."""
    taken = [n for n in of.names if n in seeds and f"d{n}" in of.function(of.derived.along).seeds]
    if taken:
        return bind(of, "along", [*x, *(seeds[n] for n in taken)], taken)[0]
    k = next(iter(seeds.values())).shape[0]
    return jnp.zeros((k, *_batch(_operands(of, "value", ()), [jnp.shape(a) for a in x]), of.size), of.dtype)


def against(of: Operator, x: Sequence[Any], weights: Any) -> dict[str, Any]:
    """Gradients (k, *batch, n) of weighted sums; those that are missing are zero."""
    if of.has(of.derived.against):
        return dict(zip(_gives(of, "against"), bind(of, "against", [*x, weights]), strict=True))
    taken = [n for n in of.names if f"d{n}" in of.function(of.derived.along).seeds]  # columns of a full Jacobian
    sizes = [of.sizes[n] for n in taken]
    units = jnp.eye(sum(sizes), dtype=of.dtype)
    starts = [sum(sizes[:i]) for i in range(len(sizes))]
    parts = {n: units[:, s : s + m] for n, s, m in zip(taken, starts, sizes, strict=True)}
    whole = jnp.einsum("d...m,k...m->k...d", along(of, x, parts), weights)
    return {n: whole[..., s : s + m] for n, s, m in zip(taken, starts, sizes, strict=True)}


def curved(of: Operator, x: Sequence[Any], weights: Any, seeds: Given) -> dict[str, Any]:
    """Changes (k, *batch, n) of the gradient of a weighted sum along seeds; those that are missing are zero."""
    if not of.has(of.derived.curved):
        raise NotImplementedError(of.no_curvature())
    taken = [n for n in of.names if n in seeds and f"d{n}" in of.function(of.derived.curved).seeds]
    if not taken:
        return {}
    return dict(
        zip(_gives(of, "curved"), bind(of, "curved", [*x, weights, *(seeds[n] for n in taken)], taken), strict=True)
    )


def crossed(of: Operator, x: Sequence[Any], first: Given, second: Given) -> Any:
    """The second derivative (*batch, m) along two directions."""
    if not of.has(of.derived.curved):
        raise NotImplementedError(of.no_curvature())
    every = {*first, *second}
    taken = [n for n in of.names if n in every]

    def whole(given: Given) -> list[Any]:
        return [given[n] if n in given else jnp.zeros(of.sizes[n], of.dtype) for n in taken]

    return bind(of, "crossed", [*x, *whole(first), *whole(second)], [*taken, *taken])[0]


def _crossed(*given: Any, of: Operator, kind: str, seeds: tuple[str, ...]) -> list[Any]:
    """`crossed` by a Hessian product for each result."""
    n, half = len(of.names), len(seeds) // 2
    x, first, second = given[:n], given[n : n + half], given[n + half :]

    def one(weights: Any) -> Any:
        changes = curved(of, x, weights, {s: a[None] for s, a in zip(seeds[:half], second, strict=True)})
        sums = [jnp.sum(a * changes[s][0], -1) for s, a in zip(seeds[:half], first, strict=True) if s in changes]
        return sum(sums, jnp.zeros(_batch(_operands(of, kind, seeds), [jnp.shape(a) for a in given]), of.dtype))

    return [jnp.moveaxis(jax.vmap(one)(jnp.eye(of.size, dtype=of.dtype)), 0, -1)]


# ---- derivatives of the primitives -----------------------------------------------------------------------------------


def _known(tangents: Mapping[str, Any]) -> dict[str, Any]:
    return {n: t for n, t in tangents.items() if type(t) is not ad.Zero}


def _each(f: Any, k: int, directed: Sequence[Any]) -> Any:
    """The results of f for each direction; they get the axis of directions in front."""
    if k == 1:
        return jax.tree.map(lambda a: a[None], f(*(a[0] for a in directed)))
    return jax.vmap(f)(*directed)


def _sum(of: Operator, parts: Sequence[Any]) -> Any:
    return functools.reduce(ad.add_tangents, parts)


def _jvp(kind: str, primals: Sequence[Any], tangents: Sequence[Any], *, of: Operator, seeds: tuple[str, ...]) -> Any:
    n = len(of.names)
    x, rest = list(primals[:n]), list(primals[n:])
    out = bind(of, kind, primals, seeds)
    dx, moved = _known(dict(zip(of.names, tangents[:n], strict=True))), list(tangents[n:])
    if kind in ("curved", "crossed") and dx:
        raise NotImplementedError(of.no_third())
    names = [of.derived.curving, *seeds] if kind == "curved" else list(seeds)
    changes: list[list[Any]] = []
    if kind == "value":
        changes += [[along(of, x, {m: t[None] for m, t in dx.items()})[0]]] if dx else []
    elif kind == "along":
        if dseeds := _known(dict(zip(names, moved, strict=True))):
            changes.append([along(of, x, dseeds)])
        if dx:
            k = out[0].shape[0]
            changes.append([_each(lambda *d: crossed(of, x, dict(zip(names, d, strict=True)), dx), k, rest)])
    elif kind == "against":
        if type(moved[0]) is not ad.Zero:
            changes.append(bind(of, kind, [*x, moved[0]]))
        if dx:

            def change(weights: Any) -> list[Any]:
                found = curved(of, x, weights, {m: t[None] for m, t in dx.items()})
                batch = _batch(_operands(of, "curved", ()), [jnp.shape(a) for a in [*x, weights]])
                return [
                    found[m][0] if m in found else jnp.zeros((*batch, of.sizes[m]), of.dtype) for m in _gives(of, kind)
                ]

            changes.append(list(_each(change, out[0].shape[0], rest)))
    else:
        changes += _by_linear_operands(of, kind, x, rest, moved, seeds)
    if not changes:
        return out, [ad.Zero(jax.typeof(o).to_tangent_aval()) for o in out]
    return out, [_sum(of, parts) for parts in zip(*changes, strict=True)]


def _by_linear_operands(
    of: Operator, kind: str, x: Sequence[Any], rest: list[Any], moved: list[Any], seeds: Sequence[str]
) -> list[list[Any]]:
    """Changes of `curved` or `crossed` along tangents of two groups of operands; the function is linear in either
    group."""
    split = 1 if kind == "curved" else len(rest) // 2
    found = []
    for begin, end in ((0, split), (split, len(rest))):
        group = moved[begin:end]
        if all(type(t) is ad.Zero for t in group):
            continue
        whole = [ad.instantiate_zeros(t) for t in group]
        found.append(bind(of, kind, [*x, *rest[:begin], *whole, *rest[end:]], seeds))
    return found


def _shaped_as(aval: Any, gradient: Any, lead: int) -> Any:
    """A gradient (..., *batch, n) summed over the batch if its operand is shared."""
    extra = gradient.ndim - len(aval.shape)
    return jnp.sum(gradient, axis=tuple(range(lead, lead + extra))) if extra else gradient


def _zero_or(aval: Any, gradient: Any, lead: int) -> Any:
    return ad.Zero(aval) if gradient is None else _shaped_as(aval, gradient, lead)


def _transpose(kind: str, cts: Sequence[Any], *operands: Any, of: Operator, seeds: tuple[str, ...]) -> Any:
    n = len(of.names)
    x, rest = list(operands[:n]), list(operands[n:])
    found: list[Any] = [None] * n
    if kind == "along":
        weights = ad.instantiate_zeros(cts[0])
        gradients = against(of, x, weights)
        return found + [
            _zero_or(a.aval, gradients.get(m), 1) if ad.is_undefined_primal(a) else None
            for m, a in zip(seeds, rest, strict=True)
        ]
    if kind == "against":
        known = _known(dict(zip(_gives(of, kind), cts, strict=True)))
        if not known:
            return [*found, ad.Zero(rest[0].aval)]
        return [*found, _shaped_as(rest[0].aval, along(of, x, known), 1)]
    if kind == "curved":
        known = _known(dict(zip(_gives(of, kind), cts, strict=True)))
        if ad.is_undefined_primal(rest[0]):
            k = rest[1].shape[0] if len(rest) > 1 else 1
            names = list(known)

            def one(*d: Any) -> Any:
                return crossed(of, x, dict(zip(seeds, d, strict=False)), dict(zip(names, d[len(seeds) :], strict=True)))

            sums = jnp.sum(_each(one, k, [*rest[1:], *known.values()]), 0) if known else None
            return [*found, _zero_or(rest[0].aval, sums, 0), *[None] * len(seeds)]
        gradients = curved(of, x, rest[0], known) if known else {}
        return [*found, None, *(_zero_or(a.aval, gradients.get(m), 1) for m, a in zip(seeds, rest[1:], strict=True))]
    half = len(rest) // 2
    first_is_linear = any(map(ad.is_undefined_primal, rest[:half]))
    linear, other = (rest[:half], rest[half:]) if first_is_linear else (rest[half:], rest[:half])
    weights = ad.instantiate_zeros(cts[0])
    gradients = curved(of, x, weights, {m: a[None] for m, a in zip(seeds[:half], other, strict=True)})
    turned = [
        _zero_or(a.aval, gradients[m][0] if m in gradients else None, 0) if ad.is_undefined_primal(a) else None
        for m, a in zip(seeds[:half], linear, strict=True)
    ]
    return [*found, *(turned + [None] * half if first_is_linear else [None] * half + turned)]


# ---- batches ---------------------------------------------------------------------------------------------------------


def _batched(kind: str, args: Sequence[Any], dims: Sequence[Any], *, of: Operator, seeds: tuple[str, ...]) -> Any:
    operands = _operands(of, kind, seeds)
    size = next(a.shape[d] for a, d in zip(args, dims, strict=True) if d is not None)
    moved = [a if d is None else jnp.moveaxis(a, d, 0) for a, d in zip(args, dims, strict=True)]
    mapped = [d is not None for d in dims]
    if not any(m and not along for m, (_, along) in zip(mapped, operands, strict=True)):
        return _more_directions(of, kind, moved, mapped, operands, size, seeds)
    own = [a.shape[1:] if m else a.shape for a, m in zip(moved, mapped, strict=True)]
    batch = _batch(operands, own)
    given = []
    for a, m, shape, (_, along) in zip(moved, mapped, own, operands, strict=True):
        shared = len(shape) == 1 + along
        if not m and shared:
            given.append(a)
            continue
        a = jnp.moveaxis(a, 0, 1) if m and along else a
        if not m:
            a = jnp.expand_dims(a, int(along))
        elif shared and batch:
            a = jnp.expand_dims(a, tuple(range(1 + along, 1 + along + len(batch))))
        given.append(jnp.broadcast_to(a, (*a.shape[:along], size, *batch, a.shape[-1])))
    out = bind(of, kind, given, seeds)
    return out, [int(kind in ("along", "against", "curved"))] * len(out)


def _more_directions(
    of: Operator, kind: str, moved: Sequence[Any], mapped: Sequence[bool], operands: Sequence[tuple[str, bool]], size: int,
    seeds: Sequence[str],
) -> Any:  # fmt: skip
    """A batch over seeds or weights alone: more directions of the same states."""
    given, k = [], 1
    for a, m, (_, along) in zip(moved, mapped, operands, strict=True):
        if along:
            a = a if m else jnp.broadcast_to(a[None], (size, *a.shape))
            k = a.shape[1]
            a = a.reshape(size * k, *a.shape[2:])
        given.append(a)
    out = bind(of, kind, given, seeds)
    return [o.reshape(size, k, *o.shape[1:]) for o in out], [0] * len(out)


# ---- lowering --------------------------------------------------------------------------------------------------------


def _lower(ctx: Any, *operands: Any, of: Operator, kind: str, seeds: tuple[str, ...]) -> Any:
    described, shapes = _operands(of, kind, seeds), [a.shape for a in ctx.avals_in]
    count, k = math.prod(_batch(described, shapes)), _directions(described, shapes)
    given = attributes(of, _function(of, kind), described, _results(of, kind), count, k)
    return jax.ffi.ffi_lowering(TARGET)(ctx, *operands, **given)


@functools.lru_cache(maxsize=1024)
def _compiled(kind: str, params: tuple[tuple[str, Any], ...]) -> Any:
    return jax.jit(functools.partial(PRIMITIVES[kind].bind, **dict(params)))


def _register(kind: str) -> None:
    primitive = PRIMITIVES[kind]
    primitive.def_impl(lambda *args, **params: _compiled(kind, tuple(params.items()))(*args))
    primitive.def_abstract_eval(_abstract)

    def jvp(primals: Any, tangents: Any, **params: Any) -> Any:
        return _jvp(primals=primals, tangents=tangents, **params)

    def transpose(cts: Any, *operands: Any, **params: Any) -> Any:
        return _transpose(params.pop("kind"), cts, *operands, **params)

    def batched(args: Any, dims: Any, **params: Any) -> Any:
        return _batched(args=args, dims=dims, **params)

    ad.primitive_jvps[primitive] = jvp
    batching.primitive_batchers[primitive] = batched
    if kind != "value":
        ad.primitive_transposes[primitive] = transpose
    if kind == "crossed":
        mlir.register_lowering(primitive, mlir.lower_fun(_crossed, multiple_results=True))
    else:
        mlir.register_lowering(primitive, _lower, platform="cpu")


for _kind in KINDS:
    _register(_kind)
