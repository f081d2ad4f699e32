"""PyTorch functions of solvers: values and derivatives against the solver and differences; bad input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learned_solvers import EVERY, MEASURES, SECOND, Extra, example

import codegen
import codegen.torch
from codegen.operators import FUNCTIONS

MISSING = "PyTorch is not installed: pip install 'ordernm[torch]'"
torch, func = Extra("torch", MISSING), Extra("torch.func", MISSING)

CLOSE = {"eps": 2e-6, "atol": 1e-8, "rtol": 1e-8}


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return example("double_pendulum", tmp_path_factory.mktemp("torch") / "double", [*SECOND, *MEASURES])


@pytest.fixture(scope="module")
def satellite(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return example("satellite", tmp_path_factory.mktemp("torch") / "satellite", EVERY)


def states(solver: codegen.Solver, *batch: int, seed: int = 0) -> tuple[Any, ...]:
    """Random states near the initial one; all share p."""
    rng = np.random.default_rng(seed)
    q, u = solver.initial
    given = (
        q + 0.3 * rng.normal(size=(*batch, solver.nq)), u + 0.5 * rng.normal(size=(*batch, solver.nu)),
        solver.parameters * (1 + 0.1 * rng.random(solver.np)), rng.normal(size=solver.ninputs),
    )  # fmt: skip
    return tuple(torch.tensor(x, requires_grad=True) for x in given)


def numbers(*tensors: Any) -> list[Any]:
    return [x.detach().numpy() for x in tensors]


def test_values_and_gradients_to_second_order(pendulum: codegen.Solver) -> None:
    f = codegen.torch.function(pendulum, "accelerations")
    for batch in ((), (3,)):
        q, u, p, _ = states(pendulum, *batch)
        np.testing.assert_array_equal(f(q, u, p).detach(), pendulum.accelerations(*numbers(q, u, p)))
        assert torch.autograd.gradcheck(f, (q, u, p), check_forward_ad=True, **CLOSE)
        assert torch.autograd.gradgradcheck(f, (q, u, p), **CLOSE)


def test_transformations_of_functions(pendulum: codegen.Solver) -> None:
    f = codegen.torch.function(pendulum, "accelerations")
    q, u, p, _ = (x.detach() for x in states(pendulum, 4))
    expected = pendulum.accelerations(*numbers(q, u, p))
    np.testing.assert_allclose(func.vmap(f, (0, 0, None))(q, u, p), expected, rtol=1e-14)
    np.testing.assert_allclose(func.vmap(f, (1, None, None))(q.T, u[0], p), f(q, u[0], p), rtol=1e-14)
    slopes = pendulum.sensitivities(*numbers(q, u, p), dp=np.eye(pendulum.np)[:, None])[1]
    for derivative in (func.jacrev, func.jacfwd):
        found = func.vmap(derivative(f, 2), (0, 0, None))(q, u, p)
        np.testing.assert_allclose(found, np.moveaxis(slopes, 0, -1), rtol=1e-10, atol=1e-10)
    curvature = pendulum.hessians(*numbers(q, u, p), weights=np.array([0.0, 1.0]), wrt="q")
    for outer in (func.jacfwd, func.jacrev):
        hessian = outer(func.jacrev(lambda q, u: f(q, u, p)[1]))
        np.testing.assert_allclose(func.vmap(hessian)(q, u), curvature, rtol=1e-10, atol=1e-10)
    backwards = func.jacrev(func.jacfwd(lambda q: f(q, u[0], p)[1]))
    np.testing.assert_allclose(backwards(q[0]), curvature[0], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", ["outputs", "energies", "inverse_dynamics"])
def test_other_functions_have_second_derivatives(pendulum: codegen.Solver, name: str) -> None:
    f = codegen.torch.function(pendulum, name)
    q, u, p, _ = (x.detach() for x in states(pendulum))
    udot = [0.3 * u] * (name == "inverse_dynamics")
    weights = torch.cos(torch.arange(f(q, u, *udot, p=p).numel()).double())
    found = func.hessian(lambda q: f(q, u, *udot, p=p) @ weights)(q)
    if udot:
        of = pendulum.inverse_dynamics_hessian_products
        wanted = of(*numbers(q, u, *udot, p), weights=weights.numpy(), dq=np.eye(2)).q
    else:
        wanted = pendulum.hessians(*numbers(q, u, p), weights=weights.numpy(), wrt="q", of=name)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


def test_compiled_programs_keep_the_operators(pendulum: codegen.Solver) -> None:
    f = codegen.torch.function(pendulum, "accelerations")
    q, u, p, _ = states(pendulum, 50)
    sin = torch.sin
    compiled = torch.compile(lambda q, u, p: sin(f(q, u, p)), fullgraph=True, backend="aot_eager")
    expected = torch.autograd.grad(sin(f(q, u, p)).sum(), (q, p))
    for a, b in zip(torch.autograd.grad(compiled(q, u, p).sum(), (q, p)), expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    of = codegen.torch.operators
    x = [a.detach() for a in (q, u, p)]
    given = (*x, torch.zeros(0).double(), torch.zeros(()).double(), torch.zeros(0).double(), of.key_of(f.operator))
    checks = ("test_schema", "test_faketensor")
    torch.library.opcheck(of.value, given, test_utils=checks)
    weights = torch.ones(50, 2).double()
    torch.library.opcheck(of.against, (*given[:6], weights, of.EVERY, given[-1]), test_utils=checks)


@pytest.mark.parametrize(
    "name",
    ["accelerations", "coordinate_rates", "outputs", "energies", "inverse_dynamics", "mass_matrix", "solve_mass"],
)
def test_every_function_has_exact_derivatives(satellite: codegen.Solver, name: str) -> None:
    """Quaternions and inputs included; gradients that the package lacks come from Jacobians."""
    if name == "outputs" and not satellite.noutputs:
        pytest.skip("no outputs")
    f = codegen.torch.function(satellite, name)
    q, u, p, inputs = states(satellite, 2)
    given = {"q": q, "u": u, "udot": 0.3 * u.detach(), "b": 0.7 * u.detach(), "inputs": inputs}
    takes = [n for n in FUNCTIONS[name].takes if n != "t"]
    at = takes.index("p")  # differences of relative changes, since parameters have very different sizes
    given["p"] = torch.ones_like(p, requires_grad=True)
    scale = None

    def relative(*x: Any) -> Any:
        found = f(*x[:at], x[at] * p.detach(), *x[at + 1 :])
        return found if scale is None else found / scale

    arguments = [given[n] for n in takes]
    found = relative(*arguments).detach()
    expected = getattr(satellite, name)(*numbers(*(p if n == "p" else given[n] for n in takes)))
    np.testing.assert_array_equal(found, np.stack(expected, -1) if name == "energies" else expected)
    scale = float(found.abs().max()) or 1.0
    assert torch.autograd.gradcheck(relative, arguments, **{**CLOSE, "eps": 1e-5})


def test_a_loop_has_the_derivatives_of_the_solver(tmp_path: Path) -> None:
    chosen = ["accelerations", "sensitivities", "gradients", "energies", "energy_sensitivities", "assemble"]
    solver = example("four_bar", tmp_path / "four_bar", chosen)
    q, u = solver.assemble({solver.independent_names[0]: 0.9}, {solver.independent_speed_names[0]: 2.0})
    p = torch.tensor(solver.parameters, requires_grad=True)
    x, v = torch.tensor(q, requires_grad=True), torch.tensor(u, requires_grad=True)
    weights = np.cos(np.arange(solver.nu))
    f = codegen.torch.function(solver, "accelerations")
    found = torch.autograd.grad((f(x, v, p) * torch.tensor(weights)).sum(), (x, v, p))
    for a, b in zip(found, solver.gradients(q, u, weights=weights)[:3], strict=True):
        np.testing.assert_allclose(a, b[0], rtol=1e-12, atol=1e-12)
    mass = codegen.torch.function(solver, "mass_matrix")  # which Python composes
    (found,) = torch.autograd.grad(mass(x, p).sum(), p)
    expected = solver.mass_matrix_sensitivities(q, dp=np.eye(solver.np))[1].sum((1, 2))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


def test_single_precision_and_names(tmp_path: Path) -> None:
    solver = example(
        "double_pendulum", tmp_path / "single", ["accelerations", "sensitivities", "gradients"], scalar="float32"
    )
    f = codegen.torch.function(solver, "accelerations")
    q, u = torch.tensor([0.3, 0.2]), torch.tensor([0.1, 0.5])
    assert f(q, u).dtype == torch.float32
    length = torch.tensor(1.3, requires_grad=True)
    f(q, u, {"length_1": length})[0].backward()
    expected = solver.sensitivities(q.numpy(), u.numpy(), {"length_1": 1.3}, dp={"length_1": 1.0})[1][0, 0]
    assert float(length.grad) == pytest.approx(float(expected), rel=1e-4)
    with pytest.raises(TypeError, match=r"q has type float64 and shape \(2,\), expected float32"):
        f(q.double(), u)


def test_wrong_arguments_raise(pendulum: codegen.Solver, satellite: codegen.Solver) -> None:
    f = codegen.torch.function(pendulum, "accelerations")
    q, u, p, _ = states(pendulum, 3)
    bad = q.detach().clone()
    bad[1, 0] = np.nan
    rates = codegen.torch.function(satellite, "coordinate_rates")
    a, b, *_ = states(satellite)
    with pytest.raises(NotImplementedError, match="of coordinate_rates: satellite was generated without"):
        func.hessian(lambda b: rates(a.detach(), b)[0])(b.detach())

    def third(x: Any) -> Any:
        return f(x * torch.ones(2).double(), torch.ones(2).double())[0]

    cases = [
        (lambda: f(q[:, :1], u, p), ValueError, r"q has shape \(3, 1\), expected \(..., 2\): upper, lower"),
        (lambda: f(q, u, p[:4]), ValueError, r"p has shape \(4,\), expected \(..., 6\): length_1"),
        (lambda: f(q, u[:2], p), ValueError, r"do not broadcast: q \(3, 2\), u \(2, 2\)"),
        (lambda: f(q.float(), u, p), TypeError, "q has type float32 and shape .*expected float64"),
        (lambda: f(q, u, {"lenght_1": 1.0}), ValueError, "did you mean 'length_1'"),
        (lambda: f(q, u, {"length_1": None}), TypeError, "p has None for 'length_1'"),
        (lambda: f(q), TypeError, "u missing; arguments are q, u, p, inputs, t"),
        (lambda: f("q", u), TypeError, "q is 'q', expected numbers"),
        (lambda: f(q.to("meta"), u), ValueError, "solvers compute on the CPU"),
        (lambda: f(bad, u, p), ValueError, "q"),
        (lambda: codegen.torch.function(pendulum, "acelerations"), ValueError, "did you mean 'accelerations'"),
        (lambda: codegen.torch.function(pendulum, "mass_matrix"), AttributeError, "generated without mass_matrix"),
        (
            lambda: func.grad(func.grad(func.grad(third)))(torch.tensor(0.3).double()),
            NotImplementedError,
            "third derivatives",
        ),
    ]
    for call, error, message in cases:
        with pytest.raises(error, match=message):
            call()


@pytest.mark.parametrize("name", ["accelerations", "inverse_dynamics", "outputs"])
def test_calls_without_autograd(satellite: codegen.Solver, name: str) -> None:
    """They give the same bits as calls with autograd, and are checked as well, also after calls of known shapes."""
    f = codegen.torch.function(satellite, name)
    of = {"q": 0, "u": 1, "p": 2, "inputs": 3}
    every = states(satellite, 3)
    plain = [every[of.get(n, 1)].detach() for n in f.operator.takes if n != "t"]
    with torch.no_grad():
        for count in range(3, len(plain) + 1):
            expected = f(*(x.clone().requires_grad_() for x in plain[:count]))
            for _ in range(2):
                assert (f(*plain[:count]) == expected).all()
            np.testing.assert_array_equal(expected, getattr(satellite, name)(*numbers(*plain[:count])))
        with pytest.raises(TypeError, match="arguments, not"):
            f(*plain, torch.tensor(0.0).double(), plain[0])
        with pytest.raises(ValueError, match=r"q has shape \(3, 2\)"):
            f(plain[0][:, :2], *plain[1:])
        with pytest.raises(TypeError, match="q has type float32"):
            f(plain[0].float(), *plain[1:])
        turned = torch.complex(plain[0], plain[0]).conj().imag  # PyTorch negates it where it is read
        assert turned.is_neg() and (f(turned, *plain[1:]) == f(-plain[0], *plain[1:])).all()


def test_arguments_that_are_no_tensors(pendulum: codegen.Solver) -> None:
    """Lists keep double precision, arrays may change after a call and have any strides, and lists of tensors keep gradients."""
    f = codegen.torch.function(pendulum, "accelerations")
    q, u, p = [0.1, 0.7], np.array([0.3, -1.1]), pendulum.parameters.copy()
    wanted = pendulum.accelerations(q, u, p)
    assert (f(q, u, p).numpy() == wanted).all()
    assert (f(np.array(q[::-1])[::-1], u[::-1].copy()[::-1], p).numpy() == wanted).all()
    x = torch.tensor(q, dtype=torch.float64, requires_grad=True)
    value = f(x, u, p).sum()
    gradients = pendulum.gradients(q, u, p, weights=[1.0, 1.0])
    u *= 2.0
    p *= 3.0
    value.backward()
    assert (x.grad.numpy() == gradients.q[0]).all()
    lower = torch.tensor(0.7, dtype=torch.float64, requires_grad=True)
    f([0.1, lower], [0.3, -1.1]).sum().backward()
    assert float(lower.grad) == gradients.q[0, 1]


def test_functions_keep_their_partition_and_their_treatment_of_bad_states(tmp_path: Path) -> None:
    solver = example("four_bar", tmp_path / "four_bar", SECOND, partitions=2)
    f = codegen.torch.function(solver, "accelerations")
    q, u = solver.assemble(solver.initial[0], solver.initial[1] + 0.3)
    x = torch.tensor(q, requires_grad=True)

    def gradient() -> Any:
        x.grad = None
        f(x, u).sum().backward()
        return x.grad.numpy().copy()

    wanted = solver.gradients(q, u, weights=np.ones(solver.nu)).q[0]
    assert (gradient() == wanted).all()
    solver.use_partition(1)
    solver.bad_states = "nan"
    assert (gradient() == wanted).all()
    with pytest.raises(ValueError, match="finite"):
        f(np.full((2, solver.nq), np.nan), u)
    other = codegen.torch.function(solver, "accelerations")
    other(x, u).sum().backward()
    assert not (x.grad.numpy() == 2 * wanted).all()
