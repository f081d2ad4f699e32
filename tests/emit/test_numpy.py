"""The generated NumPy module: against the reference engine, batches against single states, and its requirements."""

from __future__ import annotations

import hashlib
import inspect
import itertools
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from random_models import expression, random_seeds, random_state, random_tree, relative_error, vector

from codegen.model.model import GROUND, Body, Joint, JointForce, Model, Parameter
from codegen.pipeline import Source, write_solver
from codegen.reference import RecursiveEngine

Array = np.ndarray
TOLERANCE = 1e-11
SEEDS = ("dq", "du", "dp", "dinputs", "dt")

pytestmark = pytest.mark.filterwarnings("error")


def module(source: Source) -> ModuleType:
    """The generated module, executed."""
    name = f"{source.manifest['name']}_numpy"
    made = ModuleType(name)
    exec(compile(source.files[f"{name}.py"], name, "exec"), made.__dict__)
    return made


def generated(model: Model, layout: str = "kinds", functions: Any = None) -> tuple[Source, ModuleType]:
    source = write_solver(model, layout, functions=functions)
    return source, module(source)


def chain(axes: str) -> Model:
    """A chain of rods on revolute joints about the named axes; their length is the parameter."""
    one = {"x": vector(1, 0, 0), "y": vector(0, 1, 0), "z": vector(0, 0, 1)}
    mass, com, at, ground = expression("1.2*L"), vector("0.1", 0, "-L/2"), vector(0, 0, "-L"), vector(0, 0, 0)
    xx, zz, zero = expression("L**3/12"), expression("L*0.01"), expression(0)
    inertia = (xx, xx, zz, zero, zero, zero)
    bodies = tuple(
        Body(f"link_{k}", k - 1, Joint("revolute", (one[axis],), ground if k == 0 else at), mass, com, inertia)
        for k, axis in enumerate(axes)
    )
    return Model("chain", vector(0, 0, -9.81), (Parameter("L", 1.0),), (), bodies)


def given(source: Source, rng: np.random.Generator, k: int) -> dict[str, Any]:
    """A state, seeds, and the other arguments of the functions."""
    model = source.system.model
    nu = model.nu
    return {
        **random_state(rng, model)._asdict(), **random_seeds(rng, model, k),
        "udot": rng.normal(size=nu), "dudot": rng.normal(size=(k, nu)),
        "b": rng.normal(size=nu), "db": rng.normal(size=(k, nu)), "dqdot": rng.normal(size=(k, model.nq)),
        "denergy": rng.normal(size=(k, 2)), "doutputs": rng.normal(size=(k, len(model.outputs))),
    }  # fmt: skip


def call(source: Source, made: ModuleType, function: str, values: dict[str, Any]) -> dict[str, Array]:
    """The results of a call by name."""
    spec = source.manifest["functions"][function]
    results = getattr(made, function)(*(values[n] for n in [*spec["arguments"], *spec.get("seeds", ())]))
    return dict(zip(spec["results"], results, strict=True))


def reference(model: Model, x: dict[str, Any]) -> dict[str, tuple[str, Array, Array]]:
    """For each function over directions: the name of its result, the value and derivatives from the reference engine."""
    engine = RecursiveEngine(model)
    q, u, p, inputs, t = (x[n] for n in ("q", "u", "p", "inputs", "t"))
    seeds = {n: x[n] for n in SEEDS}
    dq, du, dp = x["dq"], x["du"], x["dp"]
    energy, denergy = engine.energy_sensitivities(q, u, p, inputs, t, dq=dq, du=du, dp=dp)
    rates = engine.coordinate_rate_sensitivities(q, u, p, inputs, t, dq=dq, du=du)
    inverse = engine.inverse_dynamics_sensitivities(q, u, x["udot"], p, inputs, t, dudot=x["dudot"], **seeds)
    found = {
        "sensitivities": ("udot", *engine.sensitivities(q, u, p, inputs, t, **seeds)),
        "coordinate_rate_sensitivities": ("qdot", *rates),
        "mass_matrix_sensitivities": ("M", *engine.mass_matrix_sensitivities(q, p, dq=dq, dp=dp)),
        "solve_mass_sensitivities": ("x", *engine.solve_mass_sensitivities(q, x["b"], p, dq=dq, dp=dp, db=x["db"])),
        "inverse_dynamics_sensitivities": ("force", *inverse),
        "energy_sensitivities": ("energy", np.array(energy), np.stack(denergy, -1)),
    }
    if model.outputs:
        found["output_sensitivities"] = ("outputs", *engine.output_sensitivities(q, u, p, inputs, t, **seeds))
    return found


