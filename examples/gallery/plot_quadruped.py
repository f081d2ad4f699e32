r"""
Quadruped: what standing costs
==============================

**Problem.** A robot with four legs stands on its feet. Which torques do hips and knees need at each height of the trunk?
How do they depend on the lengths of thigh and shin?

**Model.** `examples/quadruped.yaml` with its legs from `parts/leg.yaml`. Here the feet are pinned to the ground by four ball
joints, so four loops close over the ground, and the trunk keeps six degrees of freedom.

**Sources.** The dimensions are those of the model, of the size of MIT's Mini Cheetah with longer legs (B. Katz, J. Di Carlo,
S. Kim, "Mini Cheetah", IEEE ICRA 2019). The check is the principle of virtual work.
"""

# %%
# The shipped model is included, and the feet are pinned below the hips.
import numpy as np
import stage

from ordernm.model import ModelBuilder

legs = [f"leg_{i}_{j}" for i in (1, 2) for j in (1, 2)]
b = ModelBuilder("standing", folder=stage.HERE.parent)
b.include("quadruped.yaml")
for leg, x, y in zip(legs, (0.24, 0.24, -0.24, -0.24), (0.13, -0.13, 0.13, -0.13), strict=True):
    b.loop(
        f"foot_{leg}",
        "spherical",
        start={"body": f"{leg}_lower", "at": [0, 0, "-shin"]},
        end={"body": "ground", "at": [x, y, 0]},
    )
b.independent("trunk")
robot = stage.solver(b.build(), frames=True)
names = robot.parameter_names


# %%
# All hips get one torque and all knees another. The trunk is level. Three unknowns, both torques and the place of the
# trunk above the feet, make three accelerations vanish: ahead, up and in pitch. Newton's method uses the exact
# Jacobian, which includes the closed loops. The same Jacobian gives the derivatives of the torques with respect to
# the lengths.
rows = [robot.speed_names.index(f"trunk.{n}") for n in ("vx", "vz", "wy")]
ahead = robot.coordinate_names.index("trunk.px")


def stand(height, p, guess):
    """Closed state, torques of hip and knee in N m, and their derivatives by the parameters, with the trunk at this height, m."""
    q, u, x = guess.copy(), np.zeros(robot.nu), np.array([guess[ahead], 0.0, 0.0])
    for turn in range(20):
        q[:7] = [x[0], 0, height, 1, 0, 0, 0]
        q = robot.assemble(q, u, p)[0]
        udot, J = robot.accelerations(q, u, p, x[1:])[rows], robot.jacobians(q, u, p, x[1:])
        slopes = np.column_stack([J.q[rows, ahead], J.inputs[rows]])
        if turn == 0:  # without torques the legs carry nothing, and the place of the trunk has no effect
            slopes[:, 0] = 0.0
        change = np.linalg.lstsq(slopes, -udot, rcond=None)[0]
        x = x + change
        if np.abs(change).max() < 1e-11:
            break
    assert np.abs(robot.accelerations(q, u, p, x[1:])).max() < 1e-6, "the whole robot stands"
    return q, x[1:], -np.linalg.solve(slopes, J.p[rows])[1:]


heights = np.linspace(0.40, 0.58, 5 if stage.SHORT else 31)
q = robot.initial[0]
found = []
for height in heights:
    found.append(stand(height, {}, q))
    q = found[-1][0]
states, torques, slopes = map(np.array, zip(*found, strict=True))

# %%
# A check by virtual work: if the trunk rises, the torques do the work that the potential energy gains.
up = robot.coordinate_names.index("trunk.pz")
for q, (hip, knee) in zip(states, torques, strict=True):
    rise = np.zeros((1, robot.nq))
    rise[0, up] = 1.0
    _, _, dq, _ = robot.assemble_sensitivities(q, np.zeros(robot.nu), dq=rise)
    turn = [sum(dq[0, robot.coordinate_names.index(f"{leg}_{part}")] for leg in legs) for part in ("upper", "lower")]
    gain = robot.energy_gradients(q, np.zeros(robot.nu), weights=np.array([[0.0, 1.0]])).q[0, up]
    np.testing.assert_allclose(hip * turn[0] + knee * turn[1], gain, rtol=1e-9)

# %%
# **Which leg?** The figure below shows the mean square of both torques at a height of 48 cm over the lengths of thigh and
# shin, with its exact gradient as arrows. The valley runs where the legs are nearly stretched; there, however, the
# robot can no longer rise.
lengths = np.linspace(0.27, 0.35, 3 if stage.SHORT else 13)
start = states[np.argmin(np.abs(heights - 0.48))]
cost, gradient = np.zeros((len(lengths), len(lengths))), np.zeros((2, len(lengths), len(lengths)))
columns = [names.index(n) for n in ("thigh", "shin")]
for i, shin in enumerate(lengths):
    q = start
    for j, thigh in enumerate(lengths):
        q, both, by = stand(0.48, {"thigh": thigh, "shin": shin}, q)
        cost[i, j], gradient[:, i, j] = both @ both / 2, by[:, columns].T @ both
middle = len(lengths) // 2
steps = np.gradient(cost, lengths[1] - lengths[0])
assert np.abs(gradient[0] - steps[1])[:, middle].max() < (0.2 if stage.SHORT else 0.02) * np.abs(gradient).max()

# %%
# **Result.**
fig, (left, middle, right) = stage.figure(10, 3.4, 1, 3)
for k, (name, colour) in enumerate((("hip", stage.BLUE), ("knee", stage.ORANGE))):
    left.plot(100 * heights, torques[:, k], color=colour, label=name)
    for n, style in (("thigh", "-"), ("shin", "--")):
        middle.plot(100 * heights, 0.01 * slopes[:, k, names.index(n)], style, color=colour, label=f"{name} by {n}")
left.set(xlabel="height of the trunk (cm)", ylabel="torque (N m)", title="Torques that hold the robot")
middle.set(xlabel="height of the trunk (cm)", ylabel="N m per cm", title="Derivatives by the lengths")
levels = right.contourf(100 * lengths, 100 * lengths, np.sqrt(cost), 12, cmap="viridis")
fig.colorbar(levels, ax=right, label="root mean square (N m)")
every = slice(None, None, 2)
right.quiver(100 * lengths[every], 100 * lengths[every], *(-gradient[:, every, every]), color="white", width=0.006)
right.set(xlabel="thigh (cm)", ylabel="shin (cm)", title="Torque at 48 cm, and downhill")
left.legend()
middle.legend()

# %%
# With torques three percent too large the robot rises.
q, both, _ = stand(0.48, {}, start)
stage.animate(
    robot.simulate(np.linspace(0, 0.4, 33), q, 0 * robot.initial[1], inputs=1.03 * both), "quadruped", rate=80
)
