"""The mechanics of rigid multibody systems as blocks of scalar statements, one file for each sweep of the paper.

Frames. A *link* is a body with a joint of one kind. Its frame has its origin at the joint and one axis along the joint axis. The
partial velocities are then constant columns, mostly unit ones, and the inertia about the origin is constant. A field has
components along the axes of its link. Six-vectors are two triples, angular first.

Accelerations are those of the frame's origin (not spatial accelerations), so forward dynamics contains no linear velocity. With
gravity, the ground accelerates by -g.
"""
