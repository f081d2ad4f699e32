"""Assembly stays on the branch of its guess: against closed forms, and against motions along the same path."""

import importlib
import re
import warnings

import numpy as np
import pytest
from loops import followed_mechanisms
from random_mechanisms import Mechanism, random_mechanism

import codegen
from codegen.loops import partition
from codegen.runtime import AssemblyError

FOUR_BAR = """\
model: four_bar
parameters: {a: 0.05, b: 0.11, c: 0.09, d: 0.10}
bodies:
  driver: {parent: ground, joint: {type: revolute, axis: z}, mass: 0.1, com: [a/2, 0, 0], inertia: {xx: 1e-5, yy: 1e-4, zz: 1e-4}}
  coupler: {parent: driver, joint: {type: revolute, axis: z, at: [a, 0, 0]}, mass: 0.1, com: [b/2, 0, 0], inertia: {zz: 1e-4}}
  rocker: {parent: coupler, joint: {type: revolute, axis: z, at: [b, 0, 0]}, mass: 0.1, com: [c/2, 0, 0], inertia: {zz: 1e-4}}
loops:
  pin: {joint: {type: revolute, axis: z}, from: {body: rocker, at: [c, 0, 0]}, to: {body: ground, at: [d, 0, 0]}}
initial:
  q: {driver: 0.6, coupler: 0.2, rocker: -1.8}
independent: [driver]
"""
SLIDER_CRANK = """\
model: driven_crank
parameters: {r: 0.05, rod: 0.12, w: 80}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {yy: 0.01}}
  con: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, r]}, mass: 0.5, com: [0, 0, rod/2], inertia: {yy: 0.001}}
  piston: {parent: ground, joint: {type: prismatic, axis: z}, mass: 0.4}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: con, at: [0, 0, rod]}, to: piston}
motion: {crank: w*t}
initial: {q: {piston: rod + r}}
"""


def on_branch(driver, p):
    """Coupler and rocker of the four-bar by two circles, the coupler's joint above the line from the driver's tip to the pin,
    without whole turns against the driver's own."""
    a, b, c, d = p
    tip = a * np.exp(1j * driver)
    to_pin = d - tip
    r = np.abs(to_pin)
    coupler = np.angle(to_pin) + np.arccos((b * b + r * r - c * c) / (2 * b * r))
    joint = tip + b * np.exp(1j * coupler)
    return np.array([driver, coupler - driver, np.angle(d - joint) - coupler])


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    folder = tmp_path_factory.mktemp("followed")
    made = {}
    for text in (FOUR_BAR, SLIDER_CRANK):
        model = codegen.parse_model(text)
        made[model.name] = codegen.generate(model, folder / model.name).folder
    return made


@pytest.fixture(scope="module", params=["c", "numpy"])
def four_bar(request, folders):
    return codegen.load(folders["four_bar"], request.param)


@pytest.fixture(scope="module", params=["c", "numpy"])
def driven(request, folders):
    return codegen.load(folders["driven_crank"], request.param)


