"""Small batches: the call of one state, state after state in C.

Checks and arrays of a large batch take as long as some tens of calls; here a batch costs little more than its calls.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from .functions import Function, Wanted
from .results import empty, put
from .single_calls import ARRAY, LISTS, SLOT, CallMemory, PreparedCall, SingleCalls, fits

FEW, FEW_ALONG = 96, 32
"""States; with more, a large batch takes less time, along directions sooner."""

MOVED = "typedef struct {{ {0} *at, *of; long size, rows, state, row, result; }} moved;"
"""What goes from states to a call, or from a call to results, as ``NAME_calls.c`` declares it."""

EACH = "int {}_call_each(void *, {} **, long, double *, long, long, long, moved *, long);"

Moved = tuple[Any, Any, int, int, int, int, int]


class FewStates:
    """Calls a target's functions with a few states.

    Parameters
    ----------
    target : CTarget
    single_calls : SingleCalls
        Of the target, with the memory of calls.
    """

    def __init__(self, target: Any, single_calls: SingleCalls):
        self.target, self.single_calls = target, single_calls
        self.declared: dict[str, tuple[Any, Any]] = {}
        self.declaring = threading.Lock()

    def run(
        self,
        wanted: str | Wanted,
        given: Sequence[Any],
        seeds: Sequence[Any] | None = None,
        out: Any = None,
    ) -> Sequence[Array] | None:
        """Results of a function, (n, ...), and derivatives (k, n, ...); see `SingleCalls.run`.

        Returns
        -------
        sequence of arrays, or None
            None unless the arguments are plain arrays of a few valid states along one axis, and the results finite.
        """
        n = max((len(x) for x in given if type(x) is ARRAY and x.ndim == 2), default=0)
        if not 0 < n <= (FEW if seeds is None else FEW_ALONG):
            return None
        memory = self.single_calls.take()
        try:
            call = memory.get(wanted) or memory.setdefault(wanted, memory.prepare(wanted))
            return self._each(call, memory, n, given, seeds, out)
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError):  # other types and shapes
            return None
        finally:
            self.single_calls.free.append(memory)

    def _each(
        self,
        call: PreparedCall,
        memory: CallMemory,
        n: int,
        given: Sequence[Any],
        seeds: Sequence[Any] | None,
        out: Any,
    ) -> Sequence[Array] | None:
        bits, moved, kept = self._arguments(call, memory, n, given)
        if seeds is not None:
            bits |= self._directions(call, n, seeds, moved, kept)
        t = given[4]
        several = type(t) is ARRAY and t.shape == (n,)
        times = np.ascontiguousarray(t, np.float64) if several else np.array([float(t)])
        f = call.f
        found = []
        for r, x in zip(call.returned, call.results, strict=True):
            i = f.results.index(r) if r in f.results else -1  # which is zero
            along = f.derived[i] if i >= 0 else seeds is not None
            shape = x.shape[1:] if along else x.shape
            size, rows = math.prod(shape), len(x) if along else 1
            found.append(empty((rows, n, *shape) if along else (n, *shape), self.target.dtype))
            if i < 0:
                found[-1][...] = 0.0
                continue
            at = call.x[SLOT["results"] + i]
            moved.append((at, self.target.pointer(found[-1]), size, rows, size, n * size, 1))
        if seeds is None and type(out) is ARRAY:
            out = (out,)
        if out is not None and not (type(out) in LISTS and fits(out, found)):
            return None
        each, function = self._function(f)
        moves = self.target.ffi.new("moved[]", moved)
        if each(
            function,
            call.x,
            bits,
            self.target.ffi.from_buffer("double[]", times),
            int(several),
            call.k,
            n,
            moves,
            len(moved),
        ):
            return None
        return tuple(found) if out is None else put(found, out)

    def _arguments(
        self, call: PreparedCall, memory: CallMemory, n: int, given: Sequence[Any]
    ) -> tuple[int, list[Moved], list[Any]]:
        """The bits of arguments that are given, those that go to each call, and arrays to keep; shared ones are copied."""
        bits = optional = 0
        moved: list[Moved] = []
        kept = []
        for name, x in zip(call.f.order, given, strict=True):
            if x is None or name == "t":
                continue
            if name in ("p", "inputs"):  # which have defaults
                optional |= 1 << SLOT[name]
            else:
                bits |= 1 << SLOT[name]
            size = len(memory.arguments[name])
            if type(x) is not ARRAY or x.dtype != self.target.dtype:
                raise TypeError
            if x.shape == (n, size):
                kept.append(np.ascontiguousarray(x))
                moved.append((memory.pointers[name], self.target.pointer(kept[-1]), size, 1, size, 0, 0))
            else:
                memory.arguments[name][:] = x
        if bits != call.needed:
            raise ValueError
        return bits | optional, moved, kept

    def _directions(self, call: PreparedCall, n: int, seeds: Sequence[Any], moved: list[Moved], kept: list[Any]) -> int:
        """The bits of seeds that are given; those of each state are added to what is moved."""
        bits, k = 0, 0
        for x in seeds:
            if x is not None:
                k = len(x)
                if k != call.k and not call.fit(k):
                    raise ValueError
        for s, (bit, _, rows, shape), x in zip(call.f.directions, call.seeds, seeds, strict=True):
            if x is None:
                continue
            if type(x) is not ARRAY or x.dtype != self.target.dtype or len(x) != k:
                raise TypeError
            bits |= bit
            if x.shape == shape:
                rows[...] = x
            elif x.shape == (k, 1, *shape[1:]):
                rows[...] = x[:, 0]
            elif x.shape == (k, n, *shape[1:]):
                size = math.prod(shape[1:])
                kept.append(np.ascontiguousarray(x))
                moved.append((call.x[SLOT[s]], self.target.pointer(kept[-1]), size, k, size, n * size, 0))
            else:
                raise ValueError
        if not k:
            raise ValueError
        return bits

    def _function(self, f: Function) -> tuple[Any, Any]:
        """What calls a function for state after state, and the function."""
        if f.name not in self.declared:
            ffi, target = self.target.ffi, self.target
            with self.declaring:
                if not self.declared:
                    ffi.cdef(MOVED.format(target.real))
                    ffi.cdef(EACH.format(target.model, target.real))
                each = getattr(target.library_of(f.name), f"{target.model}_call_each")
                self.declared[f.name] = each, ffi.cast("void *", target.function(f))
        return self.declared[f.name]
