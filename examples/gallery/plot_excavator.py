r"""
Excavator: the digging force along the bucket's path
====================================================

**Problem.** The bucket's cylinder of a 20 t excavator pushes with a given force. A rocker and a link turn this push into a
force at the teeth, which changes as the bucket curls. How large is it along the path, and which lengths of rocker and link
make the least of these forces as large as possible?

**Model.** `examples/excavator.yaml`: three hydraulic cylinders, boom, stick, bucket, rocker and link in four loops. Boom and
stick stand still here, and the bucket curls.

**Sources.** ISO 6015 defines digging forces of excavators. The dimensions are those of the model, and the cylinder's bore of
120 mm at 350 bar is typical.
"""

# %%
# By virtual work the force at the teeth is the push times the speed of the piston over the speed of the teeth. The
# output `power` is the piston's speed if the push is 1 N, and its derivatives with respect to the lengths are those
# of a velocity in closed loops. The distance of the teeth from the bucket's pin is the length of the bucket.
import numpy as np
import stage
from scipy.optimize import linprog

machine = stage.solver("excavator.yaml", frames=True)
names = machine.parameter_names
p0 = dict(zip(names, machine.parameters, strict=True))
push = np.pi / 4 * 0.12**2 * 350e5
power = machine.output_names.index("power")
curl = machine.speed_names.index("bucket")
angles = np.linspace(-1.9, -0.2, 9 if stage.SHORT else 35)


def digging(p):
    """Force across the bucket at the teeth, N, over its angles, and its derivatives by the parameters."""
    q, u = machine.assemble({"bucket": -0.8}, p=p)
    u = np.zeros(machine.nu)
    u[curl] = 1.0
    order = np.argsort(np.abs(angles + 0.8))
    values, slopes = np.zeros(len(angles)), np.zeros((len(names), len(angles)))
    for side in (angles >= -0.8, angles < -0.8):
        near = q
        for i in order[side[order]]:
            near = near.copy()
            near[machine.coordinate_names.index("bucket")] = angles[i]
            near, v = machine.assemble(near, u, p)
            one = {"force_bucket": 1.0}
            outputs, slope = machine.output_sensitivities(near, v, p, one, dp=np.eye(len(names)))
            values[i], slopes[:, i] = push * outputs[power], push * slope[:, power]
    length = p.get("bucket_length", p0["bucket_length"])
    return np.abs(values) / length, np.sign(values) * slopes / length


force, slopes = digging({})

# %%
# A check by statics: the force of the cylinder that holds the machine against a force at the teeth. The model has no
# force there. A force F across the bucket at distance L has the torque F L about the bucket's pin. The changes of the
# bucket's acceleration by this torque and by the cylinder have to cancel, while boom and stick are held by their own
# forces. Inverse dynamics gives the forces of all joints that hold the machine, with and without the push.
q, u = machine.assemble({"bucket": float(angles[len(angles) // 2])})
hold = [machine.inverse_dynamics(q, 0 * u, np.zeros(machine.nu), inputs={"force_bucket": F}) for F in (push, 0.0)]
place = machine.independent_speed_names.index("bucket")
np.testing.assert_allclose(abs((hold[0] - hold[1])[place]) / p0["bucket_length"], force[len(angles) // 2], rtol=1e-9)

# %%
# **Design.** The least force over the path is not differentiable where its place changes, but a sequence of linear programs
# needs no more than the derivatives of the force at all angles. Each program allows steps of a few millimetres in the lengths,
# and maximises the least of the linearised forces.
free = ["rocker_length", "link_length", "rocker_back", "bucket_eye_x", "bucket_eye_z"]
columns = [names.index(n) for n in free]
design, reach = {n: p0[n] for n in free}, 0.01
values, by = force, slopes
for _ in range(3 if stage.SHORT else 15):
    rows = np.column_stack([-by[columns].T, np.ones(len(angles))])
    bounds = [(max(-reach, p0[n] - 0.06 - design[n]), min(reach, p0[n] + 0.06 - design[n])) for n in free] + [
        (None, None)
    ]
    step = linprog([0] * len(free) + [-1], A_ub=rows, b_ub=values, bounds=bounds).x[:-1]
    trial = {n: design[n] + x for n, x in zip(free, step, strict=True)}
    found, slope = digging(trial)
    if found.min() > values.min():
        design, values, by = trial, found, slope
    else:
        reach /= 2
print(f"least force along the path: {force.min() / 1e3:.1f} kN before, {values.min() / 1e3:.1f} kN after")
for n in free:
    print(f"  {n}: {1e3 * p0[n]:.0f} -> {1e3 * design[n]:.0f} mm")
assert values.min() > 1.05 * force.min()

# %%
# The work over the whole path is the push times the stroke of the piston, whatever the linkage: a second check.
for p, along in (({}, force), (design, values)):
    ends = machine.assemble({"bucket": angles[[0, -1]]}, p=p)[0][:, machine.coordinate_names.index("rod_bucket")]
    work = np.trapezoid(along, angles) * p0["bucket_length"]
    np.testing.assert_allclose(work, push * abs(ends[1] - ends[0]), rtol=0.02 if stage.SHORT else 2e-3)

# %%
# **Result.**
fig, (left, right) = stage.figure(8.5, 3.6, 1, 2)
left.plot(np.degrees(angles), force / 1e3, color=stage.GREY, label="before")
left.plot(np.degrees(angles), values / 1e3, color=stage.BLUE, label="after")
left.set(xlabel="angle of the bucket (degrees)", ylabel="digging force (kN)", title="Force at the teeth")
left.legend()
for n in free:
    right.plot(np.degrees(angles), 1e-5 * slopes[names.index(n)], label=n)
right.set(xlabel="angle of the bucket (degrees)", ylabel="kN per cm", title="Derivatives by the lengths")
right.legend()

# %%
# The arm sinks under its own weight, slowed by the throttled oil of its cylinders. `examples/excavator_lift.py` lifts
# the load with the least work.
stage.animate(machine.simulate(np.linspace(0, 2, 31)), "excavator", rate=15, view="y")
