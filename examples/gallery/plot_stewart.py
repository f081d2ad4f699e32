r"""
Stewart platform: where its legs become weak
============================================

**Problem.** Six legs move a platform in six directions. How much force does each leg need for a given motion, which
dimension of the platform changes the largest force most, and where in its workspace do the legs lose control?

**Model.** `examples/stewart.yaml`: a free platform, six telescopic legs on universal joints, and six ball joints, which
close the loops one by one. The six coordinates of the platform are the independent ones.

**Sources.** D. Stewart, "A platform with six degrees of freedom", Proc. Inst. Mech. Engrs. 180 (1965). The dimensions are
those of the model, a motion platform for 40 kg.
"""

# %%
# The motion: the platform heaves by 10 cm and rolls by 12 degrees. Position, velocity and acceleration are given for the
# independent coordinates; the loops determine the legs.
import numpy as np
import stage

stewart = stage.solver("stewart.yaml", frames=True)
names = stewart.parameter_names
p0 = dict(zip(names, stewart.parameters, strict=True))
start = stewart.initial[0]


def platform(t):
    """Closed state and acceleration of the platform, one second per turn."""
    roll, heave, w = np.radians(12) * np.sin(2 * np.pi * t), 0.1 * np.sin(2 * np.pi * t), 2 * np.pi
    q, u, udot = start.copy(), np.zeros(stewart.nu), np.zeros(stewart.nu)
    q[:7] = [0, 0, 1.0 + heave, np.cos(roll / 2), np.sin(roll / 2), 0, 0]
    spin, rise = np.radians(12) * w * np.cos(w * t), 0.1 * w * np.cos(w * t)
    cos, sin = np.cos(roll), np.sin(roll)
    u[0], u[3:6] = spin, [0, rise * sin, rise * cos]  # in the frame of the platform, which rolls about x
    udot[0] = -roll * w**2
    udot[3:6] = np.array([0, sin, cos]) * -heave * w**2 + rise * spin * np.array([0, cos, -sin])
    return *stewart.assemble(q, u), udot


# %%
# Accelerations are linear in the forces of the legs. Let J be the derivative with respect to these forces. The forces
# are :math:`J^{-1}` times the acceleration that is missing without them. The derivatives of these forces f with
# respect to a dimension p follow from those of the acceleration: :math:`df/dp = -J^{-1}\,d\dot u/dp`.
free = [stewart.speed_names.index(n) for n in stewart.independent_speed_names]


def legs(q, u, udot):
    J = stewart.jacobians(q, u, wrt="inputs").inputs[free]
    f = np.linalg.solve(J, (udot - stewart.accelerations(q, u))[free])
    _, slopes = stewart.sensitivities(q, u, inputs=f, dp=np.eye(len(names)))
    return f, -np.linalg.solve(J, slopes[:, free].T).T


t = np.linspace(0, 1, 13 if stage.SHORT else 61)
states = [platform(x) for x in t]
forces, slopes = map(np.array, zip(*(legs(*state) for state in states), strict=True))
pistons = [stewart.speed_names.index(f"piston_{k}") for k in range(1, 7)]
speeds = np.array([u[pistons] for _, u, _ in states])
own = 9.81 * (p0["top_mass"] / 6 + 1.5) - p0["damping"] * speeds

# %%
# A check: the power of the legs is the rate of the energy, which comes from the gradient of both energies along the motion.
for (q, u, udot), power in zip(states, ((forces + own) * speeds).sum(axis=1), strict=True):
    gradient = stewart.energy_gradients(q, u, weights=np.ones((1, 2)))
    full = stewart.accelerations(q, u, inputs=np.linalg.solve(
        stewart.jacobians(q, u, wrt="inputs").inputs[free], (udot - stewart.accelerations(q, u))[free]))  # fmt: skip
    rate = gradient.q[0] @ stewart.coordinate_rates(q, u) + gradient.u[0] @ full
    np.testing.assert_allclose(power, rate, atol=1e-8 * np.abs(forces).max())

# %%
# **Workspace.** The platform is turned about the vertical. Where the columns of the legs' Jacobian become dependent,
# the platform can move although all legs are locked, and the forces grow without limit. At a quarter turn from the
# middle position this happens, whatever the dimensions.
yaws, heights = (
    np.radians(np.linspace(-80, 80, 9 if stage.SHORT else 41)),
    np.linspace(0.7, 1.1, 3 if stage.SHORT else 17),
)
largest = np.zeros((len(heights), len(yaws)))
for i, z in enumerate(heights):
    level = start.copy()
    for side in (1, -1):
        level[:7] = [0, 0, z, 1, 0, 0, 0]
        q = stewart.assemble(level)[0]
        for j in np.flatnonzero(side * yaws >= -1e-12)[::side]:
            q = q.copy()
            q[3:7] = np.cos(yaws[j] / 2), 0, 0, np.sin(yaws[j] / 2)
            q, u = stewart.assemble(q)
            f = legs(q, u, 0 * u)[0] + 9.81 * (p0["top_mass"] / 6 + 1.5)
            largest[i, j] = np.abs(f).max()

# %%
# **Result.**
fig, (left, middle, right) = stage.figure(10, 3.4, 1, 3)
left.plot(t, forces + own)
left.set(xlabel="t (s)", ylabel="N", title="Forces of the six legs")
k, at = np.unravel_index(np.argmax(np.abs(forces + own).T), (6, len(t)))
shown = ["base_radius", "base_gap", "top_radius", "top_gap", "top_mass", "piston_mass", "cylinder_mass"]
found = slopes[at, [names.index(n) for n in shown], k] + np.array(
    [9.81 / 6 if n == "top_mass" else 9.81 * (n == "piston_mass") for n in shown]
)
middle.barh(shown, found * [0.01 * p0[n] for n in shown], 0.6, color=stage.BLUE)
middle.invert_yaxis()
middle.set(xlabel="N per percent", title=f"Largest force, of leg {k + 1}")
image = right.pcolormesh(np.degrees(yaws), heights, np.log10(largest), cmap="viridis", shading="nearest")
fig.colorbar(image, ax=right, label="log10 of the largest force (N)")
right.set(xlabel="yaw (degrees)", ylabel="height (m)", title="Holding the platform")

stage.animate(
    stewart.simulate(np.linspace(0, 1, 26), *states[0][:2], inputs=(t, forces, "cubic")), "stewart", view="corner"
)
