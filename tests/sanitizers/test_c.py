"""Every function of every header runs clean under the sanitizers of gcc and clang, and computes what the NumPy module does.

A compiler without its sanitizers is skipped, and the package to install is said.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from ingredients import Mixture, mixtures
from sanitizers.builds import CLANG, CLANG_MEMORY, CLANG_NATIVE, CLANG_PLAIN, EVERY, GCC, GCC_NATIVE, GCC_PLAIN, Build
from sanitizers.examination import Package, examine

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))
SMALL = {"chain", "n_four_bar"}
"""Examples of many links and of many loops; the campaign has all of them."""
WARNED = tuple(Build(c, (level,)) for c in ("gcc", "clang") for level in ("-O2", "-O3"))

SINGULAR = {
    "a body without inertia": (
        """
parameters: {m: 1.0}
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  bob: {parent: cart, joint: {type: revolute, axis: y}, mass: m, com: [0, 0, -0.5]}
""",
        {"p": 0.0},
    ),
    "a distance without derivative": (
        """
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  bob: {parent: cart, joint: {type: prismatic, axis: z}, mass: 1}
initial: {q: {cart: 1.0, bob: 1.0}}
outputs: {apart: {distance: [bob, ground]}}
""",
        {"q": 0.0},
    ),
    "a spring without length": (
        """
parameters: {k: 10.0}
bodies:
  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
  bob: {parent: cart, joint: {type: prismatic, axis: z}, mass: 1}
forces:
  rope: {type: spring, from: bob, to: ground, stiffness: k, damping: 0.1, free_length: 0.5}
initial: {q: {cart: 1.0, bob: 1.0}}
outputs: {stored: potential_energy}
""",
        {"q": 0.0},
    ),
    "a gear without a ratio": (
        """
parameters: {r: -2.0}
bodies:
  shaft: {parent: ground, joint: {type: revolute, axis: z, armature: r**2/10}, mass: 1, inertia: {zz: 1}}
  arm: {parent: ground, joint: {type: revolute, axis: y, at: [0.3, 0, 0]}, mass: 1, com: [0, 0, 0.5], inertia: {yy: 0.2}}
  wheel:
    {parent: arm, joint: {type: revolute, axis: z, at: [0, 0, 1], armature: 0.2}, mass: 1, com: [0.1, 0, 0], inertia: {zz: 0.3}}
couplings:
  gear: {joint: wheel, follows: {shaft: r}, offset: 0.1}
independent: [wheel]
forces:
  mount: {type: bushing, from: shaft, to: {body: wheel, at: [0.1, 0, 0]}, stiffness: [3, 0, 2], rotational_stiffness: [1, 2, 3],
    damping: [0, 0.1, 0], rotational_damping: [0.1, 0, 0]}
outputs: {stored: potential_energy}
""",
        {"p": 0.0},
    ),
    "a flattened four-bar": (
        """
parameters: {l: 1.0}
bodies:
  crank: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, l/2]}
  coupler: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, l]}, mass: 1, com: [0, 0, l/2]}
  rocker: {parent: coupler, joint: {type: revolute, axis: y, at: [0, 0, l]}, mass: 1, com: [0, 0, -l/2]}
loops:
  pin: {joint: {type: revolute, axis: y}, from: {body: rocker, at: [0, 0, l]}, to: {body: ground, at: [1.2, 0, 0]}}
forces:
  rope: {type: spring, from: coupler, to: ground, stiffness: 3, damping: 0.1, free_length: 0.5}
