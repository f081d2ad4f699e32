"""The solver in more digits: against the dense method in mpmath's numbers, its arguments, and its errors."""

import io
import pickle
import tokenize

import made_once
import mpmath
import numpy as np
import pytest

import codegen
from codegen.reference import RecursiveEngine
from codegen.runtime.standalone.trust.precision import Digits, Text

FOUR_BAR = "examples/four_bar.yaml"


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return made_once.solvers(tmp_path_factory)(codegen.load_model(FOUR_BAR))


@pytest.fixture(scope="module")
def exact(solver):
    return solver.in_precision(40)


def test_the_digits_are_those_that_were_asked_for(solver, exact):
    q, u = exact.initial
    for position_or_velocity in exact.closure(q, u):
        assert max(abs(position_or_velocity)) < 1e-39
    longer = solver.in_precision(60)
    a, b = exact.accelerations(q, u), longer.accelerations(q, u)
    assert 0 < max(abs(a - b)) < 1e-36
    assert max(abs(longer.closure(q, u)[0])) < 1e-39  # the state is the same
    assert repr(exact).endswith("in 40 digits>")
    with mpmath.workdps(15):
        assert max(abs(exact.accelerations(q, u) - a)) == 0


def test_everything_agrees_with_double_precision(solver, exact):
    q, u = solver.initial
    assert abs(exact.initial[0] - q).max() < 1e-15
    rng = np.random.default_rng(1)
    seeds = {"dq": rng.normal(size=(2, 3)), "du": rng.normal(size=(2, 3)), "dp": rng.normal(size=(2, 6))}
    w = rng.normal(size=(2, 3))
    calls = [
        lambda s: s.assemble(q, u),
        lambda s: s.sensitivities(q, u, dinputs=[[1.0], [0.5]], **seeds),
        lambda s: s.coordinate_rate_sensitivities(q, u, **seeds),
        lambda s: [getattr(s.jacobians(q, u), n) for n in ("q", "u", "p", "inputs", "t")],
        lambda s: s.energy_sensitivities(q, u, **seeds)[1],
        lambda s: s.output_sensitivities(q, u, **seeds),
        lambda s: s.assemble_sensitivities(q, u, **seeds),
        lambda s: s.initial_sensitivities(dp=seeds["dp"]),
        lambda s: s.gradients(q, u, weights=w),
        lambda s: s.assemble_gradients(q, u, weights_q=w, weights_u=w),
        lambda s: s.output_gradients(q, u, weights=np.eye(5)),
        lambda s: [s.accelerations([q, q + [0, 1e-3, 0]], u, {"base": 1.2}, t=[0.0, 1.0])],
    ]
    for call in calls:
        for a, b in zip(call(solver), call(exact), strict=True):
            assert np.shape(a) == np.shape(b)
            assert all(isinstance(x, exact.mp.mpf) for x in np.ravel(b))
            assert np.abs(a - b).max(initial=0) <= 1e-12 * (1 + np.abs(a).max(initial=0))


def test_what_is_taken(solver, exact):
    q, u = exact.initial
    a = exact.accelerations(q, u)
    assert max(abs(exact.accelerations([str(x) for x in q], u) - a)) < 1e-36
    assert max(abs(exact.accelerations(list(q), u.astype(float)) - a)) == 0
    third = exact.mp.mpf(1) / 3
    one, other = (exact.accelerations(q, u, {"coupler_mass": x}) for x in (third, 1 / 3))
    assert 1e-18 < max(abs(one - other)) < 1e-13
    again = pickle.loads(pickle.dumps(exact))
    assert (again.accelerations(q, u) == a).all()
    assert exact.in_precision(50).digits == 50
    for wrong, message in (([np.nan, 0, 0], "finite"), (["a", 0, 0], "real numbers"), ([1, 2], "expected")):
        with pytest.raises(ValueError, match=message):
            exact.accelerations(wrong, u)
    with pytest.raises(ValueError, match=r"holds float64.*expected a writeable C-contiguous array of object"):
        exact.accelerations(q, u, out=np.zeros(3))
    place = np.empty(3, object)
    assert exact.accelerations(q, u, out=place) is place and (place == a).all()
    for digits in (15, 40.0, True, 10**6):
        with pytest.raises(ValueError, match="digits is"):
            solver.in_precision(digits)
    with pytest.raises(AttributeError, match="double precision"):
        exact.simulate(1.0)
    with pytest.raises(codegen.runtime.AssemblyError):
        exact.assemble(q, u, {"base": 99.0})


