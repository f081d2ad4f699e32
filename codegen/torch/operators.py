"""Operators of ``torch.library`` for all solvers: values, products with Jacobian and transpose, and Hessian products.

Each operator takes seven arguments: q, u, p, inputs, t, one more array (udot or b; empty for functions without it), and
the key of an `Operator`. Leading axes broadcast. Gradients have the shapes of the arguments.
"""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..operators import Operator
from ..runtime.standalone.calls.functions import Wanted
from ..runtime.standalone.state.derivatives import CURVED

ARGUMENTS = 6
EVERY = 2**ARGUMENTS - 1
"""The bits that request the gradients with respect to all arguments."""

PLAIN = (Tensor, torch.nn.Parameter)
"""Types of tensors with numbers."""

_known: weakref.WeakValueDictionary[str, Operator] = weakref.WeakValueDictionary()
_numbers = itertools.count()


def key_of(operator: Operator) -> str:
    """The key by which PyTorch's programs name an operator."""
    if operator.key is None:
        operator.key = f"{operator.solver.name}.{operator.name}.{next(_numbers)}"
        _known[operator.key] = operator
    return operator.key


def operator_of(key: str) -> Operator:
    """The operator with a key."""
    found = _known.get(key)
    if found is None:
        raise RuntimeError(f"{key}: this program belongs to a solver that is not loaded in this process")
    return found


# ---- shapes ----------------------------------------------------------------------------------------------------------


def defaults_of(of: Operator) -> dict[str, Tensor]:
    """Default tensors of the arguments, the same objects in every call: `_given` recognises them by identity."""
    if of.tensors is None:
        kind = getattr(torch, str(of.dtype))
        of.tensors = {n: torch.tensor(x, dtype=kind) for n, x in of.defaults.items()}
        of.tensors["t"] = torch.zeros((), dtype=kind)
    return dict(of.tensors)


def lead(of: Operator, x: Sequence[Tensor]) -> tuple[Any, ...]:
    """The batch shape of arguments."""
    names = of.six
    shapes = [a.shape if n == "t" else a.shape[:-1] for n, a in zip(names, x, strict=True) if n in of.takes]
    return tuple(torch.broadcast_shapes(*shapes))


def _summed(gradient: Any, like: Tensor) -> Tensor:
    """A gradient (*batch, n), summed over the axes along which an argument was broadcast."""
    found = torch.from_numpy(np.ascontiguousarray(gradient))
    return found.sum_to_size(like.shape).contiguous() if found.shape != like.shape else found


# ---- the solver's methods --------------------------------------------------------------------------------------------


def _array(x: Tensor) -> Any:
    """The numbers of a tensor, without a copy if its memory holds them."""
    x = x.detach() if x.requires_grad else x
    return (x.resolve_neg() if x.is_neg() else x).numpy()


def _given(of: Operator, x: Sequence[Tensor]) -> tuple[Any, ...]:
    """Arguments as the solver takes them."""
    found: list[Any] = []
    defaults = of.tensors or {}
    for n, a in zip(of.six, x, strict=True):
        if not n:
            continue
        if n == "t":
            found.append(0.0 if a is defaults.get("t") or n not in of.takes else _array(a) if a.ndim else a.item())
        elif a is defaults.get(n) and n in ("p", "inputs"):
            found.append(None)
        else:
            found.append(_array(a) if n in of.takes and (of.sizes[n] or a.ndim > 1) else None)
    return tuple(found)


def _seeds(of: Operator, batch: tuple[int, ...], seeds: Sequence[Tensor | None]) -> tuple[Any, ...]:
    """One direction of each argument as the solver takes it."""
    found: list[Any] = []
    for n, s in zip(of.six, seeds, strict=True):
        if not n:
            continue
        if s is None or n not in of.takes or (n != "t" and not of.sizes[n]):
            found.append(None)
            continue
        axes = len(batch) + (n != "t")
        found.append(_array(s).reshape((1,) + (1,) * (axes - s.ndim) + tuple(s.shape)))
    return tuple(found)


def _along(of: Operator, x: Sequence[Tensor], seeds: Sequence[Tensor | None]) -> Any:
    batch = lead(of, x)
    turned = _seeds(of, batch, seeds)
    if all(s is None for s in turned):
        return np.zeros((*batch, *of.shape), of.dtype)
    return of.runs._call(of.derived.along, _given(of, x), turned)[1][0]


