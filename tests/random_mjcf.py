"""Random MJCF files: bodies in trees with every joint type, tendons, actuators, classes and copies."""

from __future__ import annotations

import random


class RandomMjcf:
    """A random robot in MJCF.

    Parameters
    ----------
    seed : int
    """

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.count = 0
        self.joints: list[str] = []
        self.sites: list[str] = []

    def text(self) -> str:
        """The text of the file."""
        rng = self.rng
        bodies = "".join(self.body(2, is_root=True) for _ in range(rng.randint(1, 2)))
        flags = [f for f in ("spring", "damper", "gravity", "actuation") if rng.random() < 0.08]
        flag = "<flag contact='disable' " + " ".join(f"{f}='disable'" for f in flags) + "/>"
        stiff = '<default class="stiff"><joint stiffness="3" springref="0.2"/></default>'
        classes = f'<default><joint damping="0.1"/>{stiff}</default>'
        angle = rng.choice(("radian", "degree"))
        ends = "".join((self.tendons(), self.actuators()))
        option = f'<option gravity="{self.numbers(3, 10)}">{flag}</option>'
        world = f'<worldbody>{bodies}<site name="w" pos="1 0 2"/></worldbody>'
        return f'<mujoco><compiler angle="{angle}"/>{option}{classes}{world}{ends}</mujoco>'

    def numbers(self, count: int, size: float = 1.0) -> str:
        return " ".join(f"{self.rng.uniform(-size, size):.3f}" for _ in range(count))

    def turn(self) -> str:
        kind = self.rng.choice(("euler", "quat", "axisangle", "zaxis", ""))
        return f' {kind}="{self.numbers({"euler": 3, "zaxis": 3}.get(kind, 4))}"' if kind else ""

    def maybe(self, name: str, low: float, high: float, part: float = 0.4) -> str:
        return f' {name}="{self.rng.uniform(low, high):.3f}"' if self.rng.random() < part else ""

    def joint(self, may_be_ball: bool) -> str:
        rng = self.rng
        self.count += 1
        kind = rng.choice(("hinge", "hinge", "slide", "ball") if may_be_ball else ("hinge", "slide"))
        name = f"j{self.count}"
        more = self.maybe("armature", 0, 0.5, 0.3) + self.maybe("damping", 0, 1)
        if kind != "ball":
            self.joints.append(name)
            more += self.maybe("ref", -0.5, 0.5) + self.maybe("springref", -0.5, 0.5)
            more += rng.choice(("", ' class="stiff"', ' stiffness="2"', ' stiffness="2 0.5 0.1"'))
            more += f' axis="{self.numbers(3)}"'
        return f'<joint name="{name}" type="{kind}" pos="{self.numbers(3, 0.3)}"{more}/>'

    def body(self, depth: int, is_root: bool = False) -> str:
        rng = self.rng
        self.count += 1
        name, site = f"b{self.count}", f"s{self.count}"
        self.sites.append(site)
        if is_root and rng.random() < 0.3:
            joints = "<freejoint/>"
        else:
            count = 1 if is_root else rng.choice((0, 1, 1, 1, 2, 3))
            joints = "".join(self.joint(may_be_ball=count == 1) for _ in range(count))
        inside = f'<site name="{site}" pos="{self.numbers(3, 0.3)}"/>{self.mass()}'
        inside += "".join(self.body(depth - 1) for _ in range(rng.randint(0, 2) if depth else 0))
        if rng.random() < 0.2:
            inside = f'<frame pos="{self.numbers(3, 0.3)}"{self.turn()}>{inside}</frame>'
        if rng.random() < 0.15 and depth:
            twin = '<body><joint axis="0 1 0"/><geom type="box" size=".1 .05 .02" pos=".1 0 0"/></body>'
            inside += f'<replicate count="2" offset="0 .3 0" euler="0 0 1">{twin}</replicate>'
        lifted = self.maybe("gravcomp", 0, 1, 0.2)
        return f'<body name="{name}" pos="{self.numbers(3, 0.5)}"{self.turn()}{lifted}>{joints}{inside}</body>'

    def mass(self) -> str:
        rng = self.rng
        if rng.random() < 0.3:
            moments = " ".join(f"{rng.uniform(0.05, 0.08):.4f}" for _ in range(3))
            mass = f'mass="{rng.uniform(0.5, 2):.3f}" diaginertia="{moments}"'
            return f'<inertial pos="{self.numbers(3, 0.2)}" {mass}{self.turn()}/>'
        size = {"box": ".1 .2 .3", "sphere": ".1", "capsule": ".05 .2", "cylinder": ".05 .2", "ellipsoid": ".1 .2 .3"}
        kind = rng.choice(list(size))
        return f'<geom type="{kind}" size="{size[kind]}" pos="{self.numbers(3, 0.2)}"{self.turn()}/>'

    def tendons(self) -> str:
        rng, parts = self.rng, []
        for k in range(rng.randint(0, 2)):
            act = self.maybe("stiffness", 1, 5, 0.7) + self.maybe("damping", 0, 1)
            act += rng.choice(("", ' springlength="0.4"', ' springlength="0.1 0.6"'))
            if self.joints and rng.random() < 0.5:
                chosen = rng.sample(self.joints, min(len(self.joints), rng.randint(1, 3)))
                inner = "".join(f'<joint joint="{j}" coef="{rng.uniform(-2, 2):.2f}"/>' for j in chosen)
                parts.append(f'<fixed name="t{k}"{act}>{inner}</fixed>')
            else:
                path = rng.sample([*self.sites, "w"], min(len(self.sites) + 1, rng.randint(2, 4)))
                inner = "".join(f'<site site="{s}"/>' for s in path)
                parts.append(f'<spatial name="t{k}"{act}>{inner}</spatial>')
        return f"<tendon>{''.join(parts)}</tendon>"

    def actuators(self) -> str:
        rng, parts = self.rng, []
        for _ in range(rng.randint(0, 3) if self.joints else 0):
            joint, gear = rng.choice(self.joints), f' gear="{rng.uniform(-3, 3):.2f}"'
            kind = rng.choice((
                'motor armature="0.02" damping="0.3"', 'position kp="4"', 'position kp="4" kv="0.5" forcerange="-1 1"',
                'velocity kv="2"', 'damper kv="2" ctrlrange="0.5 1"',
                'general biastype="affine" biasprm="1 -2 -0.3" ctrlrange="0.2 1"',
            ))  # fmt: skip
            parts.append(f'<{kind} joint="{joint}"{gear}/>')
        return f"<actuator>{''.join(parts)}</actuator>"
