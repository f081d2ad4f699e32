"""Completion of seeds and the balance through loops. Section 4 of the theory page.

Position, velocity and acceleration closure are differentiated one after the other; each gives what the dependent joints
must do by the same factored closure matrix. Inward, the loops carry the wrench that closes them, and what is left along the
dependent joints is projected on the sources by the same map ``Y``: no multiplier is ever solved for along a direction.
"""

from __future__ import annotations

from typing import Any

from sympy import Rational

from .closures import own_sources, stored_factor
from .couplings import component, from_far, hand_force, others, to_base
from .ear_tangents import EarTangents, tangents_of
from .ears import ZERO, Condition, Ear, Twist, rotate
from .energy import origin_velocity
from .far_links import far_motion_tangents
from .joints import JointTransform
from .kinematics import (
    acceleration_matrix,
    angular_velocity,
    body_force,
    load_matrix,
    load_symmetric,
    load_vector,
    store_matrix,
    store_vector,
)
from .loop_dynamics import (
    accumulate_base,
    carried_accelerations,
    closing_accelerations,
    less_external_of,
    link_constants,
    member_motion,
    place_of_base,
    places_of_partners,
    root_motions,
    root_velocities,
    source_accelerations,
    speeds_of,
    store_sources,
    system_size,
)
from .orthogonal import product
from .spatial import PAIRS, XYZ, Mat, Vec, add, cross, dot, is_zero, matvec, scale, six, transpose
from .tangents import differentiate, store_tangent

Force = tuple[Vec, Vec]
"""Moment and force."""


def let3(x: Any, name: str, v: Vec, tag: str, lanes: bool = True) -> Vec:
    return [x.let(f"{name}_{i}", v[k], tag, lanes=lanes) for k, i in enumerate(XYZ)]


# -- completion: links that ears start from --------------------------------------------------------------------------


def link_displacement(x: Any, kind: Any) -> None:
    """Outward block over directions of a link that ears start from: rotation vector, displacement, tangents of its velocity.

    All are components in the link's axes, against the origin.
    """
    if kind.closed_on == "origin":
        undisplaced(x, "lme", "lane")
    if kind.closed_on != "moving":
        return
    joint = JointTransform(x, kind)
    theta = load_vector(x, "lup", "ct")
    d = load_vector(x, "lup", "cd")
    moving = JointTransform(x, kind, lanes=True)
    r = joint.offset()
    tag = "d Eq. 22"
    turn, slide = joint_displacement(x, kind, joint)
    local, about = parameter_displacement(x, kind, joint)
    theta_here = moving.to_child(add(theta, about), "ct", tag)
    d_here = moving.to_child(add(d, cross(theta, r), local), "cd", tag)
    store_vector(x, "lme", "ct", let3(x, "ct", add(theta_here, turn), tag))
    store_vector(x, "lme", "cd", let3(x, "cd", add(d_here, slide), tag))
    store_vector(x, "lane", "ct", let3(x, "ct", add(theta_here, turn), tag))
    store_vector(x, "lane", "cd", let3(x, "cd", add(d_here, slide), tag))
    _, w = angular_velocity(x, kind, joint, "cw")
    v = origin_velocity(x, kind, joint, "cw", "cv")
    tangents = differentiate(x, kind, joint)
    for array in ("lme", "lane"):
        store_tangent(x, tangents, array, "cw", w)
        store_tangent(x, tangents, array, "cv", v)


def undisplaced(x: Any, *arrays: str) -> None:
    """The origin's."""
    for array in arrays:
        for name in ("ct", "cd", "cw", "cv"):
            store_vector(x, array, name, ZERO)


def joint_displacement(x: Any, kind: Any, joint: JointTransform) -> tuple[Vec, Vec]:
    """Rotation vector and displacement that a joint's own dq causes, in the link's axes."""
    turn: Vec = [0, 0, 0]
    slide: Vec = [0, 0, 0]
    if kind.joint == "revolute":
        turn[kind.axis] = x.load("dq", "0")
    elif kind.joint == "prismatic":
        slide[kind.axis] = x.load("dq", "0")
    else:
        turn = [x.load("lane", f"turn.{i}") for i in range(3)]
        if kind.joint == "free":
            moved = matvec(transpose(joint.matrix), [x.load("dq", str(i)) for i in range(3)])
            slide = let3(x, "slide", moved, "d Eq. 22")
    return turn, slide


def parameter_displacement(x: Any, kind: Any, joint: JointTransform) -> tuple[Vec, Vec]:
    """Displacement and rotation vector of the joint in its parent that the design parameters cause, in the parent's axes."""
    local: Vec = [0, 0, 0]
    about: Vec = [0, 0, 0]
    for j in range(kind.parameters):
        dp = x.load("dp", str(j))
        local = [local[i] + x.load("c", f"r.{a}/{j}") * dp for i, a in enumerate(XYZ)]
        if joint.fixed is not None:
            dR = [[x.load("c", f"R.{a}{b}/{j}") for b in XYZ] for a in XYZ]
            if not all(is_zero(e) for row in dR for e in row):
                about = [
                    about[i] + v * dp
                    for i, v in enumerate(let3(x, "about", rotation_vector(dR, joint.fixed), "d Eq. 22", False))
                ]
            if joint.joint in ("prismatic", "free"):
                q = [x.load("q", str(i)) for i in range(3)] if joint.joint == "free" else None
                moved = matvec(dR, q) if q else [row[joint.axis] * x.load("q", "0") for row in dR]
                local = [local[i] + v * dp for i, v in enumerate(let3(x, "moved", moved, "d Eq. 22", False))]
    return local, about


