"""Fields that are 1 in every state become constants in the code, which kinds share, unless another member stores other values.

Masses of 1, centres of mass at joints and axes along coordinates make such fields; equal links under different loops share kinds.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import error, worst

import codegen
from codegen.loops import PartitionError
from codegen.model import ModelError, parse_model
from codegen.reference import DenseEngine
from codegen.runtime import AssemblyError, SingularLoopError

INERTIA = "inertia: {xx: 0.1, yy: 0.2, zz: 0.15}"


def body(name: str, parent: str, joint: str, mass: float, com: str) -> str:
    return f"  {name}: {{parent: {parent}, joint: {{{joint}}}, mass: {mass}, com: {com}, {INERTIA}}}\n"


def model(bodies: str, loops: str = "", rest: str = "", gravity: str = "[0.3, 0.2, -9.81]") -> str:
    return f"model: m\ngravity: {gravity}\nparameters: {{L: 1.0}}\nbodies:\n{bodies}{'loops:' * bool(loops)}\n{loops}{rest}"


def four_bar_of_unit_masses(base: str) -> str:
    """A four-bar with unit masses: the region's sums get a 1 from each of three bars."""
    bodies = body("base", "ground", f"type: {base}", 3, "[0.1, 0.2, 0.1]")
    bodies += body("a", "base", "type: revolute, axis: z", 1, "[0.2, 0, 0]")
    bodies += body("b", "a", "type: revolute, axis: z, at: [0.4, 0, 0]", 1, "[0.6, 0, 0]")
    bodies += body("c", "base", "type: revolute, axis: z, at: [1.1, 0, 0]", 1, "[0.45, 0, 0]")
    loops = (
        "  l: {joint: {type: revolute, axis: z}, from: {body: b, at: [1.2*L, 0, 0]}, to: {body: c, at: [0.9, 0, 0]}}\n"
    )
    return model(bodies, loops, "initial: {q: {a: 0.8, b: -0.4, c: 1.5}}\n")


def wheel_and_slider() -> str:
    """Two equal links, one with a wheel that hands on a mass of 1, the other with a slider, which does not."""
    bodies = ""
    for k, joint, at in (("1", "revolute", "0.4"), ("2", "prismatic", "0.4")):
        bodies += body(f"g{k}", "ground", "type: prismatic, axis: z", 2, "[0.2, 0, 0.1]")
        bodies += body(f"p{k}", f"g{k}", "type: revolute, axis: y", 2, "[0.2, 0, 0.1]")
        bodies += body(f"w{k}", f"p{k}", f"type: {joint}, axis: z, at: [{at}, 0, 0]", 1, "[0, 0, 0]")
    return model(bodies, rest="initial: {q: {p1: 0.5, p2: 0.7, w2: 0.2}}\n")


def equal_links_under_different_loops(sliding: str, more: bool) -> str:
    """A hinge and a guide close equal links that slide along `sliding`; with `more`, the second moves what the first does not."""
    bodies = ""
    for k, axis in (("1", "x"), ("2", sliding)):
        bodies += body(f"s{k}", "ground", f"type: prismatic, axis: {axis}", 2, "[0.2, 0, 0.1]")
        bodies += body(f"r{k}", f"s{k}", "type: revolute, axis: z", 2, "[0.2, 0, 0.1]")
        bodies += body(f"k{k}", "ground", "type: revolute, axis: z, at: [1, 1, 0]", 2, "[0.2, 0, 0.1]")
        if more:
            bodies += body(f"m{k}", f"k{k}", f"type: revolute, axis: z, at: [0.{2 + int(k)}, 0, 0]", 2, "[0.2, 0, 0.1]")
    bodies += body("z", "ground", "type: revolute, axis: z, at: [1, 1, 0]", 2, "[0.2, 0, 0.1]")
    loops = (
        "  l1: {joint: {type: revolute, axis: z}, from: {body: r1, at: [L, 0, 0]}, to: {body: k1, at: [0.7, 0, 0]}}\n"
    )
    loops += (
        "  l2: {joint: {type: inline, axis: z}, from: {body: r2, at: [L, 0, 0]}, to: {body: k2, at: [0.7, 0, 0]}}\n"
    )
    q = "r1: 0.5, k1: 4, r2: 0.7, k2: 3.5"
    if more:
        loops += "  l3: {joint: {type: inline, axis: z}, from: {body: m1, at: [0.9, 0, 0]}, to: {body: m2, at: [0.9, 0, 0]}}\n"
        q += ", m1: 1, m2: 2"
    return model(bodies, loops, f"independent: [s1, s2]\ninitial: {{q: {{{q}}}}}\n")


