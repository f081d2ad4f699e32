"""Motions as functions in JAX and PyTorch: values and derivatives against the solver; bad input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_once import made

import codegen
import codegen.jax
import codegen.torch
from codegen.runtime import Final, Integral

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = ("length_1", "mass_2", "q0.upper", "u0.lower")
X = np.array([1.1, 0.9, 0.3, -0.2])
FUNCTIONALS = [Final("tip_x"), Integral("kinetic")]
TIMES = np.linspace(0.0, 0.5, 5)


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return made(codegen.load_model(EXAMPLES / "double_pendulum.yaml"), tmp_path_factory.mktemp("motions") / "double")


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return made(codegen.load_model(EXAMPLES / "four_bar.yaml"), tmp_path_factory.mktemp("motions") / "four_bar")


@pytest.fixture
def jax() -> Any:
    jax = pytest.importorskip("jax", reason="JAX is not installed: pip install 'ordernm[jax]'")
    jax.config.update("jax_enable_x64", True)
    return jax


@pytest.fixture
def torch() -> Any:
    return pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ordernm[torch]'")


def motion(x: Any) -> dict[str, Any]:
    """The arguments of the motion at x, in the form in which a user gives them."""
    return {"q": {"upper": x[2]}, "u": {"lower": x[3]}, "p": {"length_1": x[0], "mass_2": x[1]}, "rtol": 1e-10}


def judged(solver: codegen.Solver, x: Any = X) -> Any:
    return solver.judge(0.5, FUNCTIONALS, **motion(x), wrt=NAMES)


def simulated(solver: codegen.Solver, x: Any = X) -> tuple[list[Any], list[Any]]:
    """Results, and their Jacobians with the variables last."""
    run = solver.simulate(TIMES, **motion(x), sensitivities=NAMES)
    return [run.q, run.u, run.outputs], [np.moveaxis(d, 0, -1) for d in (run.dq, run.du, run.doutputs)]


def close(found: Any, wanted: Any) -> None:
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-13)


def test_functionals_in_jax(solver: codegen.Solver, jax: Any) -> None:
    f = jax.jit(codegen.jax.judge(solver, 0.5, FUNCTIONALS, wrt=NAMES, rtol=1e-10))
    found = judged(solver)
    close([f(X)], [found.values])
    for derivative in (jax.jacfwd, jax.jacrev):
        close([jax.jit(derivative(f))(X)], [found.gradients])
    several = np.array([X, X + 0.1])
    slopes = [judged(solver, x).gradients for x in several]
    for derivative in (jax.jacfwd, jax.jacrev):
        close(jax.vmap(derivative(f))(several), slopes)
    with pytest.raises(NotImplementedError, match="no second derivatives"):
        jax.hessian(lambda x: f(x)[0])(X)


def test_functionals_in_torch(solver: codegen.Solver, torch: Any) -> None:
    f = codegen.torch.judge(solver, 0.5, FUNCTIONALS, wrt=NAMES, rtol=1e-10)
    found, x = judged(solver), torch.tensor(X, requires_grad=True)
    close([f(x.detach())], [found.values])
    weights = torch.tensor([1.0, -0.3]).double()
    close(torch.autograd.grad((f(x) * weights).sum(), x), [weights.numpy() @ found.gradients])
    several = torch.tensor(np.array([X, X + 0.1]))
    slopes = [judged(solver, y).gradients for y in several.numpy()]
    for derivative in (torch.func.jacrev, torch.func.jacfwd):
        close([derivative(f)(x.detach())], [found.gradients])
        close(torch.func.vmap(derivative(f))(several), slopes)
    compiled = torch.compile(lambda x: f(x) * 2.0, backend="aot_eager")
    for y in several:  # the second one does not get the numbers of the first one
        close([compiled(y)], [2.0 * judged(solver, y.numpy()).values])
    (slope,) = torch.autograd.grad(f(x)[0], x, create_graph=True)
    with pytest.raises(NotImplementedError, match="no second derivatives"):
        slope.sum().backward()
    for outer in (torch.func.jacfwd, torch.func.jacrev):
        with pytest.raises(NotImplementedError, match="no second derivatives"):
            outer(torch.func.jacfwd(lambda x: f(x)[0]))(x.detach())


def test_whole_motions_in_jax(solver: codegen.Solver, jax: Any) -> None:
    f = codegen.jax.simulate(solver, TIMES, wrt=NAMES, rtol=1e-10)
    values, jacobians = simulated(solver)
    close(jax.jit(f)(X), values)
    for derivative in (jax.jacfwd, jax.jacrev):
        close(jax.jit(derivative(f))(X), jacobians)
        close(jax.vmap(derivative(f))(np.array([X - 0.1, X]))[0][1:], jacobians[:1])
    wanted = np.einsum("tn,tnk->k", 2.0 * values[0], jacobians[0]) + jacobians[2][2].sum(0)
    close([jax.jit(jax.grad(lambda x: (f(x).q ** 2).sum() + f(x).outputs[2].sum()))(X)], [wanted])


def test_whole_motions_in_torch(solver: codegen.Solver, torch: Any) -> None:
    f = codegen.torch.simulate(solver, TIMES, wrt=NAMES, rtol=1e-10)
    values, jacobians = simulated(solver)
    x = torch.tensor(X, requires_grad=True)
    close([y.detach() for y in f(x)], values)
    for derivative in (torch.func.jacfwd, torch.func.jacrev):
        close(derivative(f)(x.detach()), jacobians)
    wanted = np.einsum("tn,tnk->k", 2.0 * values[0], jacobians[0]) + jacobians[2][2].sum(0)
    run = f(x)
    close(torch.autograd.grad((run.q**2).sum() + run.outputs[2].sum(), x), [wanted])


def _every(solver: codegen.Solver) -> tuple[list[str], Any]:
    """All parameters, independent initial values and constant inputs, and their values."""
    q = dict(zip(solver.coordinate_names, solver.initial[0], strict=True))
    u = dict(zip(solver.speed_names, solver.initial[1], strict=True))
    values = dict(zip(solver.parameter_names, solver.parameters, strict=True))
    values |= {f"q0.{n}": q[n] for n in solver.independent_names}
    values |= {f"u0.{n}": u[n] for n in solver.independent_speed_names}
    values |= {f"inputs.{n}": 0.0 for n in solver.input_names}
    return list(values), np.array([*values.values()])


@pytest.mark.parametrize("model", ["solver", "four_bar"])
@pytest.mark.parametrize("library", ["jax", "torch"])
def test_gradients_by_many_variables_use_the_adjoint(model: str, library: str, request: Any, monkeypatch: Any) -> None:
    """Of states, dependent ones among them, and of outputs: to rounding the weighted sums of forward sensitivities."""
    of, solver = request.getfixturevalue(library), request.getfixturevalue(model)
    names, x = _every(solver)
    assert len(names) > 8
    f = getattr(codegen, library).simulate(solver, TIMES, wrt=names, rtol=1e-10)
    run = solver.simulate(TIMES, sensitivities=names, rtol=1e-10)
    weights = [np.cos(1.0 + np.arange(y.size)).reshape(y.shape) for y in (run.q, run.u, run.outputs)]
    each = [np.einsum("tn,ktn->k", w, d) for w, d in zip(weights, (run.dq, run.du, run.doutputs), strict=True)]
    seen: list[str] = []
    monkeypatch.setattr(type(solver), "judge", _noting(type(solver).judge, seen))
    for use in ([0], [1], [0, 1, 2]):
        wanted = sum(each[i] for i in use)

        def weighed(x: Any, use: list[int] = use) -> Any:
            moved = f(x)
            return sum((moved[i] * (weights[i] if library == "jax" else of.tensor(weights[i]))).sum() for i in use)

        if library == "jax":
            found = of.jit(of.grad(weighed))(x)
        else:
            y = of.tensor(x, requires_grad=True)
            (found,) = of.autograd.grad(weighed(y), y)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    assert seen == ["adjoint"] * 3


def test_gradcheck_of_many_variables(four_bar: codegen.Solver, torch: Any) -> None:
    """PyTorch's own comparison with differences, by the adjoint and by forward sensitivities; steps are constant."""
    names, x = _every(four_bar)
    f = codegen.torch.simulate(four_bar, TIMES[:3], wrt=names, method="rk4", step=0.02)
    y = torch.tensor(x, requires_grad=True)
    assert torch.autograd.gradcheck(lambda y: f(y)[:2], y, atol=1e-7, rtol=1e-5)
    assert torch.autograd.gradcheck(
        lambda y: (f(y).q ** 2).sum() + (f(y).u * f(y).u.cos()).sum(), y, atol=1e-7, rtol=1e-5
    )


