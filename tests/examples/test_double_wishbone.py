"""The double wishbone: the pose of its wheel, its forces and its energy, from five distances."""

import numpy as np
import pytest
from motions import at, built, motion, named
from scipy.optimize import fsolve

LINKS = (("lower_front", "lower_ball"), ("lower_rear", "lower_ball"), ("upper_front", "upper_ball"),
         ("upper_rear", "upper_ball"), ("tie_inner", "tie_outer"))  # fmt: skip
"""A wheel is held by five distances, each from a point of the chassis to one of the upright."""


def turn(axis, angle):
    """The matrix of a rotation about x, y or z."""
    R, (i, j) = np.eye(3), {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i] = np.sin(angle)
    R[i, j] = -R[j, i]
    return R


class Corner:
    """The wheel of a car, held by five distances."""

    def __init__(self, solver):
        self.p = dict(zip(solver.parameter_names, solver.parameters, strict=True))

    def point(self, name):
        return np.array([self.p[f"{name}_{axis}"] for axis in "xyz"])

    def stands(self, lift, rack=0.0):
        """x, y and turns about z, x and y of the wheel's centre, for its way up."""

        def gaps(v):
            R = turn("z", v[2]) @ turn("x", v[3]) @ turn("y", v[4])
            place = self.point("wheel") + [v[0], v[1], lift]
            found = []
            for inner, outer in LINKS:
                shift = [0, rack if inner == "tie_inner" else 0, 0]
                reached = place + R @ (self.point(outer) - self.point("wheel")) - self.point(inner) - shift
                found.append(np.linalg.norm(reached) - np.linalg.norm(self.point(outer) - self.point(inner)))
            return found

        return fsolve(gaps, np.zeros(5), xtol=1e-12)

    def load(self):
        """The force of the road at the design position, at rest, from the virtual work of lifting the wheel."""
        rows = []
        for inner, outer in LINKS:
            along = self.point(outer) - self.point(inner)
            rows.append([*along, *np.cross(self.point(outer) - self.point("wheel"), along)])
        rows = np.array(rows)
        x, y, *omega = np.linalg.solve(rows[:, [0, 1, 3, 4, 5]], -rows[:, 2])  # per lift
        velocity, omega = np.array([x, y, 1]), np.array(omega)

        def ball(name):
            return velocity + np.cross(omega, self.point(name) - self.point("wheel"))

        def swings(arm):
            axis = self.point(f"{arm}_front") - self.point(f"{arm}_rear")
            lever = np.cross(axis, self.point(f"{arm}_ball") - self.point(f"{arm}_front"))
            rate = ball(f"{arm}_ball") @ lever / (lever @ lever)
            return lambda place: rate * np.cross(axis, place - self.point(f"{arm}_front"))

        lower, upper = swings("lower"), swings("upper")
        middle = {a: sum(self.point(f"{a}_{k}") for k in ("front", "rear", "ball")) / 3 for a in ("lower", "upper")}
        strut = self.point("spring_lower") - self.point("spring_upper")
        length = np.linalg.norm(strut)
        spring = self.p["spring_rate"] * (self.p["free_length"] - length)
        weights = (
            self.p["lower_mass"] * lower(middle["lower"])
            + self.p["upper_mass"] * upper(middle["upper"])
            + self.p["tie_mass"] * ball("tie_outer") / 2
            + self.p["upright_mass"] * (velocity + np.cross(omega, [0.01, -0.06, 0.02]))
            + self.p["wheel_mass"] * velocity
        )
        return 9.81 * weights[2] - spring * (strut / length) @ lower(self.point("spring_lower"))


@pytest.fixture(scope="module")
def suspension(tmp_path_factory):
    functions = "accelerations", "outputs", "energies", "closure"
    return built("double_wishbone", tmp_path_factory.mktemp("suspension"), *functions)


def test_a_wheel_stands_as_five_distances_say(suspension):
    corner, names = Corner(suspension), suspension.coordinate_names
    chosen = [names.index(n) for n in ("steer.1", "steer.2", "steer.3", "lean", "upright")]
    assert np.abs(suspension.closure(*suspension.initial)[0]).max() < 1e-13
    for lift, rack in [(x, 0.0) for x in np.linspace(-0.09, 0.09, 7)] + [(0.04, 0.05), (-0.04, -0.05)]:
        q, u = suspension.assemble(at(suspension, lift=lift), np.zeros(11), {"rack": rack})
        assert np.abs(suspension.closure(q, u, {"rack": rack})[0]).max() < 1e-12
        expected = corner.stands(lift, rack)
        assert q[chosen] == pytest.approx(expected, abs=1e-11)
        found = named(suspension, suspension.outputs(q, u, {"rack": rack}))
        assert [found["toe"], found["camber"], found["caster"]] == pytest.approx(-expected[2:], abs=1e-11)
        contact = turn("z", expected[2]) @ turn("x", expected[3]) @ [0, 0, -corner.p["wheel_z"]]
        assert [found["base"], found["track"]] == pytest.approx(contact[:2] + expected[:2], abs=1e-11)
        if not rack:
            assert abs(found["toe"]) < np.radians(0.2), "no bump steer to speak of"
        if lift > 0.05:
            assert np.radians(-4) < found["camber"] < np.radians(-1), "leans in as it is pushed up"


def test_a_wheel_at_rest_carries_its_load(suspension):
    still = np.zeros(11)
    corner = Corner(suspension)
    assert corner.load() == pytest.approx(corner.p["load"], abs=1)
    udot = suspension.accelerations(still, still, {"load": corner.load()})
    assert np.abs(udot).max() < 1e-10
    lifted = suspension.accelerations(still, still, {"load": corner.load()}, {"bump": -0.1})
    falls = suspension.accelerations(still, still, {"load": 0.0, "tyre_rate": 0.0})
    assert lifted == pytest.approx(falls, rel=1e-12), "the road does not pull"


def test_a_wheel_on_its_tyre_keeps_its_energy(suspension):
    """On a bump, with a spinning wheel, which leans and steers as it goes up: the tyre's energy is another spring's."""
    p = {"damper_rate": 0.0}
    full = suspension.parameters
    load, rate = (full[suspension.parameter_names.index(n)] for n in ("load", "tyre_rate"))
    q, u = suspension.initial
    q, u = suspension.assemble(q, u + at(suspension, lift=0.3))
    energies, lifts = [], []
    states = motion(suspension, q, u, np.linspace(0, 0.4, 41), p, {"bump": 0.01}, tolerance=1e-10)
    for q, u in states:
        found = named(suspension, suspension.outputs(q, u, p, {"bump": 0.01}))
        contact = 0.31 + q[4] - 0.31 * np.cos(q[8])
        pressed = max(load / rate + 0.01 - contact, 0)
        energies.append(found["kinetic"] + found["potential"] + rate * pressed**2 / 2)
        lifts.append(found["travel"])
    assert np.ptp(energies) < 1e-7 * energies[0]
    assert np.ptp(lifts) > 0.01
    assert np.abs(suspension.closure(q, u)[0]).max() < 1e-9