def rotation_vector(dR: Mat, R: Mat) -> Vec:
    """Of ``dR R^T``."""
    found = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        found.append(dot(dR[k], R[j]))
    return found


# -- completion: ears --------------------------------------------------------------------------------------------------


def root_angles(x: Any, kind: Any, slot: bool) -> tuple[dict[int, Vec], dict[int, Vec]]:
    """Rotation vectors and displacements of the roots; the latter only in the sweep that finds them (`slot`)."""
    angles: dict[int, Vec] = {}
    moved: dict[int, Vec] = {}
    for t, role in enumerate(kind.roots):
        place = -1 - t
        if role == "far":
            angles[place] = load_vector(x, "lregion", f"far{kind.far[t]}.th")
            moved[place] = load_vector(x, "lregion", f"far{kind.far[t]}.d")
        elif role == "link":
            angles[place] = load_vector(x, f"lroot#{t}" if slot else f"laneroot#{t}", "th")
            if slot:
                moved[place] = load_vector(x, f"lroot#{t}", "d")
        elif role == "ground":
            # seen from the base, whose axes turn, it is the ground that turns
            angles[place] = [-v for v in load_vector(x, "lbase" if slot else "lanebase", "ct")]
            if slot:
                moved[place] = [-v for v in load_vector(x, "lbase", "cd")]
        else:
            angles[place], moved[place] = list(ZERO), list(ZERO)
    return angles, moved


def complete(x: Any, kind: Any) -> None:
    """Outward block over directions: dq and du of the dependent joints, by differentiated position and velocity closure."""
    ear = Ear(x, kind)
    angles, moved = root_angles(x, kind, True)
    for t, role in enumerate(kind.roots):
        if role == "ground":
            turned = cross(angles[-1 - t], ear.position(-1 - t))
            moved[-1 - t] = let3(x, "d", add(moved[-1 - t], turned), "d Eq. 22")
    dq = complete_positions(x, ear, angles, moved)
    complete_velocities(x, ear, angles, moved, dq)


def still(kind: Any) -> list[Twist]:
    """Roots that do not move."""
    return [Twist(list(ZERO), list(ZERO)) for _ in kind.roots]


def complete_positions(x: Any, ear: Ear, angles: dict[int, Vec], moved: dict[int, Vec]) -> dict[tuple[str, str], Any]:
    """Displacements of the ear's links, put into `angles` and `moved`, and dq of its dependent joints, by link and coordinate."""
    kind, tag = ear.kind, "d Eq. 22"
    for k, member in enumerate(ear.members):
        view = member.view
        W = ear.attitude(member.parent)
        turn, slide = [0, 0, 0], [0, 0, 0]
        for freedom in member.freedoms:
            if freedom.index in kind.dependent[k]:
                continue
            value = freedom_displacement(view, kind.links[k], member.joint, freedom.index)
            if freedom.angular:
                turn = add(turn, scale(value, freedom.e))
            else:
                slide = add(slide, scale(value, freedom.e))
        local, about = parameter_displacement(view, kind.links[k], member.joint)
        theta, d = angles[member.parent], moved[member.parent]
        angles[k] = let3(x, "th", add(theta, rotate(W, let3(x, "about", about, tag)), turn), tag)
        moved[k] = let3(x, "d", add(d, cross(theta, member.rho), rotate(W, let3(x, "dr", local, tag)), slide), tag)
    dq: dict[tuple[str, str], Any] = {}
    rows = [ear.rows()[i] for i in kind.kept]
    if rows:
        b = ear.conditions(rows, cut_displacements(x, ear, angles, moved), "b", "d Eq. 30", lanes=True)
        rates = stored_factor(x, kind).solve([-v for v in b], "dx", "d Eq. 30", lanes=True)
        for k, added in enumerate(ear.walk(still(kind), ear.coefficients(rates), "dd", tag, lanes=True)):
            angles[k] = let3(x, "th", add(angles[k], added.angular), tag)
            moved[k] = let3(x, "d", add(moved[k], added.linear), tag)
        dq = dependent_displacements(x, ear, rates)
        for (place, name), value in dq.items():
            x.store(f"dq#{place}", name, value)
    for k in range(len(ear.members)):
        for array in ("lme", "lane"):
            store_vector(x, f"{array}#{k}", "th", angles[k])
            store_vector(x, f"{array}#{k}", "d", moved[k])
    return dq