VALUES = {
    "sensitivities": "accelerations", "coordinate_rate_sensitivities": "coordinate_rates",
    "mass_matrix_sensitivities": "mass_matrix", "solve_mass_sensitivities": "solve_mass",
    "inverse_dynamics_sensitivities": "inverse_dynamics", "energy_sensitivities": "energies",
    "output_sensitivities": "outputs",
}  # fmt: skip
"""The function of the value alone, by the function over directions."""


def flat(x: Array, k: int) -> Array:
    return np.reshape(x, (k, -1))


def check_against_reference(model: Model, layout: str, rng: np.random.Generator, k: int = 3) -> None:
    compared = (*VALUES, *VALUES.values(), "jacobians")
    source, made = generated(model, layout, [f for f in compared if model.outputs or "output" not in f])
    x = given(source, rng, k)
    for function, (name, value, derivative) in reference(model, x).items():
        both = call(source, made, function, x)
        alone = call(source, made, VALUES[function], x)
        assert both[name].shape == alone[name].shape == value.shape, function
        assert both[f"d{name}"].shape == derivative.shape, function
        assert relative_error(flat(alone[name], 1), flat(value, 1)) < TOLERANCE, VALUES[function]
        assert relative_error(flat(both[name], 1), flat(value, 1)) < TOLERANCE, function
        assert relative_error(flat(both[f"d{name}"], k), flat(derivative, k)) < TOLERANCE, function
    J = RecursiveEngine(model).jacobians(*(x[n] for n in ("q", "u", "p", "inputs", "t")))
    for name, columns in call(source, made, "jacobians", x).items():
        if name != "udot":
            expected = getattr(J, name.removeprefix("J_"))
            assert columns.shape == expected.shape
            by_direction = (np.reshape(y, (model.nu, -1)).T for y in (columns, expected))
            assert relative_error(*by_direction) < TOLERANCE, name


@pytest.mark.parametrize("seed", [*range(8), *(pytest.param(i, marks=pytest.mark.campaign) for i in range(8, 12))])
def test_every_function_is_the_reference_engines(seed: int) -> None:
    rng = np.random.default_rng([7, seed])
    model = random_tree(rng, 1 + seed % 8, parameters=seed % 5 != 4, forces=seed % 4 != 3)
    check_against_reference(model, "unrolled" if seed % 3 == 2 else "kinds", rng)


def test_links_of_few_kinds_in_no_order() -> None:
    """Sweeps that choose the function of every link by its kind."""
    rng = np.random.default_rng(0)
    model = chain("".join(rng.choice(list("xxyz"), 70)))
    assert "match link[i][LINK_KIND]" in write_solver(model, "kinds").files["chain_numpy.py"]
    check_against_reference(model, "kinds", rng, 2)


