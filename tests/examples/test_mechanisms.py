"""The shipped mechanisms: numbers of coordinates, loops and degrees of freedom, closure, and closed forms."""

from pathlib import Path

import mpmath
import numpy as np
import pytest
from loop_closure import assemble, closure
from mpmath import mpf

import codegen
from codegen.loops import complete_speeds, initial_configuration, partition
from codegen.model import parse_model
from codegen.reference import DenseEngine

EXAMPLES = Path(__file__).parents[2] / "examples"

SIZES = {
    "four_bar": (3, 3, 1, 1),
    "slider_crank": (4, 3, 1, 1),
    "closed_chain": (16, 16, 1, 11),
    "hooke_ladder": (7, 14, 3, 2),
    "n_four_bar": (5, 5, 2, 1),
    "andrews": (7, 7, 3, 1),
    "bricard": (5, 5, 1, 1),
    "stewart": (13, 25, 6, 6),
    "planar_3rrr": (7, 7, 2, 3),
    "ladder": (7, 7, 3, 1),
    "pinned_chain": (12, 12, 1, 9),
    "screw_jack": (6, 9, 1, 7),
    "double_wishbone": (8, 11, 3, 2),
    "excavator": (13, 12, 4, 4),
    "coupler": (4, 3, 1, 1),
    "valve_train": (4, 4, 3, 1),
}
"""Bodies, coordinates, loops, freedoms."""


def load(name, old="", new=""):
    text = (EXAMPLES / f"{name}.yaml").read_text()
    assert not old or text.count(old) == 1
    return parse_model(text.replace(old, new) if old else text, name)


def assembled(model, change=None):
    """The partition and a closed state: the initial one, or one with other independent coordinates."""
    chosen = partition(model)
    q, u = initial_configuration(model)
    for name, value in (change or {}).items():
        q[model.coordinate_names.index(name)] = value
    q = assemble(model, chosen, q)
    return chosen, q, complete_speeds(model, chosen, q, u)


def test_every_mechanism_is_in_the_table():
    assert {p.stem for p in EXAMPLES.glob("*.yaml") if codegen.load_model(p).loops} == set(SIZES)


@pytest.mark.parametrize("name", SIZES)
def test_a_mechanism_has_the_freedoms_it_should_and_can_be_assembled(name):
    model = load(name)
    chosen, q, u = assembled(model)
    assert (len(model.bodies), model.nq, len(model.loops), len(chosen.independent)) == SIZES[name]
    assert max(np.abs(r).max() for r in closure(model, q, u)) < 1e-12
    assert max(ear.condition for ear in chosen.ears) < 50
    hinted = {model.speed_names[i] for i in chosen.independent}
    wanted = {x for x in model.independent if x in model.speed_names}
    assert wanted <= hinted


@pytest.mark.parametrize(
    "name", ["ladder", "hooke_ladder", "n_four_bar", "closed_chain", "pinned_chain", "andrews", "double_wishbone"]
)
def test_initial_coordinates_that_are_written_down_are_closed(name):
    model = load(name)
    assert np.abs(closure(model, *initial_configuration(model))[0]).max() < 1e-13


@pytest.mark.parametrize("loops", [1, 2, 7, 40])
def test_ladders_of_any_size_have_the_numbers_of_the_paper(loops):
    flat, hooke = (load(name, "{L: 3,", f"{{L: {loops},") for name in ("ladder", "hooke_ladder"))
    chosen = partition(flat)
    assert (len(flat.bodies), flat.nu, len(chosen.independent)) == (2 * loops + 1, 2 * loops + 1, 1)
    assert [(ear.rank, len(ear.loops)) for ear in chosen.ears] == [(2, 1)] * loops
    chosen = partition(hooke)
    assert (len(hooke.bodies), hooke.nu, len(chosen.independent)) == (2 * loops + 1, 4 * loops + 2, 2)
    assert [(ear.rank, ear.rows, len(ear.loops)) for ear in chosen.ears] == [(4, 4, 1)] * loops


@pytest.mark.parametrize("n", [8, 24, 80])
def test_the_closed_chain_closes_for_every_multiple_of_eight(n):
    model = load("closed_chain", "{n: 16,", f"{{n: {n},")
    q, u = initial_configuration(model)
    assert np.abs(closure(model, q, u)[0]).max() < 1e-12
    assert len(partition(model).independent) == n - 5


