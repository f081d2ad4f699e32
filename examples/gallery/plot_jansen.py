r"""
Jansen's linkage: a flatter step
================================

**Problem.** The leg of Theo Jansen's Strandbeest walks when one crank turns. While the foot is on the ground it
should neither rise nor sink, and move back at a constant speed, otherwise the beast bobs and drags its feet. Which
changes of the eleven bars make the step flatter?

**Model.** `jansen.yaml`: seven bodies, three loops, and a crank with prescribed motion. All lengths are parameters.

**Source.** T. Jansen, "The Great Pretender" (2007), gives the lengths of the bars.
"""

# %%
# We compute the path of the foot with its exact derivatives with respect to all lengths. The derivatives include the
# closed loops over the whole turn.
import numpy as np
import stage

import ordernm
from ordernm.runtime import At

leg = stage.solver("jansen.yaml", frames=True)
p0 = dict(zip(leg.parameter_names, leg.parameters, strict=True))
t = np.linspace(0.5, 1.5, 30 if stage.SHORT else 60)  # one turn; the foot is in the air at its ends
before = leg.simulate(t, sensitivities=leg.parameter_names)

# %%
# A check: the same path by intersections of circles.


def meet(A, a, B, b):
    """The point at distance a from A and b from B, on the left of the way from A to B."""
    d = np.hypot(*(B - A))
    along = (a**2 - b**2 + d**2) / (2 * d)
    x, y = (B - A) / d
    return A + along * np.array([x, y]) + np.sqrt(a**2 - along**2) * np.array([-y, x])


def by_circles(p, angle):
    crank, pivot = p["m"] * np.array([np.cos(angle), np.sin(angle)]), np.array([-p["a"], -p["l"]])
    top, low = meet(pivot, p["b"], crank, p["j"]), meet(crank, p["k"], pivot, p["c"])
    side = meet(low, p["g"], meet(pivot, p["d"], top, p["e"]), p["f"])
    return meet(low, p["i"], side, p["h"])


circles = np.array([by_circles(p0, 2 * np.pi * x) for x in t])
np.testing.assert_allclose(np.column_stack([before["foot_x"], before["foot_z"]]), circles, atol=1e-10)

# %%
# **Optimisation.** The foot is on the ground where it is less than 3 cm above its lowest point. `combine` makes one number of
# the positions at these times: their distance from a straight line that is passed at a constant speed, and the changes of the
# length of the step and of the height to which the foot is lifted. L-BFGS-B gets its exact gradient.
ground = np.flatnonzero(before["foot_z"] < before["foot_z"].min() + 0.03)
assert np.all(np.diff(ground) == 1)
ramp = np.column_stack([np.ones(len(ground)), t[ground]])
level = np.eye(len(ground)) - 1 / len(ground)
steady = np.eye(len(ground)) - ramp @ np.linalg.pinv(ramp)
top = int(np.argmax(before["foot_z"]))
step = before["foot_x"][ground[0]] - before["foot_x"][ground[-1]]
lift = before["foot_z"][top] - before["foot_z"][ground].mean()


def misses(values):
    """Half the sum of squares of bob, drag and both changes, cm^2, with its derivatives."""
    (x, z), highest = 100 * values[:-1].reshape(2, -1), 100 * values[-1]
    change, lower = x[0] - x[-1] - 100 * step, highest - z.mean() - 100 * lift
    drag = steady @ x / 4
    bob = level @ z
    by_x = steady @ drag / 4
    by_x[0] += change
    by_x[-1] -= change
    by_z = level @ bob - lower / len(z)
    return (bob @ bob + drag @ drag + change**2 + lower**2) / 2, 100 * np.concatenate([by_x, by_z, [lower]])


places = [At(output, t[i]) for output in ("foot_x", "foot_z") for i in ground]
places.append(At("foot_z", t[top]))
bars = {name: (p0[name] - 0.03, p0[name] + 0.03) for name in "bcdefghijk"}
f = ordernm.objective(leg, (0.5, 1.5), places, bars, combine=misses)
best = ordernm.optimize(f, "L-BFGS-B", maxiter=8 if stage.SHORT else 60)
after = f.simulate(best.x, t)
bob = [np.ptp(run["foot_z"][ground]) * 100 for run in (before, after)]
print(f"{len(f.history)} turns of the crank; the foot bobs by {bob[0]:.2f} cm before, {bob[1]:.2f} cm after")
for name in bars:
    print(f"  {name}: {100 * p0[name]:.1f} -> {100 * best.outcome[name]:.2f} cm")

# %%
# The optimum is checked by intersections of circles, too.
new = p0 | {name: best.outcome[name] for name in bars}
circles = np.array([by_circles(new, 2 * np.pi * x) for x in t])
np.testing.assert_allclose(np.column_stack([after["foot_x"], after["foot_z"]]), circles, atol=1e-10)
assert bob[1] < (0.9 if stage.SHORT else 0.6) * bob[0]

# %%
# **Result.**
fig, (path, height, by) = stage.figure(10, 3.4, 1, 3, width_ratios=[1.4, 1, 1])
for run, colour, label in ((before, stage.GREY, "Jansen's numbers"), (after, stage.BLUE, "optimised")):
    path.plot(100 * run["foot_x"], 100 * run["foot_z"], color=colour, label=label)
    height.plot(
        360 * t[ground], 100 * (run["foot_z"][ground] - run["foot_z"][ground].mean()), color=colour, label=label
    )
path.set(xlabel="x (cm)", ylabel="z (cm)", title="Path of the foot", aspect="equal", ylim=(-95, -50))
height.set(xlabel="crank (degrees)", ylabel="height above the mean (cm)", title="Foot on the ground")
middle = ground[len(ground) // 2]
by.barh(list(bars), [before.derivative("foot_z", name)[middle] for name in bars], 0.6, color=stage.BLUE)
by.invert_yaxis()
by.set(xlabel="cm per cm", title="Height in mid-step, by bar")
path.legend(loc="upper right")
height.legend()

stage.animate(f.simulate(best.x, np.linspace(0, 1, 31)), "jansen", rate=30, view="y")