def complete_velocities(
    x: Any, ear: Ear, angles: dict[int, Vec], moved: dict[int, Vec], dq: dict[tuple[str, str], Any]
) -> None:
    """du of the ear's dependent joints, and tangents of its links' velocities."""
    kind = ear.kind
    roots = root_velocities(x, kind)
    velocities = ear.walk(roots, [speeds_of(m) for m in ear.members], "r", "Eq. 30")
    rows = [ear.rows()[i] for i in kind.kept]
    conditions = ear.conditions(rows, ear.face_difference(velocities, roots), "cv", "Eq. 30")
    slides = any(c.slides for c in kind.closures)
    seeds: dict[Any, Any] = {}
    held: Vec = []
    for t, role in enumerate(kind.roots):
        array, names = (f"lroot#{t}", ("rw", "rv")) if role == "link" else ("lbase", ("cw", "cv"))
        if role == "far":
            array, names = "lregion", (f"far{kind.far[t]}.w", f"far{kind.far[t]}.v")
        if role in ("link", "far") or (role == "frame" and not kind.rigid):
            for vector, name in zip((roots[t].angular, roots[t].linear), names, strict=True):
                seeds.update(tangents_of(vector, load_vector(x, array, name)))
        held += [*roots[t].angular, *roots[t].linear]
        if slides and role != "frame":
            seeds.update(tangents_of(ear.position(-1 - t), moved[-1 - t]))
            held += ear.position(-1 - t)
    held += [ear.members[k].view.load("u", str(freedom.index)) for k, freedom in ear.dependents()]
    tangents = EarTangents(ear, angles, seeds, dq)
    tangents.hold(held)
    tangents.run()
    if rows:
        b = [-tangents.of(v) for v in conditions]
        rates = stored_factor(x, kind).solve(b, "du", "d Eq. 30", lanes=True)
        added = ear.walk(still(kind), ear.coefficients(rates), "dr", "d Eq. 30", lanes=True)
        pairs = [
            ((v.angular, more.angular), (v.linear, more.linear)) for v, more in zip(velocities, added, strict=True)
        ]
        tangents.correct([pair for both in pairs for pair in both])
        for (k, freedom), value in zip(ear.dependents(), rates, strict=True):
            x.store(f"du#{k}", str(freedom.index), value)
    for v in ear.fixed:
        if v.kept is not None:
            store_vector(x, *v.kept, tangents.vector(v.found))
    for k, velocity in enumerate(velocities):
        angular, linear = tangents.vector(velocity.angular), tangents.vector(velocity.linear)
        for array in ("lme", "lane"):
            store_vector(x, f"{array}#{k}", "rw", angular)
            store_vector(x, f"{array}#{k}", "rv", linear)
        if kind.links[k].closed_on == "origin":
            undisplaced(x, f"lme#{k}", f"lane#{k}")
        if kind.links[k].closed_on == "moving":
            member_displacement(x, ear, k, (angles[k], moved[k]), velocity, Twist(angular, linear))


def member_displacement(x: Any, ear: Ear, k: int, displaced: tuple[Vec, Vec], velocity: Twist, tangent: Twist) -> None:
    """The same as `link_displacement` gives, of a link of an ear that other loops close on, from what is relative to the base."""
    kind, tag = ear.kind, "d Eq. 22"
    theta, d = displaced
    W, o = ear.members[k].W, ear.position(k)
    w, v, dw, dv = velocity.angular, velocity.linear, tangent.angular, tangent.linear
    theta_whole, d_whole = list(theta), list(d)
    if kind.carried:
        theta_base, d_base = load_vector(x, "lbase", "ct"), load_vector(x, "lbase", "cd")
        theta_whole, d_whole = add(theta, theta_base), add(d, d_base, cross(theta_base, o))
        if kind.rigid:
            w_base, dw_base = load_vector(x, "base", "cw"), load_vector(x, "lbase", "cw")
            w = let3(x, "w", add(w, w_base), "Eq. 18", False)
            v = let3(x, "v", add(v, load_vector(x, "base", "cv"), cross(w_base, o)), "Eq. 18", False)
            dw = add(dw, dw_base)
            dv = add(dv, load_vector(x, "lbase", "cv"), cross(dw_base, o), cross(w_base, d))
    dw = [a - b for a, b in zip(dw, cross(theta, w), strict=True)]
    dv = [a - b for a, b in zip(dv, cross(theta, v), strict=True)]
    back = transpose(W)
    for name, value in (("ct", theta_whole), ("cd", d_whole), ("cw", dw), ("cv", dv)):
        own = let3(x, name, matvec(back, let3(x, name, value, tag)), tag)
        for array in ("lme", "lane"):
            store_vector(x, f"{array}#{k}", name, own)


def freedom_displacement(view: Any, kind: Any, joint: JointTransform, j: int) -> Any:
    """Displacement along one freedom of a joint that its dq causes."""
    if kind.joint in ("revolute", "prismatic"):
        return view.load("dq", "0")
    if j < 3:
        return view.load("lane", f"turn.{j}")
    column = [row[j - 3] for row in joint.matrix]
    return view.let("slide", dot(column, [view.load("dq", str(i)) for i in range(3)]), "d Eq. 22", lanes=True)


def dependent_displacements(x: Any, ear: Ear, rates: list[Any], lanes: bool = True) -> dict[tuple[str, str], Any]:
    """dq of dependent joints from displacements along their freedoms; a quaternion's is ``e (0, theta) / 2``."""
    result: dict[tuple[str, str], Any] = {}
    values: dict[int, dict[int, Any]] = {}
    for (k, freedom), value in zip(ear.dependents(), rates, strict=True):
        values.setdefault(k, {})[freedom.index] = value
    for k, found in values.items():
        member, kind = ear.members[k], ear.kind.links[k]
        if kind.joint in ("revolute", "prismatic"):
            result[str(k), "0"] = found[0]
            continue
        # what is dependent in part keeps what was given along its other freedoms; a rotation or displacement without any
        # dependent freedom is as given, a quaternion's length too
        if any(j < 3 for j in found):
            n = 3 if kind.joint == "free" else 0
            turn = [found[j] if j in found else member.view.load("lane", f"turn.{j}") if lanes else 0 for j in range(3)]
            half = 1 if x.structural else Rational(1, 2)
            a, b, c = (x.let("half", half * v, "d Eq. 22", lanes=lanes) for v in turn)
            w, i, j, k_ = (member.view.load("q", str(n + m)) for m in range(4))
            changed = [
                -(i * a + j * b + k_ * c), w * a + j * c - k_ * b, w * b + k_ * a - i * c, w * c + i * b - j * a,
            ]  # fmt: skip
            for m, value in enumerate(changed):
                result[str(k), str(n + m)] = x.let("dq", value, "d Eq. 22", lanes=lanes)
            if lanes:
                for m in range(3):
                    member.view.store("lane", f"turn.{m}", turn[m])
        if any(j >= 3 for j in found):
            slide = [
                found[j] if j in found else freedom_displacement(member.view, kind, member.joint, j) if lanes else 0
                for j in range(3, 6)
            ]
            for m, value in enumerate(matvec(member.joint.matrix, slide)):
                result[str(k), str(m)] = x.let("dq", value, "d Eq. 22", lanes=lanes)
    return result


