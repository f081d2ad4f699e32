"""The mechanics of a rigid multibody tree as blocks of scalar statements, one file a sweep of the paper.

Frames. A *link* is a body with a joint of one kind; its frame has its origin at the joint and one axis along the joint
axis, so that its partial velocities are constant columns, mostly unit ones, and its inertia about that origin is constant.
Components are in the frame of the link that a field belongs to. Six-vectors are two triples, angular first.

Accelerations are those of the frame's origin (not spatial accelerations): then no linear velocity is needed
anywhere in the forward dynamics. With gravity, the ground accelerates by -g.
"""