def test_a_package_without_the_adjoint_uses_sensitivities(tmp_path: Path, torch: Any) -> None:
    solver = made(codegen.load_model(EXAMPLES / "double_pendulum.yaml"), tmp_path / "lean", functions=["simulate"])
    names, x = _every(solver)
    y = torch.tensor(x, requires_grad=True)
    (found,) = torch.autograd.grad(codegen.torch.simulate(solver, TIMES, wrt=names)(y).q.sum(), y)
    wanted = solver.simulate(TIMES, sensitivities=names).dq.sum((1, 2))
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def _noting(judge: Any, seen: list[str]) -> Any:
    def noted(*given: Any, **named: Any) -> Any:
        found = judge(*given, **named)
        seen.append(found.method)
        return found

    return noted


def test_loops_and_inputs_are_variables(four_bar: codegen.Solver, jax: Any, recwarn: Any) -> None:
    """Dependent coordinates follow, without a warning; a whole input stands for its values."""
    inputs = ([0.0, 0.2, 0.4], [[1.0], [2.0], [0.0]], "cubic")
    f = codegen.jax.judge(
        four_bar, 0.4, Final("trace_x"), wrt=("q0.crank", "coupler_length", "inputs.motor"), inputs=inputs
    )
    x = np.array([0.9, 1.21, 0.5, 1.5, -0.5])
    slopes = jax.jacrev(f)(x)
    step = 1e-6
    for i, d in enumerate(np.eye(5) * step):
        difference = (f(x + d) - f(x - d)) / (2 * step)
        np.testing.assert_allclose(slopes[:, i], difference, rtol=1e-5, atol=1e-8)
    q, u = four_bar.assemble({"crank": 0.9}, None, {"coupler_length": 1.21})
    p = {"coupler_length": 1.21}
    wanted = four_bar.judge(0.4, Final("trace_x"), q, u, p, (inputs[0], x[2:, None], "cubic"))
    np.testing.assert_allclose(f(x), wanted.values, rtol=1e-12)
    assert not recwarn.list