def cut_displacements(x: Any, ear: Ear, angles: dict[int, Vec], moved: dict[int, Vec]) -> list[Twist]:
    """Displacements of the end faces against the start faces."""
    found = []
    for c, closure in enumerate(ear.kind.closures):
        sides = []
        for side in (0, 1):
            place = closure.faces[side]
            W = ear.attitude(place)
            theta, d = angles[place], moved[place]
            local, about = face_displacement(x, ear, c, side)
            at = add(d, cross(theta, ear.arm(c, side)), rotate(W, let3(x, "dr", local, "d Eq. 30")))
            theta = add(theta, rotate(W, let3(x, "about", about, "d Eq. 30")))
            slip = ear.slip(c) if side == 0 else None
            if slip is not None:
                at = add(at, cross(theta, slip))
            sides.append(Twist(let3(x, "cut", theta, "d Eq. 30"), let3(x, "cut", at, "d Eq. 30")))
        found.append(ear.difference(c, (sides[0], sides[1])))
    return found


def seed_residuals(x: Any, kind: Any) -> None:
    """Outward block over directions: by how much complete seeds open the loops, in all conditions of their joints.

    Only redundant conditions can be left open: by a parameter, say, that bends a planar loop out of its plane.
    """
    ear = Ear(x, kind)
    angles, _ = root_angles(x, kind, False)
    moved: dict[int, Vec] = {}
    for t, role in enumerate(kind.roots):
        place = -1 - t
        if role == "far":
            moved[place] = load_vector(x, "lregion", f"far{kind.far[t]}.d")
        elif role == "link":
            moved[place] = load_vector(x, f"laneroot#{t}", "d")
        elif role == "ground":
            turned = cross(angles[place], ear.position(place))
            moved[place] = let3(
                x, "d", [b - a for a, b in zip(load_vector(x, "lanebase", "cd"), turned, strict=True)], "d Eq. 22"
            )
        else:
            moved[place] = list(ZERO)
    for k in range(len(ear.members)):
        angles[k], moved[k] = load_vector(x, f"lane#{k}", "th"), load_vector(x, f"lane#{k}", "d")
    gaps = cut_displacements(x, ear, angles, moved)
    for c in range(len(kind.closures)):
        for i, row in enumerate(ear.joint_conditions(c)):
            value = dot(row.n, gaps[c].angular if row.angular else gaps[c].linear)
            x.store(f"dposition#{c}", str(i), x.let("open", value, "d Eq. 32", lanes=True))


def face_displacement(x: Any, ear: Ear, c: int, side: int) -> tuple[Vec, Vec]:
    """Displacement and rotation vector of a face in its link that the design parameters cause."""
    name = "AB"[side]
    local: Vec = [0, 0, 0]
    about: Vec = [0, 0, 0]
    closure = ear.kind.closures[c]
    for j in range(closure.parameters):
        dp = x.load(f"cldp#{c}", str(j))
        local = [local[i] + x.load(f"cl#{c}", f"{name}.r.{a}/{j}") * dp for i, a in enumerate(XYZ)]
        if closure.type == "spherical" and not closure.gaps:
            continue
        _, F = ear.face(c, side)
        dF = [[x.load(f"cl#{c}", f"{name}.F.{a}{b}/{j}") for b in XYZ] for a in XYZ]
        if not all(is_zero(e) for row in dF for e in row):
            about = [
                about[i] + v * dp for i, v in enumerate(let3(x, "about", rotation_vector(dF, F), "d Eq. 30", False))
            ]
    return local, about


# -- balance -----------------------------------------------------------------------------------------------------------


def total_udot(x: Any, kind: Any, k: int, member: Any) -> list[Any]:
    return [x.load(f"udot#{k}", str(f.index)) for f in member.freedoms]


