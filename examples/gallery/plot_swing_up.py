r"""
Swing-up: a pole that gets up, and stays up
===========================================

**Problem.** A cart swings a hanging pole up to the top, with a force of at most 20 N, in 2.5 seconds, and with as little
effort as possible. There a controller catches it. Which force over time does this?

**Model.** `examples/swing_up.yaml`: a cart on a rail, a pole in a hinge, and a bob at its end.

**Sources.** The cart-pole is the standard problem of optimal control; M. Kelly, "An Introduction to Trajectory Optimization",
SIAM Review 59 (2017), solves it by collocation. The dimensions are those of the model.
"""

# %%
# The force is a polyline through 26 values. The objective is the integral of its square, and the final state is a
# constraint. One motion gives the integral and the four numbers of the final state, with their exact derivatives with
# respect to the 26 values.
import numpy as np
import stage
from scipy.linalg import solve_continuous_are

import ordernm
from ordernm.runtime import Final, Integral

cart = stage.solver("swing_up.yaml", frames=True)
aim = {"place": 0.0, "angle": np.pi, "speed": 0.0, "spin": 0.0}
knots = np.linspace(0, 2.5, 26)
push = (knots, 3.0 * np.sin(2 * np.pi * knots / 1.3), "linear")
tight = {"rtol": 1e-8, "atol": 1e-8}
f = ordernm.objective(
    cart, 2.5, Integral("effort"), {"inputs.push": (-20.0, 20.0)}, weights=[0.02], inputs=push, **tight
)
there = f.constraint([Final(name) for name in aim], list(aim.values()), list(aim.values()))

# %%
# A check of the gradients: forward sensitivities and the adjoint integrate different equations, and agree to rounding.
wanted = [Integral("effort"), *(Final(name) for name in aim)]
one, other = (cart.judge(2.5, wanted, inputs=push, wrt=["inputs.push[3]", "inputs.push[17]"], method=m).gradients
              for m in ("forward", "adjoint"))  # fmt: skip
np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(one).max())

# %%
# The search. The short form of this page, which tests run, stops early.
best = ordernm.optimize(f, "SLSQP", constraints=there, maxiter=25 if stage.SHORT else 300)
values = f.variables.values(best.x)
t = np.linspace(0, 2.5, 251)
swing = f.simulate(best.x, t)
print(f"{len(f.history)} motions; effort {best.outcome.functional_values[0]:.2f} N^2 s")
assert np.abs(values).max() <= 20.0 + 1e-9
assert stage.SHORT or np.abs(np.subtract([swing[n][-1] for n in aim], list(aim.values()))).max() < 1e-5

# %%
# Pontryagin's principle is an independent check of the optimum: where the force is within its bounds, the gradients of effort
# and final state have to cancel, with the same four multipliers for all 26 values.
gradients = cart.judge(2.5, wanted, inputs=(knots, values[:, None], "linear"), method="adjoint",
                       wrt=[f"inputs.push[{i}]" for i in range(26)]).gradients  # fmt: skip
inside = np.abs(values) < 19.99
multipliers, *_ = np.linalg.lstsq(gradients[1:, inside].T, -gradients[0, inside], rcond=None)
left = gradients[0, inside] + multipliers @ gradients[1:, inside]
print(f"largest remaining gradient: {np.abs(left).max() / np.abs(gradients[0]).max():.1e} of that of the effort")
assert stage.SHORT or np.abs(left).max() < 1e-2 * np.abs(gradients[0]).max()

# %%
# **Staying up.** `linearize` gives A and B at the top, and Riccati's equation the gains. The controller is a joint
# force with held inputs: the force is set again every 10 ms.
top = cart.linearize({"pole": np.pi})
X = solve_continuous_are(top.A, top.B, np.diag([10.0, 10.0, 1.0, 1.0]), np.eye(1))
gain = (top.B.T @ X)[0]
assert max(np.linalg.eigvals(top.A - top.B @ gain[None]).real) < 0, "the controlled pole is stable"
q, u = cart.assemble({"cart": 0.0, "pole": np.pi + 0.1}, {"cart": 0.0, "pole": 0.0})
angles = []
for _ in range(30 if stage.SHORT else 500):
    state = np.array([q[0], q[1] - np.pi, u[0], u[1]])
    run = cart.simulate([0.0, 0.01], q, u, inputs=[float(np.clip(-gain @ state, -20, 20))])
    q, u = run.final
    angles.append(q[1])
assert stage.SHORT or abs(angles[-1] - np.pi) < 5e-3

# %%
# **Result.**
fig, (left, middle, right) = stage.figure(10, 3.4, 1, 3)
left.plot(knots, push[1], "--", color=stage.GREY, label="at the start")
left.plot(knots, values, "o-", color=stage.BLUE, markersize=3, label="optimised")
left.set(xlabel="t (s)", ylabel="force on the cart (N)", title="Force")
left.legend()
for i in range(0, 251, 10):
    shade = str(0.85 - 0.85 * i / 250)
    middle.plot([swing["place"][i], swing["tip_x"][i]], [0, swing["tip_z"][i]], color=shade, linewidth=1.2)
middle.plot(swing["tip_x"], swing["tip_z"], color=stage.ORANGE, linewidth=0.8)
middle.set(xlabel="x (m)", ylabel="z (m)", title="Every tenth of a second", aspect="equal")
right.plot(0.01 * np.arange(1, len(angles) + 1), np.degrees(angles), color=stage.BLUE)
right.set(xlabel="t (s)", ylabel="angle (degrees)", title="Caught from 6 degrees off the top")

stage.animate(f.simulate(best.x, np.linspace(0, 2.5, 39)), "swing_up", rate=15)
