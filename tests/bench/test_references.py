"""References of `ordernm bench`: closed forms against published digits, recursions against the generic engine."""

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from codegen.bench.catalogue import PROBLEMS, UnknownProblemError, chosen
from codegen.bench.dual import Dual, cosine, sine
from codegen.bench.elliptic import swing
from codegen.bench.problem import Family, Motion
from codegen.bench.problems import families, four_bars, motions, pendulum, planar_chains
from codegen.measure import articulated_chain
from codegen.measure.models import changed, example
from codegen.model import parse_model
from codegen.reference import RecursiveEngine

A01 = {
    0.5: ("-0.3910487915505463876893419", "-0.9203699487851922037602769"),
    2.0: ("-0.7935661953433217469924858", "-0.608483930443791514627198"),
    10.0: ("-0.2750874625761168600543914", "-0.9614192050991250642651351"),
    1000.0: ("0.6832301885523148554574465", "-0.7302030604227623275486221"),
    2000.0: ("0.8146030685890321521217578", "-0.580018827836935461591945"),
}
"""x and y of the ball by time, from x = -1; as published for the benchmark, 25 digits."""
A02 = {
    (2, 1.0): ("-0.1950203019494350936440586", "-0.9807992056621738326017729"),
    (2, 20.0): ("0.8397465743068435465399946", "0.5429785363528846615949654"),
    (40, 5.0): ("-0.5401900506755262741339021", "-0.8415430524644430548554659"),
    (40, 20.0): ("0.4109011537629452221452456", "0.9116799009719806516314131"),
}
"""x and y of the first crank's tip by N and time."""


def test_the_pendulum_is_where_jacobis_functions_were_tabulated():
    for t, (x, y) in A01.items():
        angle, _ = swing("9.81", t)
        with mpmath.workdps(40):
            assert abs(-angle.sin - mpmath.mpf(x)) < 1e-22
            assert abs(-angle.cos - mpmath.mpf(y)) < 1e-22


def test_a_swing_keeps_its_energy_and_its_equation():
    with mpmath.workdps(40):
        for t in ("0.3", "1.7"):
            angle, rate = swing("9.81", mpmath.mpf(t))
            assert abs(rate**2 / 2 - mpmath.mpf("9.81") * angle.cos) < 1e-35, "at rest at 90 degrees"
            assert abs(angle.sin**2 + angle.cos**2 - 1) < 1e-35


def test_derivatives_of_the_pendulum_are_the_published_ones():
    published = [
        [2.128235525459596756605769, -0.6089444722530455003300269],
        [-21.15307796733476104235699, 5.012326067703251293972429],
    ]
    assert np.array(pendulum._derivatives()) == pytest.approx(np.array(published), rel=1e-14)


def test_the_four_bars_are_where_they_were_tabulated():
    for (n, t), exact in A02.items():
        with mpmath.workdps(40):
            for found, wanted in zip(four_bars.tip(n, t), exact, strict=True):
                assert abs(found - mpmath.mpf(wanted)) < 1e-23


def test_derivatives_of_the_four_bars_are_those_of_their_closed_form():
    """By g, the length and v0: differences of the closed form in 40 digits."""
    h = mpmath.mpf("1e-12")

    def slope(**moved):
        with mpmath.workdps(40):
            ends = [four_bars.tip(2, 10.0, **{k: mpmath.mpf(x) + s * h for k, x in moved.items()}) for s in (1, -1)]
            return [float((a - b) / (2 * h)) for a, b in zip(*ends, strict=True)]

    expected = four_bars.DERIVATIVES
    assert slope(g="9.81") == pytest.approx(expected[0], rel=1e-12)
    assert slope(length="1") == pytest.approx(expected[1], rel=1e-12)
    assert slope(v0="1") == pytest.approx(expected[4], rel=1e-12)