def ear_balance_out(x: Any, kind: Any) -> None:
    """Outward block over directions: tangents of the motion, the sources' udot held, and of the force it needs. Eqs. 25-29."""
    ear = Ear(x, kind)
    f = stored_factor(x, kind)
    rows = [ear.rows()[i] for i in kind.kept]
    angles, _ = root_angles(x, kind, False)
    for k in range(len(ear.members)):
        angles[k] = load_vector(x, f"lane#{k}", "th")
    roots = root_motions(x, kind, "t")
    seeds: dict[Any, Any] = {}
    for t, role in enumerate(kind.roots):
        w, al, a, B = roots[t]
        if role == "ground":
            # minus gravity in the base's axes turns with theta, and may depend on parameters
            change = [-v for v in load_vector(x, "lground", "a")]
            W = ear.attitude(-1 - t)
            moved = add(cross(angles[-1 - t], a), [-v for v in rotate(W, change)])
            seeds.update(tangents_of(a, let3(x, "dg", moved, "d Eq. 22")))
            continue
        array = "lbase" if role == "frame" else f"lroot#{t}"
        names: tuple[str, ...] = ("w", "al", "a", "B") if role == "frame" else ("sw", "sal", "sa", "sB")
        if role == "far":
            array, names = "lregion", tuple(f"far{kind.far[t]}.{n}" for n in ("aw", "al", "a", "B"))
        for vector, name in zip((w, al, a), names, strict=False):
            seeds.update(tangents_of(vector, load_vector(x, array, name)))
        for i in range(3):
            for j in range(3):
                seeds[B[i][j]] = x.load(array, f"{names[3]}.{XYZ[i]}{XYZ[j]}")
    slides = any(c.slides for c in kind.closures)
    slip_roots = root_velocities(x, kind) if slides else []
    seeds.update(root_positions(x, ear))
    for t, twist in enumerate(slip_roots):
        role = kind.roots[t]
        if role == "ground" or (role == "frame" and kind.rigid):
            continue
        array, names = ("lanebase", ("cw", "cv")) if role == "frame" else (f"laneroot#{t}", ("rw", "rv"))
        if role == "far":
            array, names = "lregion", (f"far{kind.far[t]}.w", f"far{kind.far[t]}.v")
        for vector, name in zip((twist.angular, twist.linear), names, strict=True):
            seeds.update(tangents_of(vector, load_vector(x, array, name)))
    motions: list[Any] = []
    for k, member in enumerate(ear.members):
        before = motions[member.parent] if member.parent >= 0 else roots[-1 - member.parent]
        motions.append(member_motion(x, member, before, total_udot(x, kind, k, member)))
        if not x.structural:
            x.recall({"sw": motions[-1][0]}, f"me#{k}")
    conditions = closing_accelerations(x, ear, rows, motions, roots, "ca", slip_roots) if rows else []
    d = EarTangents(ear, angles, seeds)
    if slides:
        for t, role in enumerate(kind.roots):
            d.hold([*slip_roots[t].angular, *slip_roots[t].linear])
            if role != "frame":
                d.hold(ear.position(-1 - t))
    for t in range(len(kind.roots)):
        for vector in roots[t][:3]:
            d.hold(vector)
    d.run()
    if rows:
        rates = f.solve([-d.of(v) for v in conditions], "dx", "d Eq. 31", lanes=True)
        added = ear.walk(still(kind), ear.coefficients(rates), "da", "d Eq. 31", lanes=True)
        pairs: list[tuple[Vec, Vec]] = []
        for (_, al, a, B), more in zip(motions, added, strict=True):
            angular = more.angular
            pairs += [(al, angular), (a, more.linear)]
            for i in range(3):
                j, n = (i + 1) % 3, (i + 2) % 3
                pairs.append(([B[n][j], B[j][n]], [angular[i], -angular[i]]))
        # in a plane an entry of B is an angular acceleration itself: it stands further up in the list
        d.correct(pairs)
        for n, (k, freedom) in enumerate(ear.dependents()):
            x.store(f"lane#{k}", f"x.{freedom.index}", rates[n])
    for k, (w, al, a, B) in enumerate(motions):
        constants = link_constants(x, ear, k)
        local = load_symmetric(ear.members[k].view, "c", "J")
        d.inertia(k, ear.members[k].W, constants[2], local)
        if not x.structural:
            x.recall({"sh": constants[1]}, f"me#{k}")
            x.recall_each({f"sJ.{ij}": e for ij, e in zip(PAIRS, six(constants[2]), strict=True)}, f"me#{k}")
        moment, force = body_force(x, w, al, a, B, constants)
        d.run()
        store_vector(x, f"me#{k}", "tsal", al)
        store_vector(x, f"me#{k}", "tsa", a)
        store_matrix(x, f"me#{k}", "tsB", B)
        left = less_external_of(x, ear, k, (moment, force))
        store_vector(x, f"me#{k}", "tsn", left[0])
        store_vector(x, f"me#{k}", "tsf", left[1])
        store_vector(x, f"lme#{k}", "sw", d.vector(w))
        store_vector(x, f"lme#{k}", "sal", d.vector(al))
        store_vector(x, f"lme#{k}", "sa", d.vector(a))
        store_matrix(x, f"lme#{k}", "sB", [d.vector(row) for row in B])
        dn, df = less_external_tangents(x, ear, k, (d.vector(moment), d.vector(force)), angles[k])
        store_vector(x, f"lane#{k}", "n", dn)
        store_vector(x, f"lane#{k}", "f", df)
        if kind.links[k].carries:
            _hand_tangents(x, k, ear, d, angles[k], w, al, a)


def less_external_tangents(x: Any, ear: Ear, k: int, needed: Force, theta: Vec) -> Force:
    """The same of tangents: forces given in a link's axes turn with it."""
    if not ear.kind.links[k].pulled:
        return needed
    W = ear.members[k].W
    found: list[Vec] = []
    for v, name in zip(needed, "nf", strict=True):
        acting = let3(x, "ext", rotate(W, load_vector(x, f"me#{k}", f"ext.{name}")), "Eq. 24", False)
        change = let3(x, "dext", rotate(W, load_vector(x, f"lane#{k}", f"ext.{name}")), "d Eq. 24")
        total = add(change, cross(theta, acting))
        found.append(let3(x, "less", [e - by for e, by in zip(v, total, strict=True)], "d Eq. 24"))
    return found[0], found[1]


def _hand_tangents(x: Any, k: int, ear: Ear, d: EarTangents, theta: Vec, w: Vec, al: Vec, a: Vec) -> None:
    """Motion and tangents of a link in its own axes, for the links that it carries.

    Components change by ``dv - theta x v`` there.
    """
    back = transpose(ear.members[k].W)
    own: list[Vec] = []
    tangents: list[Vec] = []
    for v in (w, al, a):
        own.append(let3(x, "own", matvec(back, v), "Eq. 22", False))
        turned = cross(theta, v)
        relative = let3(x, "rel", [p - q for p, q in zip(d.vector(v), turned, strict=True)], "d Eq. 22")
        tangents.append(let3(x, "own", matvec(back, relative), "d Eq. 22"))
    B = acceleration_matrix(x, own[0], own[1])
    store_vector(x, f"me#{k}", "tal", own[1])
    store_vector(x, f"me#{k}", "ta", own[2])
    store_matrix(x, f"me#{k}", "tB", B)
    for name, v in zip(("w", "al", "a"), tangents, strict=True):
        store_vector(x, f"lme#{k}", name, v)
    store_matrix(x, f"lme#{k}", "B", matrix_tangent(x, own[0], tangents[0], tangents[1]))


