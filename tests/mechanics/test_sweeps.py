"""The symbolic expansion: its operations, omitted zeros, and a time that does not grow with the model."""

from __future__ import annotations

import pytest

from codegen.mechanics.structure.system import analyse
from codegen.model import ModelError, checks, parse_model
from codegen.pipeline import write_solver

FORWARD = ("start", "kinematics", "triangularize", "back_substitute")
DIRECTION = ("balance_out", "balance_in", "balance_back")


def chain(n: int, axis: str = "[1 - k % 2, k % 2, 0]", gravity: str = "gravity: [0, 0, -9.81]", more: str = "") -> str:
    return f"""
model: chain
{gravity}
constants: {{n: {n}, rho: 1, radius: 0.05}}
parameters:
  L: {{value: 1.0, unit: m}}
{more}
bodies:
  repeat k in 1..n:
    link(k):
      parent: link(k-1)
      joint: {{type: revolute, axis: {axis}, at: [0, 0, -L]}}
      shape: {{type: cylinder, axis: z, length: L, radius: radius, mass: rho*L, center: [0, 0, -L/2]}}
      first: {{parent: ground, joint: {{at: [0, 0, 0]}}}}
"""


def flops(operations: dict, sweeps: tuple[str, ...], part: str = "per_call") -> int:
    return sum(v for s in sweeps for k, v in operations[s][part].items() if k != "functions")


def cost(text: str, layout: str = "kinds") -> tuple[int, int, int]:
    """Operations of udot, operations that all directions share, and operations of one direction."""
    operations = write_solver(parse_model(text), layout).manifest["operations"]
    return flops(operations, FORWARD), flops(operations, DIRECTION), flops(operations, DIRECTION, "per_direction")


@pytest.mark.parametrize("n", [12, 50, 100])
def test_operations_per_body_of_the_chain(n: int) -> None:
    udot, _, direction = cost(chain(n))
    assert udot / n <= 246  # with what is stored, which counts had left out
    assert direction / n <= 175
    assert direction <= 0.75 * udot


@pytest.mark.parametrize("n", [12, 24])
def test_one_function_per_link_saves_at_the_ends(n: int) -> None:
    udot, _, direction = cost(chain(n), "unrolled")
    shared_udot, _, shared_direction = cost(chain(n))
    assert udot < shared_udot and direction < shared_direction
    assert udot / n <= 225
    assert direction <= udot


def test_a_planar_chain_costs_what_a_planar_one_costs() -> None:
    n = 24
    udot, _, direction = cost(chain(n, axis="y"))
    assert udot / n <= 104
    assert direction / n <= 68
    spatial, _, _ = cost(chain(n))
    assert udot < 0.5 * spatial


def test_a_scene_without_gravity_has_no_gravity() -> None:
    with_gravity, free = cost(chain(6)), cost(chain(6, gravity=""))
    assert free[0] <= with_gravity[0] - 4  # the turns of the first links' acceleration
    source = write_solver(parse_model(chain(6, gravity="")))
    assert "gravity" not in "".join(line for line in source.files["chain.c"].splitlines() if "/*" not in line)
    assert "moments" not in source.program.blocks


def test_a_parameter_that_nothing_depends_on_costs_nothing() -> None:
    plain = write_solver(parse_model(chain(6)))
    more = write_solver(parse_model(chain(6, more="  unused: 1.0")))
    assert flops(plain.manifest["operations"], DIRECTION, "per_direction") == flops(
        more.manifest["operations"], DIRECTION, "per_direction"
    )
    assert flops(plain.manifest["operations"], FORWARD) == flops(more.manifest["operations"], FORWARD)


def test_numbers_instead_of_a_parameter_cost_less() -> None:
    fixed = chain(12).replace("parameters:\n  L: {value: 1.0, unit: m}\n", "").replace("n: 12,", "n: 12, L: 1.0,")
    udot, shared, direction = cost(fixed)
    full = cost(chain(12))
    assert udot < full[0] and shared < full[1] and direction < full[2]
    source = write_solver(parse_model(fixed))
    assert "const double *p" not in source.files["chain.h"]


def test_nothing_symbolic_grows_with_the_model() -> None:
    small, large = (write_solver(parse_model(chain(n)), "kinds") for n in (20, 200))
    assert {s: len(b) for s, b in small.program.blocks.items()} == {s: len(b) for s, b in large.program.blocks.items()}
    count = [
        sum(len(b.statements) for blocks in s.program.blocks.values() for b in blocks.values()) for s in (small, large)
    ]
    assert count[0] == count[1]
    assert len(large.files["chain.c"]) < len(small.files["chain.c"]) + 2000


def test_distinct_numbers_stay_one_kind() -> None:
    """Links that differ in numbers only share their functions; the numbers are data."""
    text = (
        chain(30).replace("radius: radius", "radius: 0.05 + 0.001*k").replace("mass: rho*L", "mass: rho*L*(1 + 0.01*k)")
    )
    system = analyse(parse_model(text), unrolled=False)
    assert len(system.kinds) == 4
    assert len(system.shapes) <= 3


def test_own_parameters_stay_one_kind() -> None:
    text = (
        chain(30)
        .replace("  L: {value: 1.0, unit: m}", "  L: 1.0\n  repeat k in 1..n: {m(k): 1.0}")
        .replace("rho*L", "m(k)")
    )
    source = write_solver(parse_model(text))
    assert len(source.system.kinds) == 4
    assert len(source.manifest["parameter_names"]) == 31


def test_fixed_bodies_become_part_of_what_carries_them() -> None:
    source = write_solver(
        parse_model("""
model: hammer
parameters: {a: 0.4}
bodies:
  shaft: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.01}}
  head: {parent: shaft, joint: {type: fixed, at: [0, 0, a]}, mass: 2*a, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
""")
    )
    assert source.manifest["links"] == ["shaft"]


def test_slots_do_not_grow_along_a_chain() -> None:
    assert analyse(parse_model(chain(300)), unrolled=False).slots <= 3


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("{type: revolute, axis: x}", "{type: revolute, axis: x}"),
        ("{type: prismatic, axis: x}", "{type: prismatic, axis: x}"),
        ("{type: revolute, axis: x}", "{type: spherical}"),
    ],
)
def test_a_joint_that_never_moves_inertia_is_an_error_that_names_the_body(
    first: str, second: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checks, "singular_joint", lambda *_: None)  # what the loader finds, it finds on numbers
    model = parse_model(
        f"""
model: idle
bodies:
  hub: {{parent: ground, joint: {first}}}
  arm: {{parent: hub, joint: {second}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}
""",
        "idle.yaml",
    )
    with pytest.raises(ModelError, match=r"idle\.yaml:4:3: bodies\.hub\.joint: .* joint of 'hub'"):
        write_solver(model)