def test_bricard_has_a_redundant_condition_and_the_3rrr_is_closed_as_a_whole():
    (ear,) = partition(load("bricard")).ears
    assert (ear.rows, ear.rank) == (5, 4), "of six hinges one is the loop's: five conditions for four angles"
    (ear,) = partition(load("planar_3rrr")).ears
    assert (len(ear.loops), ear.rank) == (2, 4)


def test_the_stewart_platform_needs_no_cluster():
    chosen = partition(load("stewart"))
    assert [(len(ear.loops), ear.rows, ear.rank) for ear in chosen.ears] == [(1, 3, 3)] * 6


# --- closed forms ---------------------------------------------------------------------------------------------------


def test_the_valve_train_is_one_equation():
    """Where tappet, rocker and valve are by the camshaft's angle, and Lagrange's equation of that."""
    model = load("valve_train")
    of = {x.name: mpf(repr(x.value)) for x in model.parameters}
    base, rod, arm, pad = (of[n] for n in ("base", "pushrod", "arm", "pad"))
    shaft = mpf("8e-3")
    about_pivot = mpf("6e-5") + mpf("0.15") * (mpf("0.004") ** 2 + mpf("0.002") ** 2)
    g, theta, speed = mpf("9.81"), mpf("0.9"), mpf(40)

    def tappet(a):
        return base + of["lift"] * mpmath.cos(2 * a)

    def rocker(a):
        return mpmath.findroot(
            lambda x: (arm * (1 - mpmath.cos(x))) ** 2 + (base + rod + arm * mpmath.sin(x) - tappet(a)) ** 2 - rod**2,
            (tappet(a) - base) / arm,
        )

    def valve(a):
        return -pad * mpmath.sin(rocker(a))

    def mass(a):
        parts = ((mpf("0.08"), tappet), (about_pivot, rocker), (of["valve_mass"], valve))
        return shaft + sum(m * mpmath.diff(f, a) ** 2 for m, f in parts)

    def potential(a):
        x = rocker(a)
        of_rocker = mpf("0.15") * g * (mpf("0.002") * mpmath.cos(x) - mpf("0.004") * mpmath.sin(x))
        spring = -of["preload"] * valve(a) + of["stiffness"] * valve(a) ** 2 / 2
        return mpf("0.08") * g * tappet(a) + of_rocker + of["valve_mass"] * g * valve(a) + spring

    names, chosen = model.coordinate_names, partition(model)
    q, u = initial_configuration(model)
    q[names.index("camshaft")], u[names.index("camshaft")] = float(theta), float(speed)
    q = assemble(model, chosen, q)
    u = complete_speeds(model, chosen, q, u)
    udot = DenseEngine(model, partition=chosen).accelerations(q, u, None, [0.3])
    with mpmath.workdps(40):
        slope = mpmath.diff(potential, theta) + mpmath.diff(mass, theta) * speed**2 / 2
        wanted = (mpf("0.3") - mpf("0.01") * speed - slope) / mass(theta)
        at = {"tappet": tappet(theta), "rocker": rocker(theta), "valve": valve(theta)}
    for name, value in at.items():
        assert q[names.index(name)] == pytest.approx(float(value), rel=1e-12)
    assert udot[names.index("camshaft")] == pytest.approx(float(wanted), rel=1e-11)