def matrix_tangent(x: Any, w: Vec, dw: Vec, dal: Vec) -> Mat:
    """Tangent of ``alpha x + omega x omega x``."""
    B: Mat = [[0] * 3 for _ in range(3)]
    half = [w[i] * dw[i] for i in range(3)]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        B[i][i] = x.let("dB", -2 * (half[j] + half[k]), "d Eq. 21", lanes=True)
        mixed = x.let("dww", w[j] * dw[k] + w[k] * dw[j], "d Eq. 21", lanes=True)
        B[k][j] = x.let("dB", mixed + dal[i], "d Eq. 21", lanes=True)
        B[j][k] = x.let("dB", mixed - dal[i], "d Eq. 21", lanes=True)
    return B


def ear_balance_in(x: Any, kind: Any) -> None:
    """Inward block over directions: forces transmitted by the joints, with the wrenches that close the loops, and their tangents;
    what they miss along the joints, projected on the sources. Eqs. 9, 45, 50."""
    ear = Ear(x, kind)
    f = stored_factor(x, kind)
    rows = [ear.rows()[i] for i in kind.kept]
    count = len(ear.members)
    angles, _ = root_angles(x, kind, False)
    for k in range(count):
        angles[k] = load_vector(x, f"lane#{k}", "th")
    for c in range(len(kind.closures)):
        for side in (0, 1):
            ear.arm(c, side)
        ear.slip(c)
    tangents = EarTangents(ear, angles, root_positions(x, ear))
    if any(c.slides for c in kind.closures):
        for t, role in enumerate(kind.roots):
            if role != "frame":
                tangents.hold(ear.position(-1 - t))
    tangents.run()
    phi: list[Force] = []
    d_phi: list[Force] = []
    for k in range(count):
        own = load_force(x, f"me#{k}", "ts"), load_force(x, f"lane#{k}", "")
        parts = [own]
        if kind.followed[k]:
            parts.append((load_force(x, f"me#{k}", "sacc."), load_force(x, f"lme#{k}", "sacc.")))
        if kind.links[k].carries:
            W, theta = ear.members[k].W, angles[k]
            n, force = (let3(x, "acc", rotate(W, v), "Eq. 45", False) for v in load_force(x, f"me#{k}", "tacc."))
            dn, df = (let3(x, "acc", rotate(W, v), "d Eq. 45") for v in load_force(x, f"lme#{k}", "acc."))
            parts.append(((n, force), (add(dn, cross(theta, n)), add(df, cross(theta, force)))))
        phi.append((add(*(p[0][0] for p in parts)), add(*(p[0][1] for p in parts))))
        d_phi.append((add(*(p[1][0] for p in parts)), add(*(p[1][1] for p in parts))))
    # what the joints would transmit without the loops' wrenches
    held = inward(x, ear, phi)
    dependents = ear.dependents()
    on_roots: list[tuple[int, Force, Force]] = []
    if rows:
        gamma = [along_freedom(x, kind, k, freedom, held[k]) for k, freedom in dependents]
        wrench = f.solve_transposed([-v for v in gamma], "W", "Eq. 9")
        for c in range(len(kind.closures)):
            _apply_wrench(x, ear, c, rows, wrench, phi, d_phi, on_roots, tangents)
        held = inward(x, ear, phi)
    moved = _inward_tangents(x, ear, held, d_phi)
    missing = [_tangent_along(x, kind, k, freedom, held[k], moved[k], angles[k]) for k, freedom in dependents]
    r: dict[int, Any] = {}
    for c, (k, j) in own_sources(kind).items():
        r[c] = _tangent_along(x, kind, k, ear.members[k].freedoms[j], held[k], moved[k], angles[k])
    for n_, value in enumerate(missing):
        for c in range(kind.total):
            r[c] = r.get(c, 0) + x.load("ear", f"Y{n_}.{c}") * value
    for c, value in r.items():
        x.store("lregion_sum", f"r{c}", x.let("r", value, "d Eq. 53", lanes=True))
    for k, member in enumerate(ear.members):
        if member.parent < 0:
            n, force = held[k]
            dn, df = moved[k]
            shifted = add(dn, cross(member.rho, df), cross(load_vector(x, f"lane#{k}", "dr"), force))
            on_roots.append((-1 - member.parent, (add(n, cross(member.rho, force)), force), (shifted, df)))
    for t, role in enumerate(kind.roots):
        parts_here = [(p, dp) for root, p, dp in on_roots if root == t]
        if not parts_here or role == "ground" or (role == "frame" and not kind.carried):
            continue
        total = [let3(x, "to_root", add(*(p[0][i] for p in parts_here)), "Eq. 45", False) for i in (0, 1)]
        change = [let3(x, "to_root", add(*(p[1][i] for p in parts_here)), "d Eq. 45") for i in (0, 1)]
        for name, v, dv in (("n", total[0], change[0]), ("f", total[1], change[1])):
            for i, axis in enumerate(XYZ):
                if role == "frame":
                    x.store("region_sum", f"t.{name}.{axis}", v[i])
                    x.store("lregion_sum", f"b.{name}.{axis}", dv[i])
                elif role == "far":
                    x.store("region_sum", f"far{kind.far[t]}.t.{name}.{axis}", v[i])
                    x.store("lregion_sum", f"far{kind.far[t]}.b.{name}.{axis}", dv[i])
                else:
                    _accumulate_root(x, kind, t, f"root#{t}", f"sacc.{name}.{axis}", v[i], False)
                    _accumulate_root(x, kind, t, f"lroot#{t}", f"sacc.{name}.{axis}", dv[i], True)


