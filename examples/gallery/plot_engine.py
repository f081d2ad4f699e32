r"""
Four-cylinder engine: its second-order shake, and what a gram does
==================================================================

**Problem.** In an in-line four-cylinder engine the first-order forces of the pistons cancel, but those at twice the speed
of the crankshaft add up. How large must the unbalance of two balance shafts be to cancel them? How much does the engine
shake if one piston or one counterweight is wrong by some grams?

**Model.** `four_cylinder.yaml`: a crankshaft at constant speed, four connecting rods and pistons in four loops, and two
balance shafts that are geared to turn twice as fast, in opposite directions.

**Sources.** C. F. Taylor, "The Internal-Combustion Engine in Theory and Practice", volume 2 (1985), treats the
balance of engines; F. W. Lanchester patented the shafts in 1907. The dimensions are those of a typical two-litre
engine, chosen here.
"""

# %%
# `reactions` returns the forces of all joints. The block feels minus the sum of the joint forces on the bodies that
# it carries. Derivatives with respect to all 16 parameters are computed with them, along states whose loops stay
# closed.
import numpy as np
import stage

engine = stage.solver("four_cylinder.yaml", frames=True, reactions=True)
names = engine.parameter_names
p0 = dict(zip(names, engine.parameters, strict=True))
turn = 2 * np.pi / p0["speed"]
t = np.linspace(0, 2 * turn, 48 if stage.SHORT else 288, endpoint=False)
bodies = [
    "crank",
    *(f"{part}_{k}" for k in range(1, 5) for part in ("throw", "rod", "piston")),
    "shaft_left",
    "shaft_right",
]
carried = [i for i, name in enumerate(bodies) if name.startswith(("crank", "piston", "shaft"))]


def shake(p):
    """Vertical force on the block, N, over two turns, and its derivatives by the parameters."""
    q, u = engine.assemble(p=p, t=t)
    dp = np.eye(len(names))[:, None, :]
    joints, _, djoints, _ = engine.reaction_sensitivities(q, u, p, t=t, dp=dp)
    return -joints[:, carried, 5].sum(axis=1), -djoints[:, :, carried, 5].sum(axis=2)


force, dforce = shake({})

# %%
# A check by hand: let :math:`m` be the mass of a piston plus 0.3 of the mass of a rod. The force is
# :math:`-m \sum \ddot z`, where :math:`z = r \cos\theta + \sqrt{l^2 - r^2 \sin^2\theta}` for each crank angle.
m, r, L, w = p0["piston_1"] + 0.3 * p0["rod_mass"], p0["radius"], p0["rod"], p0["speed"]


def acceleration(angle):
    root = np.sqrt(L**2 - (r * np.sin(angle)) ** 2)
    bend = -(r**2) * np.cos(2 * angle) / root - (r**2 * np.sin(angle) * np.cos(angle)) ** 2 / root**3
    return w**2 * (-r * np.cos(angle) + bend)


by_hand = -m * sum(acceleration(w * t + phase) for phase in (0, np.pi, np.pi, 0))
np.testing.assert_allclose(force, by_hand, atol=1e-9 * np.abs(by_hand).max())


# %%
# **Balance shafts.** The amplitude at twice the speed is linear in the unbalance, so its derivative at zero gives the right
# unbalance in one step. By hand it is :math:`m r A_2/2`, where :math:`A_2 \approx r/l + (r/l)^3/4 + 15 (r/l)^5/128`.
def order(of, n):
    """Amplitudes at n times the speed of the crankshaft."""
    return 2 * (of @ np.exp(-1j * n * w * t)) / len(t)


column = names.index("unbalance")
unbalance = float(-(order(force, 2) / order(dforce[column], 2)).real)
balanced, _ = shake({"unbalance": unbalance})
s = r / L
np.testing.assert_allclose(unbalance, m * r * (s + s**3 / 4 + 15 * s**5 / 128) / 2, rtol=1e-4)
assert abs(order(balanced, 2)) < 1e-8 * abs(order(force, 2))
amplitudes = [np.ptp(x) / 2 for x in (force, balanced)]
print(f"unbalance of each shaft: {1e3 * unbalance:.4f} g m")
print(f"the force falls from {amplitudes[0]:.0f} to {amplitudes[1]:.0f} N")

# %%
# **What a gram does.** In perfect balance the derivatives show which errors shake the engine, and at which order.
errors = {"piston_1": 1e-3, "counterweight_1": 1e-5, "unbalance": 1e-5, "rod_mass": 1e-3, "rod": 1e-4, "radius": 1e-4}
labels = ["a piston, 1 g", "a counterweight, 10 g mm", "both shafts, 10 g mm", "all rods, 1 g", "length of the rods, 0.1 mm",
          "crank radius, 0.1 mm"]  # fmt: skip
first, second = (np.array([abs(order(dforce[names.index(n)], k)) * size for n, size in errors.items()]) for k in (1, 2))
np.testing.assert_allclose(first[0], 1e-3 * r * w**2, rtol=1e-9)
np.testing.assert_allclose(first[1], 1e-5 * w**2, rtol=1e-9)

# %%
# **Result.** The torque that the driven machine feels is minus the driving force. Without gas pressure, only inertia
# causes this torque.
fig, (left, middle, right) = stage.figure(10, 3.4, 1, 3)
degrees = np.degrees(w * t)
left.plot(degrees, force / 1e3, color=stage.ORANGE, label="without balance shafts")
left.plot(degrees, balanced / 1e3, color=stage.BLUE, label=f"with {1e3 * unbalance:.2f} g m in each shaft")
left.set(xlabel="crank (degrees)", ylabel="vertical force (kN)", title="Shaking force at 3000 rpm", xlim=(0, 360))
left.legend(loc="upper right")
left.set_ylim(top=1.5 * force.max() / 1e3)
places = np.arange(len(labels))
middle.barh(places + 0.2, first, 0.38, color=stage.BLUE, label="once per turn")
middle.barh(places - 0.2, second, 0.38, color=stage.ORANGE, label="twice per turn")
middle.set_yticks(places, labels)
middle.invert_yaxis()
middle.set(xlabel="amplitude of the force (N)", title="Errors")
middle.legend()
for peak, colour, label in ((p0["peak"], stage.BLUE, "gas and inertia"), (0.0, stage.GREY, "inertia")):
    q, u = engine.assemble(p={"peak": peak}, t=t)
    right.plot(degrees, -engine.outputs(q, u, {"peak": peak}, t=t)[:, 0], color=colour, label=label)
right.set(xlabel="crank (degrees)", ylabel="torque (N m)", title="Torque of the crankshaft", ylim=(-300, 950))
right.legend()

# %%
# One turn, slowed down.
stage.animate(engine.simulate(np.linspace(0, turn, 31)), "engine", rate=30 / turn, view="corner")
