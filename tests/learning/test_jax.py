"""JAX functions of solvers: values and derivatives against the solver and differences, also in batches; bad input."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learned_solvers import EVERY, EXAMPLES, MEASURES, SECOND, Extra, example

import codegen
import codegen.jax
from codegen.operators import FUNCTIONS

MISSING = "JAX is not installed: pip install 'ordernm[jax]'"
jax, jnp, checks = (Extra(m, MISSING) for m in ("jax", "jax.numpy", "jax.test_util"))
CLOSE = {"atol": 1e-8, "rtol": 1e-8}


@pytest.fixture(autouse=True)
def double_precision() -> None:
    jax.config.update("jax_enable_x64", True)


def errors_of_xla() -> tuple[type[Exception], ...]:
    """Errors of XLA; the second one is raised where JAX waits for the program."""
    return jax.errors.JaxRuntimeError, ValueError


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return example(
        "double_pendulum", tmp_path_factory.mktemp("jax") / "double", [*SECOND, *MEASURES, "coordinate_rates"]
    )


@pytest.fixture(scope="module")
def satellite(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return example("satellite", tmp_path_factory.mktemp("jax") / "satellite", EVERY)


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return example("four_bar", tmp_path_factory.mktemp("jax") / "four_bar", [*SECOND, "assemble"])


def states(solver: codegen.Solver, *batch: int, seed: int = 0) -> tuple[Any, ...]:
    """Random states near the initial one, with parameters and inputs of their own."""
    rng = np.random.default_rng(seed)
    q, u = solver.initial
    return (
        q + 0.3 * rng.normal(size=(*batch, solver.nq)), u + 0.5 * rng.normal(size=(*batch, solver.nu)),
        solver.parameters * (1 + 0.1 * rng.random((*batch, solver.np))), rng.normal(size=(*batch, solver.ninputs)),
        rng.random(batch),
    )  # fmt: skip


def test_values_and_both_modes_to_second_order(pendulum: codegen.Solver) -> None:
    f = codegen.jax.function(pendulum, "accelerations")
    q, u, p, *_ = states(pendulum)
    np.testing.assert_array_equal(f(q, u, p), pendulum.accelerations(q, u, p))
    checks.check_grads(f, (q, u, p), order=2, eps=2e-6, **CLOSE)
    q, u, *_ = states(pendulum, 3)
    checks.check_grads(f, (q, u, p), order=2, eps=2e-6, **CLOSE)  # the states share p


@pytest.mark.parametrize("order", [("fwd", "rev"), ("rev", "fwd"), ("fwd", "fwd"), ("rev", "rev")])
def test_hessians_are_those_of_the_solver(pendulum: codegen.Solver, order: tuple[str, str]) -> None:
    f = codegen.jax.function(pendulum, "accelerations")
    q, u, p, *_ = states(pendulum)
    weights = np.array([1.0, -0.4])
    modes = {"fwd": jax.jacfwd, "rev": jax.jacrev}
    outer, inner = (modes[m] for m in order)

    def whole(x: Any) -> Any:
        return f(x[:2], x[2:4], x[4:]) @ weights

    found = jax.jit(outer(inner(whole)))(np.concatenate([q, u, p]))
    expected = pendulum.hessians(q, u, p, weights=weights)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["outputs", "energies", "inverse_dynamics"])
def test_other_functions_have_second_derivatives(pendulum: codegen.Solver, name: str) -> None:
    f = codegen.jax.function(pendulum, name)
    q, u, p, *_ = states(pendulum)
    weights = np.cos(np.arange(f(q, u, *[u] * (name == "inverse_dynamics")).size))

    def whole(x: Any) -> Any:
        return f(x[:2], x[2:4], *[x[10:]] * (name == "inverse_dynamics"), p=x[4:10]) @ weights

    x = np.concatenate([q, u, p, *[0.3 * u] * (name == "inverse_dynamics")])
    found = jax.hessian(whole)(x)
    np.testing.assert_allclose(found, jax.jacrev(jax.jacrev(whole))(x), rtol=1e-12, atol=1e-12)
    if name == "inverse_dynamics":
        wanted = pendulum.inverse_dynamics_hessian_products(q, u, 0.3 * u, p, weights=weights, dq=np.eye(2)).q
        np.testing.assert_allclose(found[:2, :2], wanted, rtol=1e-12, atol=1e-12)
    else:
        wanted = pendulum.hessians(q, u, p, weights=weights, of=name)
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


def test_large_batches_go_to_lanes_and_threads(pendulum: codegen.Solver) -> None:
    pendulum.batch_threads = 3
    try:
        f = jax.jit(codegen.jax.function(pendulum, "accelerations"))
        q, u, p, *_ = states(pendulum, 5, 411)
        np.testing.assert_allclose(f(q, u, p), pendulum.accelerations(q, u, p), rtol=1e-12)
        dq = np.ones((5, 411, 2))
        found = jax.jvp(lambda q: f(q, u, p), (q,), (dq,))[1]
        np.testing.assert_allclose(found, pendulum.sensitivities(q, u, p, dq=dq[None])[1][0], rtol=1e-11, atol=1e-9)
        weights = np.cos(np.arange(5 * 411 * 2)).reshape(1, 5, 411, 2)
        gradient = jax.vjp(f, q, u, p[0, 0])[1](weights[0])
        expected = pendulum.gradients(q, u, p[0, 0], weights=weights)
        np.testing.assert_array_equal(gradient[0].shape, q.shape)
        again = jax.vjp(f, q, u, jnp.broadcast_to(p[0, 0], p.shape))[1](weights[0])
        np.testing.assert_allclose(again[0], expected.q[0], rtol=1e-11, atol=1e-9)
        np.testing.assert_allclose(gradient[2], expected.p[0].sum((0, 1)), rtol=1e-10)
    finally:
        pendulum.batch_threads = None


def test_vmap_over_any_axis_of_any_argument(pendulum: codegen.Solver) -> None:
    f = codegen.jax.function(pendulum, "accelerations")
    q, u, p, *_ = states(pendulum, 4)
    each = np.array([pendulum.accelerations(q[0], u[i], p[i]) for i in range(4)])
    np.testing.assert_allclose(jax.vmap(f, (None, 1, 0))(q[0], u.T, p), each, rtol=1e-14)
    table = jax.vmap(jax.vmap(f, (0, None, None)), (None, 0, None))(q, u, p[0])
    expected = pendulum.accelerations(q[None, :], u[:, None], p[0])
    np.testing.assert_allclose(table, expected, rtol=1e-13)
    slopes = jax.vmap(jax.jacfwd(f, 2))(q, u, p)
    expected = pendulum.sensitivities(q, u, p, dp=np.eye(pendulum.np)[:, None])[1]
    np.testing.assert_allclose(slopes, np.moveaxis(expected, 0, -1), rtol=1e-11, atol=1e-10)
    np.testing.assert_allclose(jax.vmap(jax.jacrev(f, 2))(q, u, p), slopes, rtol=1e-10, atol=1e-10)
    curvature = jax.vmap(jax.hessian(lambda q, u, p: f(q, u, p)[1]))(q, u, p)
    expected = pendulum.hessians(q, u, p, weights=np.array([0.0, 1.0]), wrt="q")
    np.testing.assert_allclose(curvature, expected, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize(
    "name",
    ["accelerations", "coordinate_rates", "outputs", "energies", "inverse_dynamics", "mass_matrix", "solve_mass"],
)
def test_every_function_has_exact_derivatives(satellite: codegen.Solver, name: str) -> None:
    """Quaternions and inputs included; gradients that the package lacks come from Jacobians."""
    if name == "outputs" and not satellite.noutputs:
        pytest.skip("no outputs")
    f = codegen.jax.function(satellite, name)
    q, u, p, inputs, _ = states(satellite)
    given = {"q": q, "u": u, "udot": 0.3 * u, "b": 0.7 * u, "p": p, "inputs": inputs}
    takes = [n for n in FUNCTIONS[name].takes if n != "t"]
    arguments = [given[n] for n in takes]
    expected = getattr(satellite, name)(*arguments)
    np.testing.assert_array_equal(f(*arguments), np.stack(expected, -1) if name == "energies" else expected)
    scale = float(np.abs(f(*arguments)).max()) or 1.0
    at = takes.index("p")  # differences of relative changes, since parameters have very different sizes

    def relative(*x: Any) -> Any:
        return f(*x[:at], x[at] * p, *x[at + 1 :]) / scale

    arguments[at] = np.ones(satellite.np)
    checks.check_grads(relative, arguments, order=1, eps=1e-5, **CLOSE)


def test_time_of_prescribed_motion(tmp_path: Path) -> None:
    solver = example("shaken_pendulum", tmp_path / "shaken", ["accelerations", "sensitivities", "gradients"])
    f = codegen.jax.function(solver, "accelerations")
    q, u, p, inputs, t = states(solver, 40)
    for time in (0.7, t):
        np.testing.assert_allclose(f(q, u, p, inputs, time), solver.accelerations(q, u, p, inputs, time), rtol=1e-13)
    scale = 1e-3  # of the changes of time: the support shakes fast

    def later(u: Any, x: Any) -> Any:
        return scale * f(q[:3], u, p[0], None, 0.1 + scale * x)

    checks.check_grads(later, (u[:3], t[:3]), order=1, eps=1e-5, **CLOSE)
    checks.check_grads(lambda x: later(u[:3], x), (0.4,), order=1, eps=1e-5, **CLOSE)


def test_a_package_with_many_functions(tmp_path: Path) -> None:
    """Functions for several states at once take one structure with the arguments and results of all functions."""
    rates = ["coordinate_rates", "coordinate_rate_sensitivities", "coordinate_rate_gradients"]
    model = (EXAMPLES / "shaken_pendulum.yaml").read_text()
    model = model.replace("bodies:", "inputs: [torque]\nbodies:").replace("-damping*u.rod", "torque - damping*u.rod")
    (tmp_path / "driven.yaml").write_text(model)
    functions = [*SECOND, *(n for n in MEASURES if "inverse" not in n), *rates]
    codegen.generate(tmp_path / "driven.yaml", tmp_path / "many", functions=functions, compile="all")
    solver = codegen.load(tmp_path / "many")
    x = states(solver, 16)
    f = codegen.jax.function(solver, "accelerations")
    found = jax.grad(lambda *x: f(*x).sum(), argnums=(0, 1, 2))(*map(jnp.asarray, x))
    wanted = solver.gradients(*x, weights=np.ones((1, 16, solver.nu)))
    for a, b in zip(found, wanted, strict=False):
        np.testing.assert_allclose(a, b[0], rtol=1e-10, atol=1e-10)


def test_a_loop_has_the_gradients_of_the_solver(four_bar: codegen.Solver) -> None:
    """Independent entries move, dependent ones follow."""
    f = codegen.jax.function(four_bar, "accelerations")
    q, u = four_bar.assemble({four_bar.independent_names[0]: 0.9}, {four_bar.independent_speed_names[0]: 2.0})
    p = four_bar.parameters
    np.testing.assert_array_equal(f(q, u, p), four_bar.accelerations(q, u, p))
    weights = np.cos(np.arange(four_bar.nu))
    found = jax.grad(lambda *x: f(*x) @ weights, argnums=(0, 1, 2))(q, u, p)
    expected = four_bar.gradients(q, u, p, weights=weights)
    for a, b in zip(found, expected[:3], strict=True):
        np.testing.assert_allclose(a, b[0], rtol=1e-12, atol=1e-12)
    forward = jax.jacfwd(f, 2)(q, u, p)
    np.testing.assert_allclose(weights @ forward, expected.p[0], rtol=1e-10, atol=1e-10)
    second = jax.hessian(lambda p: f(q, u, p) @ weights)(p)
    expected = four_bar.hessians(q, u, p, weights=weights, wrt="p")
    np.testing.assert_allclose(second, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_single_precision(tmp_path: Path) -> None:
    solver = example(
        "double_pendulum", tmp_path / "single", ["accelerations", "sensitivities", "gradients"], scalar="float32"
    )
    f = codegen.jax.function(solver, "accelerations")
    q, u, p, *_ = (x.astype(np.float32) for x in states(solver, 30))
    found = f(q, u, p)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, solver.accelerations(q, u, p), rtol=2e-5, atol=1e-4)
    gradient = jax.grad(lambda q: f(q, u, p).sum())(q)
    expected = solver.gradients(q, u, p, weights=np.ones((1, 30, 2), np.float32)).q[0]
    np.testing.assert_allclose(gradient, expected, rtol=1e-3, atol=1e-2)
    with pytest.raises(TypeError, match=r"q has type float64 and shape .*expected float32"):
        f(np.zeros(2), u, p)


def test_programs_run_side_by_side(pendulum: codegen.Solver) -> None:
    f = codegen.jax.function(pendulum, "accelerations")
    q, u, p, *_ = states(pendulum, 600)
    p = p[0]
    gradient = jax.jit(jax.grad(lambda q, u, p: (f(q, u, p) ** 2).sum(), argnums=2))
    expected = gradient(q, u, p)
    wrong: list[float] = []

    def repeat() -> None:
        for _ in range(30):
            wrong.extend(np.abs(gradient(q, u, p) - expected) / np.abs(expected))

    threads = [threading.Thread(target=repeat) for _ in range(4)]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert len(wrong) == 4 * 30 * pendulum.np and max(wrong) < 1e-12


def test_names_and_defaults(pendulum: codegen.Solver) -> None:
    f = codegen.jax.function(pendulum, "accelerations")
    q, u, *_ = states(pendulum)
    np.testing.assert_array_equal(f(q, u), pendulum.accelerations(q, u))
    np.testing.assert_array_equal(f(q, u, {"length_1": 1.3}), pendulum.accelerations(q, u, {"length_1": 1.3}))
    slope = jax.grad(lambda length: f(q, u, {"length_1": length})[0])(1.3)
    expected = pendulum.sensitivities(q, u, {"length_1": 1.3}, dp={"length_1": 1.0})[1][0, 0]
    assert slope == pytest.approx(expected, rel=1e-12)


def test_wrong_arguments_raise_while_tracing(pendulum: codegen.Solver) -> None:
    f = codegen.jax.function(pendulum, "accelerations")
    q, u, p, *_ = states(pendulum, 3)
    compiled = jax.jit(f)
    cases = [
        (lambda: compiled(q[:, :1], u, p), ValueError, r"q has shape \(3, 1\), expected \(..., 2\): upper, lower"),
        (lambda: compiled(q, u, p[:, :4]), ValueError, r"p has shape \(3, 4\), expected \(..., 6\): length_1"),
        (lambda: compiled(q, u[:2], p), ValueError, r"do not broadcast: q \(3, 2\), u \(2, 2\)"),
        (lambda: compiled(q.astype("float32"), u, p), TypeError, "q has type float32 and shape .*expected float64"),
        (lambda: compiled(q, u, p.astype(complex)), TypeError, "p has type complex128"),
        (lambda: f(q, u, {"lenght_1": 1.0}), ValueError, "did you mean 'length_1'"),
        (lambda: f(q), TypeError, "u missing; arguments are q, u, p, inputs, t"),
        (lambda: f(q, u, p, None, 0.0, 1.0), TypeError, "5 arguments, not 6"),
        (lambda: f(q, u, speed=1.0), TypeError, "speed is not an argument"),
        (lambda: f("q", u), TypeError, "q is 'q', expected numbers"),
        (lambda: codegen.jax.function(pendulum, "acelerations"), ValueError, "did you mean 'accelerations'"),
        (lambda: codegen.jax.function(pendulum, "mass_matrix"), AttributeError, "generated without mass_matrix"),
        (lambda: codegen.jax.function("pendulum", "energies"), TypeError, "expected a solver"),
    ]
    for call, error, message in cases:
        with pytest.raises(error, match=message):
            call()


def test_derivatives_that_do_not_exist_raise(satellite: codegen.Solver, pendulum: codegen.Solver) -> None:
    q, u, *_ = states(satellite)
    rates, energies = (codegen.jax.function(satellite, n) for n in ("coordinate_rates", "energies"))
    with pytest.raises(NotImplementedError, match="of coordinate_rates: satellite was generated without"):
        jax.hessian(lambda u: rates(q, u)[0])(u)
    with pytest.raises(NotImplementedError, match=r"second derivatives of energies: .*energy_hessian_products"):
        jax.hessian(lambda u: energies(q, u)[0])(u)
    f = codegen.jax.function(pendulum, "accelerations")
    with pytest.raises(NotImplementedError, match="third derivatives do not exist"):
        jax.grad(jax.grad(jax.grad(lambda x: f(x * np.ones(2), np.ones(2))[0])))(0.3)


def test_bad_states_raise_or_are_nan(pendulum: codegen.Solver, satellite: codegen.Solver) -> None:
    q, u, p, *_ = states(pendulum, 20)
    q[7, 1] = np.nan
    f = jax.jit(codegen.jax.function(pendulum, "accelerations"))
    with pytest.raises(
        jax.errors.JaxRuntimeError, match=r"q has an entry that is not finite \(state 7 of the batch of 20"
    ):
        jax.block_until_ready(f(q, u, p))
    p[:, 1:4] = 0.0  # a massless link
    q[7, 1] = 0.0
    with pytest.raises(ValueError) as expected:
        pendulum.accelerations(q, u, p)
    with pytest.raises(errors_of_xla(), match="inertia") as raised:
        jax.block_until_ready(f(q, u, p))
    assert str(expected.value).partition(" (state")[0] in str(raised.value)
    q, u, p, inputs, _ = states(satellite, 30)
    q[3], q[20, 0] = 0.0, np.inf
    satellite.bad_states = "nan"
    try:
        found = codegen.jax.function(satellite, "accelerations")(q, u, p, inputs)
        with pytest.warns(RuntimeWarning):
            expected = satellite.accelerations(q, u, p, inputs)
    finally:
        satellite.bad_states = "error"
    assert set(np.flatnonzero(np.isnan(found).any(-1))) == {3, 20}
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)
    with pytest.raises(errors_of_xla(), match="a quaternion of q is shorter than 1e-06"):
        jax.block_until_ready(codegen.jax.function(satellite, "accelerations")(q[3], u[3], p[3], inputs[3]))


def test_a_solver_that_computes_with_numpy_is_refused(tmp_path: Path) -> None:
    solver = example("pendulum", tmp_path / "plain", ["accelerations"], target="numpy")
    with pytest.raises(codegen.runtime.NoCompilerError, match="computes with NumPy"):
        codegen.jax.function(solver, "accelerations")([0.1], [0.2])


def test_arrays_may_change_before_derivatives_read_them(pendulum: codegen.Solver) -> None:
    q, u, room = np.array([0.1, 0.7]), np.array([0.3, -1.1]), np.zeros(pendulum.np + 8)
    p = room[-room.ctypes.data % 64 // 8 :][: pendulum.np]  # JAX does not copy arrays at such addresses by itself
    p[:] = pendulum.parameters
    f = codegen.jax.function(pendulum, "accelerations")
    _, back = jax.vjp(lambda q: f(q, u, p), jnp.array(q))
    wanted = pendulum.gradients(q, u, p, weights=np.ones(2)).q
    p *= 3.0
    assert (np.asarray(back(jnp.ones(2))[0]) == wanted).all()


def test_entries_in_mappings_broadcast(pendulum: codegen.Solver) -> None:
    f = codegen.jax.function(pendulum, "accelerations")
    q, u, *_ = states(pendulum, 3)
    p = {"length_1": np.array([1.0, 1.1, 1.2]), "mass_2": np.ones((2, 1))}
    np.testing.assert_allclose(f(q, u, p), pendulum.accelerations(q, u, p), rtol=1e-14)
    slope = jax.grad(lambda x: f(q, u, {"length_1": x})[:, 0].sum())(p["length_1"])
    wanted = pendulum.sensitivities(q, u, {"length_1": p["length_1"]}, dp={"length_1": 1.0})[1][..., 0]
    np.testing.assert_allclose(slope, wanted[0], rtol=1e-11)
    with pytest.raises(TypeError, match="p has None for 'length_1', expected a number"):
        f(q, u, {"length_1": None})