def load_force(x: Any, array: str, prefix: str) -> Force:
    return load_vector(x, array, f"{prefix}n"), load_vector(x, array, f"{prefix}f")


def root_positions(x: Any, ear: Ear) -> dict[Any, Any]:
    """Tangents of the roots' positions, where sliding joints ask for them and seeds are complete."""
    kind = ear.kind
    if not any(c.slides for c in kind.closures):
        return {}
    found: dict[Any, Any] = {}
    for t, role in enumerate(kind.roots):
        if role == "far":
            found.update(tangents_of(ear.position(-1 - t), load_vector(x, "lregion", f"far{kind.far[t]}.d")))
        elif role == "link":
            found.update(tangents_of(ear.position(-1 - t), load_vector(x, f"laneroot#{t}", "d")))
        elif role == "ground":
            o = ear.position(-1 - t)
            turned = cross(load_vector(x, "lanebase", "ct"), o)
            moved = [-(a + b) for a, b in zip(load_vector(x, "lanebase", "cd"), turned, strict=True)]
            found.update(tangents_of(o, let3(x, "do", moved, "d Eq. 22")))
    return found


def _accumulate_root(x: Any, kind: Any, t: int, array: str, field: str, value: Any, lanes: bool) -> None:
    if not kind.first_at[t]:
        if is_zero(value):
            return
        value = x.let("acc", x.load(array, field) + value, "Eq. 45", lanes=lanes)
    x.store(array, field, value)


def along_freedom(x: Any, kind: Any, k: int, freedom: Any, force: tuple[Vec, Vec]) -> Any:
    tau = x.load(f"tau#{k}", str(freedom.index)) if kind.links[k].forced[freedom.index] else 0
    return x.let("gamma", dot(freedom.e, force[0] if freedom.angular else force[1]) - tau, "Eq. 53")


def _tangent_along(
    x: Any, kind: Any, k: int, freedom: Any, force: tuple[Vec, Vec], moved: tuple[Vec, Vec], theta: Vec
) -> Any:
    """Tangent of a transmitted force's component along a freedom, less that of the joint force."""
    part = 0 if freedom.angular else 1
    turned = cross(theta, freedom.e)
    tau = x.load(f"dtau#{k}", str(freedom.index)) if kind.links[k].forced[freedom.index] else 0
    value = dot(freedom.e, moved[part]) + dot(turned, force[part]) - tau
    return x.let("dgamma", value, "d Eq. 53", lanes=True)


def inward(x: Any, ear: Ear, own: list[tuple[Vec, Vec]]) -> list[tuple[Vec, Vec]]:
    """Forces transmitted by the joints of the ear's links, about the links' origins."""
    held = list(own)
    for k in reversed(range(len(own))):
        n = let3(x, "phin", held[k][0], "Eq. 45", False)
        force = let3(x, "phif", held[k][1], "Eq. 45", False)
        held[k] = n, force
        parent = ear.members[k].parent
        if parent >= 0:
            held[parent] = add(held[parent][0], n, cross(ear.members[k].rho, force)), add(held[parent][1], force)
    return held


def _inward_tangents(
    x: Any, ear: Ear, held: list[tuple[Vec, Vec]], own: list[tuple[Vec, Vec]]
) -> list[tuple[Vec, Vec]]:
    moved = list(own)
    for k in reversed(range(len(own))):
        n = let3(x, "dphin", moved[k][0], "d Eq. 45")
        force = let3(x, "dphif", moved[k][1], "d Eq. 45")
        moved[k] = n, force
        member = ear.members[k]
        if member.parent >= 0:
            up = moved[member.parent]
            shifted = add(up[0], n, cross(member.rho, force), cross(load_vector(x, f"lane#{k}", "dr"), held[k][1]))
            moved[member.parent] = shifted, add(up[1], force)
    return moved


def _apply_wrench(
    x: Any,
    ear: Ear,
    c: int,
    rows: list[Condition],
    wrench: Vec,
    phi: list[Force],
    d_phi: list[Force],
    on_roots: list[tuple[int, Force, Force]],
    tangents: EarTangents,
) -> None:
    """Let a loop's wrench act on its two faces; it keeps to the directions that the joint holds, which turn with the links."""
    force: Vec = [0, 0, 0]
    moment: Vec = [0, 0, 0]
    d_force: Vec = [0, 0, 0]
    d_moment: Vec = [0, 0, 0]
    for row, value in zip(rows, wrench, strict=True):
        if row.loop != c:
            continue
        part = [product(e, value) for e in row.n]
        change = [t * value for t in tangents.vector(row.n)]
        if row.angular:
            moment, d_moment = add(moment, part), add(d_moment, change)
        else:
            force, d_force = add(force, part), add(d_force, change)
    force, moment = let3(x, "W_f", force, "Eq. 9", False), let3(x, "W_n", moment, "Eq. 9", False)
    d_force, d_moment = let3(x, "dW_f", d_force, "d Eq. 9"), let3(x, "dW_n", d_moment, "d Eq. 9")
    for side, sign in ((0, -1), (1, 1)):
        place = ear.kind.closures[c].faces[side]
        lever = ear.arm(c, side)
        slip = ear.slip(c) if side == 0 else None
        if slip is not None:
            lever = add(lever, slip)
        change = (
            tangents.vector(lever) if slip is None else add(tangents.vector(ear.arm(c, side)), tangents.vector(slip))
        )
        n = add(moment, cross(lever, force))
        dn = add(d_moment, cross(let3(x, "dlever", change, "d Eq. 30"), force), cross(lever, d_force))
        acting: Force = ([sign * e for e in n], [sign * e for e in force])
        change_of: Force = ([sign * e for e in dn], [sign * e for e in d_force])
        if place < 0:
            on_roots.append((-1 - place, acting, change_of))
        else:
            phi[place] = (add(phi[place][0], acting[0]), add(phi[place][1], acting[1]))
            d_phi[place] = (add(d_phi[place][0], change_of[0]), add(d_phi[place][1], change_of[1]))


