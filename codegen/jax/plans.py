"""Plans of compiled functions for XLA: ``handler.c`` is compiled once per version of JAX, and computes what a plan describes."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import threading
from pathlib import Path
from typing import Any

import numpy as np

from ..operators import Operator
from ..runtime.standalone.calls.single_calls import SLOT
from ..runtime.standalone.errors import NoCompilerError
from ..runtime.standalone.files.build import Build, short_key
from ..runtime.standalone.files.compiler import STANDARD, compiler_version
from ..runtime.standalone.files.user_cache import user_cache

TARGET = "ordernm_call"
"""Name of the handler in XLA."""

HANDLER = Path(__file__).with_name("handler.c")

PLAN = """
typedef struct { long slot, size, array, along, buffer; } place;
typedef struct {
    int64_t id;
    void *call, *over, *states;
    long item, operands, results, arrays, slots, workspace, lanes, workspace_of_states;
    long work_slot, lanes_slot, steps_slot, results_slot, checked, nan, quaternions;
    place operand[16], result[16];
    void *blank[144];
    const long *quaternion;
    const char *const *names;
    const char *const *errors;
    const char *function;
} ordernm_plan;
int ordernm_jax_add(ordernm_plan *);
long ordernm_jax_size(void);
extern void ordernm_jax_call(void *);
"""
"""Declarations of ``handler.c``."""

TIME, NOT_READ = -1, -2

MOST_ARRAYS = 96
"""Largest number of arrays of a package, as in ``handler.c``."""

LEAST = 8
"""Smallest batch that is computed several states at once, as in ``handler.c``."""

_lock = threading.Lock()
_kept: dict[Any, Any] = {}
"""All plans, with the memory that they point to. Compiled programs may outlive their solvers."""


class HandlerBuild(Build):
    """Compiles ``handler.c`` with the headers of JAX."""

    def __init__(self, include: str, version: str):
        super().__init__(HANDLER.parent, "ordernm_jax")
        self.version = version
        self.sources = [HANDLER]
        self.flags = ["-O2", "-I", include]
        self.places = [user_cache() / "jax"]

    def key(self) -> str:
        source = hashlib.sha256(HANDLER.read_bytes()).hexdigest()[:16]
        compiler = short_key(*self.compiler, compiler_version(tuple(self.compiler)))
        return f"{self.name}-{source}-{short_key(self.version, *STANDARD, *self.flags)}-{compiler}"


@functools.cache
def handler() -> Any:
    """The cffi interface and the library of ``handler.c``, which is registered with XLA."""
    import jax
    from cffi import FFI

    build = HandlerBuild(jax.ffi.include_dir(), jax.__version__)
    if not build.compiler:
        raise build.complaint
    path = str(build.library())
    ffi = FFI()
    ffi.cdef(PLAN)
    library = ffi.dlopen(path)
    assert library.ordernm_jax_size() == ffi.sizeof("ordernm_plan")
    jax.ffi.register_ffi_target(TARGET, jax.ffi.pycapsule(ctypes.CDLL(path).ordernm_jax_call), platform="cpu")
    return ffi, library


def plan_of(operator: Operator, name: str, operands: tuple[tuple[str, bool], ...], returned: tuple[str, ...]) -> Any:
    """The plan of a generated function.

    Parameters
    ----------
    operator : Operator
    name : str
        The generated function.
    operands : tuple of (str, bool)
        Arguments and seeds in XLA's order; whether each has an axis of directions.
    returned : tuple of str
        Results in XLA's order; the others go to scratch memory.

    Raises
    ------
    NoCompilerError
        If the solver computes with NumPy.
    """
    key = operator, name, operands, returned
    with _lock:
        if key not in _kept:
            _kept[key] = _made(operator, name, operands, returned)
        return _kept[key][0]


def _made(operator: Operator, name: str, operands: tuple[tuple[str, bool], ...], returned: tuple[str, ...]) -> Any:
    target = operator.opened.target
    if target.name != "c":
        raise NoCompilerError(
            f"{operator.solver.name}: ordernm.jax calls compiled code, and this solver computes with NumPy; install a C "
            "compiler, and generate the package with target='c'"
        )
    ffi, library = handler()
    f = operator.function(name)
    target.prepare(f)
    manifest, over = operator.opened.manifest, target.batches._over_states
    in_lanes = target.batches._in_lanes(f)
    arrays = list(over["arrays"]) if in_lanes else []
    address = functools.partial(_address, target.ffi)
    plan = ffi.new("ordernm_plan *")
    words = repr(
        (manifest["seal"], manifest["digests"], operator.opened.number, name, operands, returned, operator.nan)
    )
    plan.id = int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "little", signed=True)
    plan.call, plan.over = (ffi.cast("void *", address(x)) for x in (target.function(f), target._over(f)))
    plan.item, plan.checked, plan.nan = operator.dtype.itemsize, 1 << SLOT["default_p"], operator.nan
    for i, (n, along) in enumerate(operands):
        slot = TIME if n == "t" and "t" in f.arguments else SLOT[n] if n in f.arguments or n in f.seeds else NOT_READ
        size = operator.sizes[n] if n in operator.sizes else f.seeds.get(n, operator.size)
        plan.operand[i] = (slot, size, arrays.index(n) if n in arrays else -1, along, -1)
    for i, (r, shape, derived) in enumerate(zip(f.results, f.shapes, f.derived, strict=True)):
        size, place = int(np.prod(shape)), arrays.index(r) if r in arrays else -1
        plan.result[i] = (0, size, place, derived, returned.index(r) if r in returned else -1)
    if len(arrays) > MOST_ARRAYS:
        raise RuntimeError(
            f"{operator.name} of {operator.solver.name}: JAX cannot call a package whose functions have more than {MOST_ARRAYS} "
            f"arrays together, and this one has {len(arrays)}; generate it with fewer functions"
        )
    plan.operands, plan.results, plan.arrays = len(operands), len(f.results), len(arrays)
    plan.workspace, plan.lanes = target.workspace, f.per_direction * max(f.widths, default=0)
    plan.workspace_of_states = over["workspace"] if in_lanes else 0
    plan.work_slot, plan.lanes_slot, plan.steps_slot = SLOT["work"], SLOT["lanes"], SLOT["steps"]
    plan.results_slot, plan.slots = SLOT["results"], SLOT["results"] + len(f.results)
    kept = _constants(operator, plan, ffi, arrays)
    names = [ffi.new("char[]", n.encode()) for n, _ in operands]
    errors = [ffi.new("char[]", text.encode()) for text in _errors(target, manifest)]
    quaternions = ffi.new("long[]", list(manifest["quaternions"]))
    tables = ffi.new("char *[]", names or [ffi.NULL]), ffi.new("char *[]", errors or [ffi.NULL])
    text = ffi.new("char[]", f"{operator.name} of {operator.solver.name}".encode())
    plan.names, plan.errors, plan.quaternion, plan.function = *tables, quaternions, text
    plan.quaternions = len(manifest["quaternions"]) if operands and operands[0][0] == "q" else 0
    if not library.ordernm_jax_add(plan):
        raise RuntimeError("JAX uses more than 4096 functions of solvers in this process; start a new process")
    return plan, kept, names, errors, quaternions, tables, text, target, in_lanes, f


def _constants(operator: Operator, plan: Any, ffi: Any, arrays: list[str]) -> Any:
    """Fills in defaults: pointers to default parameters and inputs, and for each array of a batch its default, or zeros."""
    target = operator.opened.target
    address = functools.partial(_address, target.ffi)
    p, inputs = (address(x) for x in target.default_pointers)
    for n, at in (("default_p", p), ("default_inputs", inputs), ("few", address(target.few_pointer))):
        plan.blank[SLOT[n]] = ffi.cast("void *", at)
    zeros = np.zeros(max([1, operator.size, *operator.sizes.values()]) * 8, operator.dtype)
    for i, n in enumerate(arrays):
        at = p if n == "p" else inputs if n == "inputs" else zeros.ctypes.data
        plan.blank[plan.slots + i] = ffi.cast("void *", at)
    return zeros


def _errors(target: Any, manifest: Any) -> list[str]:
    """Messages for the statuses that compiled functions return, from 1 on."""
    count = len(target.links) + len(target.loops) + len(target.singular_forces) + len(manifest["output_names"])
    return [str(target.singular(status)) for status in range(1, count + 1)]


def _address(ffi: Any, pointer: Any) -> int:
    return int(ffi.cast("intptr_t", pointer))


def attributes(
    operator: Operator, name: str, operands: tuple[tuple[str, bool], ...], returned: tuple[str, ...], count: int, k: int
) -> dict[str, Any]:
    """Attributes of a call by XLA. Compiles the code for several states at once if the batch needs it."""
    plan = plan_of(operator, name, operands, returned)
    *_, target, in_lanes, f = _kept[operator, name, operands, returned]
    ffi, _ = handler()
    lanes = in_lanes and count >= LEAST
    if lanes and not plan.states:
        opened = target.batches.opened(f)
        if opened:
            symbol = target.batches._symbol(f)
            target.ffi.cdef(f"int {symbol}(states *);", override=True)
            plan.states = ffi.cast("void *", _address(target.ffi, getattr(opened, symbol)))
    threads = target.batches.threads(f, count, k, lanes)
    return {name: np.int64(x) for name, x in (("plan", plan.id), ("count", count), ("k", k), ("threads", threads))}
