"""Decimal numbers give the results of mpmath's numbers in a fifth of the time."""

import decimal
import warnings
from pathlib import Path

import mpmath
import numpy as np
import pytest

import codegen
from codegen.reference import DenseEngine, RecursiveEngine
from codegen.reference.arithmetic import Arithmetic, SingularMatrixError

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))
DIGITS = 40


def difference(a, b):
    """max |a - b| / max |a| of numbers of both kinds."""
    a, b = (np.frompyfunc(mpmath.mp.convert, 1, 1)(np.ravel(x)) for x in (a, b))
    size = max(map(abs, a), default=0)
    return float(max(map(abs, a - b), default=0) / (size or 1))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda f: f.stem)
def test_both_kinds_agree(file):
    model = codegen.load_model(file)
    rng = np.random.default_rng(1)
    q = np.array([float(x) for x in rng.normal(size=model.nq)])
    for _, place in model.quaternions:
        q[place] /= np.linalg.norm(q[place])
    u, inputs = rng.normal(size=model.nu), rng.normal(size=len(model.inputs))
    seeds = {"dq": rng.normal(size=(1, model.nq)), "dp": rng.normal(size=(1, len(model.parameters)))}
    engines = [RecursiveEngine] if len(model.bodies) > 12 else [RecursiveEngine, DenseEngine]
    for engine in engines:
        found = []
        for numbers in ("mpmath", "decimal"):
            with mpmath.workdps(DIGITS), decimal.localcontext(prec=DIGITS), warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # loops are open at a random state
                try:
                    found.append(engine(model, numbers=numbers).sensitivities(q, u, None, inputs, 0.3, **seeds))
                except SingularMatrixError as error:  # conditions that are redundant only where the loops are closed
                    found.append(str(error))
        if isinstance(found[0], str):
            assert found[0] == found[1] and engine is DenseEngine
            continue
        with mpmath.workdps(DIGITS):
            for a, b in zip(*found, strict=True):
                assert difference(a, b) < 1e-28


def test_functions():
    arithmetic = Arithmetic("decimal")
    with mpmath.workdps(60):
        for name in (
            "sin",
            "cos",
            "tan",
            "asin",
            "acos",
            "atan",
            "sinh",
            "cosh",
            "tanh",
            "sqrt",
            "exp",
            "log",
            "abs",
            "sign",
        ):
            with decimal.localcontext(prec=DIGITS):
                found = arithmetic.function(name)(arithmetic.number(0.3))
            exact = getattr(mpmath, {"abs": "fabs"}.get(name, name))(mpmath.mpf(0.3))
            assert abs(mpmath.mp.convert(found) - exact) <= 10.0 ** (1 - DIGITS) * abs(exact), name
        with decimal.localcontext(prec=DIGITS):
            found = arithmetic.function("atan2")(arithmetic.number(-1), arithmetic.number(-2.5))
        assert abs(mpmath.mp.convert(found) - mpmath.atan2(-1, -2.5)) < 1e-38


def test_numbers_are_exactly_what_they_are():
    arithmetic = Arithmetic("decimal")
    with mpmath.workdps(60), decimal.localcontext(prec=60):
        assert arithmetic.number(0.1) == decimal.Decimal.from_float(0.1)
        assert arithmetic.number(np.int64(-3)) == -3
        for x in (mpmath.mpf(-0.75), mpmath.mpf(2) ** 70, mpmath.mpf(0)):
            assert mpmath.mp.convert(arithmetic.number(x)) == x
        assert mpmath.isnan(mpmath.mp.convert(arithmetic.number(mpmath.mpf("nan"))))
