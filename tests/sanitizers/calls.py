"""Calls of every function of a generated header: arguments, and expected results.

Names and sizes are read from the header and ``model.json``, not asked of the generator; numbers must be those of the
package's NumPy module.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from codegen.runtime.standalone.files.manifest import read_manifest

Array = np.ndarray

STATES = 3
DIRECTIONS = 8
MORE = 4
"""Functions over several states at once get so many times as many, less one: vectors full and not."""

TOLERANCE = 1e-10
"""Largest relative difference to the NumPy module, per result and state, or per direction."""

IN_MODES = "_in_modes"
OF_MOTIONS = ("switches",)
"""Functions that only motions call: ``model.json`` and the NumPy module do not have them."""
PROTOTYPE = re.compile(r"^int (\w+)\(([^)]*)\);", re.MULTILINE)


@dataclass(frozen=True)
class Prototype:
    """A function of the header.

    Attributes
    ----------
    symbol : str
        In C.
    function : str
        Its name in ``model.json`` and in the NumPy module.
    width : int
        Directions at once; 0 for a function without directions.
    batch : str
        The type of its argument, if it is a loop over a batch.
    arguments, results : tuple of str
        Arguments include the seeds and, last, the modes of switches.
    in_modes : bool
        Whether it takes modes.
    """

    symbol: str
    function: str
    width: int
    batch: str
    arguments: tuple[str, ...]
    results: tuple[str, ...]
    scalars: frozenset[str]
    in_modes: bool = False

    @property
    def c(self) -> str:
        """A C function that takes arguments and results from one array of pointers."""
        head = f"static int call_{self.symbol}(double *const *a, const long *step, long count, long *failed, double *work)\n{{\n"
        names = (*self.arguments, *self.results)
        if not self.batch:
            given = [f"*a[{at}]" if name in self.scalars else f"a[{at}]" for at, name in enumerate(names)]
            if self.in_modes:  # they come behind the results
                given.append(given.pop(len(self.arguments) - 1))
            unused = "    (void)step, (void)count, (void)failed;\n"
            return f"{head}{unused}    return {self.symbol}({', '.join([*given, 'work'])});\n}}\n"
        lines = [f"b.{name}.at = a[{at}], b.{name}.step = step[{at}];" for at, name in enumerate(names)]
        if self.over_states:
            lines = [line for at, name in enumerate(names) for line in self._strided(at, name)]
            lines += [f"b.directions = {self.width};"] if self.width else []
        lines = [
            f"{self.batch} b = {{ .count = count, .failed = *failed, .work = work }};", *lines,
            f"const int status = {self.symbol}(&b);", "*failed = b.failed;", "return status;",
        ]  # fmt: skip
        return head + "".join(f"    {line}\n" for line in lines) + "}\n"

    @property
    def over_states(self) -> bool:
        """Whether the function computes several states at once."""
        return self.batch.endswith("_states")

    def _strided(self, at: int, name: str) -> list[str]:
        """Lines that state the place of an array; along directions, the direction is its last index."""
        along = bool(self.width) and name.startswith("d")
        steps = {"at": f"a[{at}]", "state": f"step[{at}]", "direction": "1" if along else "0"}
        steps["entry"] = str(self.width) if along else "1"
        return [f"b.{name}.{member} = {value};" for member, value in steps.items()]


@dataclass
class Call:
    """A call and its expected outcome: results, the number of the singular item, or None for any outcome."""

    prototype: Prototype
    count: int | None
    shift: int
    arguments: list[Array]
    steps: list[int]
    sizes: list[int]
    expected: list[Array] | int | None
    failed: int = -1


@dataclass
class Part:
    """The functions of one header; a package with a second partition has two headers."""

    folder: Path
    manifest: Mapping[str, Any]
    prototypes: list[Prototype] = field(init=False)
    module: ModuleType = field(init=False)
    known: dict[Any, Any] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        header = (self.folder / f"{self.name}.h").read_text()
        self.prototypes = []
        for symbol, declared in PROTOTYPE.findall(header):
            self.prototypes.append(self._prototype(symbol, declared))
        # what runs functions on threads takes one of them, and is examined in test_threads.py
        of_threads = header.count(f"\nint {self.name}_on_threads(")
        assert self.prototypes and header.count("\nint ") == len(self.prototypes) + of_threads
        spec = importlib.util.spec_from_file_location(f"{self.name}_numpy", self.folder / f"{self.name}_numpy.py")
        assert spec is not None and spec.loader is not None
        self.module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.module)

    @property
    def name(self) -> str:
        return str(self.manifest["name"])

    def _prototype(self, symbol: str, declared: str) -> Prototype:
        stem = symbol.removeprefix(f"{self.name}_")
        if stem.endswith("_states"):
            stem = stem.removesuffix("_states")
            single = next(f for f in self.prototypes if f.function == stem and f.width in (0, DIRECTIONS))
            return replace(single, symbol=symbol, batch=declared.split("*")[0].strip())
        if stem.endswith("_batch"):
            single = next(f for f in self.prototypes if f.symbol == symbol.removesuffix("_batch"))
            type, name = declared.split("*")
            assert name.isidentifier(), f"{symbol} takes {declared}"
            return replace(single, symbol=symbol, batch=type.strip())
        function, _, width = stem.rpartition("_")
        if not width.isdigit():
            function, width = stem, "0"
        in_modes = function.endswith(IN_MODES)
        function = function.removesuffix(IN_MODES)
        known = in_modes or function in (*self.manifest["functions"], *OF_MOTIONS)
        assert known, f"{symbol} is not in model.json"
        arguments, results, scalars = [], [], []
        for declaration in re.split(r",\s+", declared):
            type, _, name = declaration.replace("*", "* ").rpartition(" ")
            match " ".join(type.split()):
                case "const double *":
                    arguments.append(name)
                case "double":
                    arguments.append(name)
                    scalars.append(name)
                case "double *":
                    results.append(name)
                case other:
                    raise AssertionError(f"{symbol}: {other} {name}")
        assert results.pop() == "work", symbol
        assert not in_modes or arguments[-1] == "modes", symbol
        return Prototype(
            symbol, function, int(width), "", tuple(arguments), tuple(results), frozenset(scalars), in_modes
        )

    # -- sizes -----------------------------------------------------------------------------------------------------

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Number of doubles of arguments and results, as the header says; of one direction for derivatives and seeds."""
        m = self.manifest
        nq, nu, links, loops = (len(m[n]) for n in ("coordinate_names", "speed_names", "links", "loops"))
        given = {"q": nq, "u": nu, "p": len(m["parameter_names"]), "inputs": len(m["input_names"]), "t": 1}
        closure, switches = len(m["closure_names"]), len(m.get("switches", ()))
        return given | {f"J_{n}": nu * size for n, size in given.items()} | {
            "udot": nu, "qdot": nq, "b": nu, "x": nu, "M": nu * nu, "inverse_M": nu * nu,
            "force": nu, "actuation": len(m["prescribed_names"]), "energy": 2, "outputs": len(m["output_names"]),
            "position": closure, "velocity": closure, "condition": loops, "step": nq, "full_q": nq, "full_u": nu,
            "modes": switches, "switches": switches, "reaction": 6 * links, "loop_reaction": 6 * loops,
            **{n: size * len(m.get("bodies", ())) for n, size in (("frames", 18), ("frame_accelerations", 6))},
            "point_places": 3 * len(m.get("points", ())),
        }  # fmt: skip

    def size(self, f: Prototype, name: str) -> int:
        """Number of doubles of an argument or result of a function, in one call."""
        return self.sizes[name.removeprefix("d")] * f.width if self.along(f, name) else self.sizes[name]

    def along(self, f: Prototype, name: str) -> bool:
        """Whether an argument or result has a value for each direction."""
        return bool(f.width) and name not in self.sizes

    # -- states ----------------------------------------------------------------------------------------------------

    def states(self, rng: np.random.Generator) -> dict[str, Array]:
        """Arguments (STATES, n) and seeds (STATES, n, DIRECTIONS) near the initial state."""
        m = self.manifest
        spread = 0.02 if m["closure_names"] else 0.3
        q, u = (np.array(m["initial"][n], float) for n in "qu")
        p = np.array(m["parameters"], float)
        given = {
            "q": q + spread * rng.normal(size=(STATES, len(q))),
            "u": u + rng.normal(size=(STATES, len(u))),
            "p": p * rng.uniform(0.98, 1.02, size=(STATES, len(p))),
            "inputs": rng.uniform(0.2, 0.8, size=(STATES, len(m["input_names"]))),
            "t": rng.uniform(0.2, 0.8, size=(STATES, 1)),
            "udot": rng.normal(size=(STATES, len(u))),
            "b": rng.normal(size=(STATES, len(u))),
            "modes": np.outer((0, 1, -1), np.ones(self.sizes["modes"])),
        }
        weighed = {
            n: np.empty((STATES, self.sizes[n])) for n in ("qdot", "energy", "outputs", "switches", "full_q", "full_u")
        }
        return given | {f"d{n}": rng.normal(size=(*x.shape, DIRECTIONS)) for n, x in (given | weighed).items()}

    # -- calls -----------------------------------------------------------------------------------------------------

    def calls(self, rng: np.random.Generator, singular: Sequence[Mapping[str, float]] = ()) -> list[Call]:
        """Every function at every alignment and over batches, with steps of zero too, and with numbers that are none.

        `singular` are states in which functions may find no result: numbers that all entries of an argument get.
        """
        states = self.states(rng)
        calls = [call for f in self.prototypes for call in self._calls(f, states)]
        for numbers in singular:
            there = {a: np.full_like(x[0], numbers[a]) if a in numbers else x[0] for a, x in states.items()}
            for f in self.prototypes:
                own = {a: states[a].copy() for a in f.arguments}
                if not f.batch:
                    calls.append(self.call(f, {a: there[a] for a in own}))
                    continue
                for a, x in own.items():
                    x[1] = there[a]
                calls.append(self.call(f, own, STATES))
        return calls

    def _calls(self, f: Prototype, states: Mapping[str, Array]) -> list[Call]:
        if not f.batch:
            calls = [
                self.call(f, {a: states[a][shift % STATES] for a in f.arguments}, shift=shift) for shift in range(8)
            ]
        else:
            times = MORE if f.over_states else 1
            own = {a: np.concatenate([states[a]] * times)[: max(STATES, times * STATES - 1)] for a in f.arguments}
            odd = {a: x[0] if i % 2 else x for i, (a, x) in enumerate(own.items())}
            even = {a: x if i % 2 else x[0] for i, (a, x) in enumerate(own.items())}
            calls = [
                self.call(f, x, max(STATES, times * STATES - 1), shift) for shift, x in enumerate((own, odd, even))
            ]
            calls.append(self.call(f, {a: x[:0] for a, x in own.items()}, 0))
        wild = [np.nan, np.inf, -np.inf, 1e308, -1e200, 1e-320, 0.0]
        for i, x in enumerate(wild):
            given = {a: np.full_like(states[a][0], x) for a in f.arguments}
            calls.append(self.call(f, given, 1 if f.batch else None, i, checked=False))
        return calls

    def call(
        self,
        f: Prototype,
        given: Mapping[str, Array],
        count: int | None = None,
        shift: int = 0,
        checked: bool = True,
    ) -> Call:
        """A call; in a batch arguments have a first axis, or are the same for all states and have none."""
        arguments, steps, stepping = [], [], []
        for a in f.arguments:
            seed = self.along(f, a)
            x = given[a][..., : f.width] if seed else given[a]
            stepping.append(x.ndim > 1 + seed)
            steps.append(int(np.prod(x.shape[1:])) if stepping[-1] else 0)
            arguments.append(np.ascontiguousarray(x, float))
        times = 1 if count is None else count
        checked &= f.function in self.manifest["functions"]
        if f.in_modes:  # the NumPy module has no modes; with modes of zero, branches follow from the arguments
            checked &= not np.any(given["modes"])
        sizes = [times * self.size(f, r) for r in f.results]
        call = Call(f, count, shift, arguments, steps, sizes, None)
        if checked and count != 0:
            single = [
                [x[i] if along else x for x, along in zip(arguments, stepping, strict=True)] for i in range(times)
            ]
            found = [self.expected(f, x) for x in single]
            singular = [i for i, x in enumerate(found) if isinstance(x, int)]
            if singular:
                call.expected = found[singular[0]]
                call.failed = singular[0] if f.batch else -1
            else:
                call.expected = [np.concatenate([x[r].ravel() for x in found]) for r in range(len(f.results))]
        elif checked:
            call.expected = [np.zeros(0) for _ in f.results]
        return call

    def expected(self, f: Prototype, arguments: list[Array]) -> list[Array] | int:
        """The results of the NumPy module in the layout of the C, or the number of the singular item."""
        key = (f.function, f.width), *(x.tobytes() for x in arguments)
        if key not in self.known:
            self.known[key] = self._expected(f, arguments)
        return self.known[key]

    def _expected(self, f: Prototype, arguments: list[Array]) -> list[Array] | int:
        passed = []
        for name, x in zip(f.arguments, arguments, strict=True):
            if name == "modes":
                continue
            x = np.moveaxis(x, -1, 0) if self.along(f, name) else x
            passed.append(x[..., 0] if name in ("t", "dt") else x)
        try:
            with np.errstate(all="ignore"):
                found = getattr(self.module, f.function)(*passed)
        except self.module.SingularJointError as error:
            return self._number(error)
        results = []
        for name, x in zip(f.results, found, strict=True):
            # matrices are one row after the other; directions come last
            x = np.asarray(x, float)
            results.append(np.moveaxis(x, 0, -1) if self.along(f, name) else x)
        return results

    def _number(self, error: Any) -> int:
        """The status that the C returns for a singular joint, loop or force element."""
        m = self.manifest
        names = {
            "SingularJointError": [("", n) for n in m["links"]],
            "SingularLoopError": [("loop", n) for n in m["loops"]],
            "SingularForceError": [("force element", n) for n in m.get("elements", ())],
            "SingularOutputError": [("output", n) for n in m["output_names"]],
        }
        begins = 1
        for kind, known in names.items():
            if type(error).__name__ == kind:
                return begins + [n for _, n in known].index(error.link)
            begins += len(known)
        raise AssertionError(type(error).__name__)

    # -- files -----------------------------------------------------------------------------------------------------

    def header(self) -> str:
        """calls.h of the harness."""
        kind = "STATES_" if any(f.over_states for f in self.prototypes) else ""  # which is the larger one
        table = [
            f'    {{"{f.symbol}", call_{f.symbol}, {len(f.arguments)}, {len(f.results)}}},\n' for f in self.prototypes
        ]
        return (
            f'#include "{self.name}.h"\n\nenum {{ WORKSPACE = {self.name.upper()}_{kind}WORKSPACE }};\n\n'
            "typedef struct {\n    const char *name;\n"
            "    int (*call)(double *const *a, const long *step, long count, long *failed, double *work);\n"
            "    int arguments, results;\n} function;\n\n"
            f"{''.join(f.c for f in self.prototypes)}\nstatic const function functions[] = {{\n{''.join(table)}}};\n"
        )

    def write(self, calls: list[Call], file: Path) -> None:
        """Write the input of the harness."""
        with open(file, "wb") as out:
            for c in calls:
                head = [self.prototypes.index(c.prototype), -1 if c.count is None else c.count, c.shift]
                np.array(head, float).tofile(out)
                for x, step in zip(c.arguments, c.steps, strict=True):
                    np.array([x.size, step], float).tofile(out)
                    x.tofile(out)
                for name, size in zip(c.prototype.results, c.sizes, strict=True):
                    np.array([size, self.size(c.prototype, name)], float).tofile(out)

    def check(self, calls: list[Call], file: Path) -> None:
        """Compare the output of the harness with the expected results."""
        out, at = np.fromfile(file), 0
        highest = sum(len(self.manifest.get(n, ())) for n in ("links", "loops", "elements", "output_names"))
        for c in calls:
            f, (status, failed) = c.prototype, out[at : at + 2]
            at += 2
            results = []
            if not status:
                for n in c.sizes:
                    results.append(out[at : at + n])
                    at += n
            assert 0 <= status <= highest, (f.symbol, status)
            if c.expected is None:
                assert failed == (0 if status and f.batch else -1)
                continue
            wanted = c.expected if isinstance(c.expected, int) else 0
            assert (status, failed) == (wanted, c.failed), f.symbol
            if not isinstance(c.expected, int):
                for name, x, y in zip(f.results, results, c.expected, strict=True):
                    self._compare(f, name, x, y)
        assert at == len(out)

    def _compare(self, f: Prototype, name: str, x: Array, y: Array) -> None:
        assert x.shape == y.shape, (f.symbol, name)
        assert np.isfinite(y).all(), f"{f.symbol}: {name} of the NumPy module is not finite"
        columns = f.width if self.along(f, name) else 1
        x, y = x.reshape(-1, columns), y.reshape(-1, columns)
        error = np.abs(x - y).max(axis=0, initial=0.0)
        # what seeds leave open in a closed loop is nothing but rounding
        floor = 1.0 if name in ("dposition", "position") else 1e-2
        scale = np.maximum(np.abs(y).max(axis=0, initial=0.0), floor)
        assert (error <= TOLERANCE * scale).all(), (f.symbol, name, error, scale)


def parts(folder: Path) -> list[Part]:
    """The headers of a package."""
    manifest = read_manifest(folder)
    return [Part(folder, m) for m in (manifest, *manifest.get("others", ()))]