@pytest.mark.parametrize("degrees", [36, 60, 90, -120, 170])
def test_a_driver_that_jumps_stays_on_its_branch(four_bar, degrees):
    """Newton's method on residuals alone changes the branch, or winds dependents up by whole turns."""
    drivers = np.linspace(-3.0, 3.0, 25)
    before = np.array([on_branch(x, four_bar.parameters) for x in drivers])
    guess = before + [np.radians(degrees), 0.0, 0.0]
    expected = np.array([on_branch(x, four_bar.parameters) for x in guess[:, 0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, u = four_bar.assemble(guess, np.ones(3))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.abs(four_bar.closure(found, u)[1]).max() < 1e-12
    np.testing.assert_allclose(four_bar.assemble(guess[7], np.ones(3))[0], expected[7], atol=1e-12)
    _, _, dq, _ = four_bar.assemble_sensitivities(guess, np.ones(3), dq={"driver": 1.0})
    np.testing.assert_allclose(
        dq[0], four_bar.assemble_sensitivities(expected, np.ones(3), dq={"driver": 1.0})[2][0], atol=1e-9
    )


def test_the_initial_state_is_followed_through_whole_turns(four_bar):
    """As a motion goes: the coupler turns back against a driver that goes round."""
    drivers = np.linspace(0.6, 0.6 + 4.0 * np.pi, 9)
    expected = [on_branch(x, four_bar.parameters) for x in drivers]
    found, _ = four_bar.assemble({"driver": drivers})
    np.testing.assert_allclose(found, expected, atol=1e-12)
    path, _ = four_bar.assemble({"driver": drivers}, follow=True)
    np.testing.assert_allclose(path, expected, atol=1e-12)


def test_a_path_of_a_mechanism_without_parameters(tmp_path):
    text = FOUR_BAR.replace("parameters:", "constants:").replace("model: four_bar", "model: constant_bar")
    codegen.generate(codegen.parse_model(text), tmp_path / "constant_bar", target="numpy", functions="accelerations")
    drivers = np.linspace(0.6, 2.0, 4)
    path, _ = codegen.load(tmp_path / "constant_bar").assemble({"driver": drivers}, follow=True)
    np.testing.assert_allclose(path, [on_branch(x, (0.05, 0.11, 0.09, 0.10)) for x in drivers], atol=1e-12)


def test_lengths_that_change_are_followed_from_the_defaults(four_bar):
    p = np.array([0.02, 0.16, 0.15, 0.05])
    found, _ = four_bar.assemble({"driver": 2.0}, p=p)
    np.testing.assert_allclose(found, on_branch(2.0, p), atol=1e-12)


def test_a_branch_that_ends_on_the_way_is_reported(four_bar):
    """A driver that is longer than the others allow cannot go round; it stops where coupler and rocker are in line."""
    p = np.array([0.1, 0.06, 0.08, 0.12])
    q, u = four_bar.assemble({"driver": 0.6}, p=p)
    limit = np.arccos((0.1**2 + 0.12**2 - 0.14**2) / (2 * 0.1 * 0.12))
    near, _ = four_bar.assemble([limit - 1e-6, *q[1:]], u, p)
    assert np.abs(four_bar.closure(near, u, p)[0]).max() < 1e-12
    with pytest.raises(
        AssemblyError, match=r"loop pin cannot be closed: its residual is [\d.]+ at driver = 2\. Followed from"
    ) as caught:
        four_bar.assemble([2.0, *q[1:]], u, p)
    came = float(re.search(r"ends at driver = ([\d.]+)", str(caught.value))[1])
    assert came == pytest.approx(limit, abs=1e-5) and caught.value.loop == "pin"


def test_a_guess_far_from_every_closed_state_is_reported(four_bar):
    with pytest.warns(RuntimeWarning, match=r"closing the loops changed coupler from|other values"):
        q, u = four_bar.assemble([2.0, -0.5, 0.3])
    assert np.abs(four_bar.closure(q, u)[0]).max() < 1e-13


def test_states_over_time_are_followed_from_their_neighbours(driven):
    """One guess for all times: half of them used to come out with the rod folded back."""
    r, rod, w = driven.parameters
    t = np.linspace(0.0, 4.0 * np.pi / w, 23)
    x = w * t
    piston = r * np.cos(x) + np.sqrt(rod**2 - (r * np.sin(x)) ** 2)
    con = np.arctan2(-r * np.sin(x), piston - r * np.cos(x)) - x
    q, u = driven.assemble(t=t)
    np.testing.assert_allclose(q, np.stack([con, piston], axis=-1), atol=1e-12)
    assert np.abs(driven.closure(q, u, t=t)[1]).max() < 1e-10
    for k in (1, 5, 12, 22):
        np.testing.assert_allclose(driven.assemble(t=t[k])[0], q[k], atol=1e-12)
    long = (2000.0 * np.pi + x[5]) / w  # a thousand turns away, of which none are followed
    np.testing.assert_allclose(np.exp(1j * driven.assemble(t=long)[0]), np.exp(1j * q[5]), atol=1e-9)
    np.testing.assert_allclose(driven.assemble(q[3], u[3], t=t[[7, 4]])[0], q[[7, 4]], atol=1e-12)
    np.testing.assert_allclose(driven.assemble(t=t[:, None] + np.zeros(2))[0], np.stack([q, q], axis=1), atol=1e-12)


def test_initial_values_far_from_where_the_loops_close_are_reported():
    far = codegen.parse_model(FOUR_BAR.replace("coupler: 0.2, rocker: -1.8", "coupler: 2.9, rocker: 0.3"))
    said = [text for text in partition(far).warnings if "quarter turn" in text]
    assert len(said) == 1 and said[0].startswith(
        "closing the loops has moved rocker from its initial value 0.3 to 2.50"
    )
    assert not any("quarter turn" in text for text in partition(codegen.parse_model(FOUR_BAR)).warnings)


HELD = """\
model: held_by_{type}
bodies:
  body: {{parent: ground, joint: {{type: free}}, mass: 1, com: [0.1, 0.2, 0.3], inertia: {{xx: 1, yy: 1.2, zz: 1.4}}}}
loops:
  hold: {{joint: {joint}, from: {{body: body, at: [0.3, 0.1, 0]}}, to: {{body: ground, at: [0, 0, 0.2]}}}}
"""
HALF_TURNS = ([0, 1, 0, 0], [0, 0, 1, 0], [0, 0.6, 0.8, 0], [0, 0.48, 0.6, 0.64])


@pytest.mark.parametrize(
    "joint", ["{type: universal, axes: [x, y]}", "{type: revolute, axis: z}", "{type: prismatic, axis: x}"]
)
def test_a_free_body_is_held_from_any_attitude(tmp_path, joint):
    """Closing used to give up on some attitudes, and at exactly half a turn residuals were NaN, or zero."""
    type = joint[7:].split(",")[0]
    folder = codegen.generate(
        codegen.parse_model(HELD.format(type=type, joint=joint)), tmp_path / type, functions=("states",)
    ).folder
    solver = codegen.load(folder)
    q, u = solver.initial
    rng = np.random.default_rng(0)
    guesses = np.tile(q, (44, 1))
    guesses[:40, :3] += 0.3 * rng.normal(size=(40, 3))
    guesses[:40, 3:] = rng.normal(size=(40, 4))
    guesses[40:, 3:] = HALF_TURNS
    turned = solver.closure(guesses[40:], u)[0][:, -2:]
    both = codegen.load(folder, "numpy").closure(guesses[40:], u)[0]
    np.testing.assert_allclose(both[:, -2:], turned, atol=1e-12)
    if type == "prismatic":
        np.testing.assert_allclose(np.linalg.norm(solver.closure(guesses[40:], u)[0][:, -3:], axis=1), 2.0, rtol=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found, _ = solver.assemble(guesses)
    assert np.abs(solver.closure(found, u)[0]).max() < 1e-12


# ---- beside motions --------------------------------------------------------------------------------------------------


def differences(solver, ways):
    """What differs from motions along the same ways, by number; each way as a path and, where that says enough, as a guess."""
    modes = (True,) if solver.name in followed_mechanisms.AMBIGUOUS else (True, False)
    found = {
        (n, follow): followed_mechanisms.compare(solver, way, follow) for n, way in enumerate(ways) for follow in modes
    }
    return {key: said for key, said in found.items() if said not in ("same", "ended")}


@pytest.mark.parametrize(("name", "count"), [("stephenson", 3), *(
    pytest.param(name, 40, marks=pytest.mark.campaign) for name in followed_mechanisms.MODELS
)])  # fmt: skip
def test_random_linkages_are_followed_as_motions_go(tmp_path, name, count):
    """Four-bars, slider-cranks, six-bars of Watt and Stephenson, three links that close at once, and a spatial linkage."""
    text = followed_mechanisms.MODELS[name]
    solver = codegen.load(codegen.generate(codegen.parse_model(text), tmp_path / name, functions=("states",)).folder)
    ways = [followed_mechanisms.random_way(np.random.default_rng(seed), solver) for seed in range(count)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert differences(solver, ways) == {}


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(100, 160))
def test_random_mechanisms_are_followed_as_motions_go(tmp_path, seed):
    """In space and in planes, balls and free bodies, several loops."""
    drawn = random_mechanism(np.random.default_rng(seed), forces=False, springs=False, bodies=(3, 6), loops=(1, 2))
    if not isinstance(drawn, Mechanism):
        pytest.skip(f"no mechanism: {drawn.reason}")
    solver = codegen.load(codegen.generate(drawn.model, tmp_path / "m", functions=("states",)).folder)
    dependent = {name for name in solver.speed_names if name not in solver.independent_speed_names}
    if any(
        name.rpartition(".")[0] in {d.rpartition(".")[0] for d in dependent if "." in d}
        for name in solver.independent_names
    ):
        pytest.skip("a joint is independent in part: where its coordinates go depends on the steps, to second order")
    ways = [followed_mechanisms.way_of_initial(np.random.default_rng([seed, k]), solver) for k in range(2)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert differences(solver, ways) == {}


def test_initial_values_that_assembly_has_changed_are_reported_when_a_package_is_used(tmp_path, monkeypatch):
    """The driver is too long to reach its initial angle. An angle that it reaches is kept, without a warning. A package that is
    imported says the same."""
    far = FOUR_BAR.replace("a: 0.05", "a: 0.15").replace("driver: 0.6", "driver: 3.0")
    codegen.generate(codegen.parse_model(far), tmp_path / "far", target="numpy", functions="accelerations")
    with pytest.warns(
        RuntimeWarning, match=r"four_bar: the loops cannot be closed .*: driver from 3 to ([-\d.]+)\. Give"
    ) as told:
        solver = codegen.load(tmp_path / "far")
    assert re.search(r"to ([-\d.]+)\. Give", str(told[0].message))[1] == f"{solver.initial[0][0]:.4g}"
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.warns(RuntimeWarning, match="cannot be closed with the initial values") as again:
        importlib.import_module("far").Solver()
    assert len(again) == 1
    near = far.replace("driver: 3.0", "driver: 1.0")
    codegen.generate(codegen.parse_model(near), tmp_path / "near", target="numpy", functions="accelerations")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert codegen.load(tmp_path / "near").initial[0][0] == 1.0
