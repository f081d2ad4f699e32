"""Run time of a generated solver: compiles its C once, checks arguments, runs it on arrays.

This file is copied as it is into every generated package, where it needs NumPy, and cffi for the C target. The first
lines of a call are those of the Python side: shapes follow NumPy's broadcasting, directions come first.
"""

from __future__ import annotations

import contextlib
import difflib
import hashlib
import importlib.util
import json
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FLAGS = ("-std=gnu11", "-O2", "-march=native", "-fPIC", "-shared")
"""How C is compiled; ``ORDERNM_CFLAGS`` in the environment replaces them. Never -ffast-math."""


class CompileError(RuntimeError):
    """The C compiler refused the generated source; the message says where source and log are kept."""


class NoCompilerError(RuntimeError):
    """No C compiler was found."""


class SingularJointError(ValueError):
    """Nothing outboard of a joint has inertia about it, so its acceleration is not determined."""


class AssemblyError(ValueError):
    """A loop cannot be closed."""


# -- compiling ----------------------------------------------------------------------------------------------------------


def find_compiler() -> str:
    """The C compiler: ``CC`` of the environment, else cc, gcc or clang.

    Raises
    ------
    NoCompilerError
    """
    wanted = os.environ.get("CC")
    for name in [wanted] if wanted else ["cc", "gcc", "clang"]:
        path = shutil.which(name)
        if path:
            return path
    what = f"CC={wanted} is no program" if wanted else "none of cc, gcc, clang is on the PATH"
    raise NoCompilerError(
        f"no C compiler: {what}. Install one (gcc or clang) or set CC; until then the NumPy target serves, more slowly"
    )


def _processor() -> str:
    """What -march=native depends on."""
    features = platform.machine() + platform.processor()
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith(("flags", "Features", "model name")):
                features += line
                if line.startswith(("flags", "Features")):
                    break
    return features


def _user_cache() -> Path:
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ordernm"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ordernm"


def library_path(folder: Path, name: str, compiler: str, flags: Sequence[str]) -> Path:
    """Where the compiled library of a source belongs: its name says source, compiler, flags and processor."""
    key = hashlib.sha256()
    for file in (f"{name}.c", f"{name}.h", f"{name}_directions.h"):
        key.update((folder / file).read_bytes())
    status = os.stat(compiler)
    key.update(f"{os.path.realpath(compiler)} {status.st_size} {status.st_mtime_ns} {' '.join(flags)}".encode())
    key.update(_processor().encode())
    file_name = f"{name}-{key.hexdigest()[:16]}.so"
    return (folder if os.access(folder, os.W_OK) else _user_cache() / name) / file_name


def compile_library(folder: Path, name: str, force: bool = False) -> Path:
    """Compile ``<name>.c`` unless that has been done, and return the library.

    The library appears under its name only when it is complete, so several processes may build at once.

    Raises
    ------
    NoCompilerError, CompileError
    """
    compiler = find_compiler()
    given = os.environ.get("ORDERNM_CFLAGS")
    flags = [*given.split(), "-fPIC", "-shared"] if given else list(FLAGS)
    target = library_path(folder, name, compiler, flags)
    if target.exists() and not force:
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=f".{name}-", suffix=".so", dir=target.parent)
    os.close(handle)
    try:
        log = _run_compiler(compiler, flags, folder, name, temporary)
        if log is not None and "-march=native" in flags:
            log = _run_compiler(compiler, [f for f in flags if f != "-march=native"], folder, name, temporary)
        if log is not None:
            log_file = target.with_suffix(".log")
            log_file.write_text(log)
            first = "\n".join(log.splitlines()[:6])
            raise CompileError(f"{compiler} failed on {folder / (name + '.c')}; the whole log is {log_file}:\n{first}")
        os.chmod(temporary, 0o755)
        os.replace(temporary, target)
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
    return target


