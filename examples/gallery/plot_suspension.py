r"""
Suspension with anti-roll bar: roll and camber in a bend
========================================================

**Problem.** In a bend the body rolls and takes the wheels along: the outer wheel leans out, just where it should stand
upright. Which hard points and springs decide this? Which design rolls by 1.5 degrees at 5 m/s², with half the camber of the
outer wheel?

**Model.** `axle.yaml`: two double wishbones in front view (two loops), springs, an anti-roll bar, tyres, and a chassis that
heaves, shifts and rolls; five degrees of freedom.

**Sources.** W. F. and D. L. Milliken, "Race Car Vehicle Dynamics" (1995), for the concepts. The hard points are those
of `double_wishbone.yaml`, a mid-size car.
"""

# %%
# `equilibrium` finds the state in a steady bend with its derivatives with respect to all parameters.
# `output_sensitivities` turns them into the derivatives of roll and camber. Four kinds of derivative, of loops,
# forces, equilibrium and outputs, are exact.
import numpy as np
import stage

axle = stage.solver("axle.yaml", frames=True)
names, outputs = axle.parameter_names, axle.output_names
p0 = dict(zip(names, axle.parameters, strict=True))


def steady(turn, p):
    """Outputs in a steady bend, and their derivatives by the parameters."""
    rest = axle.equilibrium(p=p, inputs=[turn], sensitivities=names)
    return axle.output_sensitivities(rest.q, rest.u, p, [turn], dq=rest.dq, dp=np.eye(len(names)))


values, slopes = steady(5.0, {})
found = dict(zip(outputs, values, strict=True))

# %%
# A check: forces of gravity and of the tyres are in balance, and so are their moments about the road below the car.
masses = p0["mass"] + 2 * (6 + 3.5 + 30)
up = [p0["tyre"] * max(0.0165 - found[f"height_{s}"], 0) for s in ("left", "right")]
across = [-p0["cornering"] * (found[f"width_{s}"] - y) for s, y in (("left", p0["wheel_y"]), ("right", -p0["wheel_y"]))]
np.testing.assert_allclose([sum(up), sum(across)], [masses * 9.81, masses * 5.0], rtol=1e-9)
moment = sum(
    found[f"width_{s}"] * f - found[f"height_{s}"] * a for s, f, a in zip(("left", "right"), up, across, strict=True)
)
np.testing.assert_allclose(moment, masses * (9.81 * found["center_y"] - 5.0 * found["center_z"]), rtol=1e-9)
print(
    f"at 5 m/s^2: roll {np.degrees(found['roll']):.2f} degrees, outer camber {np.degrees(found['camber_right']):.2f} degrees"
)

# %%
# **A design that meets two demands.** Newton's method with the exact derivatives finds the height of the upper wishbone on the
# chassis and the stiffness of the anti-roll bar.
free = ["upper_inner_z", "bar"]
columns = [names.index(n) for n in free]
roll, outer = outputs.index("roll"), outputs.index("camber_right")
demand = np.array([np.radians(1.5), values[outer] / 2])
design = {n: p0[n] for n in free}
for _ in range(20):
    at, by = steady(5.0, design)
    miss = at[[roll, outer]] - demand
    if np.abs(miss).max() < 1e-12:
        break
    change = np.linalg.solve(by[np.ix_(columns, [roll, outer])].T, -miss)
    design = {n: design[n] + x for n, x in zip(free, change, strict=True)}
assert np.abs(miss).max() < 1e-12
for n in free:
    print(f"  {n}: {p0[n]:.4f} -> {design[n]:.4f}")

# %%
# **Result.** The figure shows what a millimetre, or a percent of a stiffness, changes. It compares both designs over
# the lateral acceleration, and shows the roll after the driver has turned in within 0.2 s.
fig, (bars, static, dynamic) = stage.figure(10, 3.6, 1, 3, width_ratios=[1.2, 1, 1])
shown = [n for n in names if n.endswith(("_y", "_z"))] + ["spring", "bar"]
unit = np.array([1e-3 if n.endswith(("_y", "_z")) else 0.01 * p0[n] for n in shown])
index = [names.index(n) for n in shown]
places = np.arange(len(shown))
for output, shift, colour in ((roll, 0.2, stage.BLUE), (outer, -0.2, stage.ORANGE)):
    bars.barh(places - shift, np.degrees(slopes[index, output]) * unit, 0.38, color=colour, label=outputs[output])
bars.set_yticks(places, shown, fontsize=7)
bars.invert_yaxis()
bars.set(xlabel="degrees per mm, or per % of spring and bar", title="Derivatives at 5 m/s²")
bars.legend(["roll", "outer camber"])
turns = np.linspace(0, 7, 4 if stage.SHORT else 15)
time = np.linspace(0, 1.5, 151)
steer = ([0.0, 0.1, 0.3, 1.5], [[0.0], [0.0], [5.0], [5.0]])
for p, style, label in (({}, "--", "before"), (design, "-", "after")):
    at = np.degrees([steady(turn, p)[0][[roll, outer]] for turn in turns])
    static.plot(turns, at[:, 0], style, color=stage.BLUE, label=f"roll, {label}")
    static.plot(turns, at[:, 1], style, color=stage.ORANGE, label=f"outer camber, {label}")
    rest = axle.equilibrium(p=p)
    run = axle.simulate(time, rest.q, rest.u, p, steer, rtol=1e-7, atol=1e-7)
    dynamic.plot(time, np.degrees(run["roll"]), style, color=stage.BLUE, label=label)
static.set(xlabel="lateral acceleration (m/s²)", ylabel="degrees", title="Steady bend")
static.set_ylim(-0.5, 3.8)
dynamic.set(xlabel="t (s)", ylabel="roll (degrees)", title="Turning in")
static.legend()
dynamic.legend()

stage.animate(
    axle.simulate(np.linspace(0, 1.5, 38), rest.q, rest.u, design, steer, rtol=1e-7, atol=1e-7), "suspension", view="x"
)
