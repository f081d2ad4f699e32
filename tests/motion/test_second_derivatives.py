"""Hessian products of functionals of motions: against gradients in 40 digits, symmetry, and errors."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import crank_driven_by_its_piston

import codegen
from codegen.runtime import At, Final, Integral, LeastSquares

EXAMPLES = Path(__file__).parents[2] / "examples"
FUNCTIONS = "motion,hessian_products,sensitivities"
DIGITS, APART = 40, "1e-12"
FIXED = {"integrator": "rk4", "step": 0.05}
WRT = ("pole_length", "bob_mass", "cart_damping", "q0.pole", "u0.cart", "inputs.push[1]", "inputs.push[2]")
TIMES, PUSH = np.linspace(0.0, 1.0, 4), np.array([1.0, -2.0, 3.0, 0.5])
START = {"q": [0.1, 0.7], "u": [0.3, -0.4]}
EVERY = [
    Final("tip_x"), At("tip_z", 0.53), Integral("effort"), Integral("kinetic"),
    LeastSquares([0.0, 0.2, 0.77, 1.0], {"angle": [0.1, 0.2, np.nan, 0.3], "tip_x": [0.0, 0.1, 0.2, 0.3]}, sigma=0.1),
]  # fmt: skip


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    folder = tmp_path_factory.mktemp("swing") / "package"
    codegen.generate(EXAMPLES / "swing_up.yaml", folder, functions=FUNCTIONS)
    return codegen.load(folder)


def judged(solver: codegen.Solver, **more: Any) -> Any:
    return solver.judge(1.0, EVERY, **START, inputs=(TIMES, PUSH, "linear"), wrt=WRT, **more)


class Exact:
    """The classical method with fixed steps in 40 digits: gradients by forward sensitivities, differences of them."""

    def __init__(self, solver: codegen.Solver, steps: int, seconds: float):
        self.exact = solver.in_precision(DIGITS)
        self.mp = __import__("mpmath").mp.clone()
        self.mp.dps = DIGITS
        self.number = np.frompyfunc(self.mp.mpf, 1, 1)
        self.steps, self.h, self.solver = steps, self.mp.mpf(seconds) / steps, solver

    def gradients(self, q: Any, u: Any, p: Any, inputs: Any, names: list[str]) -> Any:
        """Derivatives (names, k) of outputs at the end with respect to all entries of q, u and p."""
        nq, k = len(q), 2 * len(q) + len(p)
        unit = self.number(np.eye(k))
        dq, du, dp = unit[:, :nq], unit[:, nq : 2 * nq], unit[:, 2 * nq :]

        def rate(q: Any, u: Any, dq: Any, du: Any) -> tuple[Any, ...]:
            udot, dudot = self.exact.sensitivities(q, u, p, inputs, self.mp.mpf(0), dq=dq, du=du, dp=dp)
            return u, udot, du, dudot

        z = (self.number(q), self.number(u), dq, du)
        for _ in range(self.steps):
            k1 = rate(*z)
            k2 = rate(*(x + self.h / 2 * y for x, y in zip(z, k1, strict=True)))
            k3 = rate(*(x + self.h / 2 * y for x, y in zip(z, k2, strict=True)))
            k4 = rate(*(x + self.h * y for x, y in zip(z, k3, strict=True)))
            z = tuple(x + self.h / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip(z, k1, k2, k3, k4, strict=True))
        q, u, dq, du = z
        found = self.exact.output_sensitivities(q, u, p, inputs, self.mp.mpf(0), dq=dq, du=du, dp=dp)[1]
        return np.array([found[:, self.solver.output_names.index(n)] for n in names])

    def hessian(self, q: Any, u: Any, p: Any, inputs: Any, names: list[str]) -> Any:
        x = self.number(np.concatenate([q, u, p]))
        parts = (len(q), len(q) + len(u))
        found = []
        for i in range(len(x)):
            ends = []
            for sign in (1, -1):
                moved = x.copy()
                moved[i] += sign * self.mp.mpf(APART)
                ends.append(self.gradients(*np.split(moved, parts), self.number(inputs), names))
            found.append((ends[0] - ends[1]) / (2 * self.mp.mpf(APART)))
        return np.array(found).astype(float).transpose(1, 0, 2)


def test_hessians_equal_differences_of_gradients_in_40_digits(solver: codegen.Solver) -> None:
    q, u, p = np.array([0.1, 0.7]), np.array([0.3, -0.4]), np.array([1.0, 0.6, 0.1, 0.2, 0.1, 0.002])
    names = ["tip_x", "tip_z", "kinetic", "angle"]
    wrt = ("q0.cart", "q0.pole", "u0.cart", "u0.pole", *solver.parameter_names)
    found = solver.judge(
        0.3, [Final(n) for n in names], q, u, p, [2.0], wrt=wrt, hessian=True, integrator="rk4", step=0.1
    ).hessian_products  # fmt: skip
    wanted = Exact(solver, 3, 0.3).hessian(q, u, p, [2.0], names)
    assert np.abs(wanted).max() > 0.1
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-13 * np.abs(other).max())


@pytest.mark.parametrize("method", [FIXED, {"integrator": "dop853", "rtol": 1e-6, "atol": 1e-6}])
def test_products_are_symmetric_and_gradients_those_of_the_adjoint(solver: codegen.Solver, method: Any) -> None:
    plain = judged(solver, method="adjoint", **method)
    found = judged(solver, hessian=True, **method)
    assert found.hessian_products.shape == (len(EVERY), len(WRT), len(WRT))
    np.testing.assert_allclose(found.values, plain.values, rtol=0, atol=0)
    np.testing.assert_allclose(found.gradients, plain.gradients, rtol=1e-12, atol=1e-13)
    for hessian in found.hessian_products:
        assert np.abs(hessian).max() > 0.0
        np.testing.assert_allclose(hessian, hessian.T, rtol=0, atol=1e-12 * np.abs(hessian).max())


def test_hessians_of_every_functional_equal_differences(solver: codegen.Solver) -> None:
    """Central differences of order six in double: a coarse check of inputs, integrals, and least squares."""
    found = judged(solver, hessian=True, **FIXED).hessian_products
    base = dict(zip(solver.parameter_names, (1.0, 0.6, 0.1, 0.2, 0.1, 0.002), strict=True))

    def gradients(name: str, by: float) -> np.ndarray:
        p, q, u, push = dict(base), list(START["q"]), list(START["u"]), PUSH.copy()
        if name in p:
            p[name] += by
        elif name.startswith("inputs"):
            push[int(name[-2])] += by
        else:
            (q if name == "q0.pole" else u)[name == "q0.pole"] += by
        return solver.judge(
            1.0, EVERY, q, u, p, (TIMES, push, "linear"), wrt=WRT, method="adjoint", **FIXED
        ).gradients  # fmt: skip

    h = 2e-3
    for i, name in enumerate(WRT):
        sides = [gradients(name, n * h) - gradients(name, -n * h) for n in (1, 2, 3)]
        wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h)
        scale = np.abs(found).max(axis=(1, 2))
        assert (np.abs(found[:, i] - wanted).max(axis=1) <= 1e-8 * scale).all(), name


@pytest.mark.parametrize("more", [0.0, 0.3])
def test_least_squares_have_curvature_where_the_error_is_zero(solver: codegen.Solver, more: float) -> None:
    """The Hessian without errors is the sum of squares of gradients; one sample with an error keeps those of the others."""
    times, given = [0.0, 0.2, 0.77, 1.0], {**START, "inputs": (TIMES, PUSH, "linear")}
    of_samples = [At("angle", t) for t in times]
    at = solver.judge(1.0, of_samples, **given, wrt=WRT, hessian=True, **FIXED)
    samples = at.values - [more, 0.0, 0.0, 0.0]
    fit = LeastSquares(times, {"angle": samples})
    found = solver.judge(1.0, fit, **given, wrt=WRT, hessian=True, **FIXED).hessian_products[0]
    wanted = at.gradients.T @ at.gradients + more * at.hessian_products[0]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("method", [FIXED, {"integrator": "dop853"}])
def test_outputs_at_jumps_of_inputs_have_the_input_before(solver: codegen.Solver, method: Any) -> None:
    wrt = [f"inputs.push[{i}]" for i in range(4)]
    wanted = [At("effort", 0.0), *(At("effort", t) for t in TIMES[1:]), Integral("effort"), At("speed", TIMES[1])]
    given = {**START, "inputs": (TIMES, PUSH, "hold"), "wrt": wrt, **method}
    found = solver.judge(1.0, wanted, **given, hessian=True)
    plain = solver.judge(1.0, wanted, **given, method="adjoint")
    np.testing.assert_allclose(found.gradients, plain.gradients, rtol=1e-12, atol=1e-13)
    for hessian, i in zip(found.hessian_products, (0, 0, 1, 2), strict=False):
        assert (hessian == 2.0 * np.outer(np.eye(4)[i], np.eye(4)[i])).all()


def test_directions_combine_variables_and_many_are_computed_in_parts(solver: codegen.Solver) -> None:
    whole = judged(solver, hessian=True, **FIXED).hessian_products
    factors = np.random.default_rng(34).normal(size=(11, len(WRT)))
    found = judged(solver, hessian=factors, **FIXED).hessian_products
    assert found.shape == (len(EVERY), 11, len(WRT))
    scale = np.abs(whole).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found / scale, factors @ whole / scale, rtol=1e-10, atol=1e-11)


def test_memory_of_stages_is_freed_at_once(solver: codegen.Solver) -> None:
    """No cycle of references keeps the tangents of stages until the next garbage collection."""
    judged(solver, hessian=True, **FIXED)
    gc.collect()
    gc.disable()
    try:
        judged(solver, hessian=True, **FIXED)
        assert not [x for x in gc.get_objects() if type(x).__name__ == "_Tangents"]
    finally:
        gc.enable()


@pytest.mark.parametrize(
    "method", [{"integrator": "rk4", "step": 0.01}, {"integrator": "dop853"}, {"integrator": "radau"}]
)
@pytest.mark.parametrize("memory", [1000, 200_000])
def test_tangents_are_computed_again_if_memory_is_short(solver: codegen.Solver, method: Any, memory: int) -> None:
    """With 1000 bytes, a single step at a time. Repeated steps are those of the first run, so the products are, too."""
    kept, again = judged(solver, hessian=True, **method), judged(solver, hessian=True, memory=memory, **method)
    for name in ("values", "gradients", "hessian_products"):
        one, other = getattr(kept, name), getattr(again, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14 * np.abs(one).max())


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"hessian": [1.0, 2.0]}, r"hessian is \[1.0, 2.0\]; allowed are True, .* or directions \(r, 7\)"),
        ({"hessian": [np.nan] * 7}, "hessian: directions must be finite"),
    ],
)
def test_bad_arguments_are_refused(solver: codegen.Solver, more: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        judged(solver, **more)


def test_other_refusals(solver: codegen.Solver) -> None:
    with pytest.raises(ValueError, match="nothing to differentiate by; name variables in wrt"):
        solver.judge(1.0, Final("tip_x"), hessian=True)


def test_a_package_without_the_function_says_which(tmp_path: Path) -> None:
    codegen.generate(EXAMPLES / "swing_up.yaml", tmp_path / "package", functions="motion")
    solver = codegen.load(tmp_path / "package")
    with pytest.raises(codegen.runtime.PackageError, match="without hessian_products; generate it with --functions"):
        solver.judge(1.0, Final("tip_x"), wrt="pole_length", hessian=True)


def test_second_derivatives_of_initial_values_count(tmp_path: Path) -> None:
    text = (EXAMPLES / "swing_up.yaml").read_text()
    model = tmp_path / "formula.yaml"
    model.write_text(text + "\ninitial:\n  q: {pole: sin(pole_length**2)}\n")
    codegen.generate(model, tmp_path / "package", functions=FUNCTIONS)
    solver = codegen.load(tmp_path / "package")
    wrt = ("pole_length", "bob_mass")
    found = solver.judge(0.5, Final("tip_x"), wrt=wrt, hessian=True, **FIXED).hessian_products[0]
    h, ends = 1e-3, []
    for n in (1, -1, 2, -2, 3, -3):
        p = {"pole_length": 0.6 + n * h}
        ends.append(solver.judge(0.5, Final("tip_x"), p=p, wrt=wrt, method="adjoint", **FIXED).gradients[0])
    wanted = (45 * (ends[0] - ends[1]) - 9 * (ends[2] - ends[3]) + (ends[4] - ends[5])) / (60 * h)
    np.testing.assert_allclose(found[0], wanted, rtol=1e-8)
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-12 * np.abs(found).max())


@pytest.mark.parametrize("given", [{"q": {"cart": 0.2}}, {"q": {"pole": 0.2}, "u": {"cart": 0.1}}])
def test_initial_values_that_a_mapping_omits_depend_on_parameters(given: Any, tmp_path: Path) -> None:
    """Gradients against differences of values, Hessians against differences of gradients."""
    model = tmp_path / "formula.yaml"
    formulas = "initial: {q: {pole: sin(pole_length**2), cart: bob_mass**2*pole_length}, u: {pole: bob_mass**3}}"
    model.write_text(f"{(EXAMPLES / 'swing_up.yaml').read_text()}\n{formulas}\n")
    codegen.generate(model, tmp_path / "package", functions="motion,hessian_products")
    solver = codegen.load(tmp_path / "package")
    wrt, x, h = ("pole_length", "bob_mass"), np.array([0.6, 0.2]), 1e-3

    def judged_at(x: np.ndarray, **more: Any) -> Any:
        p = dict(zip(wrt, x, strict=True))
        return solver.judge(0.5, [Final("tip_x"), Integral("kinetic")], p=p, wrt=wrt, **given, **FIXED, **more)

    found = judged_at(x, hessian=True)
    for method in ("forward", "adjoint"):
        np.testing.assert_allclose(judged_at(x, method=method).gradients, found.gradients, rtol=1e-12, atol=1e-14)
    for i, e in enumerate(h * np.eye(2)):
        ends = [judged_at(x + n * e, method="adjoint") for n in (1, -1, 2, -2, 3, -3)]
        for of, exact in (("values", found.gradients[:, i]), ("gradients", found.hessian_products[:, i])):
            one, two, three = (getattr(a, of) - getattr(b, of) for a, b in zip(ends[::2], ends[1::2], strict=True))
            np.testing.assert_allclose(exact, (45 * one - 9 * two + three) / (60 * h), rtol=1e-8, atol=1e-10)


def test_prescribed_motion(tmp_path: Path) -> None:
    """Products equal those of differences, with a driving force among the outputs."""
    codegen.generate(EXAMPLES / "shaken_pendulum.yaml", tmp_path / "package", functions=FUNCTIONS)
    solver = codegen.load(tmp_path / "package")
    wrt = ("amplitude", "frequency", "length", "q0.rod", "u0.tip")
    x = np.array([0.2, 1.5, 0.3, 0.4, 0.2])
    wanted = [f(name) for name in ("motor", "height", "kinetic") for f in (Final, Integral)]

    def judged_at(x: np.ndarray, **more: Any) -> Any:
        p = dict(zip(wrt[:3], x[:3], strict=True))
        return solver.judge(0.6, wanted, [x[3], 0.25], [0.2, x[4]], p, wrt=wrt, integrator="rk4", step=0.02, **more)

    default = solver.judge(0.1, Final("height"), wrt="length", hessian=True)  # the model's initial state
    given = solver.judge(0.1, Final("height"), *solver.initial_state(), wrt="length", hessian=True)
    np.testing.assert_allclose(default.hessian_products, given.hessian_products, rtol=1e-14)
    found = judged_at(x, hessian=True).hessian_products
    scale, h = np.abs(found).max(axis=(1, 2)), 1e-3
    assert (np.abs(found - found.transpose(0, 2, 1)).max(axis=(1, 2)) < 1e-13 * scale).all()
    for i in range(len(x)):
        step = np.eye(len(x))[i] * h * x[i]
        sides = [
            judged_at(x + n * step, method="adjoint").gradients - judged_at(x - n * step, method="adjoint").gradients
            for n in (1, 2, 3)
        ]
        differences = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h * x[i])
        assert (np.abs(found[:, i] - differences).max(axis=1) < 1e-7 * scale).all()


def same_as_differences(
    judge: Any, x: np.ndarray, apart: np.ndarray, tolerance: float, rounding: float = 1e-12
) -> np.ndarray:
    """Check Hessians against sixth-order differences of gradients, and their symmetry; returns them."""
    found, plain = judge(x, hessian=True), judge(x, method="adjoint")
    hessians = found.hessian_products
    scale = np.abs(hessians).max(axis=(1, 2))
    assert (scale > 0.0).all()
    of_gradient = np.abs(plain.gradients).max(axis=1, keepdims=True)
    assert (np.abs(found.gradients - plain.gradients) < 1e-12 * of_gradient).all()
    assert (np.abs(hessians - hessians.transpose(0, 2, 1)).max(axis=(1, 2)) < rounding * scale).all()
    for i, h in enumerate(apart):
        step = h * np.eye(len(x))[i]
        sides = [
            judge(x + n * step, method="adjoint").gradients - judge(x - n * step, method="adjoint").gradients
            for n in (1, 2, 3)
        ]
        differences = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h)
        assert (np.abs(hessians[:, i] - differences).max(axis=1) < tolerance * scale).all(), i
    return hessians


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory: pytest.TempPathFactory) -> codegen.Solver:
    folder = tmp_path_factory.mktemp("four_bar") / "package"
    codegen.generate(EXAMPLES / "four_bar.yaml", folder, functions=FUNCTIONS)
    return codegen.load(folder)


LOOP = ("crank_length", "coupler_length", "rocker_length", "base", "q0.crank", "u0.crank", "inputs.motor[1]")


def judged_loop(solver: codegen.Solver, x: np.ndarray, wanted: Any, seconds: float, **more: Any) -> Any:
    """A motion of the four-bar linkage from crank angle x[4], with speed x[5] and the input 0, x[6], 0."""
    p = dict(zip(LOOP[:4], x[:4], strict=True))
    q, u = solver.assemble([x[4], -0.3, -2.3], [x[5], 0.0, 0.0], p)
    inputs = ([0.0, 0.1, 0.5], [0.0, x[6], 0.0], "linear")
    return solver.judge(seconds, wanted, q, u, p, inputs, wrt=LOOP, **more)


AT_LOOP = np.array([0.5, 1.2, 0.9, 1.0, 0.8, 2.0, 3.0])


@pytest.mark.parametrize("method", [{"integrator": "rk4", "step": 0.01}, {"integrator": "radau"}])
def test_loops_with_little_memory(four_bar: codegen.Solver, method: Any) -> None:
    wanted = [Final("trace_x"), Integral("kinetic"), At("swing", 0.19)]
    kept = judged_loop(four_bar, AT_LOOP, wanted, 0.4, hessian=True, **method)
    again = judged_loop(four_bar, AT_LOOP, wanted, 0.4, hessian=True, memory=30_000, **method)
    for one, other in zip(kept.hessian_products, again.hessian_products, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14 * np.abs(one).max())


@pytest.mark.filterwarnings("ignore:steps of 0.05 s do not resolve")
def test_loops(four_bar: codegen.Solver) -> None:
    names = ("trace_x", "swing", "kinetic")
    samples = LeastSquares([0.0, 0.13, 0.4], {"swing": [0.1, 0.2, 0.3], "trace_z": [0.1, np.nan, 0.2]}, sigma=0.1)
    wanted = [*map(Final, names), *map(Integral, names), At("swing", 0.19), samples]
    assert four_bar.judge(0.4, wanted, wrt=LOOP[:4], hessian=True, **FIXED).hessian_products.shape == (8, 4, 4)

    def judge(x: np.ndarray, **more: Any) -> Any:
        return judged_loop(four_bar, x, wanted, 0.4, integrator="rk4", step=0.01, **more)

    same_as_differences(judge, AT_LOOP, np.full(7, 1e-4), 1e-9)


def test_loops_with_steps_of_their_own(four_bar: codegen.Solver) -> None:
    """Steps change with the variables, so that differences need small tolerances."""

    def judge(x: np.ndarray, **more: Any) -> Any:
        return judged_loop(four_bar, x, [Final("trace_x"), Integral("kinetic")], 0.4, rtol=1e-12, atol=1e-12, **more)

    same_as_differences(judge, AT_LOOP, np.full(7, 2e-3), 1e-7)


def test_compiled_products_of_outputs_are_those_of_dual_numbers(four_bar: codegen.Solver, tmp_path: Path) -> None:
    """A package with output_hessian_products evaluates outputs in C."""
    functions = f"{FUNCTIONS},output_hessian_products"
    codegen.generate(EXAMPLES / "four_bar.yaml", tmp_path / "package", functions=functions)
    samples = LeastSquares([0.0, 0.13, 0.4], {"swing": [0.1, 0.2, 0.3], "kinetic": [0.1, np.nan, 0.2]}, sigma=0.1)
    wanted = [Final("trace_x"), Integral("kinetic"), At("swing", 0.19), samples]
    more: dict[str, Any] = {"hessian": True, "integrator": "rk4", "step": 0.01}
    other = codegen.load(tmp_path / "package")
    assert "output_hessian_products" in other._functions and "output_hessian_products" not in four_bar._functions
    plain, compiled = (judged_loop(solver, AT_LOOP, wanted, 0.4, **more) for solver in (four_bar, other))
    for one, other in zip(plain.hessian_products, compiled.hessian_products, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * np.abs(one).max())
    np.testing.assert_allclose(plain.gradients, compiled.gradients, rtol=1e-12, atol=1e-13)


@pytest.mark.filterwarnings("ignore:steps of 0.05 s do not resolve")
def test_loops_equal_differences_of_gradients_in_40_digits(four_bar: codegen.Solver) -> None:
    """The classical method with closed loops at every stage, and the first variables' rows."""
    exact, mp = four_bar.in_precision(DIGITS), __import__("mpmath").mp.clone()
    mp.dps = DIGITS
    number = np.frompyfunc(mp.mpf, 1, 1)
    rows, steps, h, torque = (0, 3, 4, 5), 2, mp.mpf(1) / 20, number([0.5])

    def gradients(x: Any) -> Any:
        p = number(four_bar.parameters)
        of = [four_bar.parameter_names.index(n) for n in LOOP[:4]]
        p[of] = x[:4]
        dp = number(np.zeros((6, len(p))))
        dp[range(4), of] = number(1)

        def closed(z: Any) -> Any:
            (q, u), unknown = z[:2], number([0.0, 0.0])
            return exact.assemble([q, *number([-0.3, -2.3])], [u, *unknown], p)

        def seeds(z: Any) -> Any:
            zeros = number(np.zeros((6, 2)))
            return {"dq": np.column_stack([z[2:8], zeros]), "du": np.column_stack([z[8:], zeros]), "dp": dp}

        def rate(z: Any) -> Any:
            udot, dudot = exact.sensitivities(*closed(z), p, torque, mp.mpf(0), **seeds(z))
            return np.array([z[1], udot[0], *z[8:], *dudot[:, 0]])

        z = np.array([*x[4:6], *number(np.eye(6)[4]), *number(np.eye(6)[5])])
        for _ in range(steps):
            k = [rate(z)]
            for part in (h / 2, h / 2, h):
                k.append(rate(z + part * k[-1]))
            z = z + h / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])
        return exact.output_sensitivities(*closed(z), p, torque, mp.mpf(0), **seeds(z))[1].T

    x = number(AT_LOOP[:6])
    q, u = four_bar.assemble([0.8, -0.3, -2.3], [2.0, 0.0, 0.0], dict(zip(LOOP[:4], AT_LOOP[:4], strict=True)))
    found = four_bar.judge(
        0.1, [Final(n) for n in four_bar.output_names], q, u, dict(zip(LOOP[:4], AT_LOOP[:4], strict=True)), [0.5],
        wrt=LOOP[:6], hessian=True, integrator="rk4", step=0.05,
    ).hessian_products  # fmt: skip
    for i in rows:
        moved = number(np.eye(6)[i]) * mp.mpf(APART)
        wanted = ((gradients(x + moved) - gradients(x - moved)) / (2 * mp.mpf(APART))).astype(float)
        scale = np.abs(found).max(axis=(1, 2))
        assert (np.abs(found[:, i] - wanted).max(axis=1) < 1e-12 * scale).all(), i


