r"""
Cam and follower: the spring that keeps contact
===============================================

**Problem.** A cam lifts a follower, and a spring presses the follower on the cam. At high speed the follower's inertia
exceeds the force of the spring, and the follower lifts off. How stiff must the spring be at each speed?

**Model.** `cam.yaml`: the profile is a periodic cubic table, whose second derivative is continuous everywhere, also
at the seam. Both motions are prescribed, and the driving force of the follower is the contact force. A negative
contact force means that the follower would have to be pulled.

**Sources.** The 3-4-5 polynomial and the criterion are those of R. L. Norton, "Cam Design and Manufacturing Handbook"
(2002). The dimensions are chosen for this example.
"""

# %%
# The contact force over one turn, and its exact derivatives with respect to the design parameters.
import numpy as np
import stage
from scipy.interpolate import CubicSpline

from ordernm.runtime import Event

cam = stage.solver("cam.yaml", frames=True)
p0 = dict(zip(cam.parameter_names, cam.parameters, strict=True))
turn = 2 * np.pi / p0["speed"]
run = cam.simulate(np.linspace(0, turn, 361), sensitivities=cam.parameter_names)
degrees = 360 * run.t / turn

# %%
# A check by hand: the contact force is :math:`m (g + \omega^2 y'') + F_0 + k y`, with the derivatives of SciPy's periodic spline
# through the same points.
knots = np.radians(np.arange(0, 361, 15))
s = np.arange(9) / 8
rise = np.round(10 * s**3 - 15 * s**4 + 6 * s**5, 6)
spline = CubicSpline(knots, [*rise, 1, *rise[::-1], *[0] * 6], bc_type="periodic")


def by_hand(angle, stiffness, speed):
    y, bend = p0["lift"] * spline(angle), p0["lift"] * spline(angle, 2)
    return p0["mass"] * (9.81 + speed**2 * bend) + p0["preload"] + stiffness * y


np.testing.assert_allclose(run["contact"], by_hand(np.radians(degrees), p0["stiffness"], p0["speed"]), rtol=1e-5)


# %%
# **The stiffness at which the follower just keeps contact.** The least force while the follower is lifted is a
# function of the stiffness. Its derivative is that of the force at the place of the minimum, so Newton's method needs
# only a few iterations.
def softest(speed, turns=20):
    stiffness, t = 1e4, np.linspace(0, 2 * np.pi / speed, 721)
    for _ in range(turns):
        run = cam.simulate(t, p={"speed": speed, "stiffness": stiffness}, sensitivities="stiffness")
        least = int(np.argmin(np.where(run["height"] > 1e-3, run["contact"], np.inf)))
        slope = run.derivative("contact", "stiffness")[least]
        if abs(run["contact"][least]) < 1e-9:
            return stiffness
        stiffness = stiffness - run["contact"][least] / slope
    raise RuntimeError("no stiffness keeps contact")


speeds = np.linspace(1200, 2100, 3 if stage.SHORT else 10) * np.pi / 30
needed = np.array([softest(speed) for speed in speeds])
angles = np.linspace(0, 2 * np.pi, 721)
for speed, stiffness in zip(speeds, needed, strict=True):
    assert abs(by_hand(angles, stiffness, speed).min()) < 1e-5 * stiffness * p0["lift"], (
        "by hand, the force just vanishes"
    )

# %%
# At 1500 rpm the standard spring is too soft. An event finds where the contact would be lost, and how this time changes with
# the design.
fast = 50 * np.pi
lost = cam.simulate(
    0.015,
    p={"speed": fast},
    events=[Event("contact", stop=False)],
    sensitivities=("stiffness", "mass"),
    largest_step=1e-4,
).events[0]
print(f"contact is lost at {np.degrees(fast * lost.t):.2f} degrees of the cam")
print(f"  {np.degrees(fast * lost.dt[0]) * 1e3:.3f} degrees later for each additional kN/m")
print(f"  {np.degrees(fast * lost.dt[1]) * 0.1:.3f} degrees later for each additional 100 g")
assert abs(by_hand(fast * lost.t, p0["stiffness"], fast)) < 1e-3

# %%
# **Result.**
fig, (left, middle, right) = stage.figure(10, 3.2, 1, 3)
for rpm, colour in ((600, stage.BLUE), (1500, stage.ORANGE)):
    faster = cam.simulate(np.linspace(0, 60 / rpm, 361), p={"speed": rpm * np.pi / 30})
    left.plot(degrees, faster["contact"], color=colour, label=f"{rpm} rpm")
left.axhline(0, color=stage.BLACK, linewidth=0.6)
left.plot(np.degrees(fast * lost.t), 0, "o", color=stage.BLACK, label="contact is lost")
left.set(xlabel="cam (degrees)", ylabel="contact force (N)", title="Contact force")
for name, unit, scale in (("stiffness", "1 kN/m", 1e3), ("mass", "100 g", 0.1), ("preload", "10 N", 10.0)):
    middle.plot(degrees, scale * run.derivative("contact", name), label=f"{name}, by {unit}")
middle.set(
    xlabel="cam (degrees)", ylabel="change of the contact force (N)", title="Derivatives at 600 rpm", ylim=(-5, 18)
)
right.plot(speeds * 30 / np.pi, needed / 1e3, color=stage.BLUE)
right.set(xlabel="speed (rpm)", ylabel="stiffness (kN/m)", title="Softest spring that keeps contact")
left.legend()
middle.legend()

stage.animate(cam.simulate(np.linspace(0, turn, 37)), "cam", rate=360, view="y")
