"""Models with coupled coordinates: chains, branches, differentials, single coordinates of joints, prescribed ones, five-bars."""

from __future__ import annotations

HEAD = """
model: train
gravity: [0.3, 0, -9.81]
parameters: {r: -1.7, s: 0.6, c: 0.3, L: 0.5, m: 1.2}
inputs: [motor]
outputs: {kinetic: kinetic_energy, potential: potential_energy}
bodies:
"""


def body(k: int, parent: str, joint: str) -> str:
    """A body without any symmetry."""
    return (
        f"  b{k}: {{parent: {parent}, joint: {{{joint}, at: [L, 0.1, 0.2]}}, mass: m*1.{k}, com: [0.3*L, 0.1, -0.05], "
        f"inertia: {{xx: 0.2, yy: 0.25, zz: 0.3, xy: 0.01}}}}\n"
    )


def chain(*joints: str) -> str:
    parents = ["ground", *(f"b{k}" for k in range(1, len(joints)))]
    return HEAD + "".join(body(k, p, j) for k, (p, j) in enumerate(zip(parents, joints, strict=True), 1))


def turning(*axes: str) -> list[str]:
    return [f"type: revolute, axis: {axis}" for axis in axes]


STAR = HEAD + "".join(
    body(k, parent, joint)
    for k, parent, joint in (
        (1, "ground", "type: free"), (2, "b1", "type: revolute, axis: x"), (3, "b1", "type: revolute, axis: y"),
        (4, "b2", "type: revolute, axis: z"), (5, "b3", "type: prismatic, axis: [1, 1, 0]"),
    )
)  # fmt: skip
FIVE = """
model: five
gravity: [0, 0, -9.81]
parameters: {l: 0.6, L: 1.0, d: 0.8, r: -1.05, c: 3.1}
inputs: [motor]
outputs: {kinetic: kinetic_energy, potential: potential_energy}
bodies:
  a: {parent: BASE, joint: {type: revolute, axis: -y}, mass: 1, com: [l/2, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  b: {parent: a, joint: {type: revolute, axis: -y, at: [l, 0, 0]}, mass: 1.2, com: [L/2, 0, 0],
      inertia: {xx: 0.1, yy: 0.15, zz: 0.2}}
  e: {parent: BASE, joint: {type: revolute, axis: -y, at: [d, 0, 0]}, mass: 1, com: [l/2, 0, 0],
      inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  f: {parent: e, joint: {type: revolute, axis: -y, at: [l, 0, 0]}, mass: 1.4, com: [L/2, 0, 0],
      inertia: {xx: 0.1, yy: 0.13, zz: 0.2}}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: b, at: [L, 0, 0]}, to: {body: f, at: [L, 0, 0]}}
couplings:
  gear: {joint: e, follows: {a: r}, offset: c}
forces:
  drive: {type: joint, joint: a, value: motor - 0.1*u.a}
initial:
  q: {a: 2.2, b: -1.5, e: 0.9, f: 1.6}
"""
CART = "  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 3, inertia: {xx: 1, yy: 1, zz: 1}}\n"
FIVE_ON_CART = FIVE.replace("BASE", "cart").replace("bodies:\n", f"bodies:\n{CART}")
FIVE_INSIDE = FIVE.replace("BASE", "ground").replace(
    "joint: e, follows: {a: r}, offset: c", "joint: f, follows: {b: r}"
)
MANY = turning("x", "y", "z", "x", "[1, 1, 0]", "y", "z", "x", "y")
BRANCHES = [(k, "b1" if k in (2, 8) else f"b{k - 1}", f"type: revolute, axis: {'xyz'[k % 3]}") for k in range(2, 14)]
MODELS = {
    "neighbours": chain(*turning("x", "[1, 2, 0.5]", "z")) + "couplings:\n  g: {joint: b2, follows: {b1: r}, offset: c}\n",
    "over two": chain(*turning("x", "y", "z", "[1, 1, 0]", "x"))
    + "couplings:\n  g: {joint: b4, follows: {b2: r}, offset: c}\n",
    "inward": chain(*turning("x", "y", "z", "[1, 1, 0]", "x")) + "couplings:\n  g: {joint: b2, follows: {b4: r}}\n",
    "racks": chain("type: revolute, axis: x", "type: prismatic, axis: y", "type: revolute, axis: z", "type: prismatic, axis: x")
    + "couplings:\n  g: {joint: b2, follows: {b1: s*L}}\n  h: {joint: b4, follows: {b3: s}, offset: c*L}\n",
    "branches": STAR + "couplings:\n  g: {joint: b4, follows: {b5: r}, offset: c}\n",
    "differential": STAR + "couplings:\n  g: {joint: b2, follows: {b3: r, b4: s}, offset: c}\n",
    "sharing": STAR + "couplings:\n  g: {joint: b2, follows: b3}\n  h: {joint: b4, follows: {b3: s, b5: 1/2}, offset: c}\n",
    "far": chain(*MANY) + "couplings:\n  g: {joint: b9, follows: {b1: r}, offset: c}\n  h: {joint: b5, follows: {b3: s}}\n",
    "parts of joints": HEAD + body(1, "ground", "type: universal, axes: [x, y]") + body(2, "b1", "type: cylindrical, axis: z")
    + body(3, "b2", "type: planar, normal: y")
    + "couplings:\n  g: {joint: b2.2, follows: {b2.1: s, b1.2: 0.3}}\n  h: {joint: b3.1, follows: {b3.3: s}}\n",
    "followed motion": STAR + "couplings:\n  g: {joint: b2, follows: {b3: r, b4: s}, offset: c}\n"
    "motion:\n  b3: 0.3*sin(2*t)*L\n",
    "between": chain(*turning("x", "y", "z", "[1, 1, 0]", "x")) + "couplings:\n  g: {joint: b4, follows: {b2: r}}\n"
    "motion:\n  b3: 0.2*t**2*L\n",
    "geared five-bar": FIVE.replace("BASE", "ground"),
    "geared five-bar on a cart": FIVE_ON_CART,
    "inside a loop": FIVE_INSIDE,
    "tips of long branches": HEAD + body(1, "ground", "type: free") + "".join(body(*of) for of in BRANCHES)
    + "couplings:\n  g: {joint: b7, follows: {b13: r}, offset: c}\n",
    "inside a loop, with a hint": FIVE_INSIDE + "independent: [a]\n",
}  # fmt: skip