def test_the_screw_jack_is_two_equations():
    """The spindle's angle and the ram's place, from energies; the crate slides across and only weighs."""
    model = load("screw_jack")
    values = {"pitch": 0.003, "friction": 0.0}
    p = np.array([values.get(x.name, x.value) for x in model.parameters])
    of = {x.name: value for x, value in zip(model.parameters, p, strict=True)}
    names = model.coordinate_names
    chosen, q, _ = partition(model), *initial_configuration(model)
    q[names.index("screw")], q[names.index("ram.1")] = 0.7, 0.04
    u = np.zeros(model.nu)
    u[names.index("motor")], u[names.index("screw")], u[names.index("ram.1")] = 3.0, 2.0, -0.3
    q = assemble(model, chosen, q, p)
    udot = DenseEngine(model, partition=chosen).accelerations(q, complete_speeds(model, chosen, q, u, p), p, [0.5])
    found = {n: udot[i] for i, n in enumerate(model.speed_names)}
    lift, ram = -of["pitch"], 3.0  # the table's way by the spindle's angle, kg
    heavy = of["table_mass"] + of["crate_mass"] + ram
    shaft = of["coupling"] * (q[names.index("motor")] - 0.7) + of["coupling_damping"] * (3.0 - 2.0)
    mass = [[of["spindle"] + heavy * lift**2, ram * lift], [ram * lift, ram]]
    spindle, slide = np.linalg.solve(mass, [shaft - 9.81 * heavy * lift, -400 * 0.04 - 20 * -0.3 - 9.81 * ram])
    assert found["screw"] == pytest.approx(spindle, rel=1e-11)
    assert found["ram.1"] == pytest.approx(slide, rel=1e-11)
    assert found["table"] == pytest.approx(lift * spindle, rel=1e-11)
    assert found["motor"] == pytest.approx((0.5 - shaft) / of["rotor"], rel=1e-11)


def test_andrews_begins_with_the_published_accelerations():
    """To every digit printed, from the published coordinates and data as decimal numbers."""
    published = (
        "-0.0617138900142764496358948458001 0 0.455279819163070380255912382449 0.222668390165885884674473185609"
        " 0.487364979543842550225598953530 -0.222668390165885884674473185609 1.23054744454982119249735015568"
    )
    model = load("andrews")
    with mpmath.workdps(50):
        q = np.array([mpf(x) for x in published.split()], dtype=object)
        p = np.array([mpf(repr(x.value)) for x in model.parameters], dtype=object)
        udot = DenseEngine(model, "mpmath").accelerations(q, np.zeros(7), p)
        expected = [mpf("14222.4439199541138705911625887"), mpf("-10666.8329399655854029433719415"), *[0] * 5]
        assert max(abs(a - b) for a, b in zip(udot, expected, strict=True)) < 1e-25
    chosen, q, u = assembled(model)
    udot = DenseEngine(model, partition=chosen).accelerations(q, u)
    assert np.abs(udot - np.array([float(x) for x in expected])).max() < 1e-9


def test_andrews_accelerates_as_published_at_the_end_too():
    """At t = 0.03 s, against a state and accelerations from an integration with 80-bit numbers, right to 13 digits."""
    q = "15.810771195153704691 -15.756371058411837046 4.0822240119646751159e-2 -0.53473011634207794399" \
        " 0.52440996587995403308 0.53473011634207770118 1.0480807410419377723"  # fmt: skip
    u = "1139.9203022591064587 -1424.3792951775405951 11.032911910618192986 19.293374105031347900" \
        " 0.57356991482946315114 -19.293374105031356086 0.32317914924916315769"  # fmt: skip
    udot = "-24631.763122872729166 51850.319636460715646 324102.60070757890045 566749.42200099581009" \
        " 16743.635418345231852 -566749.42200099580765 9826.5078015451039537"  # fmt: skip
    model = load("andrews")
    with mpmath.workdps(30):
        state = (np.array([mpf(x) for x in line.split()], dtype=object) for line in (q, u))
        p = np.array([mpf(repr(x.value)) for x in model.parameters], dtype=object)
        found = DenseEngine(model, "mpmath").accelerations(*state, p)
    for a, b in zip(found, udot.split(), strict=True):
        assert float(a) == pytest.approx(float(b), rel=1e-11)


@pytest.mark.parametrize("loops", [1, 3, 10])
def test_a_ladder_is_a_pendulum(loops):
    """Rungs turn about their feet, rails move on circles; all in one angle."""
    model = load("ladder", "{L: 3,", f"{{L: {loops},")
    chosen, q, u = assembled(model, {"rung_0": 0.7})
    foot, rail = 1 / 3 + 0.05**2 / 4, 1.0
    expected = 9.81 * np.sin(0.7) * ((loops + 1) / 2 + loops) / ((loops + 1) * foot + loops * rail)
    udot = DenseEngine(model, partition=chosen).accelerations(q, u)
    assert udot[::2] == pytest.approx(expected, rel=1e-12)
    assert udot[1::2] == pytest.approx(-expected, rel=1e-12)