# -- regions -----------------------------------------------------------------------------------------------------------


def region_balance_start(x: Any, kind: Any) -> None:
    """Nothing is summed yet; tangents of the motion of far links."""
    for c in range(kind.total):
        x.store("lregion", f"r{c}", 0)
    for prefix in transmitted_fields(kind):
        for name in ("n", "f"):
            for axis in XYZ:
                x.store("region", f"{prefix}t.{name}.{axis}", 0)
                x.store("lregion", f"{prefix}b.{name}.{axis}", 0)
    far_motion_tangents(x, kind, matrix_tangent)


def transmitted_fields(kind: Any) -> list[str]:
    """Where a region sums up forces on the links that it hangs on: ``t`` the force, ``b`` its tangent, after these prefixes."""
    return [""] * kind.carried + [f"far{f}." for f, m in enumerate(kind.far) if m >= 0]


def region_balance_in(x: Any, kind: Any) -> None:
    """Inward block over directions: the sources' right sides are eliminated; what is left goes to the links that carry them.

    Eqs. 45, 53.
    """
    at, where = place_of_base(kind), places_of_partners(kind)
    g: list[Any] = [x.load("lregion", f"r{c}") for c in range(kind.total)]
    g += [0] * (system_size(kind) + 6 * len(others(kind)) - len(g))
    for i in range(6 if kind.carried else 0):
        g[at + i] = g[at + i] + x.load("lregion", component("b.", i))
    for j in reversed(range(kind.sources)):
        x.store("lregion", f"rD{j}", x.let("rD", -g[j] * x.load("region", f"Dinv{j}"), "d Eq. 53", lanes=True))
        for i in range(len(g)):
            if i < j or i >= kind.sources:
                g[i] = x.let("g", g[i] - x.load("region", f"G{j}.{i}") * g[j], "d Eq. 45", lanes=True)
    transmitted: dict[int, Vec] = {m: [0] * 6 for m in others(kind)}
    for f, m in enumerate(kind.far):
        s = kind.sources + 6 * f
        W, o = load_matrix(x, "region", f"far{f}.W"), load_vector(x, "region", f"far{f}.o")
        for i, value in enumerate(to_base(x, o, g[s : s + 6], "d Eq. 45", True)):
            g[at + i] = x.let("g", g[at + i] - value, "d Eq. 45", lanes=True)
        if m < 0:
            continue
        theta = load_vector(x, "lregion", f"far{f}.th")
        t, b = (
            [x.load(array, component(f"far{f}.{n}.", i)) for i in range(6)]
            for array, n in (("region", "t"), ("lregion", "b"))
        )
        # components in the far link's axes, which turn
        b = [p - q for p, q in zip(b, [*cross(theta, t[:3]), *cross(theta, t[3:])], strict=True)]
        own = [x.let("g", p + q, "d Eq. 45", lanes=True) for p, q in zip(b, g[s : s + 6], strict=True)]
        for i, value in enumerate(from_far(x, W, own, "d Eq. 45", True)):
            g[where[m] + i] = x.let("g", g[where[m] + i] + value, "d Eq. 45", lanes=True)
        transmitted[m] = from_far(x, W, t, "Eq. 45")
    for m in others(kind):
        hand_force(x, kind, m, g[where[m] : where[m] + 6], lanes=True)
        hand_force(x, kind, m, transmitted[m], "tacc.")
    for i in range(6 if kind.carried else 0):
        name = component("", i)
        accumulate_base(x, kind, f"acc.{name}", g[at + i], "lbase", True)
        accumulate_base(x, kind, f"tacc.{name}", x.load("region", f"t.{name}"))


def region_balance_back(x: Any, kind: Any) -> None:
    """Outward block over directions: tangents of the sources' accelerations."""
    store_sources(x, kind, "lregion", [x.load("lregion", f"rD{j}") for j in range(kind.sources)], True)


def ear_balance_back(x: Any, kind: Any) -> None:
    """Outward block over directions: tangents of the accelerations of the ear's joints. Eq. 55."""
    a = source_accelerations(x, kind, "lregion", "lbase")
    for c, (k, j) in own_sources(kind).items():
        x.store(f"dudot#{k}", str(j), a[c])
    dependents = [(k, j) for k in range(len(kind.links)) for j in kind.dependent[k]]
    for d, (k, j) in enumerate(dependents):
        value = x.load(f"lane#{k}", f"x.{j}")
        for c in range(kind.total):
            value = value + x.load("ear", f"Y{d}.{c}") * a[c]
        x.store(f"dudot#{k}", str(j), x.let("dudot", value, "d Eq. 53", lanes=True))
    if any(link.carries for link in kind.links):
        carried_accelerations(x, kind, a, "lme", "lbase", True)
