"""Random SDF files: nested models, frames, poses in every notation, includes."""

from __future__ import annotations

import math
import random
from pathlib import Path

JOINTS = ("revolute", "continuous", "prismatic", "screw", "fixed")


class RandomSdf:
    """A random robot of SDF, a tree, in the folder in which its files are written.

    Parameters
    ----------
    seed : int
    folder : path
    """

    def __init__(self, seed: int, folder: Path) -> None:
        self.rng = random.Random(seed)
        self.folder = folder
        self.version = self.rng.choice(("1.7", "1.8", "1.9", "1.10", "1.11", "1.12"))
        self.files = 0
        self.names = 0

    def write(self) -> Path:
        """Write the file, and the files that it includes."""
        rng = self.rng
        body, _ = self.model("robot", depth=2)
        if rng.random() < 0.6:
            frame = f'<frame name="stand">{self.pose(["world"])}</frame>'
            where = self.pose(["stand", "world"])
            joint = ""
            if rng.random() < 0.3:
                ends = f"<parent>{rng.choice(('world', 'stand'))}</parent><child>robot</child>"
                joint = f'<joint name="hold" type="fixed">{ends}</joint>'
            text = (
                f"<world name='w'><gravity>0 0 -9.81</gravity>{frame}{self.opened('robot', body, where)}{joint}</world>"
            )
        else:
            text = self.opened("robot", body, self.pose([]))
        path = self.folder / "robot.sdf"
        path.write_text(
            f'<?xml version="1.0"?>\n<sdf version="{self.version}" xmlns:drake="drake.mit.edu">\n{text}\n</sdf>\n'
        )
        return path

    def opened(self, name: str, body: tuple[str, str], pose: str) -> str:
        """A model with its pose, in the file."""
        attributes, inner = body
        return f'<model name="{name}"{attributes}>{pose}{inner}</model>'

    # ---- numbers ---------------------------------------------------------------------------------------------------

    def three(self, size: float = 1.0) -> str:
        return " ".join(f"{self.rng.uniform(-size, size):.3f}" for _ in range(3))

    def pose(self, relative: list[str]) -> str:
        """A <pose>, relative to one of some frames or without a frame."""
        rng, attributes = self.rng, ""
        if relative and rng.random() < 0.6:
            attributes = f' relative_to="{rng.choice(relative)}"'
        kind, at = rng.random(), self.three(0.5)
        if kind < 0.2 and self.version not in ("1.7", "1.8"):
            e = [rng.gauss(0, 1) for _ in range(4)]
            size = math.sqrt(sum(v * v for v in e))
            return f'<pose{attributes} rotation_format="quat_xyzw">{at} {" ".join(repr(v / size) for v in e)}</pose>'
        if kind < 0.4 and self.version not in ("1.7", "1.8"):
            return f'<pose{attributes} degrees="true">{at} {self.three(180)}</pose>'
        return f"<pose{attributes}>{at} {self.three(3)}</pose>"

    def inertial(self) -> str:
        rng = self.rng
        a, b, c = (rng.uniform(0.01, 0.1) for _ in range(3))
        moments = f"<ixx>{b + c:.4f}</ixx><iyy>{a + c:.4f}</iyy><izz>{a + b:.4f}</izz>"
        if rng.random() < 0.15 and self.version in ("1.11", "1.12"):
            shape = rng.choice((
                "<box><size>.1 .2 .4</size></box>", "<sphere><radius>.2</radius></sphere>",
                "<cylinder><radius>.1</radius><length>.4</length></cylinder>",
                "<capsule><radius>.1</radius><length>.4</length></capsule>", "<ellipsoid><radii>.1 .2 .3</radii></ellipsoid>",
            ))  # fmt: skip
            density = f"<density>{rng.uniform(100, 2000):.1f}</density>"
            return f'<inertial auto="true"/><collision name="c">{self.pose([])}{density}<geometry>{shape}</geometry></collision>'
        return f"<inertial>{self.pose([])}<mass>{rng.uniform(0.5, 2):.3f}</mass><inertia>{moments}</inertia></inertial>"

    # ---- models ----------------------------------------------------------------------------------------------------

    def model(self, name: str, depth: int) -> tuple[tuple[str, str], list[str]]:
        """The attributes and contents of a model, and its links with their names in the model."""
        rng = self.rng
        frames, links, parts = ["__model__"], [], []
        for _ in range(rng.randint(2, 3)):
            k = self.names = self.names + 1  # every name is there once, so that files can be merged
            link = f"l{k}"
            parts.append(f'<link name="{link}">{self.pose(frames)}{self.inertial()}</link>')
            if links:
                parts.append(self.joint(f"j{k}", rng.choice(self.part_of(links, frames)), link, frames))
            links.append(link)
            frames.append(link)
            if rng.random() < 0.5:
                frame = f"f{k}"
                parts.append(f'<frame name="{frame}" attached_to="{rng.choice(links)}">{self.pose(frames)}</frame>')
                frames.append(frame)
            if depth and rng.random() < 0.5:
                inner, merged = f"m{k}", rng.random() < 0.3 and self.version not in ("1.7", "1.8", "1.9")
                part, root, added, seen = self.nested(inner, depth, frames, merged)
                parts += [part, self.joint(f"n{k}", rng.choice(links), root, frames)]
                links += added
                frames += seen
        attributes = (
            f' placement_frame="{rng.choice(frames[1:])}"' if rng.random() < 0.3 and self.version != "1.7" else ""
        )
        attributes += f' canonical_link="{rng.choice(links)}"' if rng.random() < 0.2 and self.version != "1.7" else ""
        return (attributes, "\n".join(parts)), links

    def part_of(self, links: list[str], frames: list[str]) -> list[str]:
        """Possible parents of a joint: links, and frames that are attached to them."""
        return [*links, *(f for f in frames if f.rpartition("::")[2].startswith("f"))]

    def nested(self, name: str, depth: int, frames: list[str], merged: bool) -> tuple[str, str, list[str], list[str]]:
        """A model in another one, or a file that it includes; its root, and the names of its links and frames there."""
        rng = self.rng
        body, links = self.model(name, depth - 1)
        if not merged and rng.random() < 0.5:
            text = self.opened(name, body, self.pose(frames))
            return (
                text,
                f"{name}::{links[0]}",
                [f"{name}::{v}" for v in links],
                [name, *(f"{name}::{v}" for v in links)],
            )
        self.files += 1
        file = f"part{self.files}.sdf"
        whole = self.opened(f"other{self.files}", body, self.pose([]))
        (self.folder / "parts").mkdir(exist_ok=True)
        (self.folder / "parts" / file).write_text(
            f'<sdf version="{self.version}" xmlns:drake="drake.mit.edu">{whole}</sdf>'
        )
        said = self.pose(frames) if rng.random() < 0.7 else ""
        if merged:
            text = f'<include merge="true"><uri>package://parts/{file}</uri>{said}</include>'
            return text, links[0], links, links
        text = f"<include><uri>package://parts/{file}</uri><name>{name}</name>{said}</include>"
        return text, f"{name}::{links[0]}", [f"{name}::{v}" for v in links], [name, *(f"{name}::{v}" for v in links)]

    def joint(self, name: str, parent: str, child: str, frames: list[str]) -> str:
        rng = self.rng
        kind = rng.choice(JOINTS)
        pose = self.pose([*frames, parent]) if rng.random() < 0.6 else ""
        axis = ""
        if kind != "fixed":
            expressed = f' expressed_in="{rng.choice([*frames, child])}"' if rng.random() < 0.5 else ""
            spring = "<spring_stiffness>2.5</spring_stiffness><spring_reference>0.3</spring_reference>"
            spring = spring if rng.random() < 0.3 and kind in ("revolute", "continuous", "prismatic") else ""
            damping = (
                f"<dynamics><damping>{rng.uniform(0, 1):.2f}</damping>{spring}</dynamics>" if rng.random() < 0.5 else ""
            )
            axis = f"<axis><xyz{expressed}>{self.three()}</xyz>{damping}</axis>"
        pitch = "<screw_thread_pitch>0.2</screw_thread_pitch>" if kind == "screw" else ""
        rotor = "<drake:rotor_inertia>0.002</drake:rotor_inertia><drake:gear_ratio>7</drake:gear_ratio>"
        pitch += rotor if rng.random() < 0.3 and kind in ("revolute", "prismatic") else ""
        ends = f"<parent>{parent}</parent><child>{child}</child>"
        return f'<joint name="{name}" type="{kind}">{ends}{pose}{axis}{pitch}</joint>'