def _against(of: Operator, x: Sequence[Tensor], weights: Tensor, needed: int) -> list[Any]:
    """Gradients (1, *batch, n) with respect to each argument in `needed`; None for the other arguments."""
    w = _array(weights.contiguous())
    asked = [n for i, n in enumerate(of.six) if needed >> i & 1 and n in of.takes and of.sizes[n]]
    if of.has(of.derived.against):
        if needed not in of.wanted:
            of.wanted[needed] = Wanted(of.derived.against, [f"d{n}" for n in asked])
        by = dict(zip(asked, of.runs._call(of.wanted[needed], _given(of, x), (w[None],)), strict=True)) if asked else {}
        return [by.get(n) for n in of.six]
    names = asked
    sizes = [of.sizes[n] for n in names]
    units, batch = np.eye(sum(sizes), dtype=of.dtype), lead(of, x)
    parts, start = {}, 0
    for n, m in zip(names, sizes, strict=True):
        part = units[:, start : start + m].reshape(len(units), *(1,) * len(batch), m)
        parts[n], start = part[..., 0] if n == "t" else part, start + m
    seeds = tuple([parts.get(n) for n in of.six if n])
    whole = of.runs._call(of.derived.along, _given(of, x), seeds)[1]
    axes = tuple(range(-len(of.shape), 0))
    sums = np.moveaxis((whole * w).sum(axes), 0, -1)
    found, start = {}, 0
    for n, m in zip(names, sizes, strict=True):
        part = sums[..., start : start + m]
        found[n], start = (part[..., 0] if n == "t" else part)[None], start + m
    return [found.get(n) for n in of.six]


def _gradients(x: Sequence[Tensor], found: Sequence[Any]) -> tuple[Tensor, ...]:
    """Gradients with the shapes of the arguments, contiguous."""
    made = []
    for a, g in zip(x, found, strict=True):
        made.append(a.new_zeros(a.shape) if g is None or not a.numel() else _summed(g[0], a))
    return tuple(made)


# ---- the operators ---------------------------------------------------------------------------------------------------

SIX = "Tensor q, Tensor u, Tensor p, Tensor inputs, Tensor t, Tensor other"
SEEDS = "Tensor? dq, Tensor? du, Tensor? dp, Tensor? dinputs, Tensor? dt, Tensor? dother"
GRADIENT = "(Tensor, Tensor, Tensor, Tensor, Tensor, Tensor)"


def _value(*given: Any) -> Tensor:
    of = operator_of(given[-1])
    return computed(of, _given(of, given[:6]))


def _directional(*given: Any) -> Tensor:
    of = operator_of(given[-1])
    return torch.from_numpy(np.ascontiguousarray(_along(of, given[:6], given[6:12])))


def _weighted(*given: Any) -> tuple[Tensor, ...]:
    of = operator_of(given[-1])
    return _gradients(given[:6], _against(of, given[:6], *given[6:8]))


def _curved(*given: Any) -> tuple[Tensor, ...]:
    of = operator_of(given[-1])
    x, weights, seeds = given[:6], given[6], given[7:13]
    if not of.has(of.derived.curved):
        raise NotImplementedError(of.no_curvature())
    turned = _seeds(of, lead(of, x), seeds)
    if all(s is None for s in turned):
        return _gradients(x, [None] * ARGUMENTS)
    wanted = CURVED[of.name].wanted
    found = of.runs._call(wanted, (*_given(of, x), _array(weights)), turned)
    by = dict(zip(wanted.returned, found, strict=True))
    return _gradients(x, [by.get(f"dg{n}") for n in of.six])


def _value_fake(*given: Any) -> Tensor:
    of = operator_of(given[-1])
    x = given[:6]
    return x[0].new_empty((*lead(of, x), *of.shape))


def _gradients_fake(*given: Any) -> tuple[Tensor, ...]:
    return tuple(torch.empty_like(a, memory_format=torch.contiguous_format) for a in given[:6])


def _made(name: str, signature: str, run: Callable[..., Any], fake: Callable[..., Any]) -> Any:
    schema = f"({signature}, str key) -> {'Tensor' if fake is _value_fake else GRADIENT}"
    made = torch.library.custom_op(f"ordernm::{name}", run, mutates_args=(), schema=schema, device_types="cpu")
    made.register_fake(fake)
    return made


value = _made("value", SIX, _value, _value_fake)
along = _made("along", f"{SIX}, {SEEDS}", _directional, _value_fake)
against = _made("against", f"{SIX}, Tensor weights, int needed", _weighted, _gradients_fake)
curved = _made("curved", f"{SIX}, Tensor weights, {SEEDS}", _curved, _gradients_fake)


# ---- derivatives: functions of autograd around the operators, since torch.func does not enter operators ---------------


