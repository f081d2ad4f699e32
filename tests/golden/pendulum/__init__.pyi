"""Types of pendulum: the members of its solver, and the model's names in mappings."""

from pathlib import Path
from typing import Any, Literal, TypedDict

from numpy import float64
from numpy.typing import ArrayLike, NDArray

from ._runtime.errors import (
    AssemblyError as AssemblyError, CompileError as CompileError, NoCompilerError as NoCompilerError,
    PackageError as PackageError, SingularForceError as SingularForceError, SingularJointError as SingularJointError,
    SingularLoopError as SingularLoopError, SingularOutputError as SingularOutputError, TargetsDifferError as TargetsDifferError,
)
from ._runtime.state.derivatives import Jacobians as Jacobians
from ._runtime.state.derivatives import Gradients
from ._runtime.trust.diagnosis import Diagnosis

Array = NDArray[float64]

_Coordinates = TypedDict("_Coordinates", {
    "rod": ArrayLike,
}, total=False)
Coordinates = ArrayLike | _Coordinates | None

_Speeds = TypedDict("_Speeds", {
    "rod": ArrayLike,
}, total=False)
Speeds = ArrayLike | _Speeds | None

_Parameters = TypedDict("_Parameters", {
    "length": ArrayLike,
}, total=False)
Parameters = ArrayLike | _Parameters | None

class Solver:
    folder: Path
    name: str
    nq: int
    nu: int
    np: int
    ninputs: int
    noutputs: int
    coordinate_names: tuple[str, ...]
    speed_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    input_names: tuple[str, ...]
    signal_names: tuple[str, ...]
    moving_inputs: tuple[str, ...]
    output_names: tuple[str, ...]
    closure_names: tuple[str, ...]
    prescribed_names: tuple[str, ...]
    def __init__(self, target: Literal["c", "numpy", "both"] | None = None) -> None: ...
    @property
    def target(self) -> str: ...
    @property
    def parameters(self) -> Array: ...
    @property
    def batch_threads(self) -> int | None: ...
    @batch_threads.setter
    def batch_threads(self, threads: int | None) -> None: ...
    @property
    def bad_states(self) -> str: ...
    @bad_states.setter
    def bad_states(self, wanted: str) -> None: ...
    @property
    def independent_names(self) -> tuple[str, ...]: ...
    @property
    def independent_speed_names(self) -> tuple[str, ...]: ...
    @property
    def operations(self) -> dict[str, Any]: ...
    @property
    def initial(self) -> tuple[Array, Array]: ...
    @property
    def partitions(self) -> tuple[tuple[str, ...], ...]: ...
    @property
    def partition(self) -> int: ...
    def prepare(self, *members: str) -> None: ...
    def accelerations(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, out: Array | None = None
    ) -> Array: ...
    def sensitivities(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, dq: Coordinates = None, du: Speeds = None, dp: Parameters = None,
        dinputs: ArrayLike | None = None, dt: ArrayLike | None = None, out: tuple[Array, Array] | None = None
    ) -> tuple[Array, Array]: ...
    def initial_state(self, p: Parameters = None) -> tuple[Array, Array]: ...
    def initial_sensitivities(
        self, p: Parameters = None, *, dp: Parameters
    ) -> tuple[Array, Array, Array, Array]: ...
    def assemble(
        self, q: Coordinates = None, u: Speeds = None, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, follow: bool | None = None
    ) -> tuple[Array, Array]: ...
    def assemble_sensitivities(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, dq: Coordinates = None, du: Speeds = None, dp: Parameters = None,
        dinputs: ArrayLike | None = None, dt: ArrayLike | None = None, follow: bool | None = None
    ) -> tuple[Array, Array, Array, Array]: ...
    def closure(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> tuple[Array, Array]: ...
    def closure_sensitivities(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, dq: Coordinates = None, du: Speeds = None, dp: Parameters = None,
        dinputs: ArrayLike | None = None, dt: ArrayLike | None = None
    ) -> tuple[Array, Array]: ...
    def use_partition(self, partition: int) -> None: ...
    def condition(
        self, q: Coordinates, p: Parameters = None, inputs: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> Array: ...
    def diagnose(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, dq: Coordinates = None, du: Speeds = None, dp: Parameters = None,
        dinputs: ArrayLike | None = None, dt: ArrayLike | None = None, derivatives: bool = True
    ) -> Diagnosis: ...
    def gradients(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, weights: Speeds
    ) -> Gradients: ...
    def assemble_gradients(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, weights_q: Coordinates = None, weights_u: Speeds = None
    ) -> Gradients: ...
    def outputs(
        self, q: Coordinates, u: Speeds, p: Parameters = None, inputs: ArrayLike | None = None,
        t: ArrayLike = 0.0, *, out: Array | None = None
    ) -> Array: ...
    def in_precision(self, digits: int = 40, model: Any = None) -> Any: ...