@pytest.mark.parametrize("seed", range(3))
def test_batches_are_single_states(seed: int) -> None:
    """Leading axes broadcast: every argument has others of them, seeds too."""
    rng = np.random.default_rng([8, seed])
    model = random_tree(rng, 5)
    source, made = generated(model)
    batch, k = (2, 3), 2
    axes = {
        "q": (2, 1),
        "u": (3,),
        "p": (),
        "inputs": (2, 3),
        "t": (3,),
        "udot": (2, 1),
        "b": (),
        "qdot": (3,),
        "energy": (),
        "outputs": (2, 1),
    }
    base = given(source, rng, k)
    split = {
        n: ((k,), axes[n[1:]], np.shape(v)[1:]) if n.startswith("d") else ((), axes[n], np.shape(v))
        for n, v in base.items()
    }  # directions, leading axes, own axes
    x: dict[str, Any] = {}
    for name, (lanes, leading, own) in split.items():
        value = np.reshape(base[name], (*lanes, *(1 for _ in leading), *own))
        x[name] = value + 0.1 * rng.normal(size=(*lanes, *leading, *own))

    def one(name: str, at: tuple[int, ...]) -> Array:
        """An argument for one state of the batch."""
        lanes, leading, own = split[name]
        full = x[name].reshape(*lanes, *(1 for _ in batch[len(leading) :]), *leading, *own)
        full = np.broadcast_to(full, (*lanes, *batch, *own))
        return full[:, *at] if lanes else full[at]

    for function in source.manifest["functions"]:
        together = call(source, made, function, x)
        spec = source.manifest["functions"][function]
        taken = [axes[n] for n in spec["arguments"]] + [axes[n[1:]] for n in spec.get("seeds", ())]
        shape = np.broadcast_shapes(*taken)
        for at in itertools.product(*map(range, batch)):
            single = call(source, made, function, {n: one(n, at) for n in x})
            for name, value in single.items():
                lanes = bool(spec.get("seeds")) and name.startswith("d")
                found = together[name]
                assert found.shape == value.shape[: int(lanes)] + shape + value.shape[int(lanes) :], (function, name)
                here = tuple(min(i, n - 1) for i, n in zip(at[2 - len(shape) :], shape, strict=True))
                found = found[:, *here] if lanes else found[here]
                np.testing.assert_allclose(found, value, rtol=1e-12, atol=1e-12 * max(1, abs(value).max(initial=0)))


def test_columns_of_matrices_some_at_a_time() -> None:
    rng = np.random.default_rng(3)
    source, made = generated(random_tree(rng, 6))
    x = given(source, rng, 2)
    functions = ("jacobians", "mass_matrix", "mass_matrix_sensitivities")
    whole = [call(source, made, f, x) for f in functions]
    made.COLUMNS = 3
    for f, expected in zip(functions, whole, strict=True):
        for name, value in call(source, made, f, x).items():
            np.testing.assert_allclose(value, expected[name], rtol=1e-13, atol=1e-13)


def test_arguments_are_those_of_the_manifest() -> None:
    one, zero = expression(1), expression(0)
    turn = Joint("revolute", (vector(0, 1, 0),), vector(0, 0, 0))
    only = Body("only", GROUND, turn, one, vector(0, 0, "-0.5"), (one,) * 3 + (zero,) * 3)
    bare = Model("bare", None, (), (), (only,))
    full = random_tree(np.random.default_rng(11), 4)
    for model in (bare, full):
        source, made = generated(model)
        assert made.__all__ == ["SingularJointError", *source.manifest["functions"]]
        for name, spec in source.manifest["functions"].items():
            assert list(inspect.signature(getattr(made, name)).parameters) == spec["arguments"] + spec.get("seeds", [])
    assert list(inspect.signature(generated(bare)[1].accelerations).parameters) == ["q", "u"]


def with_weightless_end() -> Model:
    """Two links; the mass of the second is a parameter, which may be zero."""
    zero = expression(0)
    bodies = []
    for k, m in ((0, "1"), (1, "m")):
        at = vector(0, 0, -k)
        inertia = (expression(f"0.1*{m}"),) * 3 + (zero,) * 3
        joint = Joint("revolute", (vector(0, 1, 0),), at)
        bodies.append(Body(("upper", "lower")[k], k - 1, joint, expression(m), vector(0, 0, "-0.5"), inertia))
    damper = JointForce("damper", 1, (expression("-0.1*u.lower"),))
    return Model("ends", vector(0, 0, -9.81), (Parameter("m", 1.0),), (), tuple(bodies), forces=(damper,))