def _keep(ctx: Any, inputs: Any, output: Any) -> None:
    """Keeps all operands for derivatives."""
    ctx.save_for_backward(*inputs[:-1])
    ctx.save_for_forward(*inputs[:-1])
    ctx.key = inputs[-1]
    ctx.set_materialize_grads(False)


class Value(torch.autograd.Function):
    """The value of a function."""

    setup_context = staticmethod(_keep)

    @staticmethod
    def forward(*given: Any) -> Any:
        return _value(*given) if plain(given) else value(*given)

    @staticmethod
    def backward(ctx: Any, weights: Any) -> Any:
        if weights is None:
            return (None,) * 7
        return (*pulled(*ctx.saved_tensors, weights, _bits(ctx.needs_input_grad[:6]), ctx.key), None)

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Any:
        return Along.apply(*ctx.saved_tensors, *tangents[:6], ctx.key)

    @staticmethod
    def vmap(info: Any, dims: Any, *given: Any) -> Any:
        return _mapped(Value.apply, info, dims, given)


class Along(torch.autograd.Function):
    """The derivative of the function along one direction."""

    setup_context = staticmethod(_keep)

    @staticmethod
    def forward(*given: Any) -> Any:
        return _directional(*given) if plain(given) else along(*given)

    @staticmethod
    def backward(ctx: Any, weights: Any) -> Any:
        if weights is None:
            return (None,) * 13
        x, seeds = ctx.saved_tensors[:6], ctx.saved_tensors[6:]
        second, first = _none(6), _none(6)
        if any(ctx.needs_input_grad[:6]):
            second = Curved.apply(*x, weights, *seeds, ctx.key)
        if any(ctx.needs_input_grad[6:12]):
            first = Against.apply(*x, weights, _bits(ctx.needs_input_grad[6:12]), ctx.key)
        return (*second, *(g if s is not None else None for g, s in zip(first, seeds, strict=True)), None)

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Any:
        of = operator_of(ctx.key)
        if any(t is not None for t in tangents[:6]):
            raise NotImplementedError(
                f"{of.name} of {of.solver.name}: no forward mode over forward mode; torch.func.hessian is forward mode "
                "over reverse mode"
            )
        return Along.apply(*ctx.saved_tensors[:6], *tangents[6:12], ctx.key)

    @staticmethod
    def vmap(info: Any, dims: Any, *given: Any) -> Any:
        return _mapped(Along.apply, info, dims, given, seeds=True)


class Against(torch.autograd.Function):
    """The gradients of a weighted sum of results; those that are not needed are zero."""

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        _keep(ctx, (*inputs[:-2], inputs[-1]), output)
        ctx.needed = inputs[-2]

    @staticmethod
    def forward(*given: Any) -> Any:
        return _weighted(*given) if plain((*given[:-2], given[-1])) else against(*given)

    @staticmethod
    def backward(ctx: Any, *seeds: Any) -> Any:
        x, weights = ctx.saved_tensors[:6], ctx.saved_tensors[6]
        seeds = tuple([s if ctx.needed >> i & 1 else None for i, s in enumerate(seeds)])
        second, first = _none(6), None
        if all(s is None for s in seeds):
            return _none(9)
        if any(ctx.needs_input_grad[:6]):
            second = Curved.apply(*x, weights, *seeds, ctx.key)
        if ctx.needs_input_grad[6]:
            first = Along.apply(*x, *seeds, ctx.key)
        return (*second, first, None, None)

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Any:
        x, weights = ctx.saved_tensors[:6], ctx.saved_tensors[6]
        parts = []
        if any(t is not None for t in tangents[:6]):
            parts.append(Curved.apply(*x, weights, *tangents[:6], ctx.key))
        if tangents[6] is not None:
            parts.append(Against.apply(*x, tangents[6], ctx.needed, ctx.key))
        return tuple(sum(each[1:], each[0]) for each in zip(*parts, strict=True))

    @staticmethod
    def vmap(info: Any, dims: Any, *given: Any) -> Any:
        def run(*x: Any) -> Any:
            return Against.apply(*x[:-1], given[-2], x[-1])

        return _mapped(run, info, (*dims[:-2], None), (*given[:-2], given[-1]), weights=True)


class Curved(torch.autograd.Function):
    """The changes of the gradients of `Against` along one direction."""

    setup_context = staticmethod(_keep)

    @staticmethod
    def forward(*given: Any) -> Any:
        return _curved(*given) if plain(given) else curved(*given)

    @staticmethod
    def backward(ctx: Any, *seeds: Any) -> Any:
        raise NotImplementedError(operator_of(ctx.key).no_third())

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Any:
        raise NotImplementedError(operator_of(ctx.key).no_third())

    @staticmethod
    def vmap(info: Any, dims: Any, *given: Any) -> Any:
        return _mapped(Curved.apply, info, dims, given, weights=True, seeds=True)


