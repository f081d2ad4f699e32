"""Functions of autograd for motions: results, derivatives along directions, and gradients of weighted sums."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor


def _tensor(x: Any) -> Tensor:
    return torch.tensor(x, dtype=torch.float64)


def _numbers(x: Tensor) -> Any:
    return x.detach().resolve_neg().numpy()


def _keep(ctx: Any, inputs: Any, output: Any) -> None:
    """Keeps x, for which derivatives may be needed, and the motion."""
    ctx.save_for_backward(inputs[0])
    ctx.save_for_forward(inputs[0])
    ctx.motion, ctx.count = inputs[-1], len(inputs) - 2


def _no_second(ctx: Any, tangent: Any) -> None:
    if tangent is not None:
        raise NotImplementedError(ctx.motion.no_second())


def _by_x(ctx: Any) -> None:
    if ctx.needs_input_grad[0]:
        raise NotImplementedError(ctx.motion.no_second())


class Value(torch.autograd.Function):
    """The results of a motion."""

    setup_context = staticmethod(_keep)

    @staticmethod
    def forward(x: Any, motion: Any) -> Any:
        return tuple(_tensor(y) for y in motion.values(_numbers(x), ahead=x.requires_grad))

    @staticmethod
    def backward(ctx: Any, *weights: Any) -> Any:
        return Pulled.apply(*ctx.saved_tensors, *weights, ctx.motion), None

    @staticmethod
    def jvp(ctx: Any, tangent: Any, _: Any) -> Any:
        return Pushed.apply(*ctx.saved_tensors, tangent, ctx.motion)

    @staticmethod
    def vmap(info: Any, dims: Any, x: Any, motion: Any) -> Any:
        return _one_by_one(Value, info, dims, x, (), motion)


class Pushed(torch.autograd.Function):
    """The derivatives of the results along directions (*batch, k)."""

    setup_context = staticmethod(_keep)

    @staticmethod
    def forward(x: Any, v: Any, motion: Any) -> Any:
        return tuple(_tensor(y) for y in motion.pushed(_numbers(x), _numbers(v)))

    @staticmethod
    def backward(ctx: Any, *weights: Any) -> Any:
        _by_x(ctx)
        return None, Pulled.apply(*ctx.saved_tensors, *weights, ctx.motion), None

    @staticmethod
    def jvp(ctx: Any, x: Any, v: Any, _: Any) -> Any:
        _no_second(ctx, x)
        return Pushed.apply(*ctx.saved_tensors, v, ctx.motion)

    @staticmethod
    def vmap(info: Any, dims: Any, x: Any, v: Any, motion: Any) -> Any:
        return _together(Pushed, info, dims, x, (v,), motion)


class Pulled(torch.autograd.Function):
    """The gradients (*batch, k) of weighted sums of the results."""

    setup_context = staticmethod(_keep)

    @staticmethod
    def forward(x: Any, *rest: Any) -> Any:
        *weights, motion = rest
        return _tensor(motion.pulled(_numbers(x), [_numbers(w) for w in weights]))

    @staticmethod
    def backward(ctx: Any, direction: Any) -> Any:
        _by_x(ctx)
        return None, *Pushed.apply(*ctx.saved_tensors, direction, ctx.motion), None

    @staticmethod
    def jvp(ctx: Any, x: Any, *weights: Any) -> Any:
        _no_second(ctx, x)
        return Pulled.apply(*ctx.saved_tensors, *weights[:-1], ctx.motion)

    @staticmethod
    def vmap(info: Any, dims: Any, x: Any, *rest: Any) -> Any:
        return _together(Pulled, info, dims, x, rest[:-1], rest[-1])


def _together(operation: Any, info: Any, dims: Any, x: Any, linear: Sequence[Any], motion: Any) -> Any:
    """Directions or weights of one motion are processed in one call."""
    if dims[0] is not None:
        return _one_by_one(operation, info, dims, x, linear, motion)
    whole = [y.expand(info.batch_size, *y.shape) if d is None else y.movedim(d, 0)
             for y, d in zip(linear, dims[1:], strict=False)]  # fmt: skip
    found = operation.apply(x, *whole, motion)
    return found, (0,) * len(found) if isinstance(found, tuple) else 0


def _one_by_one(operation: Any, info: Any, dims: Any, x: Any, linear: Sequence[Any], motion: Any) -> Any:
    """Motions run one after another."""
    every = [(y, d) for y, d in zip((x, *linear), dims, strict=False)]
    found = [operation.apply(*(y if d is None else y.select(d, i) for y, d in every), motion)
             for i in range(info.batch_size)]  # fmt: skip
    if isinstance(found[0], tuple):
        return tuple(torch.stack(part) for part in zip(*found, strict=True)), (0,) * len(found[0])
    return torch.stack(found), 0
