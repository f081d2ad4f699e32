r"""
Governor: the dashpot without which it hunts
============================================

**Problem.** A centrifugal governor closes an engine's valve when the engine runs fast. A spring on its sleeve sets the
speed and makes the governor less sensitive. How fast does the engine run under each load, and how strong must the
dashpot be, so that the speed does not oscillate with a growing amplitude?

**Model.** `governor.yaml`: an engine shaft, two arms with balls, a sleeve and two massless links, which close two loops.
Two degrees of freedom remain, the angle of the shaft and that of the arms.

**Sources.** Porter's governor is in every textbook on the theory of machines; I. Vyshnegradsky, "Sur la théorie générale
des régulateurs", Comptes Rendus 83 (1876), found the limit of stability. The dimensions are typical and chosen here.
"""

# %%
# Steady rotation is not a state of rest. We solve :math:`\dot u = 0` for the angle of the arms and the speed of the
# shaft. Newton's method uses exact Jacobians, which include the closed loops.
import numpy as np
import stage

governor = stage.solver("governor.yaml", frames=True)
shaft, arm = (governor.speed_names.index(n) for n in ("shaft", "arm_right"))
names, p0 = governor.parameter_names, dict(zip(governor.parameter_names, governor.parameters, strict=True))


def steady(load, p):
    """State of steady rotation, and the derivatives of angle and speed by the parameters."""
    q, u = governor.initial
    for _ in range(20):
        udot, J = governor.accelerations(q, u, p, [load]), governor.jacobians(q, u, p, [load])
        slopes = np.column_stack([J.q[[shaft, arm], arm], J.u[[shaft, arm], shaft]])
        change = np.linalg.solve(slopes, -udot[[shaft, arm]])
        q, u = governor.assemble({"arm_right": q[arm] + change[0]}, {"shaft": u[shaft] + change[1]}, p)
        if np.abs(change).max() < 1e-12:
            break
    return q, u, -np.linalg.solve(slopes, J.p[[shaft, arm]])


# %%
# **Speed and load.** The valve's opening determines the height of the sleeve, and this height determines the speed.
# For equal arms and links the speed is known: :math:`\omega^2 = ((m + M) g + F)/(m h)`, where F is the force of the
# spring and h the height of the rhombus' upper half.
loads = np.linspace(40.0, 180.0, 5 if stage.SHORT else 29)
springs = [0.0, 500.0, 1500.0]
speeds = np.array([[steady(load, {"stiffness": k})[1][shaft] for load in loads] for k in springs])
lift = (p0["torque"] - loads) / p0["gain"]
height = (0.8 - 0.35 - lift) / 2
for k, found in zip(springs, speeds, strict=True):
    weight = (p0["ball"] + p0["sleeve"]) * 9.81 + k * lift
    np.testing.assert_allclose(found, np.sqrt(weight / (p0["ball"] * height)), rtol=1e-10)
q, u, dsteady = steady(120.0, {})
for name, x in zip(names, dsteady[1], strict=True):
    print(f"d speed/d {name:10} {x:9.4f} rad/s per unit")

# %%
# **Stability.** `linearize` accepts a state in motion. The derivatives of its eigenvalues are exact, so Newton's method
# finds the dashpot at which a pair of eigenvalues crosses the imaginary axis.
dashpots = np.linspace(5.0, 400.0, 6 if stage.SHORT else 60)


def hunting(dashpot):
    """The oscillating eigenvalue, and its derivative by the dashpot."""
    linear = governor.linearize(q, u, {"dashpot": dashpot}, [120.0], outputs=())
    values = linear.eigenvalues()
    worst = int(np.argmax(values.imag))
    return values[worst], linear.eigenvalue_sensitivities("dashpot", moving=False)[0, worst]


roots = np.array([hunting(c)[0] for c in dashpots])
critical = 100.0
for _ in range(8):
    value, slope = hunting(critical)
    critical -= value.real / slope.real
print(f"critical dashpot: {critical:.4f} N s/m, where the engine hunts at {value.imag:.3f} rad/s")

# %%
# Vyshnegradsky's condition, written down by hand for this governor, gives the same dashpot. The characteristic polynomial
# is :math:`A J \lambda^3 + C J \lambda^2 + (B J + D E) \lambda + D G`, and a pair is imaginary where
# :math:`C J (B J + D E) = A J D G`.
m, M, L, g, w = p0["ball"], p0["sleeve"], p0["arm"], 9.81, u[shaft]
sin, cos = np.cos(q[arm]), np.sin(q[arm])  # of the angle from the vertical
A, B = 2 * m * L**2 + 4 * M * L**2 * sin**2, -2 * m * L**2 * w**2 * (cos**2 - sin**2) + 2 * (m + M) * g * L * cos
J, D = p0["inertia"] + 2 * m * L**2 * sin**2, 4 * m * L**2 * sin * cos * w
E, G = D, 2 * L * sin * p0["gain"]
C = A * D * G / (B * J + D * E)  # of 4 L^2 sin^2 times the dashpot
np.testing.assert_allclose(critical, C / (4 * L**2 * sin**2), rtol=1e-9)

# %%
# **Result.** After a sudden load the engine settles with a dashpot twice the critical one, and hunts with half of it.
seconds = np.linspace(0.0, 2.0 if stage.SHORT else 20.0, 401)
fig, (left, middle, right) = stage.figure(10, 3.2, 1, 3)
for k, found in zip(springs, speeds, strict=True):
    left.plot(loads, found * 30 / np.pi, label=f"spring {k:g} N/m")
left.set(xlabel="load (N m)", ylabel="speed (rpm)", title="Steady speed")
left.legend()
middle.plot(dashpots, roots.real, color=stage.BLUE)
middle.axvline(critical, color=stage.ORANGE, linestyle="--", label=f"critical: {critical:.0f} N s/m")
middle.axhline(0, color=stage.BLACK, linewidth=0.6)
middle.set(xlabel="dashpot (N s/m)", ylabel="growth of the oscillation (1/s)", title="Stability at 120 N m")
middle.legend()
for factor, colour in ((2.0, stage.BLUE), (0.5, stage.ORANGE)):
    run = governor.simulate(seconds, q, u, p={"dashpot": factor * critical}, inputs=[130.0])
    right.plot(seconds, run["speed"] * 30 / np.pi, color=colour, label=f"{factor:g} times the critical dashpot")
    if factor == 0.5:
        film = governor.simulate(
            np.arange(0.0, 4.0, 0.1), run.q[-1], run.u[-1], p={"dashpot": factor * critical}, inputs=[130.0]
        )
        stage.animate(film, "governor", rate=10)
right.set(xlabel="t (s)", ylabel="speed (rpm)", title="A load of 130 instead of 120 N m")
right.legend()