@pytest.mark.parametrize("N", [2, 40])
def test_n_four_bars_are_a_pendulum(N):
    model = load("n_four_bar", "{N: 2}", f"{{N: {N}}}")
    chosen, q, u = assembled(model, {"crank_0": 0.4})
    udot = DenseEngine(model, partition=chosen).accelerations(q, u)
    c = 9.81 * ((N + 1) / 2 + N) / ((N + 1) / 3 + N)
    assert udot[0] == pytest.approx(c * np.sin(0.4), rel=1e-10)


@pytest.mark.parametrize("alpha", [0.3, 1.0, 2.0, 2.8])
def test_bricard_follows_its_closure_curve(alpha):
    model = load("bricard")
    q, (chosen, *_) = None, assembled(model)
    q = initial_configuration(model)[0]
    for step in np.linspace(0, alpha, 12)[1:]:  # beta follows along; from afar another branch could be found
        q[0] = step
        q = assemble(model, chosen, q)
    beta = np.arcsin(1 / (1 + np.sin(alpha)) - 1)
    assert q[2:5:2] == pytest.approx(alpha, abs=1e-12)
    assert q[1:5:2] == pytest.approx(beta, abs=1e-12)
    place = [np.cos(alpha) * (1 + np.sin(beta)), -np.cos(beta), -np.sin(alpha) * (1 + np.sin(beta))]
    assert DenseEngine(model, partition=chosen).outputs(q, np.zeros(5))[:3] == pytest.approx(place, abs=1e-12)


def test_the_slider_crank_slides_as_its_crank_turns():
    model = load("slider_crank")
    r, rod, offset = (
        next(p.value for p in model.parameters if p.name == n) for n in ("crank_length", "rod_length", "offset")
    )
    for angle in (0.7, 2.0, -1.0):
        chosen, q, u = assembled(model, {"wheel": angle})
        stroke = r * np.cos(angle) + np.sqrt(rod**2 - (r * np.sin(angle) + offset) ** 2)
        assert DenseEngine(model, partition=chosen).outputs(q, u)[0] == pytest.approx(stroke, rel=1e-13)


def test_the_legs_of_the_stewart_platform_reach_from_base_to_platform():
    model = load("stewart")
    _, q, _ = assembled(model)
    value = {p.name: p.value for p in model.parameters}
    w, x, y, z = q[3:7] / np.linalg.norm(q[3:7])
    R = np.array([[w*w + x*x - y*y - z*z, 2*(x*y - w*z), 2*(x*z + w*y)], [2*(x*y + w*z), w*w - x*x + y*y - z*z, 2*(y*z - w*x)],
                  [2*(x*z - w*y), 2*(y*z + w*x), w*w - x*x - y*y + z*z]])  # fmt: skip
    around = 2 * np.pi / 3
    for k in range(6):
        near = around * (k // 2) + (0.5 - k % 2) * value["base_gap"]
        far = around * (k // 2 + 0.5 - k % 2) - (0.5 - k % 2) * value["top_gap"]
        foot = value["base_radius"] * np.array([np.cos(near), np.sin(near), 0])
        ball = [value["top_radius"] * np.cos(far), value["top_radius"] * np.sin(far), -value["thickness"] / 2]
        length = np.linalg.norm(q[:3] + R @ ball - foot)
        stroke = q[model.coordinate_names.index(f"piston_{k + 1}")]
        assert stroke + value["cylinder_length"] == pytest.approx(length, rel=1e-13)


def test_the_hooke_ladder_sways_as_a_whole():
    """All rungs stay parallel, so one rung's two angles say everything."""
    model = load("hooke_ladder")
    chosen, q, u = assembled(model, {"rung_0.1": -0.3, "rung_0.2": 0.4})
    tip = np.array([np.sin(-0.3) * np.cos(0.4), -np.sin(0.4), np.cos(-0.3) * np.cos(0.4)])
    assert DenseEngine(model, partition=chosen).outputs(q, u)[:3] == pytest.approx(tip, rel=1e-13)
    assert q[6:].reshape(2, 4) == pytest.approx(np.tile(q[2:6], (2, 1)), abs=1e-13)
