"""The short way of a call: plain arrays of one state, which the C finds and checks in the arrays' objects themselves."""

from __future__ import annotations

import functools
import sys
import threading
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .arrays import Shape
from .functions import Function
from .jacobians import JACOBIANS, Jacobians, jacobians_of

SHORT = (
    "accelerations", "sensitivities", "jacobians", "coordinate_rates", "coordinate_rate_sensitivities", "energies",
    "energy_sensitivities", "outputs", "output_sensitivities", "mass_matrix", "inverse_mass_matrix",
)  # fmt: skip
"""Functions that have a short way: those of a state and its seeds."""

OF_COORDINATES = ("mass_matrix", "inverse_mass_matrix")
"""Those that speeds do not enter: the C gets coordinates, parameters, and what prescribed motion depends on."""

ARRAY_HEAD = """\
typedef struct { char *data; int dimensions; intptr_t *shape, *strides; void *base, *type; int flags; } ordernm_array;
typedef struct { void *take, *function; intptr_t head; void *arrays, *doubles; double *x[32]; } ordernm_desk;
"""
"""The same stand in ``NAME_calls.c``: arrays as NumPy's C interface publishes them, and what a thread calls with."""


@functools.cache
def _head_of_objects() -> int:
    """Bytes of a Python object before what an array adds; 0 where arrays are not laid out as `ARRAY_HEAD` says."""
    if sys.implementation.name != "cpython":
        return 0
    from cffi import FFI

    ffi = FFI()
    ffi.cdef(ARRAY_HEAD)
    head = object.__basicsize__
    if np.ndarray.__basicsize__ < head + ffi.sizeof("ordernm_array"):
        return 0
    for x in (np.zeros(3), np.zeros((2, 5)), np.zeros((4, 6))[1:, ::2], np.zeros((3, 2)).T, np.zeros(0)):
        x.flags.writeable = x.ndim == 2
        seen = ffi.cast("ordernm_array *", id(x) + head)
        if (
            ffi.cast("void **", id(x) + head)[-1] != ffi.cast("void *", id(np.ndarray))
            or seen.dimensions != x.ndim
            or int(ffi.cast("intptr_t", seen.data)) != x.__array_interface__["data"][0]
            or any(seen.shape[i] != x.shape[i] or seen.strides[i] != x.strides[i] for i in range(x.ndim))
            or seen.type != ffi.cast("void *", id(x.dtype))
            or seen.flags != x.flags.num
        ):
            return 0
    return head


class Desk(threading.local):
    """What one thread calls the functions of a target with: the short way of a function is the attribute of its name.

    It takes the arguments of the solver's member, and returns the results, or None if they are not plain arrays of one valid
    state. Then the long way takes them, and tells what is wrong.

    Parameters
    ----------
    target : CTarget
    """

    def __init__(self, target: Any):
        self.target = target
        self.kept: list[Any] = []
        for name in SHORT:
            setattr(self, name, functools.partial(self._first, name))

    def _first(self, name: str, *arguments: Any) -> Any:
        """The first call of a thread."""
        f, head = self.target.functions.get(name), _head_of_objects()
        way = self._short_way(f, head) if f is not None and head else no_short_way
        setattr(self, name, way)
        return way(*arguments)

    @functools.cached_property
    def work(self) -> Any:
        """This thread's workspace."""
        return self.target.pointer(np.empty(self.target.workspace))

    def _short_way(self, f: Function, head: int) -> Callable[..., Any]:
        """What calls a function with what the C needs beside the arguments."""
        target, ffi = self.target, self.target.ffi
        desk = ffi.new("ordernm_desk *")
        desk.head = head
        desk.arrays, desk.doubles = (ffi.cast("void *", id(x)) for x in (np.ndarray, np.dtype(np.float64)))
        unasked = np.empty(f.shapes[0])  # udot beside its Jacobians
        x, kept = target.table(f, {}, [unasked], self.work)
        ffi.memmove(desk.x, x, ffi.sizeof("double *") * len(x))
        self.kept.append(kept)
        if f.seeds:
            return _short_along(target.take("along", f, desk), desk, f.shapes[0], f.shapes[1])
        if f.name == "jacobians":
            return _short_jacobians(target.take("matrices", f, desk), desk, target.shapes, f.results[1:])
        speeds = left_out if f.name in OF_COORDINATES else id
        return _short_values(target.take("values", f, desk), desk, f.shapes[0], speeds)


def no_short_way(*arguments: Any) -> None:
    """Leaves every call to the long way."""
    return None


NO_DESK = types.SimpleNamespace(**dict.fromkeys(SHORT, no_short_way))
"""Stands for `Desk` where there is no short way."""


