r"""
Robot identification: which inertias does a motion show?
========================================================

**Problem.** A robot moves an unknown payload, and encoders sample its three joints with noise. Find the payload, the centre
of mass and inertia of the forearm, and the friction, with their uncertainties. Which parameters can this motion not tell
apart?

**Model.** `manipulator.yaml`: the first three joints of a PUMA 560 with rotors, friction and position controllers.

**Sources.** B. Armstrong, O. Khatib, J. Burdick, "The explicit dynamic model and inertial parameters of the PUMA 560 arm",
IEEE ICRA (1986). Payload, friction, gains and noise are chosen here.
"""

# %%
# The experiment: the command of each joint is a sum of five sines over eight seconds, and the samples have errors of
# 0.1 mrad.
import numpy as np
import stage

import ordernm

robot = stage.solver("manipulator.yaml", frames=True)
truth = dict(zip(robot.parameter_names, robot.parameters, strict=True))
seconds, sigma, rng = (3.0 if stage.SHORT else 8.0), 1e-4, np.random.default_rng(3)
knots = np.linspace(0, seconds, round(10 * seconds) + 1)
waves = np.random.default_rng(8).normal(size=(3, 5, 2)) * 0.25
way = np.array([0.0, 0.4, -1.2]) + sum(
    waves[:, k, 0] * np.sin((k + 1) * knots[:, None]) + waves[:, k, 1] * (1 - np.cos((k + 1) * knots[:, None]))
    for k in range(5)
)
command = (knots, way, "cubic")
times = np.linspace(0, seconds, round(50 * seconds) + 1)
joints = ("waist", "upper", "forearm")
motion = robot.simulate(times, inputs=command)
samples = {name: motion[name] + sigma * rng.normal(size=len(times)) for name in joints}

# %%
# The fit takes the exact Jacobian of all residuals, and its covariance gives the standard deviations.
wanted = ["payload", "forearm_center", "forearm_inertia", "viscous_1", "viscous_2", "viscous_3"]
guess = {
    "payload": 0.5,
    "forearm_center": 0.2,
    "forearm_inertia": 0.1,
    "viscous_1": 1.0,
    "viscous_2": 1.0,
    "viscous_3": 1.0,
}
fit = ordernm.fit(robot, times, samples, dict.fromkeys(wanted), p=guess, inputs=command, sigma=sigma)
print(fit)

# %%
# Checks: all values are within four standard deviations of the truth, and the sum of squares agrees with the noise.
# The standard deviations are compared with those from a Jacobian that is computed in another way: from the motion's
# own sensitivities.
errors = np.array([(fit[n] - truth[n]) / fit.deviation(n) for n in wanted])
assert fit.success and np.abs(errors).max() < 4 and 0.8 < fit.variance < 1.2
found = robot.simulate(times, p={n: fit[n] for n in wanted}, inputs=command, sensitivities=wanted)
J = np.concatenate([np.array([found.derivative(name, n) for n in wanted]).T for name in joints]) / sigma
np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(J.T @ J))), [fit.deviation(n) for n in wanted], rtol=1e-4)

# %%
# **What the motion cannot tell.** Forearm and payload are fixed to each other. They act through their mass, their first moment
# and two moments of inertia only. Of five unknowns one combination therefore changes no sample: the fit names it.
more = ["payload", "payload_distance", "forearm_mass", "forearm_center", "forearm_inertia"]
start = {n: 1.02 * truth[n] for n in more}
lost = ordernm.fit(robot, times, samples, dict.fromkeys(more), p=start, inputs=command, sigma=sigma)
(direction,) = lost.undetermined
print("no sample changes with", ", ".join(f"{n} by {x:+.3g}" for n, x in direction.items()))


def change(of):
    """Largest change of a sample if these parameters move along the direction."""
    runs = [
        robot.simulate(times, p={n: lost[n] + h * direction.get(n, 0.0) * (n in of) for n in more}, inputs=command)
        for h in (0, 1e-4)
    ]
    return max(np.abs(runs[1][n] - runs[0][n]).max() for n in joints)


assert change(direction) < 0.01 * change(["payload"]), "together they have no effect, alone they have"

# %%
# **Result.**
fig, (left, middle, right) = stage.figure(10, 3.4, 1, 3)
for name in joints:
    left.plot(times, motion[name], label=name)
left.set(xlabel="t (s)", ylabel="angle (rad)", title="Motion")
left.legend()
places = np.arange(len(wanted))
middle.axvspan(-2, 2, color="#eeeeee", zorder=0)
middle.errorbar(errors, places, xerr=1, fmt="o", color=stage.BLACK, capsize=3)
middle.set_yticks(places, wanted)
middle.invert_yaxis()
middle.set(xlabel="error (standard deviations)", title="Identified minus true values", xlim=(-4, 4))
image = right.imshow(fit.correlations, cmap="PuOr", vmin=-1, vmax=1)
right.set_xticks(places, wanted, rotation=60, ha="right", fontsize=7)
right.set_yticks(places, wanted, fontsize=7)
right.grid(False)
right.set_title("Correlations")
fig.colorbar(image, ax=right)

stage.animate(robot.simulate(np.linspace(0, 3, 38), inputs=command), "identification", rate=12.5, view="corner")