def a_slide_beside_a_hinge() -> str:
    """Two equal four-bars; the displacement between the faces is needed in the region of one of them."""
    bodies, loops = "", ""
    for k, joint in (("1", "revolute"), ("2", "inline")):
        bodies += body(f"a{k}", "ground", "type: revolute, axis: z", 2, "[0.2, 0, 0.1]")
        bodies += body(f"b{k}", f"a{k}", "type: revolute, axis: z, at: [0.5, 0, 0]", 2, "[0.2, 0, 0.1]")
        bodies += body(f"c{k}", "ground", "type: revolute, axis: z, at: [1, 0, 0]", 2, "[0.2, 0, 0.1]")
        bodies += body(f"d{k}", f"b{k}", "type: revolute, axis: z, at: [0.4, 0.3, 0]", 2, "[0.2, 0, 0.1]")
        bodies += body(f"e{k}", "ground", "type: revolute, axis: z, at: [0, 2, 0]", 2, "[0.2, 0, 0.1]")
        loops += f"  l{k}: {{joint: {{type: revolute, axis: z}}, from: {{body: b{k}, at: [L, 0, 0]}}, "
        loops += f"to: {{body: c{k}, at: [0.7, 0, 0]}}}}\n"
        up = 0.2 if joint == "inline" else 0
        loops += f"  k{k}: {{joint: {{type: {joint}, axis: z}}, from: {{body: d{k}, at: [1, 0, 0]}}, "
        loops += f"to: {{body: e{k}, at: [0.7, 0, {up}]}}}}\n"
    bodies += body("z", "ground", "type: revolute, axis: z", 2, "[0.2, 0, 0.1]")
    q = ", ".join(f"a{k}: 1.0, b{k}: -0.5, c{k}: 1.5, d{k}: 1, e{k}: -1" for k in "12")
    return model(bodies, loops, f"independent: [a1, a2]\ninitial: {{q: {{{q}}}}}\n")


def a_force_that_is_an_acceleration() -> str:
    """A mass of 1 whose centre is at the loop's joint: the force that it needs is the acceleration of that place."""
    bodies = body("base", "ground", "type: free", 3, "[0.1, 0.2, 0.1]")
    bodies += body("k", "base", "type: revolute, axis: z, at: [-1, 0, 0]", 0.5, "[0.2, 0.1, 0]")
    bodies += body("r1", "k", "type: revolute, axis: z, at: [0.3, 0, 0]", 0.7, "[0.3, 0, 0]")
    bodies += body("g", "base", "type: prismatic, axis: y", 0.6, "[0.1, 0, 0]")
    bodies += body("s", "g", "type: prismatic, axis: x", 1, "[0.5, 0.25, 0]")
    bodies += body("x", "s", "type: revolute, axis: z, at: [0.5, 0.25, 0]", 0.7, "[0.3, 0, 0]")
    bodies += body("y", "base", "type: revolute, axis: z, at: [1.5, 0, 0]", 0.5, "[0.2, 0.1, 0]")
    loops = (
        "  l1: {joint: {type: revolute, axis: z}, from: {body: r1, at: [L, 0, 0]}, to: {body: s, at: [0.5, 0.25, 0]}}\n"
    )
    loops += (
        "  l2: {joint: {type: revolute, axis: z}, from: {body: y, at: [0.3, 0, 0]}, to: {body: x, at: [1.2, 0, 0]}}\n"
    )
    q = "k: 1.5, r1: -0.8, g: 0.5, s: -0.5, x: -0.3, y: 1.8"
    return model(bodies, loops, f"independent: [k, y]\ninitial: {{q: {{{q}}}, u: {{k: 1.0, y: 0.5}}}}\n")