def _run_compiler(compiler: str, flags: Sequence[str], folder: Path, name: str, target: str) -> str | None:
    """Run the compiler; None if all went well, else what it said."""
    command = [compiler, *flags, "-o", target, str(folder / f"{name}.c"), "-lm"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    return None if result.returncode == 0 else f"{' '.join(command)}\n{result.stderr}{result.stdout}"


class CTarget:
    """The compiled functions of a solver, called through cffi in ABI mode (calls release the GIL)."""

    def __init__(self, folder: Path, manifest: Mapping[str, Any]):
        try:
            from cffi import FFI
        except ImportError as error:
            raise NoCompilerError("cffi is not installed; the C target needs it (pip install cffi)") from error
        self.manifest = manifest
        self.name: str = manifest["name"]
        self.ffi = FFI()
        self.ffi.cdef("\n".join(self._declarations()))
        path = compile_library(folder, self.name)
        try:
            self.library = self.ffi.dlopen(str(path))
        except OSError:
            path = compile_library(folder, self.name, force=True)  # built elsewhere, or damaged
            self.library = self.ffi.dlopen(str(path))
        self.path = path
        self._local = threading.local()
        self._functions: dict[str, Any] = {}

    def _declarations(self) -> list[str]:
        lines = []
        for name, f in self.manifest["functions"].items():
            inputs = [*f["arguments"], *f.get("seeds", ())]
            single = ["double t" if a == "t" else f"const double *{a}" for a in inputs]
            batch = ["long count", "long *failed", *(f"const double *{a}, long {a}_step" for a in inputs)]
            results = [*(f"double *{r}" for r in f["results"]), "double *work"]
            for width in f.get("widths") or (0,):
                symbol = f"{self.name}_{name}" + (f"_{width}" if width else "")
                lines.append(f"int {symbol}({', '.join(single + results)});")
                lines.append(f"int {symbol}_batch({', '.join(batch + results)});")
        return lines

    def workspace(self) -> Any:
        """This thread's workspace."""
        work = getattr(self._local, "work", None)
        if work is None:
            work = self._local.work = self.ffi.new("double[]", self.manifest["workspace"])
        return work

    def single(self, name: str, arguments: Sequence[Any], results: Sequence[Array]) -> None:
        """Run a function without directions on one state; arguments are contiguous arrays, ``t`` a float."""
        function = self._functions.get(name)
        if function is None:
            function = self._functions[name] = getattr(self.library, f"{self.name}_{name}")
        pointer = self.ffi.from_buffer
        status = function(
            *[a if type(a) is float else pointer("double[]", a) for a in arguments],
            *[pointer("double[]", r) for r in results],
            self.workspace(),
        )
        if status:
            self._singular(status, 0, 1)

    def run(
        self, name: str, arguments: list[Array], seeds: list[Array], sizes: list[int], k: int, batch: int
    ) -> list[Array]:
        """Run a function on a batch.

        Parameters
        ----------
        arguments : list of (batch, n) arrays
            ``t`` is (batch,). One that is the same for all states may be (1, n).
        seeds : list of (k, batch, n) arrays
        sizes : list of int
            Length of every result.

        Returns
        -------
        list of (batch, n) arrays, derivatives (k, batch, n)
        """
        spec = self.manifest["functions"][name]
        if not spec.get("widths"):
            results = [np.empty((batch, n)) for n in sizes]
            self._batch(name, arguments, results, batch)
            return results
        derived = [r.startswith("d") for r in spec["results"]]
        results = [np.empty((k, batch, n) if d else (batch, n)) for n, d in zip(sizes, derived, strict=True)]
        start = 0
        for width in split(k, spec["widths"]):
            m = min(width, k - start)
            lanes = []
            for s in seeds:
                lane = np.zeros((s.shape[1], s.shape[2], width))
                lane[:, :, :m] = s[start : start + m].transpose(1, 2, 0)
                lanes.append(lane)
            pieces = [np.empty((batch, n, width)) if d else r for n, d, r in zip(sizes, derived, results, strict=True)]
            self._batch(f"{name}_{width}", [*arguments, *lanes], pieces, batch)
            for piece, result, d in zip(pieces, results, derived, strict=True):
                if d:
                    result[start : start + m] = piece[:, :, :m].transpose(2, 0, 1)
            start += m
        return results

    def _batch(self, symbol: str, arguments: Sequence[Array], results: Sequence[Array], batch: int) -> None:
        function = self._functions.get(symbol + "_batch")
        if function is None:
            function = self._functions[symbol + "_batch"] = getattr(self.library, f"{self.name}_{symbol}_batch")
        pointer = self.ffi.from_buffer
        given: list[Any] = []
        for a in arguments:
            given += [pointer("double[]", a), a.size // len(a) if len(a) > 1 else 0]
        failed = self.ffi.new("long *")
        status = function(batch, failed, *given, *(pointer("double[]", r) for r in results), self.workspace())
        if status:
            self._singular(status, failed[0], batch)

    def _singular(self, status: int, state: int, batch: int) -> None:
        link = self.manifest["links"][status - 1]
        where = f" (state {state} of the batch)" if batch > 1 else ""
        raise SingularJointError(
            f"joint {link!r}: nothing outboard of it has inertia about it{where}, so its acceleration is not "
            "determined; give its body, or one that it carries, mass or inertia"
        )


def split(k: int, widths: Sequence[int]) -> list[int]:
    """Widths that cover k directions: eights, then the narrowest that covers the rest."""
    widest = max(widths)
    rest = k % widest
    parts = [widest] * (k // widest)
    if rest:
        parts.append(min((w for w in widths if w >= rest), default=widest))
    return parts


class NumpyTarget:
    """The generated NumPy module."""

    def __init__(self, folder: Path, manifest: Mapping[str, Any]):
        self.manifest = manifest
        name = f"{manifest['name']}_numpy"
        spec = importlib.util.spec_from_file_location(f"_ordernm_{name}_{abs(hash(str(folder)))}", folder / f"{name}.py")
        assert spec is not None and spec.loader is not None
        self.module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.module)

    def run(
        self, name: str, arguments: list[Array], seeds: list[Array], sizes: list[int], k: int, batch: int
    ) -> list[Array]:
        """As `CTarget.run`."""
        spec = self.manifest["functions"][name]
        given = [s[..., 0] if n == "dt" else s for s, n in zip(seeds, spec.get("seeds", ()), strict=True)]
        try:
            results = getattr(self.module, name)(*arguments, *given)
        except ValueError as error:
            if type(error).__name__ == "SingularJointError":
                raise SingularJointError(str(error)) from None
            raise
        out = []
        for r, n, result in zip(results, sizes, spec["results"], strict=True):
            derived = bool(seeds) and result.startswith("d")
            r = np.asarray(r).reshape(*((k, -1) if derived else (-1,)), n)
            out.append(np.ascontiguousarray(np.broadcast_to(r, (k, batch, n) if derived else (batch, n))))
        return out


# -- the solver ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Jacobians:
    """Partial derivatives of udot.

    Attributes
    ----------
    q : (..., nu, nq), u : (..., nu, nu), p : (..., nu, np), inputs : (..., nu, ninputs), t : (..., nu)
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array


class Solver:
    """A generated solver; see the methods. Thread-safe.

    Parameters
    ----------
    folder : path
        The generated package.
    target : {"c", "numpy", "both"}, optional
        Which code computes; left out: what the package was generated for. With "both" the two are compared first.

    Notes
    -----
    Leading axes of q, u, p, inputs and t are batch axes and broadcast. Seeds have their k directions first. Missing p are
    the defaults, missing inputs and seeds are zero. All in SI units and radians.
    """

    def __init__(self, folder: str | os.PathLike[str], target: str | None = None):
        self.folder = Path(folder)
        self._manifest: dict[str, Any] = json.loads((self.folder / "model.json").read_text(encoding="utf-8"))
        m = self._manifest
        self.name: str = m["name"]
        self.coordinate_names = tuple(m["coordinate_names"])
        self.speed_names = tuple(m["speed_names"])
        self.parameter_names = tuple(m["parameter_names"])
        self.input_names = tuple(m["input_names"])
        self.output_names = tuple(m["output_names"])
        self.closure_names = tuple(m["closure_names"])
        self.prescribed_names = tuple(m["prescribed_names"])
        self.independent_names = self.coordinate_names
        self.independent_speed_names = self.speed_names
        self.nq, self.nu, self.np = len(self.coordinate_names), len(self.speed_names), len(self.parameter_names)
        self.ninputs, self.noutputs = len(self.input_names), len(self.output_names)
        nu = self.nu
        self._sizes = {
            "q": self.nq, "u": nu, "p": self.np, "inputs": self.ninputs, "t": 1, "udot": nu, "qdot": self.nq, "b": nu,
            "x": nu, "force": nu, "energy": 2, "outputs": self.noutputs, "M": nu * nu, "J_q": nu * self.nq,
            "J_u": nu * nu, "J_p": nu * self.np, "J_inputs": nu * self.ninputs, "J_t": nu,
        }  # fmt: skip
        self._defaults = np.array(m["parameters"], dtype=float)
        self._no_inputs = np.zeros(self.ninputs)
        target = target or m.get("target", "c")
        if target not in ("c", "numpy", "both"):
            raise ValueError(f"target is {target!r}; allowed are 'c', 'numpy' and 'both'")
        self.target = target
        self._target: CTarget | NumpyTarget
        if target == "numpy":
            self._target = NumpyTarget(self.folder, m)
        else:
            try:
                self._target = CTarget(self.folder, m)
            except NoCompilerError as error:
                if target == "both":
                    raise
                warnings.warn(f"{self.name}: {error}; using {self.name}_numpy.py", RuntimeWarning, stacklevel=2)
                self._target = NumpyTarget(self.folder, m)
                self.target = "numpy"
        if target == "both":
            self._compare(NumpyTarget(self.folder, m))

    def __repr__(self) -> str:
        return f"<Solver {self.name}: nq={self.nq} nu={self.nu} np={self.np} ninputs={self.ninputs} target={self.target}>"

    # -- what the model is ---------------------------------------------------------------------------------------------

    @property
    def parameters(self) -> Array:
        """Default design parameters, (np,)."""
        return self._defaults.copy()

    @property
    def initial(self) -> tuple[Array, Array]:
        """The model's initial state (q, u) at the default parameters."""
        return np.array(self._manifest["initial"]["q"], float), np.array(self._manifest["initial"]["u"], float)

    @property
    def operations(self) -> dict[str, Any]:
        """Additions, multiplications, divisions and functions of every sweep, per call and per direction."""
        return json.loads(json.dumps(self._manifest["operations"]))

    # -- checking arguments --------------------------------------------------------------------------------------------

    def _array(self, name: str, value: ArrayLike, n: int, scalar: bool = False) -> Array:
        if isinstance(value, np.ndarray) and value.dtype == np.float64:
            array = value
        else:
            try:
                array = np.asarray(value, dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise ValueError(f"{name}: {error}; expected an array of numbers of shape {_shape(n, scalar)}") from None
        if not scalar and (array.ndim == 0 or array.shape[-1] != n):
            raise ValueError(f"{name} has shape {array.shape}; expected {_shape(n, scalar)}, as many as {self._names(name)}")
        if not np.isfinite(array).all():
            place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            raise ValueError(f"{name}[{', '.join(map(str, place))}] is {array[place]}; expected finite numbers")
        return array

    def _names(self, name: str) -> str:
        kind = name[1:] if name.startswith("d") and name[1:] in self._sizes else name
        found = {"q": "coordinate_names", "p": "parameter_names", "inputs": "input_names"}.get(kind, "speed_names")
        return f"{found} ({len(getattr(self, found))})"

    def _parameters(self, p: ArrayLike | Mapping[str, float] | None) -> Array:
        if p is None:
            return self._defaults
        if isinstance(p, Mapping):
            values = self._defaults.copy()
            for name, value in p.items():
                if name not in self.parameter_names:
                    near = difflib.get_close_matches(name, self.parameter_names, 1)
                    hint = f"; did you mean {near[0]!r}?" if near else ""
                    raise ValueError(f"p: no parameter {name!r}{hint} The model has {', '.join(self.parameter_names)}")
                values[self.parameter_names.index(name)] = value
            p = values
        return self._array("p", p, self.np)

    def _state(self, given: dict[str, Any]) -> dict[str, Array]:
        arrays: dict[str, Array] = {}
        for name, value in given.items():
            if name == "p":
                arrays[name] = self._parameters(value)
            elif name == "inputs":
                arrays[name] = np.zeros(self.ninputs) if value is None else self._array(name, value, self.ninputs)
            elif name == "t":
                arrays[name] = self._array(name, value, 1, scalar=True)
            else:
                arrays[name] = self._array(name, value, self._sizes[name])
        if "q" in arrays:
            for i in self._manifest["quaternions"]:
                norm = np.sqrt((arrays["q"][..., i : i + 4] ** 2).sum(-1))
                if np.any(norm < 1e-6):
                    names = ", ".join(self.coordinate_names[i : i + 4])
                    raise ValueError(f"q: the quaternion ({names}) has length {norm.min():.3g}; expected at least 1e-6")
        return arrays

    # -- running -------------------------------------------------------------------------------------------------------

    def _run(
        self, name: str, given: dict[str, Any], seeds: dict[str, Any] | None = None, flat: Callable[..., Any] | None = None
    ) -> list[Array]:
        if seeds is None and isinstance(self._target, CTarget):
            fast = self._single(name, given)
            if fast is not None:
                return fast
        spec = self._manifest["functions"].get(name)
        if spec is None:
            raise ValueError(f"this solver has no function {name!r}; it has {', '.join(self._manifest['functions'])}")
        arrays = self._state(given)
        k = 0
        directions: dict[str, Array] = {}
        if seeds is not None:
            for key, value in seeds.items():
                if value is None:
                    continue
                n = self._sizes[key[1:]]
                seed = self._array(key, value, n, scalar=key == "dt")
                if seed.ndim == (0 if key == "dt" else 1):
                    seed = seed[None]
                directions[key] = seed
            if not directions:
                raise ValueError(f"no seed given; give at least one of {', '.join(seeds)}, directions first: dq (k, ..., nq)")
            counts = {key: len(v) for key, v in directions.items()}
            k = max(counts.values())
            if any(c not in (1, k) for c in counts.values()):
                raise ValueError(f"the seeds have different numbers of directions: {counts}; expected the same k for all")
        batch = self._batch(arrays, directions)
        count = int(np.prod(batch, dtype=int))
        arguments = []
        for a in spec["arguments"]:
            x = arrays[a]
            if a == "t":
                arguments.append(np.ascontiguousarray(np.broadcast_to(x, batch).reshape(count) if x.ndim else x.reshape(1)))
            elif x.ndim == 1:
                arguments.append(np.ascontiguousarray(x[None]))
            else:
                n = x.shape[-1]
                arguments.append(np.ascontiguousarray(np.broadcast_to(x, (*batch, n)).reshape(count, n)))
        lanes = []
        for s in spec.get("seeds", ()):
            n = self._sizes[s[1:]]
            seed = directions.get(s)
            if seed is None:
                lanes.append(np.zeros((k, 1, n)))
                continue
            if s == "dt":
                seed = seed[..., None]
            if seed.ndim == 2:
                lanes.append(np.broadcast_to(seed, (k, n))[:, None])
                continue
            inner = seed.shape[1:-1]
            seed = seed.reshape(len(seed), *(1,) * (len(batch) - len(inner)), *inner, n)
            lanes.append(np.ascontiguousarray(np.broadcast_to(seed, (k, *batch, n)).reshape(k, count, n)))
        sizes = [self._sizes[r[1:] if lanes and r.startswith("d") else r] for r in spec["results"]]
        if count == 0:
            results = [
                np.zeros((k, 0, n) if lanes and r.startswith("d") else (0, n))
                for n, r in zip(sizes, spec["results"], strict=True)
            ]
        else:
            results = self._target.run(name, arguments, lanes, sizes, k, count)
        out = []
        for r, result in zip(results, spec["results"], strict=True):
            lead = (k, *batch) if lanes and result.startswith("d") else batch
            out.append(r.reshape(*lead, r.shape[-1]))
        return out

    def _single(self, name: str, given: dict[str, Any]) -> list[Array] | None:
        """One state in plain arrays, the common case of an integrator: the same checks in fewer steps. None: not that case."""
        spec = self._manifest["functions"].get(name)
        if spec is None:
            return None
        arguments: list[Any] = []
        for a in spec["arguments"]:
            value = given[a]
            if value is None:
                value = self._defaults if a == "p" else self._no_inputs
            elif a == "t":
                if not isinstance(value, (int, float)) or not math.isfinite(value):
                    return None
                arguments.append(float(value))
                continue
            elif type(value) is not np.ndarray or value.dtype != np.float64 or value.shape != (self._sizes[a],):
                return None
            elif not value.flags.c_contiguous or not math.isfinite(np.add.reduce(value)):
                return None
            arguments.append(value)
        if len(arguments) != len(given) and any(
            given[a] is not None and a not in spec["arguments"] and not (a == "t" and given[a] == 0.0) for a in given
        ):
            return None
        for i in self._manifest["quaternions"]:
            e = given["q"][i : i + 4] if "q" in given else None
            if e is not None and float(e @ e) < 1e-12:
                return None
        results = [np.empty(self._sizes[r]) for r in spec["results"]]
        assert isinstance(self._target, CTarget)
        self._target.single(name, arguments, results)
        return results

    def _batch(self, arrays: dict[str, Array], directions: dict[str, Array]) -> tuple[int, ...]:
        shapes = {a: x.shape if a == "t" else x.shape[:-1] for a, x in arrays.items()}
        shapes |= {s: x.shape[1:] if s == "dt" else x.shape[1:-1] for s, x in directions.items()}
        try:
            return np.broadcast_shapes(*shapes.values())
        except ValueError:
            seen = ", ".join(f"{n} {s}" for n, s in shapes.items() if s)
            raise ValueError(f"the leading (batch) axes do not broadcast: {seen}") from None

    def _matrix(self, x: Array, columns: int) -> Array:
        return x.reshape(*x.shape[:-1], self.nu, columns)

    # -- dynamics ------------------------------------------------------------------------------------------------------

    def accelerations(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> Array:
        """Time derivatives of the speeds (Eqs. 18-24, 42-56).

        Parameters
        ----------
        q : (..., nq), u : (..., nu), p : (..., np), optional, inputs : (..., ninputs), optional, t : (...)

        Returns
        -------
        udot : (..., nu)

        Raises
        ------
        ValueError
            Wrong shape, a number that is not finite, a quaternion without length.
        SingularJointError
            Nothing outboard of a joint has inertia about it.
        """
        return self._run("accelerations", {"q": q, "u": u, "p": p, "inputs": inputs, "t": t})[0]

    def sensitivities(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0, *,
        dq: ArrayLike | None = None, du: ArrayLike | None = None, dp: ArrayLike | None = None,
        dinputs: ArrayLike | None = None, dt: ArrayLike | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Accelerations and their total derivative along seeds (Eqs. 9, 10), exact to rounding, in O(n) per direction.

        Parameters
        ----------
        dq : (k, ..., nq), du : (k, ..., nu), dp : (k, ..., np), dinputs : (k, ..., ninputs), dt : (k, ...)
            At least one; the others are zero.

        Returns
        -------
        udot : (..., nu), dudot : (k, ..., nu)
        """
        given = {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}
        udot, dudot = self._run("sensitivities", given, {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt})
        return udot, dudot

    def jacobians(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> Jacobians:
        """Partial derivatives of udot with respect to q, u, p, inputs and t."""
        results = self._run("jacobians", {"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
        found = dict(zip(self._manifest["functions"]["jacobians"]["results"], results, strict=True))
        batch = results[0].shape[:-1]
        columns = {"q": self.nq, "u": self.nu, "p": self.np, "inputs": self.ninputs}
        J = {
            n: self._matrix(found[f"J_{n}"], c) if f"J_{n}" in found else np.zeros((*batch, self.nu, c))
            for n, c in columns.items()
        }
        return Jacobians(**J, t=found.get("J_t", np.zeros((*batch, self.nu))))

    def coordinate_rates(self, q: ArrayLike, u: ArrayLike, p: Any = None, t: ArrayLike = 0.0) -> Array:
        """Time derivatives of the coordinates, (..., nq) (Eq. 1)."""
        return self._run("coordinate_rates", {"q": q, "u": u, "p": p, "t": t})[0]

    def coordinate_rate_sensitivities(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, t: ArrayLike = 0.0, *,
        dq: ArrayLike | None = None, du: ArrayLike | None = None, dp: ArrayLike | None = None, dt: ArrayLike | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """qdot (..., nq) and its total derivative (k, ..., nq) along seeds."""
        given = {"q": q, "u": u, "p": p, "t": t}
        qdot, dqdot = self._run("coordinate_rate_sensitivities", given, {"dq": dq, "du": du, "dp": dp, "dt": dt})
        return qdot, dqdot

    def mass_matrix(self, q: ArrayLike, p: Any = None) -> Array:
        """Mass matrix, (..., nu, nu)."""
        return self._matrix(self._run("mass_matrix", {"q": q, "p": p})[0], self.nu)

    def mass_matrix_sensitivities(
        self, q: ArrayLike, p: Any = None, *, dq: ArrayLike | None = None, dp: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """M (..., nu, nu) and its total derivative (k, ..., nu, nu) along seeds."""
        M, dM = self._run("mass_matrix_sensitivities", {"q": q, "p": p}, {"dq": dq, "dp": dp})
        return self._matrix(M, self.nu), self._matrix(dM, self.nu)

    def solve_mass(self, q: ArrayLike, b: ArrayLike, p: Any = None) -> Array:
        """Solution x (..., nu) of M x = b in O(n)."""
        return self._run("solve_mass", {"q": q, "b": b, "p": p})[0]

    def solve_mass_sensitivities(
        self, q: ArrayLike, b: ArrayLike, p: Any = None, *,
        dq: ArrayLike | None = None, db: ArrayLike | None = None, dp: ArrayLike | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """x (..., nu) of M x = b and its total derivative (k, ..., nu) along seeds."""
        x, dx = self._run("solve_mass_sensitivities", {"q": q, "b": b, "p": p}, {"dq": dq, "db": db, "dp": dp})
        return x, dx

    def inverse_dynamics(
        self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> Array:
        """Joint forces (..., nu) that udot needs beside the model's own: M udot - K."""
        return self._run("inverse_dynamics", {"q": q, "u": u, "udot": udot, "p": p, "inputs": inputs, "t": t})[0]

    def inverse_dynamics_sensitivities(
        self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0, *,
        dq: ArrayLike | None = None, du: ArrayLike | None = None, dudot: ArrayLike | None = None,
        dp: ArrayLike | None = None, dinputs: ArrayLike | None = None, dt: ArrayLike | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Those forces and their total derivative (k, ..., nu) along seeds."""
        given = {"q": q, "u": u, "udot": udot, "p": p, "inputs": inputs, "t": t}
        seeds = {"dq": dq, "du": du, "dudot": dudot, "dp": dp, "dinputs": dinputs, "dt": dt}
        force, dforce = self._run("inverse_dynamics_sensitivities", given, seeds)
        return force, dforce

    def bias_force(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> Array:
        """-K (..., nu): the inverse dynamics at udot = 0."""
        return self.inverse_dynamics(q, u, np.zeros(self.nu), p, inputs, t)

    def energies(self, q: ArrayLike, u: ArrayLike, p: Any = None, t: ArrayLike = 0.0) -> tuple[Array, Array]:
        """Kinetic and potential energy, (...) each, J; the potential energy of gravity is zero at the ground's origin."""
        energy = self._run("energies", {"q": q, "u": u, "p": p, "t": t})[0]
        return energy[..., 0], energy[..., 1]

    def energy_sensitivities(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, t: ArrayLike = 0.0, *,
        dq: ArrayLike | None = None, du: ArrayLike | None = None, dp: ArrayLike | None = None, dt: ArrayLike | None = None,
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:  # fmt: skip
        """(kinetic, potential) and their total derivatives (k, ...) along seeds."""
        seeds = {"dq": dq, "du": du, "dp": dp, "dt": dt}
        e, de = self._run("energy_sensitivities", {"q": q, "u": u, "p": p, "t": t}, seeds)
        return (e[..., 0], e[..., 1]), (de[..., 0], de[..., 1])

    def outputs(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> Array:
        """The model's outputs, (..., noutputs), in the order of `output_names`."""
        if not self.noutputs:
            arrays = self._state({"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
            return np.zeros((*self._batch(arrays, {}), 0))
        return self._run("outputs", {"q": q, "u": u, "p": p, "inputs": inputs, "t": t})[0]

    def output_sensitivities(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0, *,
        dq: ArrayLike | None = None, du: ArrayLike | None = None, dp: ArrayLike | None = None,
        dinputs: ArrayLike | None = None, dt: ArrayLike | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Outputs and their total derivative (k, ..., noutputs) along seeds."""
        if not self.noutputs:
            udot, dudot = self.sensitivities(q, u, p, inputs, t, dq=dq, du=du, dp=dp, dinputs=dinputs, dt=dt)
            return udot[..., :0], dudot[..., :0]
        given = {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}
        seeds = {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}
        values, dvalues = self._run("output_sensitivities", given, seeds)
        return values, dvalues

    # -- states ----------------------------------------------------------------------------------------------------------

    def assemble(self, q: ArrayLike | None = None, u: ArrayLike | None = None, p: Any = None) -> tuple[Array, Array]:
        """A state that satisfies the model's constraints: quaternions of length one. What is left out is the model's."""
        start = self.initial
        arrays = self._state({"q": start[0] if q is None else q, "u": start[1] if u is None else u, "p": p})
        q_out = arrays["q"].copy()
        for i in self._manifest["quaternions"]:
            q_out[..., i : i + 4] /= np.sqrt((q_out[..., i : i + 4] ** 2).sum(-1, keepdims=True))
        return q_out, arrays["u"].copy()

    def assemble_sensitivities(
        self, q: ArrayLike, u: ArrayLike, p: Any = None, *,
        dq: ArrayLike | None = None, du: ArrayLike | None = None, dp: ArrayLike | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """The assembled state and its seeds: q, u, dq (k, ..., nq), du (k, ..., nu)."""
        q_out, u_out = self.assemble(q, u, p)
        given = {"dq": dq, "du": du, "dp": dp}
        seeds = {n: self._array(n, v, self._sizes[n[1:]]) for n, v in given.items() if v is not None}
        if not seeds:
            raise ValueError("no seed given; give at least one of dq, du, dp")
        seeds = {n: s[None] if s.ndim == 1 else s for n, s in seeds.items()}
        k = max(len(s) for s in seeds.values())
        batch = self._batch({"q": q_out, "u": u_out}, seeds)
        dq_out = np.broadcast_to(seeds.get("dq", np.zeros((k, self.nq))), (k, *batch, self.nq)).copy()
        du_out = np.broadcast_to(seeds.get("du", np.zeros((k, self.nu))), (k, *batch, self.nu)).copy()
        raw = np.asarray(q, dtype=float)
        for i in self._manifest["quaternions"]:
            length = np.sqrt((raw[..., i : i + 4] ** 2).sum(-1, keepdims=True))
            e = q_out[..., i : i + 4]
            de = dq_out[..., i : i + 4] / length
            dq_out[..., i : i + 4] = de - e * (e * de).sum(-1, keepdims=True)
        return q_out, u_out, dq_out, du_out

    def closure(self, q: ArrayLike, u: ArrayLike, p: Any = None) -> tuple[Array, Array]:
        """Residuals of the loops at position and velocity level, in the order of `closure_names`."""
        arrays = self._state({"q": q, "u": u, "p": p})
        shape = (*self._batch(arrays, {}), len(self.closure_names))
        return np.zeros(shape), np.zeros(shape)

    # -- both targets ----------------------------------------------------------------------------------------------------

    def _compare(self, other: NumpyTarget) -> None:
        """Compare the two targets at random states; they print the same statements, so only rounding may differ."""
        rng = np.random.default_rng(0)
        own = self._target
        for _ in range(3):
            q = np.array(self._manifest["initial"]["q"]) + 0.3 * rng.normal(size=self.nq)
            u, dq, du = rng.normal(size=self.nu), rng.normal(size=(2, self.nq)), rng.normal(size=(2, self.nu))
            dp = 0.1 * rng.normal(size=(2, self.np))
            results = []
            for target in (own, other):
                self._target = target
                results.append(self.sensitivities(q, u, dq=dq, du=du, dp=dp))
            self._target = own
            for a, b in zip(*results, strict=True):
                error = np.max(np.abs(a - b), initial=0.0)
                if not error <= 1e-9 * max(1e-3, float(np.max(np.abs(b), initial=0.0))):
                    raise RuntimeError(f"{self.name}: the C and the NumPy target differ by {error:.3g}; please report this")


def _shape(n: int, scalar: bool) -> str:
    return "(...)" if scalar else f"(..., {n})"