def test_batches_with_bad_states_keep_their_digits(solver):
    solver.bad_states = "nan"
    try:
        exact = solver.in_precision(40)
    finally:
        solver.bad_states = "error"
    q, u = exact.initial
    third = exact.mp.mpf(1) / 3
    states = np.stack([q, q, q])
    alone = exact.accelerations(q, u, {"coupler_mass": third})
    assert (exact.accelerations(states, u, {"coupler_mass": third}) == alone).all()
    states[1, 0] = exact.mp.nan
    calls = [
        lambda q: exact.accelerations(q, u, {"coupler_mass": third}),
        lambda q: exact.jacobians(q, u, {"coupler_mass": third}, wrt="p").p,
        lambda q: exact.gradients(q, u, {"coupler_mass": third}, weights=[1, 0, 0]).p[0],
    ]
    for call in calls:
        with pytest.warns(RuntimeWarning, match=r"1 of 3 states are NaN: state \[1\]: q\[0\]"):
            found = call(states)
        assert (found[[0, 2]] == call(q)).all() and all(map(mpmath.isnan, found[1].ravel()))


def test_without_mpmath_it_says_what_to_install(solver, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mpmath", None)
    with pytest.raises(ImportError, match="pip install mpmath"):
        solver.in_precision()


def test_what_has_no_real_value_is_told_as_in_double_precision(tmp_path):
    model = codegen.parse_model("""
model: without_value
parameters: {k: 2}
bodies:
  a: {parent: ground, mass: 1, joint: {type: prismatic, axis: x}}
  b: {parent: a, mass: 1, joint: {type: prismatic, axis: x}}
forces:
  push: {type: joint, joint: a, value: k*acos(u.a/4)}
  spring: {type: joint, joint: b, value: -k*q.a**1.5}
""")
    codegen.generate(model, tmp_path)
    exact = codegen.load(tmp_path).in_precision(30)
    engine = RecursiveEngine(model, numbers="mpmath")
    for q, u, force in [([1.0, 0.0], [9.0, 0.0], "push"), ([-1.0, 0.0], [1.0, 0.0], "spring")]:
        with pytest.warns(RuntimeWarning, match=f"udot of accelerations is not finite.*force {force}"):
            found = exact.accelerations(q, u)
        with pytest.warns(RuntimeWarning, match=f"not finite.*force {force}"):
            _, along = exact.sensitivities([q, q], u, dp=[1.0])
        udot, dudot = engine.sensitivities(q, u, dp=[[1.0]])
        assert all(mpmath.isnan(x) for x in (*found, *along.ravel(), *udot, *dudot.ravel()))


def test_forces_of_loops_keep_the_digits_of_accelerations(exact):
    """They are affine in the accelerations, to all digits and not to those of doubles."""
    q, u = exact.initial
    third = np.linspace(0.1, 1.0, exact.nu) / exact.mp.mpf(3)
    dp = np.ones(exact.np) / exact.mp.mpf(7)
    at = [
        (exact.inverse_dynamics(q, u, n * third), *exact.inverse_dynamics_sensitivities(q, u, n * third, dp=dp))
        for n in (0, 1, 3)
    ]
    for none, once, thrice in zip(*at, strict=True):
        assert np.abs(thrice - 3 * once + 2 * none).max() < 1e-35 * np.abs(thrice).max()


def test_forces_of_loops_refuse_accelerations_as_those_of_trees(solver):
    q, u = solver.initial
    for udot, said in (
        (None, "udot"),
        ([1j] * solver.nu, "udot holds complex"),
        ([np.nan] * solver.nu, "udot.* is nan"),
    ):
        with pytest.raises(ValueError, match=said):
            solver.inverse_dynamics(q, u, udot)


def test_every_float_of_a_module_becomes_a_decimal_number_and_nothing_else(solver):
    opened = solver._opened
    text = (opened.folder / f"{opened.manifest['name']}_numpy.py").read_text()
    text += 'x1e5 = a1.b2 = 7  # 1.5\ny = [1., .5, 1e3, 2.5E-07, 3, x1e5.real]; z = "0.1 \\" 0.2"\n'
    known, words = {}, []
    for kind, word, *_ in tokenize.generate_tokens(io.StringIO(text).readline):
        if kind == tokenize.NUMBER and not word.isdigit():
            word = known.setdefault(word, f"number_{len(known)}_")
        words.append(word)
    made = Text(text, Digits(40))
    assert made.known == known
    found = [word for _, word, *_ in tokenize.generate_tokens(io.StringIO(made.text).readline)]
    assert "".join(found) == "".join(words).replace("importnumpyasnp", "", 1)
