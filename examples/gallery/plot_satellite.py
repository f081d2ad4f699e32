r"""
Satellite with wheels: a slew that leaves the panels at rest
============================================================

**Problem.** The torque of a reaction wheel turns a satellite by 30 degrees in a minute. Its solar panels and its boom
swing with the turn. Which torque over time leaves them at rest, and points the satellite exactly?

**Model.** `examples/satellite.yaml`: a free bus with two hinged panels, a boom of three pieces and three reaction wheels.
There is no gravity and no force from outside, so momentum is conserved: what the bus gains, the wheel loses.

**Sources.** J. R. Wertz, "Spacecraft Attitude Determination and Control" (1978). The dimensions are those of the model.
"""

# %%
# The shipped model, with outputs for the angle of the bus, the angular momentum and the energy. The slew is about x, the axis
# of the panels' hinges.
import numpy as np
import stage
from scipy.integrate import simpson
from scipy.interpolate import BSpline

from ordernm.model import ModelBuilder
from ordernm.runtime import Final, Integral

b = ModelBuilder("slew", folder=stage.HERE.parent)
b.include("satellite.yaml")
b.output("turn", rotation="bus", entry="qx")
for axis in "xyz":
    b.output(f"momentum_{axis}", momentum="angular", axis=axis, about="center_of_mass")
b.output("rate", angular_velocity="bus", axis="x")
b.output("effort", value="torque_1**2")
for panel in (1, 2):
    b.output(f"panel_{panel}", value=f"q.panel_{panel}")
    b.output(f"panel_rate_{panel}", value=f"u.panel_{panel}")
b.output("boom_1", value="q.boom_1.1")
b.output("boom_rate_1", value="u.boom_1.1")
satellite = stage.solver(b.build(), frames=True)

# %%
# The torque of the wheel is a cubic B-spline through 17 control points. At the end the bus has turned by 30 degrees,
# and all rates and deflections vanish: those of the second panel follow by symmetry, and those of the boom's outer
# pieces belong to modes that a smooth torque hardly excites. One motion gives the effort, six conditions, and the
# exact derivatives of all of them with respect to the control points.
seconds, count = 60.0, 17
knots = np.linspace(0, seconds, count - 2)
rest = np.zeros(satellite.nq)
rest[satellite.coordinate_names.index("bus.qw")] = 1.0
still = {"q": rest, "u": np.zeros(satellite.nu)}
aim = {"turn": np.sin(np.radians(15)), "rate": 0.0}
aim |= dict.fromkeys(("panel_1", "panel_rate_1", "boom_1", "boom_rate_1"), 0.0)
points = [f"inputs.torque_1[{i}]" for i in range(count)]
same = {"rtol": 1e-8, "atol": 1e-8}


def slew(values):
    """The effort and the final outputs, and their derivatives by the control points."""
    wanted = [Integral("effort"), *map(Final, aim)]
    torque = {"torque_1": (knots, values, "spline")}
    found = satellite.judge(seconds, wanted, **still, inputs=torque, wrt=points, integrator="radau", **same)
    return found.values, found.gradients


# %%
# The effort is a quadratic form of the control points; SciPy's B-splines give its matrix H. The conditions are nearly linear. The
# steps of sequential quadratic programming solve one linear system each, and converge in a few motions. Two points at each end
# stay zero, so the torque begins and ends smoothly.
dense = np.linspace(0, seconds, 2001)
B = BSpline.design_matrix(dense, np.concatenate([np.zeros(3), knots, np.full(3, seconds)]), 3).toarray()[:, 2:-2]
H = 2 * simpson(B[:, :, None] * B[:, None], x=dense, axis=0)
inertia = 120 * (0.8**2 + 1.2**2) / 12 + 60
guess = -np.radians(30) * inertia * (2 * np.pi / seconds**2) * np.sin(2 * np.pi * np.linspace(0, 1, count))
guess[[0, 1, -2, -1]] = 0
values, zero = guess.copy(), np.zeros((len(aim), len(aim)))
for _ in range(12):
    found, slopes = slew(values)
    miss, C = found[1:] - list(aim.values()), slopes[1:, 2:-2]
    step = np.linalg.solve(np.block([[H, C.T], [C, zero]]), np.concatenate([-H @ values[2:-2], -miss]))
    values[2:-2] += step[: len(H)]
    if np.abs(step[: len(H)]).max() < 1e-7:
        break
assert np.abs(miss).max() < 1e-7, "the end is reached"
print(f"effort {found[0]:.4f} N^2 m^2 s; the aim is missed by {np.abs(miss).max():.1e}")

# %%
# Checks: the angular momentum stays zero although the wheel runs fast; and at an optimum the gradients of the effort and of the
# conditions cancel.
t = np.linspace(0, seconds, 241)
before, after = (
    satellite.simulate(t, **still, inputs={"torque_1": (knots, x, "spline")}, method="radau", **same)
    for x in (guess, values)
)
wheel = 0.02 * np.abs(after["u.wheel_1"]).max()
for axis in "xyz":
    assert np.abs(after[f"momentum_{axis}"]).max() < 1e-7 * wheel
remain = np.abs(slopes[0, 2:-2] + step[len(H) :] @ C).max() / np.abs(slopes[0]).max()
assert remain < 1e-6
np.testing.assert_allclose(found[0], values[2:-2] @ H @ values[2:-2] / 2, rtol=1e-6)
print(
    f"angular momentum of the wheel up to {wheel:.3f} N m s, of all bodies {np.abs(after['momentum_x']).max():.1e} N m s"
)

# %%
# **What if** the hinges are softer than was believed? The derivatives of the final state answer this for the torque
# that was found.
doubt = ("hinge_stiffness", "boom_stiffness", "panel_density", "boom_tip")
torque = {"torque_1": (knots, values, "spline")}
robust = satellite.simulate(t, **still, inputs=torque, sensitivities=doubt, method="radau")
for name in doubt:
    value = satellite.parameters[satellite.parameter_names.index(name)]
    off = np.degrees(2 * robust.derivative("turn", name)[-1] / np.cos(np.radians(15))) * 0.01 * value
    print(f"{name} one percent larger: {3600 * off:+.2f} arc seconds at the end")

# %%
# **Result.**
fig, (left, middle, right) = stage.figure(10, 3.4, 1, 3)
for run, x, colour, label in ((before, guess, stage.GREY, "a sine"), (after, values, stage.BLUE, "optimised")):
    past = satellite.simulate(np.linspace(seconds, 1.5 * seconds, 121), run.q[-1], run.u[-1], method="radau")
    time = np.append(t, past.t)
    left.plot(time, np.degrees(2 * np.arcsin(np.append(run["turn"], past["turn"]))), color=colour, label=label)
    middle.plot(time, np.degrees(np.append(run["panel_1"], past["panel_1"])), color=colour, label=f"panel, {label}")
    middle.plot(time, np.degrees(np.append(run["boom_1"], past["boom_1"])), ":", color=colour, label=f"boom, {label}")
    right.plot(np.linspace(0, seconds, count), 1e3 * x, "o-", color=colour, markersize=3, label=label)
left.set(xlabel="t (s)", ylabel="degrees", title="Turn of the bus")
middle.set(xlabel="t (s)", ylabel="degrees", title="Deflections; the slew ends at 60 s")
right.set(xlabel="t (s)", ylabel="control points (mN m)", title="Torque of the wheel")
for axis in (left, middle, right):
    axis.legend()

film = satellite.simulate(np.linspace(0, seconds, 31), **still, inputs=torque, method="radau")
stage.animate(film, "satellite", rate=0.5, view="corner")