def test_what_changes_later_does_not_matter(solver: codegen.Solver, torch: Any) -> None:
    q = np.array([0.3, 0.4])
    f = codegen.torch.judge(solver, 0.5, FUNCTIONALS, wrt="length_1", q=q)
    x = torch.tensor([1.0]).double()
    before = f(x)
    q += 1.0
    assert (f(x) == before).all()


@pytest.mark.parametrize("library", ["jax", "torch"])
def test_wrong_arguments_raise(library: str, solver: codegen.Solver, request: Any) -> None:
    request.getfixturevalue(library)
    of = getattr(codegen, library)
    f = of.judge(solver, 0.5, FUNCTIONALS, wrt=NAMES)
    single = np.zeros(4, np.float32) if library == "jax" else request.getfixturevalue("torch").zeros(4)
    cases = [
        (lambda: f([0.0] * 3), ValueError, r"x has shape \(3,\), expected \(4,\): length_1, mass_2"),
        (lambda: f(single), TypeError, "x has type float32"),
        (lambda: of.judge(solver, 0.5, FUNCTIONALS, wrt="lenght_1"), ValueError, "did you mean 'length_1'"),
        (lambda: of.judge(solver, 0.5, FUNCTIONALS, wrt=["mass_1", "mass_1"]), ValueError, "name 'mass_1' twice"),
        (lambda: of.judge(solver, 0.5, FUNCTIONALS, wrt=[]), ValueError, "there are no variables"),
        (lambda: of.judge(solver, 0.5, FUNCTIONALS, wrt="mass_1", dq0=X), TypeError, "dq0 is not an option here"),
        (
            lambda: of.judge("pendulum", 0.5, FUNCTIONALS, wrt="mass_1"),
            TypeError,
            "expected a solver with judge, not str",
        ),
        (lambda: of.simulate(solver, 0.5, wrt="mass_1"), ValueError, r"t has shape \(\), expected at least two"),
        (lambda: of.simulate(solver, TIMES, wrt="mass_1", events="tip_x"), TypeError, "events is not an option here"),
    ]
    for call, error, message in cases:
        with pytest.raises(error, match=message):
            call()
