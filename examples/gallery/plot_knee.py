r"""
Human leg: moment arms about a knee that is no hinge
====================================================

**Problem.** The cruciate ligaments guide the knee like a four-bar linkage, so its centre of rotation wanders as the leg is
bent, and with it the moment arms of the muscles. How do they change if a surgeon attaches a new anterior ligament to the
femur some millimetres away from the old place?

**Model.** `knee.yaml`: thigh and shank, two ligaments as massless distances (two loops), and three muscles as lengths.

**Sources.** J. J. O'Connor, T. L. Shercliff, E. Biden, J. W. Goodfellow, "The geometry of the knee in the sagittal
plane", Proc. Inst. Mech. Engrs. H 203 (1989), for the linkage. The positions of the attachments are rounded values
for an adult, chosen for this example.
"""

# %%
# The moment arm of a muscle is minus the derivative of its length with respect to the flexion, with the loops closed.
import numpy as np
import stage

leg = stage.solver("knee.yaml", frames=True)
knee = leg.speed_names.index("shank.3")
muscles = ("hamstring", "patellar", "gastrocnemius")
flexion = np.radians(np.linspace(0, 120, 13 if stage.SHORT else 61))
q, u = leg.assemble({"shank.3": flexion}, follow=True)
weights = np.zeros((3, 1, leg.noutputs))
for k, muscle in enumerate(muscles):
    weights[k, 0, leg.output_names.index(muscle)] = 1.0
arms = -leg.output_gradients(q, u, weights=weights).q[:, :, leg.coordinate_names.index("shank.3")]

# %%
# A check by geometry: the centre of rotation is the point in which the lines of both ligaments meet, and the moment arm is the
# distance of the muscle's line from it.
ends = leg.points(q, points=[f"{name}_{end}" for name in ("acl", "pcl", *muscles) for end in "ab"]).position[
    :, :, [0, 2]
]
starts, ways = ends[:, 0::2], ends[:, 1::2] - ends[:, 0::2]
along = np.linalg.solve(np.stack([ways[:, 0], -ways[:, 1]], axis=2), (starts[:, 1] - starts[:, 0])[..., None])[..., 0]
centre = starts[:, 0] + along[:, :1] * ways[:, 0]
arm = centre[:, None] - starts[:, 2:]
by_geometry = (arm[..., 1] * ways[:, 2:, 0] - arm[..., 0] * ways[:, 2:, 1]) / np.linalg.norm(ways[:, 2:], axis=2)
np.testing.assert_allclose(np.abs(by_geometry.T), np.abs(arms), atol=1e-12)

# %%
# **The surgeon's millimetres.** `bias_force` is the torque at the knee that holds the leg. It is linear in the force
# of the hamstrings, so the change of the torque by one newton is their moment arm, and the derivatives of this change
# are those of the moment arm. No finite difference is needed, although these are second derivatives of the length.
moves = ("acl_femur.x", "acl_femur.z", "hamstring_insertion.x", "hamstring_insertion.z")
dp = np.zeros((len(moves), 1, leg.np))
for k, name in enumerate(moves):
    dp[k, 0, leg.parameter_names.index(name)] = 1.0
one, none = (leg.bias_force_sensitivities(q, 0 * u, inputs=[pull], dp=dp) for pull in (1.0, 0.0))
place = leg.independent_speed_names.index("shank.3")
np.testing.assert_allclose((none[0] - one[0])[:, place], arms[0], atol=1e-11)
darm = (none[1] - one[1])[:, :, place]

# %%
# Without the ligaments' loops, the derivative with respect to the insertion would be that of a hinge. With the loops,
# moving a ligament moves the centre of rotation. A difference of two assembled legs confirms one of these numbers.
h = 1e-5
shifted = []
for sign in (1, -1):
    p = {"acl_femur.x": -0.010 + sign * h}
    closed = leg.assemble(q, u, p)
    gradient = leg.output_gradients(*closed, p, weights=weights[:1]).q[0, :, leg.coordinate_names.index("shank.3")]
    shifted.append(-gradient)
np.testing.assert_allclose((shifted[0] - shifted[1]) / (2 * h), darm[0], atol=1e-5)

# %%
# **Result.**
fig, (path, left, right) = stage.figure(10, 3.6, 1, 3)
for i in range(0, len(q), len(q) // 4):
    for k, colour in ((0, stage.BLUE), (1, stage.ORANGE)):
        path.plot(*1e3 * ends[i, 2 * k : 2 * k + 2].T, "o-", color=colour, markersize=3, alpha=0.3 + 0.7 * i / len(q))
path.plot(*1e3 * centre.T, color=stage.BLACK, label="centre of rotation")
path.plot([], [], color=stage.BLUE, label="anterior ligament")
path.plot([], [], color=stage.ORANGE, label="posterior ligament")
path.set(
    xlabel="x (mm)",
    ylabel="z (mm)",
    title="Ligaments, from 0 to 120 degrees",
    aspect="equal",
    xlim=(-50, 50),
    ylim=(-35, 50),
)
path.legend(loc="upper right")
for row, name in zip(arms, muscles, strict=True):
    left.plot(np.degrees(flexion), 1e3 * row, label=name)
left.set(xlabel="flexion (degrees)", ylabel="mm; positive: bends the knee", title="Moment arms")
left.legend()
for row, name in zip(darm, moves, strict=True):
    right.plot(np.degrees(flexion), row, label=name)
right.set(xlabel="flexion (degrees)", ylabel="mm per mm", title="Arm of the hamstrings by places")
right.legend()

# %%
# The relaxed leg swings.
start = leg.assemble({"thigh": np.radians(40), "shank.3": np.radians(80)})
stage.animate(leg.simulate(np.linspace(0, 2, 51), *start), "knee", view="y")
