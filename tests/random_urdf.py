"""Random URDF robots in the notations of people and programs: numbers, orders, names, missing elements, fixed links."""

from __future__ import annotations

import html
import math

import numpy as np

TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating")
SHARES = (0.3, 0.2, 0.2, 0.22, 0.08)
SINGLE = TYPES[:3]
SHAPES = ('<box size="0.1 0.2 0.3"/>', '<sphere radius=".1"/>', '<cylinder radius="0.05" length="0.3"/>')
HEADS = ('<?xml version="1.0"?>\n', '<?xml version="1.0" encoding="utf-8"?>\n', "")


class RandomUrdf:
    """A tree of two to eight links; `followers` holds follower, leader, factor and offset after `text`."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.free = self.chance(0.3)
        self.followers: list[tuple[str, str, float, float]] = []
        count = int(self.rng.integers(2, 9))
        self.parents = [-1] + [int(self.rng.integers(max(0, k - 3), k)) for k in range(1, count)]
        self.types = ["root"] + [str(self.rng.choice(TYPES, p=SHARES)) for _ in range(1, count)]
        if all(type_ == "fixed" for type_ in self.types[1:]):
            self.types[-1] = "revolute"

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def number(self, value: float) -> str:
        """A number in the notation of Python, C, CAD programs or people."""
        text = (f"{value:.6g}", f"{value!r}", f"{value:.12e}", f"{value:+.8f}", f"{value:.5E}")[self.rng.integers(5)]
        return text[1:] if text.startswith("0.") and self.chance(0.2) else text

    def numbers(self, *values: float) -> str:
        """Numbers separated by blanks, since urdfdom accepts no tabs and line ends."""
        text = ("  " if self.chance(0.2) else " ").join(self.number(float(value)) for value in values)
        return f" {text} " if self.chance(0.1) else text

    def origin(self) -> str:
        rng, parts = self.rng, []
        if self.chance(0.15):
            return ""
        if self.chance(0.85):
            parts.append(f'xyz="{self.numbers(*rng.normal(0, 0.3, 3))}"')
        if self.chance(0.7):
            rpy, kind = rng.normal(0, 1.2, 3), rng.random()
            if kind < 0.15:
                rpy[1] = math.pi / 2 * rng.choice((-1, 1))
            elif kind < 0.3:
                rpy = rng.normal(0, 20.0, 3)
            elif kind < 0.4:
                rpy = rng.integers(-2, 3, 3) * math.pi / 2
            parts.append(f'rpy="{self.numbers(*rpy)}"')
        rng.shuffle(parts)
        return f"<origin {' '.join(parts)}/>"

    def inertial(self) -> str:
        """Mass and inertia of six equal point masses."""
        rng, mass = self.rng, float(self.rng.uniform(0.1, 5.0))
        points = rng.normal(0, rng.uniform(0.05, 0.5), (6, 3))
        points -= points.mean(axis=0)
        matrix = mass / 6 * sum((point @ point) * np.eye(3) - np.outer(point, point) for point in points)
        entries = [f'i{"xyz"[i]}{"xyz"[k]}="{matrix[i, k]:.10g}"' for i in range(3) for k in range(i, 3)]
        rng.shuffle(entries)
        parts = [self.origin(), f'<mass value="{self.number(mass)}"/>', f"<inertia {' '.join(entries)}/>"]
        rng.shuffle(parts)
        return f"<inertial>{''.join(parts)}</inertial>"

    def shown(self) -> str:
        if self.chance(0.6):
            return ""
        tag = self.rng.choice(("visual", "collision"))
        return f"<{tag}>{self.origin()}<geometry>{SHAPES[self.rng.integers(3)]}</geometry></{tag}>"

    def name(self, stem: str, k: int) -> str:
        spelled = (
            f"{stem}{k}",
            f"{stem}_{k}_joint",
            f"{stem}-{k}",
            f"{stem} {k}",
            f"{stem}.{k}",
            f"{stem}&{k}",
            f"é{stem}{k}",
        )
        return spelled[int(self.rng.choice(7, p=(0.5, 0.2, 0.1, 0.05, 0.05, 0.05, 0.05)))]

    def axis(self) -> str:
        """An axis: absent, along a coordinate axis, or of any direction and length."""
        if self.chance(0.15):
            return ""
        if self.chance(0.5):
            vector = np.eye(3)[self.rng.integers(3)] * self.rng.choice((-1.0, 1.0, 2.0))
        else:
            vector = self.rng.normal(0, 1, 3) * 10.0 ** self.rng.integers(-3, 3)
        return f'<axis xyz="{self.numbers(*vector)}"/>'

    def mimic(self, name: str, leaders: list[str]) -> str:
        factor, offset = self.number(float(self.rng.normal(0, 1.5))), self.number(float(self.rng.normal(0, 0.3)))
        leader = leaders[self.rng.integers(len(leaders))]
        self.followers.append((name, leader, float(factor), float(offset)))
        return f'<mimic joint="{html.escape(leader)}" multiplier="{factor}" offset="{offset}"/>'

    def joint(self, k: int, links: list[str], leaders: dict[bool, list[str]]) -> str:
        name, type_ = self.name("joint", k), self.types[k]
        ends = (f'<{tag} link="{html.escape(links[i])}"/>' for tag, i in (("parent", self.parents[k]), ("child", k)))
        parts = [*ends, self.origin()]
        if type_ != "floating":
            parts.append(self.axis())
        if type_ in ("revolute", "prismatic"):
            parts.append('<limit lower="-1" upper="2" effort="10" velocity="3"/>')
        if type_ in SINGLE:
            if self.chance(0.4):
                parts.append(f'<dynamics damping="{self.number(float(self.rng.uniform(0, 2)))}"/>')
            if self.chance(0.3) and leaders[type_ == "prismatic"]:
                parts.append(self.mimic(name, leaders[type_ == "prismatic"]))
            else:
                leaders[type_ == "prismatic"].append(name)
        self.rng.shuffle(parts)
        return f'<joint type="{type_}" name="{html.escape(name)}">{"".join(parts)}</joint>'

    def has_inertia(self, k: int) -> bool:
        """Whether a link has a mass; only links that fixed joints carry, or that carry others, may have none."""
        if k == 0:
            return self.free or self.chance(0.5)
        return self.types[k] != "fixed" or k not in self.parents or self.chance(0.75)

    def text(self) -> str:
        rng, count = self.rng, len(self.types)
        names = [self.name("link", k) for k in range(count)]
        links = []
        for k, name in enumerate(names):
            body = (self.inertial() if self.has_inertia(k) else "") + self.shown()
            links.append(f'<link name="{html.escape(name)}">{body}</link>')
        leaders: dict[bool, list[str]] = {False: [], True: []}
        elements = links[1:] + [self.joint(k, names, leaders) for k in range(1, count)]
        rng.shuffle(elements)
        elements.insert(0 if self.chance(0.7) else len(elements), links[0])
        if self.chance(0.3):
            elements.insert(rng.integers(len(elements)), '<!-- <link name="none"/> -->')
        if self.chance(0.3):
            elements.append('<gazebo reference="link0"><mu1>0.2</mu1></gazebo>')
        return HEADS[rng.integers(3)] + "\n".join(['<robot name="random">', *elements, "</robot>", ""])
