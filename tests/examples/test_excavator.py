"""The excavator: its geometry, its holding forces and its energy, from circles and moments."""

import itertools

import numpy as np
import pytest
from motions import at, built, meeting, motion, named


def turned(angle, x, z):
    return np.array([x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle)])


class Arm:
    """An excavator's arm in its plane: positions of masses and lengths of cylinders, from circles and rotated points."""

    def __init__(self, p, boom, stick, bucket):
        self.pin = np.array([p["boom_pin_x"], 1 + p["boom_pin_z"]])
        at_boom = self.of(self.pin, boom)
        elbow = at_boom(p["boom_length"], 0)
        at_stick = self.of(elbow, boom + stick)
        wrist = at_stick(p["stick_length"], 0)
        at_bucket = self.of(wrist, boom + stick + bucket)
        foot = at_stick(p["stick_length"] - p["rocker_back"], 0)
        eye = at_bucket(p["bucket_eye_x"], p["bucket_eye_z"])
        end = meeting(eye, foot, p["link_length"], p["rocker_length"], -1)
        self.teeth = at_bucket(p["bucket_length"], 0)
        self.cylinders = [
            (np.array([p["boom_foot_x"], 1 + p["boom_foot_z"]]), at_boom(p["boom_eye_x"], p["boom_eye_z"])),
            (at_boom(p["stick_foot_x"], p["stick_foot_z"]), at_stick(p["stick_eye_x"], p["stick_eye_z"])),
            (at_stick(p["bucket_foot_x"], p["bucket_foot_z"]), end),
        ]
        self.beyond = [  # masses that the boom carries as a whole, kg and m
            (p["boom_mass"], at_boom(0.47 * p["boom_length"], 0.5)),
            (p["stick_mass"], at_stick(0.35 * p["stick_length"], 0.15)),
            (p["bucket_mass"], at_bucket(0.45 * p["bucket_length"], 0.2)),
            (p["payload"], at_bucket(0.5 * p["bucket_length"], 0.3)),
            (60.0, (foot + end) / 2),
            (70.0, (end + eye) / 2),
        ]
        for (near, far), barrel, rod in zip(
            self.cylinders[1:], ((220, 1.1), (110, 0.7)), ((130, 1.05), (65, 0.65)), strict=True
        ):
            way = (far - near) / np.linalg.norm(far - near)
            self.beyond += [(barrel[0], near + barrel[1] * way), (rod[0], far - rod[1] * way)]

    @staticmethod
    def of(origin, angle):
        return lambda x, z: origin + turned(angle, x, z)

    def lengths(self):
        return [np.linalg.norm(b - a) for a, b in self.cylinders]

    def boom_force(self):
        """The force of the boom's cylinder at rest, from moments about the boom's pin and the work of its own weight."""
        foot, eye = self.cylinders[0]
        length = np.linalg.norm(eye - foot)
        way = (eye - foot) / length
        moved = turned(np.pi / 2, *(eye - self.pin))  # of the eye, by the boom's angle
        stretched = moved @ way
        tilted = (way[0] * moved[1] - way[1] * moved[0]) / length
        own = 240 * 0.8 * way[0] * tilted + 150 * (stretched * way[1] + (length - 0.75) * way[0] * tilted)
        moment = sum(m * (place[0] - self.pin[0]) for m, place in self.beyond)
        return 9.81 * (moment + own) / stretched


def test_an_excavator_stands_as_its_circles_say_and_its_cylinders_hold_it(tmp_path):
    solver = built("excavator", tmp_path, "accelerations", "outputs", "energies", "closure", "jacobians")
    p = dict(zip(solver.parameter_names, solver.parameters, strict=True))
    names = list(solver.coordinate_names)
    places = [names.index(n) for n in ("boom", "stick", "bucket")]
    assert np.abs(solver.closure(*solver.initial)[0]).max() < 1e-12
    for target in itertools.product((-0.6, 0.2, 1.0), (-2.4, -0.7), (-2.1, 0.4)):
        q = solver.initial[0]
        for part in np.linspace(0, 1, 5)[1:]:  # in steps, so that no loop goes another way
            q[places] += part * (np.array(target) - q[places])
            q, u = solver.assemble(q, np.zeros(12))
        assert np.abs(solver.closure(q, u)[0]).max() < 1e-12
        arm, found = Arm(p, *target), named(solver, solver.outputs(q, u))
        assert [found["reach"], found["height"]] == pytest.approx(arm.teeth, abs=1e-12)
        assert [found[f"length_{c}"] for c in ("boom", "stick", "bucket")] == pytest.approx(arm.lengths(), abs=1e-12)
        pushes = solver.jacobians(q, u).inputs[places][:, 1:]
        holding = np.linalg.solve(pushes, -solver.accelerations(q, u)[places])
        assert holding[0] == pytest.approx(arm.boom_force(), rel=1e-9)
        assert 50e3 < holding[0] < 700e3, "a pair of cylinders of 120 mm at 35 MPa pushes with 790 kN"
        assert np.abs(solver.accelerations(q, u, inputs=[0, *holding])).max() < 1e-9


def test_an_excavator_that_falls_keeps_its_energy(tmp_path):
    """Without throttles, as it swings and its cylinders push; what they do is energy too, by Simpson's rule over the power."""
    solver = built("excavator", tmp_path, "accelerations", "energies", "outputs", "closure")
    p = {"damping": 0, "swing_damping": 0}
    q, u = solver.initial
    u = at(solver, upper=0.5, boom=0.2, stick=-0.3, bucket=0.4)
    times = np.linspace(0, 0.5, 101)
    for inputs in (None, [4e4, 2.5e5, -5e4, -1e4]):
        states = motion(solver, q, u, times, p, inputs, tolerance=1e-10)
        energies = np.array([np.sum(solver.energies(q, u)) for q, u in states])
        power = np.array([solver.outputs(q, u, p, inputs)[6] for q, u in states])
        work = (power[0] + 4 * power[1::2].sum() + 2 * power[2:-1:2].sum() + power[-1]) * (times[1] / 3)
        assert energies[-1] - energies[0] == pytest.approx(work, abs=1e-5)
        assert np.abs(solver.closure(*states[-1])[0]).max() < 1e-9
