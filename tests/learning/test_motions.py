"""Functionals of motions in JAX and PyTorch: values and gradients are those of `judge`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_once import made

import codegen
from codegen.runtime import Final, Integral

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = ("length_1", "mass_2")
X = np.array([1.1, 0.9])
FUNCTIONALS = [Final("tip_x"), Integral("kinetic")]


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    return made(codegen.load_model(EXAMPLES / "double_pendulum.yaml"), tmp_path_factory.mktemp("motions") / "double")


def expected(solver: codegen.Solver, x: Any = X) -> Any:
    return solver.judge(0.5, FUNCTIONALS, p=dict(zip(NAMES, x, strict=True)), wrt=NAMES, rtol=1e-10)


def test_jax(solver: codegen.Solver) -> None:
    jax = pytest.importorskip("jax", reason="JAX is not installed: pip install 'ordernm[jax]'")
    import codegen.jax

    jax.config.update("jax_enable_x64", True)
    f = jax.jit(codegen.jax.judge(solver, 0.5, FUNCTIONALS, wrt=NAMES, rtol=1e-10))
    found = expected(solver)
    np.testing.assert_allclose(f(X), found.values, rtol=1e-12)
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jax.jit(derivative(f))(X), found.gradients, rtol=1e-12)
    several = np.array([X, X + 0.1])
    slopes = [expected(solver, x).gradients for x in several]
    np.testing.assert_allclose(jax.vmap(jax.jacrev(f))(several), slopes, rtol=1e-12)
    with pytest.raises(NotImplementedError, match="no second derivatives"):
        jax.hessian(lambda x: f(x)[0])(X)
    with pytest.raises(ValueError, match=r"x has shape \(3,\), expected \(2,\): length_1, mass_2"):
        f(np.zeros(3))
    with pytest.raises(TypeError, match="x has type float32"):
        f(X.astype("float32"))
    with pytest.raises(ValueError, match="did you mean 'length_1'"):
        codegen.jax.judge(solver, 0.5, FUNCTIONALS, wrt="lenght_1")
    with pytest.raises(TypeError, match="p is not an option here"):
        codegen.jax.judge(solver, 0.5, FUNCTIONALS, wrt="length_1", p=X)


def test_torch(solver: codegen.Solver) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ordernm[torch]'")
    import codegen.torch

    f = codegen.torch.judge(solver, 0.5, FUNCTIONALS, wrt=NAMES, rtol=1e-10)
    found, x = expected(solver), torch.tensor(X, requires_grad=True)
    np.testing.assert_allclose(f(x.detach()), found.values, rtol=1e-12)
    weights = torch.tensor([1.0, -0.3]).double()
    (gradient,) = torch.autograd.grad((f(x) * weights).sum(), x)
    np.testing.assert_allclose(gradient, weights.numpy() @ found.gradients, rtol=1e-12)
    with pytest.raises(ValueError, match=r"x has shape \(3,\)"):
        f(torch.zeros(3).double())
    with pytest.raises(TypeError, match="x has type float32"):
        f(x.float())