def test_the_light_cart_is_where_its_quadrature_ends():
    """Energy and momentum leave one quadrature: the time at which the pole has its last angle."""
    mass, g = mpmath.mpf("1e-6"), mpmath.mpf("9.81")

    def rate(theta):  # of a cart at rest in the mean: speed^2 (1 - cos^2/(1 + mass))/2 = g cos
        c = mpmath.cos(theta)
        return mpmath.sqrt(2 * g * c / (1 - c * c / (1 + mass)))

    with mpmath.workdps(25):
        theta = mpmath.mpf("-1.5491294418948281698")
        quarter = mpmath.mpf("0.4515245356816588751002399")
        # from rest at 90 degrees: with s^2 = pi/2 - theta the integrand is smooth there
        part = mpmath.quad(lambda s: 2 * s / rate(mpmath.pi / 2 - s * s), [0, mpmath.sqrt(mpmath.pi / 2 + theta)])
        period = 4 * quarter
        rest = 10 - 5 * period  # after five swings to and fro it comes from the right side
        assert abs(rate(theta) - mpmath.mpf("0.65212777497647409792")) < 1e-15
        assert abs((rest - period / 2) - part) < 1e-15, "10 s, counted from the left end"


def test_the_chain_in_motion_is_where_scipy_finds_it():
    """The angles; their derivatives are compared with those that are integrated, in test_problems.py."""

    def rates(t, y):
        q, u = y[:4].tolist(), y[4:].tolist()
        return [*u, *articulated_chain.accelerations(q, u, 1.0, math.sin, math.cos, 1.0, 0.05, 9.81)]

    start = np.concatenate(families.chain_state(motions.RODS))
    end = solve_ivp(rates, (0.0, 5.0), start, method="DOP853", rtol=1e-7, atol=1e-7).y[:4, -1]
    assert end == pytest.approx(motions.ANGLES, abs=1e-6)


def against_the_engine(evaluation, directions):
    """The largest difference between a reference and the generic engine, both in 40 digits."""
    engine = RecursiveEngine(parse_model(evaluation.text, "model"), numbers="mpmath")
    with mpmath.workdps(40):
        seeds = {"dq": evaluation.dq, "du": evaluation.du, "dp": evaluation.dp}
        udot, dudot = engine.sensitivities(evaluation.q, evaluation.u, **{k: v[:directions] for k, v in seeds.items()})
        exact = evaluation.reference()
        pairs = [(udot, exact.udot), *zip(dudot, exact.dudot[:directions], strict=True)]
        return max(float(max(abs(a - b) for a, b in zip(x, y, strict=True)) / max(map(abs, y))) for x, y in pairs)


@pytest.mark.parametrize("make", [families.chain, planar_chains.straight, planar_chains.coiled])
def test_recursions_written_by_hand_agree_with_the_engine(make):
    """To what models lose by constants that are folded in doubles, such as the mass of a fifth."""
    assert against_the_engine(make(5), 5) < 1e-14


def test_dual_numbers_differentiate():
    with mpmath.workdps(30):
        x = Dual(mpmath.mpf("0.7"), mpmath.mpf(1))
        y = (2 - x * x) / (1 / sine(x) + 3) - -cosine(x)
        value = mpmath.diff(lambda x: (2 - x * x) / (1 / mpmath.sin(x) + 3) + mpmath.cos(x), mpmath.mpf("0.7"))
        assert abs(y.slope - value) < 1e-18


def test_problems_are_chosen_by_name():
    assert [p.name for p in chosen(["andrews", "pendulum"])] == ["pendulum", "andrews"], "in the order of the catalogue"
    assert chosen([]) == list(PROBLEMS.values())
    assert {type(p) for p in chosen(["motions"])} == {Motion} and {type(p) for p in chosen(["families"])} == {Family}
    with pytest.raises(
        UnknownProblemError, match=r"no problem 'andrew'; there are pendulum, .*; did you mean 'andrews'\?"
    ):
        chosen(["andrew"])


def test_models_of_the_examples_are_changed_where_they_say_so_once():
    assert "{N: 7}" in changed("n_four_bar", "{N: 2}", "{N: 7}")
    with pytest.raises(ValueError, match="does not contain 'mass' exactly once"):
        changed("n_four_bar", "mass", "")
    with pytest.raises(FileNotFoundError, match="lacks a model"):
        example("nothing")