@pytest.mark.parametrize("method", [{"integrator": "rk4", "step": 0.003}, {"rtol": 1e-12, "atol": 1e-12}])
def test_independents_that_change_on_the_way(tmp_path: Path, method: Any) -> None:
    solver = crank_driven_by_its_piston(tmp_path, FUNCTIONS)
    samples = LeastSquares([0.1, 0.333], {"stroke": [0.5, 0.5], "kinetic": [0.1, 0.2]})
    wanted = [Final("stroke"), At("speed", 0.11), Integral("kinetic"), At("stroke", 0.333), samples]
    wrt = ("crank_length", "rod_length", "offset", "q0.piston", "u0.piston", "inputs.load")
    q0, u0 = solver.initial_state()
    place = solver.coordinate_names.index("piston")

    def judge(x: np.ndarray, **more: Any) -> Any:
        p, q, u = dict(zip(wrt[:3], x[:3], strict=True)), q0.copy(), u0.copy()
        q[place], u[place] = x[3:5]
        q, u = solver.assemble(q, u, p)
        found = solver.judge(0.4, wanted, q, u, p, [x[5]], wrt=wrt, **method, **more)
        assert found.counts["partitions_changed"] == 1
        return found

    x = np.array([0.15, 0.5, 0.02, q0[place], u0[place], 0.5])
    fixed = "step" in method
    same_as_differences(judge, x, np.full(6, 2e-6 if fixed else 1e-4), 1e-8 if fixed else 1e-6, 1e-11)