def _keep_compiled(ctx: Any, inputs: Any, output: Any) -> None:
    ctx.save_for_backward(*inputs[:-1])
    ctx.key = inputs[-1]


def _backward_compiled(ctx: Any, weights: Any) -> Any:
    """Gradients in compiled programs, which hold the operators themselves."""
    return (*against(*ctx.saved_tensors, weights, _bits(ctx.needs_input_grad[:6]), ctx.key), None)


value.register_autograd(_backward_compiled, setup_context=_keep_compiled)


def plain(given: Sequence[Any]) -> bool:
    """Whether no program records this call. The call then runs without an operator, which would take 0.1 ms."""
    of_program = torch.compiler.is_compiling() or torch._C._len_torch_dispatch_stack()
    return not of_program and all(x is None or type(x) in PLAIN for x in given[:-1])


def direct(of: Operator, arguments: Sequence[Any]) -> list[Any] | None:
    """The arrays of tensors for the solver; None if the call needs a conversion, or something records or differentiates it."""
    if torch.compiler.is_compiling() or torch._C._len_torch_dispatch_stack() or _transformed():
        return None
    arrays = []
    try:
        for a in arguments:
            if type(a) is not Tensor or a.requires_grad:
                return None
            arrays.append(x := a.numpy())  # refused for negated numbers and other devices
            if x.dtype is not of.dtype:
                return None
    except (RuntimeError, TypeError):
        return None
    return arrays


def computed(of: Operator, arrays: tuple[Any, ...]) -> Tensor:
    """The solver's result as a tensor."""
    return torch.from_numpy(np.ascontiguousarray(of.runs._call(of.name, arrays)[0]))


def called(*given: Any) -> Any:
    """The function as autograd sees it."""
    if torch.compiler.is_compiling():
        return value(*given)
    if not _differentiated(given) and plain(given):
        return _value(*given)
    return Value.apply(*given)


def pulled(*given: Any) -> Any:
    """The gradients as autograd sees them."""
    tensors = (*given[:-2], given[-1])
    if not torch.compiler.is_compiling() and not _differentiated(tensors) and plain(tensors):
        return _weighted(*given)
    return Against.apply(*given)


def _differentiated(given: Sequence[Any]) -> bool:
    """Whether a transformation or autograd may see a call. If not, the call skips autograd and saves 0.05 ms."""
    if _transformed():
        return True
    return torch.is_grad_enabled() and any(x.requires_grad for x in given[:-1])


def _transformed() -> bool:
    """Whether a transformation of torch.func or forward mode is active."""
    return torch._C._are_functorch_transforms_active() or torch.autograd.forward_ad._current_level >= 0


def _bits(needed: Sequence[bool]) -> int:
    return sum(1 << i for i, x in enumerate(needed) if x)


def _none(n: int) -> tuple[Any, ...]:
    return (None,) * n


# ---- vmap ------------------------------------------------------------------------------------------------------------


def _front(x: Tensor, dim: int | None, size: int, entries: int, axes: int) -> Tensor:
    """An operand whose first axis is that of vmap, then `axes` batch axes, then its entries."""
    x = x.expand(size, *x.shape) if dim is None else x.movedim(dim, 0)
    missing = axes - (x.ndim - 1 - entries)
    return x.reshape(size, *(1,) * missing, *x.shape[1:])


def _mapped(
    operation: Any, info: Any, dims: Sequence[Any], given: Sequence[Any], weights: bool = False, seeds: bool = False
) -> Any:
    """Runs an operation with the axis of vmap as the first batch axis; results with weights are gradients."""
    of, size = operator_of(given[-1]), info.batch_size
    entries = [0 if n == "t" else 1 for n in of.six]
    every = entries + [len(of.shape)] * weights + entries * seeds
    operands = [*zip(given[:-1], dims[:-1], every, strict=True)]
    axes = max(x.ndim - (d is not None) - e for x, d, e in operands if x is not None)
    moved = [None if x is None else _front(x, d, size, e, axes) for x, d, e in operands]
    found = operation(*moved, given[-1])
    if not weights:
        return found, 0
    shapes = [x.shape if d is None else x.movedim(d, 0).shape[1:] for x, d, _ in operands[:6]]
    return tuple(g.reshape(size, *s) for g, s in zip(found, shapes, strict=True)), (0,) * ARGUMENTS
