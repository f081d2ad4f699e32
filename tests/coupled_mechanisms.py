"""Mechanisms whose loops close between long branches: ears that start from two or more moving links, couplings (4.6).

Chains of rods of length 0.4 l with general inertias and a mass centre off the plane. ``n`` is the number of rods of a chain.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from loop_closure import assemble, independent_coordinates
from random_mechanisms import Mechanism

from codegen.loops import complete_speeds, partition
from codegen.model import Model, parse_model

PIN = "{type: revolute, axis: y}"
BALL = "{type: spherical}"
TIP = "[0, 0, 0.4*l]"
GROUND = "ground"


class Rods:
    """The text of a model of rods, as it is built."""

    def __init__(self, name: str, spatial: bool = False, base: str = "") -> None:
        self.spatial = spatial
        self.bodies: list[str] = []
        self.loops: list[str] = []
        self.q: dict[str, float] = {}
        self.dependent: list[str] = []
        self.more = ""
        self.head = f"model: {name}\ngravity: [0.3, 0.2, -9.81]\nparameters: {{k: 1.1, l: 1.0, s: 0.05}}\n"
        self.root = GROUND
        if base:
            self.bodies.append(
                f"  base: {{parent: ground, joint: {{type: {base}, at: [0.1, 0, s], rpy: [0.4*k, 0, 0]}}, mass: 3*k,"
                " com: [0.1, -0.05, l/5], inertia: {xx: 0.7, yy: 0.8*k, zz: 0.9, xz: 0.05}}\n"
            )
            self.root = "base"

    def rod(self, name: str, parent: str, angle: float, at: str = TIP, axis: str = "y") -> str:
        self.bodies.append(
            f"  {name}: {{parent: {parent}, joint: {{type: revolute, axis: {axis}, at: {at}}}, mass: 1.2*k,"
            " com: [0.03, 0.05, 0.2*l], inertia: {xx: 0.1, yy: 0.2*k, zz: 0.15, xy: 0.01}}\n"
        )
        self.q[name] = angle
        return name

    def chain(self, letter: str, parent: str, n: int, angle: float, at: str = "[0, 0, 0]", first: int = 1) -> list[str]:
        names: list[str] = []
        for i in range(first, first + n):
            at = at if not names else "[0.05, s/2, 0.4*l]" if self.spatial else TIP
            axis = "zxy"[i % 3] if self.spatial else "y"
            names.append(
                self.rod(f"{letter}{i}", names[-1] if names else parent, angle * (1 + 0.03 * (i % 6)), at, axis)
            )
        return names

    def loop(self, name: str, start: str, end: str, at: str = TIP, to: str = TIP, joint: str = "") -> None:
        joint = joint or (BALL if self.spatial else PIN)
        self.loops.append(
            f"  {name}: {{joint: {joint}, from: {{body: {start}, at: {at}}}, to: {{body: {end}, at: {to}}}}}\n"
        )

    def text(self, hinted: bool = False) -> str:
        """The text of the model file; if hinted, all rods are independent except the dependent ones."""
        more = self.more
        if hinted:
            more += f"independent: [{', '.join(n for n in self.q if n not in self.dependent)}]\n"
        q = ", ".join(f"{n}: {x:.4f}" for n, x in self.q.items())
        return f"{self.head}bodies:\n{''.join(self.bodies)}loops:\n{''.join(self.loops)}{more}initial: {{q: {{{q}}}}}\n"

    def model(self, hinted: bool = False) -> Model:
        return parse_model(self.text(hinted))


def tip_on_own_link(n: int = 12, k: int = 3, spatial: bool = False, base: str = "", joint: str = "") -> Rods:
    """A chain whose tip is held by its k-th link."""
    rods = Rods("tip_on_own_link", spatial, base)
    names = rods.chain("c", rods.root, n, 0.5)
    rods.loop("tip", names[-1], names[k - 1], to="[0.3, 0, 0.1*l]", joint=joint)
    rods.dependent = names[-2:]
    return rods


def tips_joined(n: int = 6, spatial: bool = False, base: str = "", joint: str = "") -> Rods:
    """Two chains on one base with joined tips; the base is the ground, or a moving body with six or no degrees of freedom."""
    rods = Rods("tips_joined", spatial, base)
    a = rods.chain("a", rods.root, n, 0.15)
    b = rods.chain("b", rods.root, n, -0.15, at="[1.5, 0.1, 0]" if spatial else "[1.5, 0, 0]")
    rods.loop("tip", a[-1], b[-1], joint=joint)
    rods.dependent = [a[-1], b[-1]]
    return rods


def four_bar(name: str) -> Rods:
    """The beginning of a model: crank, coupler and rocker between two fixed pivots."""
    rods = Rods(name)
    rods.rod("crank", GROUND, 0.4, "[0, 0, 0]")
    rods.rod("coupler", "crank", 0.9, "[0, 0, l]")
    rods.rod("rocker", "coupler", 1.0, "[0, 0, l]")
    rods.loop("four_bar", "rocker", GROUND, at="[0, 0, l]", to="[1.2, 0, 0]")
    return rods


def chain_on_four_bar(n: int = 7) -> Rods:
    """A four-bar with a chain from its coupler to the ground: an ear that starts from a link of another ear."""
    rods = four_bar("chain_on_four_bar")
    names = rods.chain("c", "coupler", n, 0.35, at="[0.2, 0, 0.5*l]")
    rods.loop("tip", names[-1], GROUND, to="[1.5, 0, 1.3]")
    return rods


def chains_on_four_bar(n: int = 5) -> Rods:
    """A four-bar with two chains on its coupler whose tips are joined: couplings of a region that end at a link of another."""
    rods = four_bar("chains_on_four_bar")
    a = rods.chain("a", "coupler", n, 0.15, at="[0.1, 0, 0.2*l]")
    b = rods.chain("b", "coupler", n, -0.15, at="[0.2, 0, 0.9*l]")
    rods.loop("tips", a[-1], b[-1])
    return rods


def chain_on_slide(n: int = 8, axis: str = "[-1, 0, 0]") -> Rods:
    """A slide, a chain on it that is guided along a line on the ground, and a second chain from that chain to the ground."""
    rods = Rods("chain_on_slide", spatial=True)
    rods.bodies.append(
        f"  slide: {{parent: ground, joint: {{type: prismatic, axis: {axis}, at: [0.2*s, s, 2*s]}}, mass: 1.5*k,"
        " com: [0.1, 0, s], inertia: {xx: 0.3, yy: 0.2*k, zz: 0.4}}\n"
    )
    rods.q["slide"] = 0.1
    guided = rods.chain("g", "slide", 4, 0.5, at="[s, 0, 0.1*l]")
    names = rods.chain("c", guided[-1], n, 0.15, at=TIP)
    rods.loop("guide", guided[-1], GROUND, to="[0.2, s, 0.6*l]", joint="{type: cylindrical, axis: [1, 0.2, 0.3]}")
    rods.loop("tip", names[-1], GROUND, to="[0.6, s, 0.7]")
    return rods


def ring_with_sub_loop(n: int = 9, k: int = 3) -> Rods:
    """A long loop that contains the links of a short one."""
    rods = Rods("ring_with_sub_loop")
    names = rods.chain("c", GROUND, n, 0.55)
    rods.rod("d", names[k - 1], 0.6, at="[0.2, 0, 0]")
    rods.loop("sub", "d", names[k + 1], to="[0.2, 0, 0]")
    rods.loop("tip", names[-1], GROUND, to="[0.3, 0, 0.1]")
    return rods


def rails(rungs: int = 3) -> Rods:
    """Two rails with a rung after every third rod: loops with degrees of freedom, each starting from two links of the one
    before."""
    rods = Rods("rails")
    a, b = GROUND, GROUND
    at_a, at_b = "[0, 0, 0]", "[0.9, 0, 0]"
    turned = 0.0
    for i in range(rungs):
        angle = (-1) ** i * 0.25
        for letter, parent, at in (("a", a, at_a), ("b", b, at_b)):
            rods.chain(letter, parent, 3, angle, at=at, first=3 * i + 1)
        a, b, at_a, at_b = f"a{3 * i + 3}", f"b{3 * i + 3}", TIP, TIP
        turned += sum(rods.q[f"a{3 * i + k}"] for k in (1, 2, 3))
        rods.rod(f"rung{i}", a, np.pi / 2 - turned, at=TIP)
        rods.loop(f"loop{i}", f"rung{i}", b, at="[0, 0, 0.9*l]")
        rods.dependent += [f"b{3 * i + 1}", f"rung{i}"]  # b3 instead would pass on an error threefold, rung by rung
    return rods


def platform(n: int = 5, third: str = "leg") -> Rods:
    """Three chains that carry a plate, the first taking up the loops: one cluster that starts from three links.

    ``third="ground"``: the third point of the plate is held by a pin on the ground: two links and the ground.
    """
    rods = Rods("plate_on_legs")
    legs = [
        rods.chain(c, GROUND, n, angle, at=f"[{x}, 0, 0]")
        for c, angle, x in (("a", 0.2, 0.0), ("b", -0.15, 1.2), ("c", -0.1, 0.6))
    ]
    rods.rod("plate", legs[0][-1], 1.2)
    rods.loop("second", "plate", legs[1][-1], at="[0.1, 0, 0.8*l]")
    if third == "ground":
        legs.pop()
        rods.bodies = [b for b in rods.bodies if not b.startswith("  c")]
        rods.q = {n: x for n, x in rods.q.items() if not n.startswith("c")}
        rods.loop("third", "plate", GROUND, at="[0.2, 0, 0.4*l]", to="[0.5, 0, 1.4]")
    else:
        rods.loop("third", "plate", legs[2][-1], at="[0.2, 0, 0.4*l]")
    rods.dependent = ["plate", *legs[0][-2:], legs[-1][-1]]
    return rods


def sprung(rods: Rods) -> Rods:
    """The mechanism with a spring from the middle of the first chain to the last rod."""
    names = list(rods.q)
    rods.more += (
        f"forces:\n  band: {{type: spring, from: {{body: {names[len(names) // 2]}, at: [0, s, 0.1]}}, "
        f"to: {{body: {names[-1]}, at: [0.1, 0, 0.1*l]}}, stiffness: 40*k, damping: 0.7, free_length: 0.2*l}}\n"
    )
    return rods


BY_HAND = {
    "tip_on_own_link": lambda: tip_on_own_link(),
    "tip_on_own_link_spatial": lambda: tip_on_own_link(12, 3, spatial=True),
    "tip_on_own_link_of_free_chain": lambda: tip_on_own_link(11, 2, base="free"),
    "tip_slides_on_own_link": lambda: tip_on_own_link(12, 3, spatial=True, joint="{type: planar, normal: [1, 0.2, 0]}"),
    "tips_joined": lambda: tips_joined(),
    "tips_joined_spatial": lambda: tips_joined(8, spatial=True),
    "tips_joined_on_free_base": lambda: tips_joined(5, base="free"),
    "tips_slide": lambda: tips_joined(8, spatial=True, joint="{type: cylindrical, axis: [0.2, 1, 0.1]}"),
    "chain_on_four_bar": lambda: chain_on_four_bar(),
    "chains_on_four_bar": lambda: chains_on_four_bar(),
    "chain_on_slide": lambda: chain_on_slide(),
    "chain_on_forward_slide": lambda: chain_on_slide(axis="[1, 0, 0]"),
    "ring_with_sub_loop": lambda: ring_with_sub_loop(),
    "rails": lambda: rails(),
    "platform": lambda: platform(),
    "platform_on_ground": lambda: platform(7, third="ground"),
    "platform_on_short_legs": lambda: platform(third="ground"),
    "sprung_tips": lambda: sprung(tips_joined()),
}

HINTED = ("rails", "platform", "platform_on_ground", "platform_on_short_legs")


@cache
def by_hand(name: str) -> Mechanism:
    """One of the mechanisms above, assembled at coordinates other than its initial ones."""
    return assembled(BY_HAND[name]().model(hinted=name in HINTED))


def assembled(model: Model) -> Mechanism:
    chosen = partition(model)
    rng = np.random.default_rng(5)
    q = np.array(chosen.q)
    for i in independent_coordinates(model, chosen):
        q[i] += 0.01 * rng.normal()
    p = np.array([x.value for x in model.parameters])
    q = np.array(assemble(model, chosen, q, p))
    u = complete_speeds(model, chosen, q, rng.uniform(-1, 1, model.nu), p)
    return Mechanism(model, q, u, p, np.zeros(0), 0.0)