def test_a_platform_of_three_arms(tmp_path: Path) -> None:
    """Two loops, three degrees of freedom, and arms whose statements the NumPy module shares."""
    codegen.generate(EXAMPLES / "planar_3rrr.yaml", tmp_path / "package", functions=FUNCTIONS)
    solver = codegen.load(tmp_path / "package")
    wrt = ("base_radius", "lower", "platform_mass", "q0.upper_2", "u0.upper_1")
    wanted = [f(n) for n in ("x", "turn", "kinetic") for f in (Final, Integral)]
    q0, u0 = solver.initial_state()
    places = solver.coordinate_names.index("upper_2"), solver.speed_names.index("upper_1")

    def judge(x: np.ndarray, **more: Any) -> Any:
        p, q, u = dict(zip(wrt[:3], x[:3], strict=True)), q0.copy(), u0.copy()
        q[places[0]], u[places[1]] = x[3:]
        q, u = solver.assemble(q, u, p)
        return solver.judge(0.3, wanted, q, u, p, wrt=wrt, integrator="rk4", step=0.01, **more)

    p0 = [solver.parameters[solver.parameter_names.index(n)] for n in wrt[:3]]
    same_as_differences(judge, np.array([*p0, q0[places[0]], 0.5]), np.full(5, 1e-4), 1e-8)


def test_joints_of_which_loops_determine_a_part_are_refused(tmp_path: Path) -> None:
    text = (EXAMPLES / "hooke_ladder.yaml").read_text()
    text = text.replace("independent: [rung_0]", "independent: [rung_0.1, rail_1.1]")
    (tmp_path / "ladder.yaml").write_text(text)
    codegen.generate(tmp_path / "ladder.yaml", tmp_path / "package", functions="motion")
    solver = codegen.load(tmp_path / "package")
    with pytest.raises(ValueError, match="hessian: a joint of hooke_ladder has both independent and dependent speeds"):
        solver.judge(0.1, Final(solver.output_names[0]), wrt=solver.parameter_names[:1], hessian=True)
