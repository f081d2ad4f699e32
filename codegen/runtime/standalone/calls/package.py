"""An open package: properties of its model, and calls of its functions with a user's arguments.

`Solver` is derived from it and has a method for each function.
"""

from __future__ import annotations

import inspect
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....html_tables import html_of
from ..arrays import Array, Shape
from ..errors import SingularJointError
from ..files.manifest import read_manifest, refuse_another
from .arguments import NO_SEEDS, Arguments, Seeds, Unseen, some
from .bad_states import BAD_STATES, spread, warn_of_bad, without_bad
from .c_target import CTarget
from .functions import (
    MADE_OF,
    MEMBERS,
    SELECTIVE,
    SOMETIMES,
    WEIGHTED,
    WEIGHTS,
    WITHOUT_ENTRIES,
    Function,
    Wanted,
    function,
    lacks,
    made_of,
    shapes_of,
)
from .non_finite import warn_of_infinite
from .operation_counts import OperationCounts
from .results import empty, overlap, places, put
from .targets import Opened, c_target, open_partition
from .task import Target, Task

Composed = Callable[[tuple[Any, ...], Any, Any], Sequence[Array]]
"""A function that computes results from arguments, seeds and `out`; see `Package._call`."""


class Package:
    """An open generated package. `Solver` documents its parameters."""

    _watch: Callable[[str | Wanted, tuple[Any, ...], tuple[Any, ...] | None], None] | None = None
    """Warns if no derivative exists along a direction."""
    _looks_at_state: Sequence[Callable[[str | Wanted, tuple[Any, ...]], None]] = ()
    """Warn if a state that a user has typed leaves loops open, or if parameters by name make a mass negative."""
    _masses: Any = None
    """Warns of parameters that make a mass negative, if parameters can do so."""
    _threads: int | None = None
    _bad_states = "error"

    def __init__(self, folder: str | os.PathLike[str], target: str | None = None):
        self.folder = Path(folder).absolute()
        self._manifest = manifest = self._read()
        self.name: str = manifest["name"]
        self.coordinate_names: tuple[str, ...] = tuple(manifest["coordinate_names"])
        self.speed_names: tuple[str, ...] = tuple(manifest["speed_names"])
        self.parameter_names: tuple[str, ...] = tuple(manifest["parameter_names"])
        self.input_names: tuple[str, ...] = tuple(manifest["input_names"])
        self.moving_inputs: tuple[str, ...] = tuple(manifest.get("moving_inputs", ()))
        self.signal_names = self.input_names[: len(self.input_names) - 2 * len(self.moving_inputs)]
        self.output_names: tuple[str, ...] = tuple(manifest["output_names"])
        self.closure_names: tuple[str, ...] = tuple(manifest["closure_names"])
        self.prescribed_names: tuple[str, ...] = tuple(manifest["prescribed_names"])
        self.nq, self.nu, self.np = len(self.coordinate_names), len(self.speed_names), len(self.parameter_names)
        self.ninputs, self.noutputs = len(self.input_names), len(self.output_names)
        self._shapes = shapes_of(manifest)
        self._arguments = Arguments(manifest, self._shapes)
        self._initial = np.array(manifest["initial"]["q"], float), np.array(manifest["initial"]["u"], float)
        self._wanted: str = manifest.get("target", "c") if target is None else target
        self._made: dict[int, Opened] = {}
        self._compiled: dict[int, CTarget] = {}
        self._making = threading.Lock()
        self._use(self._open(0))
        self._is_opened()

    def _read(self) -> dict[str, Any]:
        return read_manifest(self.folder)

    def _open(self, partition: int) -> Opened:
        """Opens a partition at its first use, and returns it."""
        with self._making:
            if partition not in self._made:
                opened = open_partition(self.folder, self._manifest, partition, self._wanted, self._shapes)
                opened.target.threads = self._threads
                self._made[partition] = opened
            return self._made[partition]

    def _in_c(self, opened: Opened) -> CTarget:
        """The compiled code of a partition, even if the partition computes with NumPy.

        Raises
        ------
        PackageError, NoCompilerError, CompileError
        """
        if isinstance(opened.target, CTarget):
            return opened.target
        with self._making:
            if opened.number not in self._compiled:
                made = c_target(opened.folder, opened.package, opened.manifest, opened.functions, self._shapes)
                self._compiled[opened.number] = made
            return self._compiled[opened.number]

    def _use(self, opened: Opened) -> None:
        """Makes `opened` the current partition."""
        self._opened = opened
        self._calls = opened.target.calls
        self._watched = bool(opened.manifest.get("opening"))
        self._is_used()

    def _is_opened(self) -> None:
        """Called once; `Solver` warns of an initial state that differs from the model's values."""

    def _is_used(self) -> None:
        """A hook that is called after the current partition has changed."""

    def __getstate__(self) -> tuple[str, str, int, int | None, str, str]:
        # a pool of processes pickles solvers; each process opens the package again
        sealed = self._manifest.get("seal", "")
        return str(self.folder), self.target, self._opened.number, self._threads, self._bad_states, sealed

    def __setstate__(self, state: tuple[str, str, int, int | None, str, str]) -> None:
        folder, target, partition, threads, bad_states, sealed = state
        refuse_another(Path(folder), sealed)
        Package.__init__(self, folder, target)
        self.batch_threads, self.bad_states = threads, bad_states
        if partition:
            self._use(self._open(partition))

    def __repr__(self) -> str:
        return (
            f"<Solver {self.name}: nq={self.nq}, nu={self.nu}, np={self.np}, ninputs={self.ninputs}, "
            f"noutputs={self.noutputs}, target={self.target}>"
        )

    def _repr_html_(self) -> str:
        kinds = ("coordinate", "speed", "parameter", "input", "output")
        every = ((kind, getattr(self, f"{kind}_names")) for kind in kinds)
        rows = [(f"{kind}s", f"{len(names)}", some(names)) for kind, names in every if names]
        return html_of([f"solver of {self.name}, target {self.target}"], ("", "number", "names"), rows)

    def __getattr__(self, name: str) -> Any:
        """Explains why a package lacks a method; Python calls this for missing attributes only."""
        member: Any = getattr(type(self), name, None)
        if hasattr(member, "__get__"):
            return member.__get__(self)  # the error of a property: raise this error again
        if name in SOMETIMES:
            raise AttributeError(self._why_not(name))
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    # -- properties of the model ---------------------------------------------------------------------------------------

    @property
    def target(self) -> str:
        """The target that computes: ``c`` or ``numpy``."""
        return self._target.name

    @property
    def parameters(self) -> Array:
        """Default values of the design parameters, (np,): a copy. Pass other values as ``p`` of a call."""
        return self._arguments.defaults["p"].copy()

    @property
    def batch_threads(self) -> int | None:
        """Number of threads that share the states of a batch in C, or None to choose by the batch.

        With None, the default, a batch has one thread for each 0.1 ms of the time that a single thread would take, and at
        most one for each processor. A batch of less than 0.2 ms has one thread. In any case each thread has at least 64
        states. Results do not depend on the number of threads, to the last bit.
        """
        return self._threads

    @batch_threads.setter
    def batch_threads(self, threads: int | None) -> None:
        number = isinstance(threads, (int, np.integer)) and not isinstance(threads, bool)
        if threads is not None and not (number and threads >= 1):
            raise ValueError(
                f"batch_threads is {threads!r}, expected a number of threads, at least 1, or None, which chooses by the batch"
            )
        self._threads = None if threads is None else int(threads)
        with self._making:
            for opened in self._made.values():
                opened.target.threads = self._threads

    @property
    def bad_states(self) -> str:
        """Treatment of batch states that cannot be computed, ``error`` or ``nan``.

        Such states are singular, or have numbers that are not finite. With ``error``, the default, such a state raises
        an error. With ``nan`` its results are NaN, a warning names it, and the other states are computed.
        """
        return self._bad_states

    @bad_states.setter
    def bad_states(self, wanted: str) -> None:
        if wanted not in BAD_STATES:
            raise ValueError(f"bad_states is {wanted!r}; allowed are {' and '.join(map(repr, BAD_STATES))}")
        self._bad_states = wanted

    @property
    def independent_names(self) -> tuple[str, ...]:
        """Names of the independent coordinates; all names in a model without loops."""
        return tuple(self._opened.manifest.get("independent_names", self.coordinate_names))

    @property
    def independent_speed_names(self) -> tuple[str, ...]:
        """Names of the independent speeds; all names in a model without loops."""
        return tuple(self._opened.manifest.get("independent_speed_names", self.speed_names))

    @property
    def operations(self) -> dict[str, Any]:
        """Additions, multiplications, divisions and functions, by function and sweep.

        ``operations["sensitivities"]["balance_in"]["per_direction"]["additions"]`` counts operations of one more direction,
        ``"per_call"`` those that all directions share. ``"start"`` computes constants, sines and cosines. A sweep that a
        function runs twice counts twice; each column of a matrix is a direction. ``"solve_in_1"`` is the sweep ``"solve_in"``
        over directions, here run for values.
        """
        by_sweep = self._manifest["operations"]
        run = {name: f.get("sweeps", ()) for name, f in self._manifest["functions"].items()}
        return OperationCounts(
            {name: {s: _times(by_sweep[s], sweeps.count(s)) for s in sweeps} for name, sweeps in run.items()}
        )

    @property
    def _composed(self) -> Mapping[str, Composed]:
        """Functions that Python composes from generated functions, by name. In models without loops, generated
        functions have these names."""
        return {}

    @property
    def _target(self) -> Target:
        return self._opened.target

    @property
    def _functions(self) -> Mapping[str, Function]:
        return self._opened.functions

    # -- compiling -----------------------------------------------------------------------------------------------------

    def prepare(self, *members: str) -> None:
        """Compile now the code that methods need, which is otherwise compiled at their first call.

        Libraries are kept beside the package or in the user's cache, so this takes time once. The NumPy target compiles
        code for motions only.

        Parameters
        ----------
        *members : str
            Names of methods, such as ``"accelerations"``, ``"jacobians"``, ``"simulate"``; ``"batches"`` for large
            batches of `accelerations`, `sensitivities` and `gradients`. Default: everything.

        Raises
        ------
        ValueError
            If the solver has no such method.
        AttributeError
            If the package was generated without it.
        NoCompilerError
            If there is no C compiler.
        CompileError
            If the compiler fails.

        Examples
        --------
        >>> solver.prepare("simulate", "jacobians")
        """
        methods = [n for n, _ in inspect.getmembers(type(self), inspect.isfunction) if n[0] != "_"]
        compiled = [*(n for n in methods if self._needed(n) and not lacks(self._manifest, n)), "batches"]
        for member in members or compiled:
            if member in SOMETIMES:
                getattr(self, member)  # raises with the reason if the package lacks this method
            if member not in methods and member != "batches":
                raise ValueError(
                    f"prepare: {member!r} is not a method that is compiled; expected one of {', '.join(compiled)}"
                )
            if lacks(self._manifest, member):
                raise AttributeError(self._why_not(member))
            self._prepare(member)

    def _needed(self, member: str) -> list[Function]:
        """The generated functions that a method calls."""
        names = made_of(self._manifest, member)
        return [f for name, f in self._functions.items() if name in names or MEMBERS.get(name) in names]

    def _prepare(self, member: str) -> None:
        target = self._opened.target
        if not isinstance(target, CTarget):
            return
        if member == "batches":
            target.batches.prepare()
        for f in self._needed(member):
            target.prepare(f)

    # -- calls ---------------------------------------------------------------------------------------------------------

    def _call(
        self, wanted: str | Wanted, given: tuple[Any, ...], seeds: tuple[Any, ...] | None = None, out: Any = None
    ) -> Any:
        """Computes a function with a user's arguments; writes the results to `out` if it is given.

        `given` are the arguments in the order of `Function.order`, and `seeds` the seeds in the order of
        `Function.directions`. One state or a small batch goes directly to C.
        """
        if self._watched:
            self._look_at_directions(wanted, given, seeds)
        looks = self._looks_at_state
        if looks and (type(given[0]) is not np.ndarray or dict in map(type, given)):
            for look in looks:
                look(wanted, given)
            looks = ()
        found = self._calls[wanted](given, seeds, out)
        if found is not None:
            return found
        for look in looks:  # parameters may be a mapping of another type
            look(wanted, given)
        opened, name = self._opened, wanted if isinstance(wanted, str) else wanted.name
        if name in self._composed and name not in opened.functions:
            return self._composed[name](given, seeds, out)
        f = self._find(opened, name)
        unseen: list[Unseen] = []
        arrays, batch, bad = self._taken(f, given, unseen)
        along = NO_SEEDS
        if seeds is not None:
            of, called = batch, WEIGHTS if name in WEIGHTED else {}
            named = dict(zip(f.directions, seeds, strict=True))
            along, batch = Seeds.take(self._arguments, named, arrays, batch, called, unseen)
            bad = bad if batch == of else spread(bad, of, batch)
        returned = f.results if isinstance(wanted, str) else wanted.returned
        out = [out] if out is not None and seeds is None and len(returned) == 1 else out
        return self._computed(opened, Task(f, arrays, batch, along, (), unseen=unseen), returned, out, bad)

    def _one_state(self, wanted: str | Wanted, given: tuple[Any, ...], seeds: tuple[Any, ...] | None = None) -> Any:
        """Results of a function for one state; None unless q and u are vectors and a direct call of C can compute this
        state."""
        q, u, *_ = given
        if type(q) is not np.ndarray or type(u) is not np.ndarray or q.ndim != 1 or u.ndim != 1:
            return None
        found = self._calls[wanted](given, seeds, None)
        return found if found is not None and found[0].ndim == 1 else None

    def _taken(
        self, f: Function, values: Sequence[Any], unseen: list[Unseen] | None = None
    ) -> tuple[dict[str, Any], Shape, dict[int, str]]:
        """Checks arguments; returns the checked arrays, the batch shape, and the reasons for bad states if `bad_states`
        is "nan". For `unseen` see `Arguments.take`."""
        given = f.named(values)
        if self._bad_states == "error":
            return *self._arguments.take(given, self._left_out, unseen), {}
        return without_bad(self._arguments, self._initial[0], given, self._left_out)

    def _computed(
        self, opened: Opened, task: Task, returned: Sequence[str], out: Any, bad: Mapping[int, str]
    ) -> tuple[Array, ...]:
        """Results for checked arguments, in `out` if it is given; zeros for results that the function does not compute.

        Warns of results that are not finite; results of bad states are NaN.
        """
        f, batch, seeds, dtype = task.f, task.batch, task.seeds, self._arguments.dtype
        shapes = dict(zip(f.results, f.whole_shapes(batch, seeds.k), strict=True))
        lead = (seeds.k, *batch) if f.seeds else batch
        wanted = [shapes[r] if r in shapes else lead + self._shapes[r.removeprefix("d")] for r in returned]
        taken: dict[str, Array] = {}
        if out is not None:
            called = [r.replace("J_", "J.") for r in returned]
            taken = dict(zip(returned, places(out, called, wanted, dtype), strict=True))
        # results that would overwrite arguments are copied at the end
        direct = {} if overlap([*taken.values()], {**task.arrays, **seeds.of}) else taken
        skipped = {*f.results[1:]}.difference(returned) if f.name in SELECTIVE else ()
        found = {r: None if r in skipped else direct[r] if r in direct else empty(s, dtype) for r, s in shapes.items()}
        failed: dict[int, SingularJointError] | None = {} if batch and self._bad_states == "nan" else None
        task = task._replace(out=[*found.values()], failed=failed)
        finite = False
        if f.has_entries():
            finite = opened.target.run(task)
        else:
            task.look()
        zero, along = self._arguments.kind(0), dict(zip(f.results, f.derived, strict=True))
        results: list[Any] = [
            found[r] if r in found else np.full(s, zero, dtype) for r, s in zip(returned, wanted, strict=True)
        ]
        if failed or bad:
            reasons = {n: str(error) for n, error in (failed or {}).items()} | dict(bad)
            task.spoil(results, [along.get(r, bool(f.seeds)) for r in returned], reasons)
            warn_of_bad(self.name, dict(sorted(reasons.items())), batch)
        elif not finite and f.has_entries():
            warn_of_infinite(opened, task)
        return tuple(put(results, [*taken.values()]))

    def _has(self, name: str) -> bool:
        """Whether the model has this function, even if the package does not contain it."""
        return name in self._functions or MEMBERS.get(name, name) in self._manifest.get("left_out", ())

    def _find(self, opened: Opened, name: str) -> Function:
        f = opened.functions.get(name)
        if f is None and name in WITHOUT_ENTRIES and not self._has(name):
            f = function(name, WITHOUT_ENTRIES[name], self._shapes)
            f = None if f.has_entries() else f
        if f is None:
            raise AttributeError(self._why_not(name))
        return f

    def _needs_all(self, name: str) -> None:
        """Raises AttributeError if the package lacks a function that the method needs."""
        if not set(MADE_OF[name]).isdisjoint(self._manifest.get("left_out", ())):
            raise AttributeError(self._why_not(name))

    def _why_not(self, name: str) -> str:
        """The reason why a function or method is missing."""
        if name in IN_DOUBLE_ONLY and "scalar" in self._manifest:
            return (
                f"{self.name} was generated with --scalar {self._manifest['scalar']}: it evaluates functions and their "
                f"derivatives; motions are integrated in double precision, which needs a package of --scalar float64"
            )
        if name.startswith("driving_force") and not self.prescribed_names:
            return f"{self.name} has no prescribed motion (section motion of the model file), so there are no driving forces"
        if name in ("reactions", "reaction_sensitivities"):
            among = ", or add it to --functions" if "left_out" in self._manifest else ""
            return f"{self.name} was generated without {name}: generate it with --reactions{among}"
        if name == "hessians" or name.endswith("hessian_products"):
            asked = {"hessians": "hessian_products", EQUILIBRIA: "statics,gradients,hessian_products"}.get(name, name)
            return f"{self.name} was generated without {asked}: add {'them' if ',' in asked else 'it'} to --functions"
        if name.startswith(("frame", "point", "picture", "view")):
            return f"{self.name} was generated without {name}: generate it with --frames"
        left_out, needed = self._manifest.get("left_out", ()), (name, *MADE_OF.get(name, ()))
        if called := [n for n in dict.fromkeys(MEMBERS.get(n, n) for n in needed) if n in left_out]:
            have = [f.get("member", n) for n, f in self._manifest["functions"].items()]
            why = f", which {name} needs" if name in MADE_OF and name not in called else ""
            return (
                f"{self.name} was generated without {', '.join(called)}{why}; generate it with "
                f"--functions {','.join([*have, *called])}, or without --functions for all"
            )
        if self.closure_names:
            return f"{self.name} has closed loops: {name!r} is defined for trees only" + _ON_INDEPENDENTS.get(name, "")
        return f"{self.name} was generated without the function {name!r}; it has {', '.join(self._functions)}"

    def _left_out(self, name: str, given: Mapping[str, Any]) -> Array | float:
        """Values of entries that a mapping leaves out: default parameters, else zeros."""
        return self._arguments.defaults.get(name, 0.0)

    def _look_at_directions(self, wanted: str | Wanted, given: tuple[Any, ...], seeds: tuple[Any, ...] | None) -> None:
        """Warns of directions without a derivative, if the model can have any."""
        if self._watch is not None:
            self._watch(wanted, given, seeds)


EQUILIBRIA = "equilibrium_hessian_products"
"""A method composed of several functions; the message that it is missing names all of them."""

IN_DOUBLE_ONLY = ("simulate", "judge", "state_rates", "state_rate_sensitivities")
"""Methods available in double precision only."""

_ON_INDEPENDENTS = dict.fromkeys(
    ("solve_mass", "solve_mass_sensitivities", "inverse_mass_matrix"),
    "; mass_matrix is there, on the independent speeds",
)


def state(q: Any, u: Any, p: Any, inputs: Any, t: Any) -> dict[str, Any]:
    """Arguments of a state by name."""
    return {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}


def seeds(dq: Any, du: Any, dp: Any, dinputs: Any, dt: Any) -> dict[str, Any]:
    """Seeds of a state by name."""
    return {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}


def _times(counts: Mapping[str, Mapping[str, int]], n: int) -> dict[str, dict[str, int]]:
    """The operations of a sweep, times n."""
    return {part: {k: n * v for k, v in of.items()} for part, of in counts.items()}