def test_a_zero_pivot_names_the_link() -> None:
    _, made = generated(with_weightless_end())
    q, u = np.zeros((3, 2)), np.ones((3, 2))
    made.accelerations(q, u, np.array([1.0]))
    for p in (np.array([0.0]), np.array([[1.0], [0.0], [2.0]])):
        for function, arguments in (
            (made.accelerations, (q, u, p)),
            (made.sensitivities, (q, u, p, *(np.ones((1, n)) for n in (2, 2, 1)))),
            (made.jacobians, (q, u, p)),
            (made.solve_mass, (q, p, u)),
        ):
            with pytest.raises(made.SingularJointError, match="joint of lower: nothing outboard") as caught:
                function(*arguments)
            assert caught.value.link == "lower"
            assert isinstance(caught.value, ValueError)


def test_text_grows_by_tables_only() -> None:
    short, long = (write_solver(chain("yx" * n), "kinds").files["chain_numpy.py"] for n in (20, 200))
    assert short.count("\ndef ") == long.count("\ndef ")
    assert len(long) - len(short) < 40 * 360


ALONE = """
import sys

class NumpyOnly:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top not in ("numpy", "chain_numpy") and top not in sys.stdlib_module_names:
            raise ImportError(f"{name} is not NumPy")

sys.meta_path.insert(0, NumpyOnly())
import numpy as np
import chain_numpy as m
udot, dudot = m.sensitivities(np.zeros(3), np.ones(3), np.ones(1), np.eye(3), np.zeros((3, 3)), np.zeros((3, 1)))
print(udot.shape, dudot.shape)
"""


def test_needs_numpy_only(tmp_path: Path) -> None:
    (tmp_path / "chain_numpy.py").write_text(write_solver(chain("yxz")).files["chain_numpy.py"])
    run = subprocess.run([sys.executable, "-c", ALONE], cwd=tmp_path, capture_output=True, text=True, env={"PATH": ""})
    assert run.stdout == "(3,) (3, 3)\n", run.stderr


SAME = """
import hashlib, sys
sys.path[:0] = {path!r}
import numpy as np
from random_models import random_tree
from codegen.pipeline import write_solver
text = write_solver(random_tree(np.random.default_rng(2), 2)).files["random_tree_numpy.py"]
print(hashlib.sha256(text.encode()).hexdigest())
"""


def test_bytes_do_not_depend_on_hash_seeds() -> None:
    root = Path(__file__).parents[2]
    script = SAME.format(path=[str(root), str(root / "tests")])
    # the random model's inertias are products of matrices, whose last bits are those of the processor that BLAS is told
    blas = {name: value for name, value in os.environ.items() if name.startswith("OPENBLAS_")}
    digests = {
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True,
                       env=blas | {"PATH": "", "PYTHONHASHSEED": seed}).stdout
        for seed in ("1", "4711")
    }  # fmt: skip
    text = write_solver(random_tree(np.random.default_rng(2), 2)).files["random_tree_numpy.py"]
    assert digests == {hashlib.sha256(text.encode()).hexdigest() + "\n"}


def test_the_ground_may_carry_several_links() -> None:
    """Two chains on the ground: the second adds to what the first handed on."""
    one, rng = chain("yxz"), np.random.default_rng(5)
    second = tuple(
        Body(f"other_{k}", b.parent if b.parent == GROUND else b.parent + 3, b.joint, b.mass, b.com, b.inertia)
        for k, b in enumerate(one.bodies)
    )
    model = Model("chain", one.gravity, one.parameters, (), one.bodies + second)
    check_against_reference(model, "kinds", rng)
