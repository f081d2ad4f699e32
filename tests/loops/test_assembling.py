"""Assembly against closed forms, and the coordinates that it does not change."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loop_closure import assemble, closure
from loops.mechanisms import (
    GROUND,
    RandomMechanism,
    X,
    Y,
    body,
    four_bar,
    jacobian,
    ladder,
    loop,
    model,
    pinned,
    slider_crank,
    stewart,
)
from random_models import expression, vector

import codegen
from codegen.loops import AssemblyError, complete_speeds, initial_configuration, partition
from codegen.model.model import Parameter

EXAMPLES = Path(__file__).parents[2] / "examples"


def residual(made, q, p=None):
    return np.abs(closure(made, q, np.zeros(made.nu), p)[0]).max()


def test_a_four_bar_is_assembled_as_the_two_circles_say():
    a, b, c, d = 1.0, 2.0, 1.5, 2.2
    made = four_bar(a, b, c, d)
    chosen = partition(made)
    q = np.array(chosen.q)
    for crank in np.linspace(1.0, 1.9, 10):
        q[0] = crank
        q = assemble(made, chosen, q)
        # rotation about y by t sends x to (cos t, 0, -sin t)
        tip = np.array((a * np.cos(crank), -a * np.sin(crank)))
        foot = np.array((d, 0.0))
        r = np.linalg.norm(foot - tip)
        along = (b * b - c * c + r * r) / (2 * r)
        across = np.sqrt(b * b - along * along)
        e = (foot - tip) / r
        joint = tip + along * e + across * np.array((e[1], -e[0]))
        coupler = np.arctan2(-(joint - tip)[1], (joint - tip)[0])
        rocker = np.arctan2(-(foot - joint)[1], (foot - joint)[0])
        assert np.abs(np.exp(1j * (q[1] - coupler + crank)) - 1) < 1e-14
        assert np.abs(np.exp(1j * (q[2] - rocker + coupler)) - 1) < 1e-14
        assert residual(made, q) < 1e-15


def test_a_slider_crank_is_assembled_by_the_theorem_of_pythagoras():
    made = slider_crank()
    chosen = partition(made)
    for crank in (-0.7, -0.3, 0.4, 1.2):
        q = assemble(made, chosen, np.array([crank, chosen.q[1], chosen.q[2]]))
        assert q[0] == crank
        assert q[2] == pytest.approx(0.5 * np.cos(crank) + np.sqrt(1.3**2 - (0.5 * np.sin(crank)) ** 2), abs=1e-14)


def test_legs_of_a_stewart_platform_are_as_long_as_their_ends_are_apart():
    made = stewart()
    chosen = partition(made)
    rng = np.random.default_rng(3)
    q = np.array(chosen.q)
    for _ in range(5):
        q[:3] = rng.uniform(-0.15, 0.15, 3) + (0, 0, 1.2)
        q[3:7] = np.array((1, 0, 0, 0)) + 0.15 * rng.normal(size=4)
        q = assemble(made, chosen, q)
        w, v = q[3], q[4:7]
        n = w * w + v @ v
        for i in range(6):
            high = np.array([e.value for e in made.loops[i].end.at], dtype=float)
            low = np.array([e.value for e in made.bodies[1 + 2 * i].joint.at], dtype=float)
            turned = high + 2 * (w * np.cross(v, high) + np.cross(v, np.cross(v, high))) / n
            distance = np.linalg.norm(q[:3] + turned - low)
            slide = q[made.coordinate_names.index(f"rod{i}")]
            assert slide + 1 == pytest.approx(distance, abs=1e-13)


def test_independent_coordinates_are_kept_to_the_bit_and_closed_ones_are_not_moved():
    for made in (four_bar(), ladder(12), pinned(9)):
        chosen = partition(made)
        rng = np.random.default_rng(2)
        q = np.array(chosen.q)
        assert np.array_equal(assemble(made, chosen, q), q) or residual(made, q) > 1e-15
        q += rng.normal(size=made.nq) * 0.01
        result = assemble(made, chosen, q)
        kept = list(chosen.independent)  # single freedoms: coordinates are numbered as speeds
        assert np.array_equal(result[kept], q[kept])
        assert residual(made, result) < 1e-13
        assert np.abs(result - q).max() > 1e-4


def long_ladder(lean: str, loops: int):
    """The example with many loops, whose joints are alike: what rounding turns too far adds up."""
    text = (EXAMPLES / "ladder.yaml").read_text()
    text, n = re.subn(r"L: \d+", f"L: {loops}", text, count=1)
    return codegen.parse_model(text.replace("rung_0: lean,", f"rung_0: {lean},", 1)), n


@pytest.mark.parametrize("loops", [400, pytest.param(1200, marks=pytest.mark.campaign)])
def test_a_long_ladder_is_closed_as_it_is_given(monkeypatch, loops):
    made, n = long_ladder("lean", loops)
    assert n == 1 and len(made.loops) == loops
    called = []
    module = sys.modules["codegen.loops.partition"]  # the package has a function of that name
    assembly = module.first_assembly
    monkeypatch.setattr(module, "first_assembly", lambda *a: called.append(1) or assembly(*a))
    chosen = partition(made)
    assert not called and set(chosen.q) == {np.pi / 6, -np.pi / 6}
    made, _ = long_ladder("lean + 1e-9", loops)  # a gap that is no rounding
    partition(made)
    assert called


def test_assembly_follows_the_parameters():
    made = four_bar()
    parameter = Parameter("base", 2.2)
    foot = made.loops[0]
    made = replace(
        made, parameters=(parameter,), loops=(replace(foot, end=replace(foot.end, at=vector("base", 0, 0))),)
    )
    chosen = partition(made)
    moved = assemble(made, chosen, chosen.q, [2.4])
    assert residual(made, moved, [2.4]) < 1e-15
    assert residual(made, moved) > 0.01
    assert np.abs(moved - assemble(four_bar(base=2.4), partition(four_bar(base=2.4)), moved)).max() < 1e-14


@pytest.mark.parametrize("seeds", [range(20), pytest.param(range(20, 40), marks=pytest.mark.campaign)], ids=str)
def test_quaternions_of_dependent_joints_move_as_rotations_and_stay_of_unit_length(seeds):
    count = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        bodies = [body("arm", GROUND, "revolute", Y), body("ball", 0, "spherical", at=(0.4, 0, 0)),
                  body("slide", GROUND, "prismatic", X, at=(0.2, 0.7, 0)), body("turn", 2, "universal", X, Y)]  # fmt: skip
        made = model(bodies, [loop("lock", "fixed", (1, (0.9, 0.1, 0)), (3, (-0.2, 0.3, 0.1)))],
                     {"arm": rng.uniform(-0.5, 0.5), "ball.qw": 1.0, "ball.qx": 0.2})  # fmt: skip
        try:
            chosen = partition(made)
        except AssemblyError:
            continue
        count += 1
        ball = [made.speed_names.index(f"ball.w{x}") for x in "xyz"]
        assert set(ball) <= {s for ear in chosen.ears for s in ear.dependent}
        q = np.array(chosen.q)
        place = made.coordinate_slices[1][0]
        q[place] = 1.7 * (q[place] + 0.1 * rng.normal(size=4))
        result = assemble(made, chosen, q)
        assert np.linalg.norm(result[place]) == pytest.approx(1, abs=1e-15)
        assert residual(made, result) < 1e-13
    assert count >= 5


def test_quaternions_get_unit_length_even_if_all_is_closed():
    ball = body("ball", GROUND, "spherical")
    made = model([ball, body("arm", GROUND, "revolute", Y)], [loop("hold", "fixed", (0, (1, 0, 0)), (1, (1, 0, 0)))])
    chosen = partition(made)
    assert names_of(made, chosen) == {"arm"}
    assert np.array_equal(assemble(made, chosen, [2.0, 0, 0, 0, 0]), [1, 0, 0, 0, 0])


def names_of(made, chosen):
    return {made.speed_names[s] for s in chosen.independent}


def test_a_guess_without_values_is_closed_too_and_the_doubt_is_told():
    made = four_bar(q=(0, 0, 0))
    chosen = partition(made)
    assert chosen.q[0] == 0
    assert residual(made, chosen.q) < 1e-14
    assert any("foot" in x and "initial" in x for x in chosen.warnings)


def test_unreachable_independents_are_moved_with_a_warning():
    made = slider_crank()
    hinted = replace(made, independent=("slide",), initial_q={"slide": expression(2.5), "crank": expression(-0.7)})
    chosen = partition(hinted)
    assert residual(hinted, chosen.q) < 1e-14
    assert chosen.q[2] < 1.8 + 1e-12
    assert any("pin" in x and "independent" in x for x in chosen.warnings)


def test_links_too_short_name_the_loop_and_the_gap():
    with pytest.raises(AssemblyError) as error:
        partition(four_bar(base=5.0))
    text = str(error.value)
    assert "loop foot" in text
    assert "rocker and ground" in text
    assert "too short" in text
    assert error.value.loop == "foot"
    gap = float(text.split("closed: ")[1].split(" m ")[0])
    assert gap == pytest.approx(0.5, abs=1e-3)  # 5 m less 1, 2 and 1.5
    chosen = partition(four_bar())
    with pytest.raises(AssemblyError, match="loop foot"):
        assemble(four_bar(base=5.0), chosen, chosen.q)


def test_a_joint_the_wrong_way_round_is_not_closed():
    made = four_bar()
    foot = made.loops[0]
    turned = replace(foot, end=replace(foot.end, rotation=((vector(1, 0, 0), expression(float(np.pi))),)))
    with pytest.raises(AssemblyError, match="turned by pi"):
        partition(replace(made, loops=(turned,)))


def test_initial_configuration_takes_what_is_given_and_fills_in_the_rest():
    made = stewart()
    given = {"platform.qx": expression(0.6), "platform.qw": expression(0.8), "leg0.2": expression("2*0.1")}
    q, u = initial_configuration(replace(made, initial_q=given, initial_u={"rod3": expression(1.5)}))
    expected = {"platform.qx": 0.6, "platform.qw": 0.8, "leg0.2": 0.2}
    assert dict(zip(made.coordinate_names, q, strict=True)) == {x: expected.get(x, 0.0) for x in made.coordinate_names}
    assert np.flatnonzero(u).tolist() == [made.speed_names.index("rod3")]
    q, _ = initial_configuration(replace(made, initial_q={"platform.qy": expression(2.0)}))
    assert q[3:7].tolist() == [0, 0, 1, 0]
    q, _ = initial_configuration(replace(made, initial_q={}))
    assert q[3:7].tolist() == [1, 0, 0, 0]


def test_completed_speeds_are_what_assembly_does_as_the_independents_move():
    made = four_bar()
    chosen = partition(made)
    h, q = 1e-6, np.array(chosen.q)
    plus, minus = (assemble(made, chosen, q + sign * h * np.eye(3)[0]) for sign in (1, -1))
    u = complete_speeds(made, chosen, q, np.array([1.0, 99.0, -99.0]))
    assert np.abs((plus - minus) / (2 * h) - u).max() < 1e-8


def test_completed_speeds_keep_the_independents_and_close_every_loop():
    for seed in range(30):
        rng = np.random.default_rng(seed)
        mechanism = RandomMechanism(rng, 8, ["spherical", "universal"], ("revolute", "prismatic", "universal"))
        made = mechanism.model
        chosen = partition(made)
        given = rng.normal(size=made.nu)
        u = complete_speeds(made, chosen, chosen.q, given)
        kept = list(chosen.independent)
        assert np.array_equal(u[kept], given[kept])
        assert np.abs(jacobian(made, chosen.q) @ u).max() < 1e-11 * np.abs(u).max()