def left_out(u: Any) -> int:
    """What the C gets for an argument that is left out."""
    return 0


def _short_values(
    call: Callable[..., int], desk: Any, shape: Shape, speeds: Callable[[Any], int]
) -> Callable[..., Any]:
    """The short way of a function without directions; `speeds` makes of u what the C gets: where it is, or 0."""
    empty, ndarray = np.empty, np.ndarray

    def short(q: Any, u: Any, p: Any, inputs: Any, t: Any, out: Any = None) -> Any:
        if type(t) is not float and not isinstance(t, float):
            return None
        if out is None:
            result = empty(shape)
        elif type(out) is ndarray and out.shape == shape:
            result = out
        else:
            return None
        p = 0 if p is None else id(p)
        inputs = 0 if inputs is None else id(inputs)
        return None if call(desk, id(q), speeds(u), p, inputs, t, id(result)) else result

    return short


def _short_jacobians(
    call: Callable[..., int], desk: Any, shapes: Mapping[str, Shape], computed: Sequence[str]
) -> Callable[..., Any]:
    """The short way of `Solver.jacobians`; matrices that are not computed are zero."""
    names = [f"J_{n}" for n in JACOBIANS]
    new_q, new_u, new_p, new_inputs, new_t = (np.empty if n in computed else np.zeros for n in names)
    q_shape, u_shape, p_shape, inputs_shape, t_shape = (shapes[n] for n in names)
    new = {n: (np.empty if f"J_{n}" in computed else np.zeros, shapes[f"J_{n}"]) for n in JACOBIANS}

    def some(q: int, u: int, p: int, inputs: int, t: float, asked: tuple[str, ...]) -> Any:
        """Some of the matrices, no others."""
        found = {n: new[n][0](new[n][1]) for n in asked}
        status = call(desk, q, u, p, inputs, t, *(id(found[n]) if n in found else 0 for n in JACOBIANS))
        return None if status else jacobians_of(found)

    def short(q: Any, u: Any, p: Any, inputs: Any, t: Any, out: Any = None, asked: tuple[str, ...] = JACOBIANS) -> Any:
        if out is not None or (type(t) is not float and not isinstance(t, float)):
            return None
        if asked is not JACOBIANS:
            return some(id(q), id(u), 0 if p is None else id(p), 0 if inputs is None else id(inputs), t, asked)
        J_q, J_u, J_p = new_q(q_shape), new_u(u_shape), new_p(p_shape)
        J_inputs, J_t = new_inputs(inputs_shape), new_t(t_shape)
        p = 0 if p is None else id(p)
        inputs = 0 if inputs is None else id(inputs)
        status = call(
            desk, id(q), id(u), p, inputs, t, id(J_q), id(J_u), id(J_p), id(J_inputs), id(J_t)
        )  # fmt: skip
        return None if status else Jacobians(J_q, J_u, J_p, J_inputs, J_t)

    return short


def _short_along(call: Callable[..., int], desk: Any, value_shape: Shape, derived_shape: Shape) -> Callable[..., Any]:
    """The short way of a function over directions."""
    empty, ndarray, array = np.empty, np.ndarray, np.array

    def short(q: Any, u: Any, p: Any, inputs: Any, t: Any, seeds: Any, out: Any = None) -> Any:
        if type(t) is not float and not isinstance(t, float):
            return None
        dq, du, dp, dinputs, dt = seeds
        if type(dt) is float:
            dt = array([dt])
        first = dq
        if first is None:
            first = du if du is not None else dp if dp is not None else dinputs if dinputs is not None else dt
        if type(first) is not ndarray:
            return None
        axes = first.ndim
        if axes == 2 or (axes == 1 and first is dt):
            k = len(first)
        elif axes == 1:
            k = 1
        else:
            return None
        if out is None:
            value, derivative = empty(value_shape), empty((k, *derived_shape))
        else:
            if not (isinstance(out, (tuple, list)) and len(out) == 2 and all(type(x) is ndarray for x in out)):
                return None
            value, derivative = out
            if value.shape != value_shape or derivative.shape != (k, *derived_shape):
                return None
            if np.may_share_memory(value, derivative):
                return None
        status = call(
            desk, id(q), id(u), 0 if p is None else id(p), 0 if inputs is None else id(inputs), t, k,
            0 if dq is None else id(dq), 0 if du is None else id(du), 0 if dp is None else id(dp),
            0 if dinputs is None else id(dinputs), 0 if dt is None else id(dt), id(value), id(derivative),
        )  # fmt: skip
        return None if status else (value, derivative)

    return short