def a_door_with_a_second_hinge() -> str:
    """The loop of the second hinge adds no condition: it has no links and transmits no force."""
    bodies = body("door", "ground", "type: revolute, axis: z", 1.3, "[0.5, 0, 0]")
    bodies += body("r", "door", "type: revolute, axis: z, at: [1, 0, 0]", 1.7, "[0.5, 0, 0]")
    bodies += body("s", "ground", "type: revolute, axis: z, at: [1.5, 1, 0]", 1.1, "[0.5, 0, 0]")
    bodies += body("r2", "r", "type: revolute, axis: z, at: [1, 0, 0]", 1.7, "[0.5, 0, 0]")
    bodies += body("s2", "s", "type: revolute, axis: z, at: [1, 0, 0]", 1.1, "[0.5, 0, 0]")
    loops = (
        "  l1: {joint: {type: revolute, axis: z}, from: {body: r, at: [0.5*L, 0, 0]}, to: {body: s, at: [0.7, 0, 0]}}\n"
    )
    loops += (
        "  l2: {joint: {type: revolute, axis: z}, from: {body: r2, at: [1.1, 0, 0]}, to: {body: s2, at: [1.2, 0, 0]}}\n"
    )
    loops += "  h: {joint: {type: revolute, axis: z}, from: {body: r, at: [1, 0, 1]}, to: {body: r2, at: [0, 0, 1]}}\n"
    return model(bodies, loops, "independent: [door]\ninitial: {q: {door: 0.3, r: 0.5, s: 3}, u: {door: 1.0}}\n")


def unit_gravity() -> str:
    """A model whose forces are 1 in every state and have no derivative."""
    bodies = body("x", "ground", "type: prismatic, axis: x", 1, "[0, 0, 0]")
    bodies += body("y", "x", "type: prismatic, axis: y", 1, "[0, 0, 0]")
    bodies += body("w", "y", "type: revolute, axis: x, at: [0, L, 0]", 1, "[0, 0.3, 0]")
    return model(bodies, gravity="[0, 0, -1]")


MODELS = {
    "four-bar on a free base": four_bar_of_unit_masses("free"),
    "four-bar on a slide": four_bar_of_unit_masses("prismatic, axis: x"),
    "wheel and slider": wheel_and_slider(),
    "slides along x and y": equal_links_under_different_loops("y", False),
    "a source that moves one of two": equal_links_under_different_loops("x", True),
    "a slide beside a hinge": a_slide_beside_a_hinge(),
    "a force that is an acceleration": a_force_that_is_an_acceleration(),
    "a door with a second hinge": a_door_with_a_second_hinge(),
    "unit gravity": unit_gravity(),
}


def errors(text: str, folder: Path, layout: str, targets: tuple[str, ...], rng: np.random.Generator) -> dict[str, Any]:
    """Relative errors of udot and its derivatives against the dense method, at an assembled state with random speeds."""
    m = parse_model(text)
    codegen.generate(m, folder, "c" if "c" in targets else "numpy", layout, functions=("sensitivities",))
    engine, found = DenseEngine(m), {}
    for target in targets:
        s = codegen.load(folder, target)
        q, u = s.assemble(s.initial[0], rng.uniform(-1, 1, m.nu))
        seeds = {
            "dq": rng.uniform(-1, 1, (3, m.nq)),
            "du": rng.uniform(-1, 1, (3, m.nu)),
            "dp": rng.uniform(-1, 1, (3, s.np)),
        }
        expected, d_expected = engine.sensitivities(q, u, s.parameters, None, 0.0, **seeds)
        for _ in range(2):  # nothing is left from the first call
            udot, dudot = s.sensitivities(q, u, **seeds)
            found[target] = max(error(udot, expected), worst(dudot, d_expected))
    found["condition"] = float(np.max(s.condition(q), initial=1.0)) if m.loops else 1.0
    return found


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("layout", ["kinds", "unrolled"])
@pytest.mark.parametrize("name", MODELS)
def test_generated_is_dense(tmp_path, name, layout):
    targets = ("c", "numpy") if layout == "kinds" else ("numpy",)
    found = errors(MODELS[name], tmp_path / "m", layout, targets, np.random.default_rng(5))
    assert max(found[target] for target in targets) < 1e-11, found