initial: {q: {crank: 0.3, coupler: 1.27, rocker: 1.87}}
independent: [crank]
outputs: {height: {position: rocker, axis: z}}
""",
        {"q": 0.0},
    ),
}


def example(path: Path) -> str:
    """The text of a shipped model, shortened if it has a constant for its length."""
    text = path.read_text()
    for long, short in ((r"\bn: 12\b", "n: 4"), (r"\bL: 3\b", "L: 2")):
        if path.stem in ("chain", "ladder", "hooke_ladder"):
            text = re.sub(long, short, text)
    return text


# what differs with the vectors' width takes turns
TURNS = ((GCC, CLANG_NATIVE), (GCC_NATIVE, CLANG), (GCC, CLANG_PLAIN), (GCC_PLAIN, CLANG))
SANITIZERS = ((GCC, GCC_NATIVE, GCC_PLAIN), (CLANG_NATIVE, CLANG, CLANG_PLAIN), (CLANG_MEMORY,))


def shared_out(found: Sequence[Mixture]) -> list[tuple[Build, ...]]:
    """Builds of each mixture, as few as possible so that every feature is run with every sanitizer."""
    entries = [set(m.choice.items()) for m in found]
    builds: list[list[Build]] = [[] for _ in found]
    for turns in SANITIZERS:
        missing, count = set().union(*entries), 0
        while missing:
            i = max(range(len(found)), key=lambda i: (len(entries[i] & missing), -len(builds[i])))
            builds[i].append(turns[count % len(turns)])
            missing, count = missing - entries[i], count + 1
    return [tuple(b) for b in builds]


def packages() -> dict[str, Package]:
    """What is examined in a few minutes: mixtures in which every two ingredients meet, and two examples."""
    warned = {"tree_6": WARNED[:1], "loop_0": WARNED[1:2]}  # it takes long
    mixed = mixtures()
    found = [
        Package(
            m.name,
            m.text,
            tuple(m.options.items()),
            builds or SANITIZERS[1][i % 3 :][:1],
            warned.get(m.name, ()),
            second=m.name == "loop_7",
        )
        for i, (m, builds) in enumerate(zip(mixed, shared_out(mixed), strict=True))
    ]
    for i, (name, (text, there)) in enumerate(SINGULAR.items()):
        found.append(
            Package(
                name, f"model: singular_{i}{text}", (), ((GCC, CLANG_PLAIN)[i % 2], CLANG_MEMORY), singular=({}, there)
            )
        )
    everything = (("reactions", True), ("frames", True), ("partitions", 2))
    small = [path for path in EXAMPLES if path.stem in SMALL]
    for i, path in enumerate(small):  # the campaign has all in all builds
        found.append(Package(path.stem, example(path), everything, ((GCC_NATIVE, CLANG)[i % 2],)))
    return {p.name: p for p in found}


def campaign() -> dict[str, Package]:
    """More mixtures, one in sixteen of them in all builds with all checks; all examples, with all options."""
    found = []
    for i, m in enumerate(mixtures(every=True)):
        builds, warned = (EVERY, WARNED) if i % 16 == 0 else ((*TURNS[i % 4], CLANG_MEMORY), WARNED[i % 4 : i % 4 + 1])
        found.append(Package(f"every {m.name}", m.text, tuple(m.options.items()), builds, warned, thorough=True))
    for path in EXAMPLES:
        for layout, builds in (("kinds", (GCC_NATIVE, CLANG)), ("unrolled", (GCC, CLANG_NATIVE))):
            options = (("reactions", True), ("frames", True), ("partitions", 2), ("layout", layout))
            found.append(
                Package(
                    f"{path.stem} {layout}", example(path), options, (*builds, CLANG_MEMORY), WARNED[0:2], thorough=True
                )
            )
    return {p.name: p for p in found}


PACKAGES, CAMPAIGN = packages(), campaign()
MIXTURES = mixtures()
FOR_PAIRS = {m.name for m, builds in zip(MIXTURES, shared_out(MIXTURES), strict=True) if not builds}
"""What they have meets every sanitizer in others too; only here two of them meet. Left to the campaign."""


@pytest.mark.parametrize("build", [GCC, CLANG, CLANG_MEMORY], ids=str)
def test_the_sanitizers_are_there(build: Build) -> None:
    """The tests below do without those that are not."""
    if build.missing:
        pytest.skip(build.missing)


def test_whatever_a_model_may_have_meets_every_sanitizer() -> None:
    met = {
        (entry, i) for m in MIXTURES if m.name not in FOR_PAIRS for entry in m.choice.items()
        for i, of in enumerate(SANITIZERS) if not set(of).isdisjoint(PACKAGES[m.name].builds)
    }  # fmt: skip
    assert met == {(entry, i) for m in MIXTURES for entry in m.choice.items() for i in range(len(SANITIZERS))}
    examined = [p for p in PACKAGES.values() if p.name not in FOR_PAIRS]
    assert {b for p in examined for b in p.builds} >= {b for of in SANITIZERS for b in of}
    assert {b for p in examined for b in p.warned} == set(WARNED[:2])
    assert any(p.second for p in examined if dict(p.options).get("partitions") == 2)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.campaign] * (n in FOR_PAIRS)) for n in PACKAGES])
def test_every_function_is_clean(tmp_path: Path, name: str) -> None:
    clean(PACKAGES[name], tmp_path)


@pytest.mark.campaign
@pytest.mark.parametrize("name", CAMPAIGN)
def test_every_function_is_clean_with_all_checks(tmp_path: Path, name: str) -> None:
    clean(CAMPAIGN[name], tmp_path)


def clean(package: Package, folder: Path) -> None:
    """Check that a package has no errors; skips if no compiler of this machine can examine it."""
    if package.missing:
        pytest.skip(package.missing)
    complaints = examine(package, folder / "package")
    assert not complaints, "\n".join(complaints)