def mixed(rng: np.random.Generator) -> str:
    """Three mechanisms with equal parts in different arrangements, in one model: their links share kinds."""
    bodies, loops, q, independent = "", [], [], []
    for n in range(3):
        base = "ground"
        if rng.random() < 0.4:
            base = f"g{n}"
            joint = rng.choice(["free", "revolute, axis: z", "prismatic, axis: x"])
            bodies += body(base, "ground", f"type: {joint}", 1, "[0.5, 0, 0]")
        first = str(rng.choice(["revolute, axis: z", "prismatic, axis: x", "prismatic, axis: y"]))
        at = rng.choice([0.0, 0.5]) if first.startswith("p") else 0.5
        bodies += body(f"a{n}", base, f"type: {first}", 1, "[0.5, 0, 0]")
        bodies += body(f"b{n}", f"a{n}", f"type: revolute, axis: z, at: [{at}, 0, 0]", 1, "[0.5, 0, 0]")
        bodies += body(f"c{n}", base, "type: revolute, axis: z, at: [1, 0, 0]", 1, "[0.5, 0, 0]")
        independent.append(f"a{n}")
        q += [f"a{n}: {1.0 if first.startswith('r') else 0.2}", f"b{n}: -0.5", f"c{n}: 1.5"]
        kinds = ["revolute, axis: z", "inline, axis: z", "cylindrical, axis: z", "spherical"]
        loops.append((rng.choice(kinds), f"b{n}", "1, 0, 0", f"c{n}", "0.7, 0, 0"))
        if rng.random() < 0.6:
            bodies += body(f"d{n}", f"b{n}", "type: revolute, axis: z, at: [0.4, 0.3, 0]", 1, "[0.5, 0, 0]")
            on = f"c{n}" if rng.random() < 0.4 else base
            bodies += body(f"e{n}", on, "type: revolute, axis: z, at: [0, 1.6, 0]", 1, "[0.5, 0, 0]")
            q += [f"d{n}: 1", f"e{n}: -1"]
            loops.append((rng.choice(kinds), f"d{n}", "1, 0, 0", f"e{n}", "0.7, 0, 0"))
            if rng.random() < 0.5:
                loops.append((rng.choice(kinds[:2]), f"b{n}", "0.4, 0.3, 1", f"d{n}", "0, 0, 1"))
        if rng.random() < 0.4:
            on = rng.choice([f"a{n}", f"b{n}", f"c{n}"])
            bodies += body(f"f{n}", on, "type: revolute, axis: y, at: [0.2, 0, 0]", 1, "[0.5, 0, 0]")
    bodies += body("z", "ground", "type: revolute, axis: z", 1, "[0.5, 0, 0]")
    text = "".join(
        f"  l{i}: {{joint: {{type: {joint}}}, from: {{body: {a}, at: [{x}]}}, to: {{body: {b}, at: [{y}]}}}}\n"
        for i, (joint, a, x, b, y) in enumerate(loops)
    )
    rest = f"independent: [{', '.join(independent)}]\ninitial: {{q: {{{', '.join(q)}}}}}\n"
    return model(bodies, text, rest, gravity="[0.3, -9.81, 0.1]")


def agree(tmp_path, seeds, wanted: int) -> None:
    """Check that enough drawn models can be assembled, and that they agree with the dense method."""
    done = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        try:
            found = errors(mixed(rng), tmp_path / f"m{seed}", "kinds", ("numpy",), rng)
        except (ModelError, PartitionError, AssemblyError, SingularLoopError):
            continue
        assert found["numpy"] < max(1e-9, 50 * np.finfo(float).eps * found["condition"] ** 2), (seed, found)
        done += 1
        if done == wanted:
            return
    raise AssertionError(f"only {done} of the models close")


@pytest.mark.filterwarnings("ignore")
def test_mixed_mechanisms_share_kinds(tmp_path):
    agree(tmp_path, range(100), 4)


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore")
def test_many_mixed_mechanisms_share_kinds(tmp_path):
    agree(tmp_path, range(1000, 3000), 150)


def test_an_inertia_of_one_about_the_axis_of_a_planar_loop(tmp_path: Path) -> None:
    """Zero patterns know it for the number one, so the sums of squares of a symmetric inertia must not stand for it."""
    text = """
model: bar
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
  b: {parent: a, joint: {type: revolute, axis: y, at: [1, 0, 0]}, mass: 1, com: [0, 0, 0], inertia: {xx: 1.5, yy: 1, zz: 1}}
  c: {parent: b, joint: {type: revolute, axis: y, at: [2, 0, 0]}, mass: 1, com: [0, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
loops:
  foot: {joint: {type: revolute, axis: y}, from: {body: c, at: [1.5, 0, 0]}, to: {body: ground, at: [2.2, 0, 0]}}
initial:
  q: {a: 1.0, b: -0.8, c: -1.2}
"""
    report = codegen.generate(parse_model(text), tmp_path / "bar", target="numpy", check=True)
    assert max(report.errors.values()) < 1e-12
