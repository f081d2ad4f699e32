"""The manifest lists the sweeps of a function and how often they run; the generated C and NumPy must agree with it."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen import generate
from codegen.manifest import OUTSIDE
from codegen.measure.models import sized
from codegen.measure.operations import of_manifest, plain, total
from codegen.mechanics.procedures import arrays, procedures
from codegen.mechanics.procedures.words import MOTIONS
from codegen.mechanics.sweeps import SWEEP
from codegen.model import load_model, parse_model
from codegen.pipeline import Source, write_solver
from codegen.program.chosen_steps import for_target
from codegen.program.counting import counted
from codegen.program.procedure import Together, walk

EXAMPLES = Path(__file__).parents[2] / "examples"

SPRINGS = """
model: springs
gravity: [0, 0, -9.81]
parameters: {length: 1.0, k: 50.0}
inputs: [pull]
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y},
      shape: {type: rod, axis: z, length: length, density: 1.5, center: [0, 0, -length/2]}}
  b: {parent: a, joint: {type: spherical, at: [0, 0, -length]}, mass: 0.7, com: [0, 0, -0.2],
      inertia: {xx: 0.02, yy: 0.02, zz: 0.01}}
forces:
  spring: {type: spring, from: {body: b, at: [0, 0.1, -0.4]}, to: {body: ground, at: [1, 0, 0]},
           stiffness: k*(1 + pull), damping: 0.3, free_length: 0.4*(1 + 0.1*t)}
  drive: {type: joint, joint: a, value: pull - 0.1*u.a}
initial: {q: {a: 0.3*length}, u: {a: -2}}
outputs:
  energy: potential_energy
  height: {position: {body: b, at: [0, 0, -0.4]}, axis: z}
"""

FORMULAS = {
    "tau": "joint_forces",
    "coefficient": "element_coefficients",
    "drive": "drives",
    "outputs": "output_formulas",
    "energy": "potential_of_gravity",
    "initial_q": "initial_values",
    "initial_u": "initial_values",
}
EVERY_FORMULA = {*FORMULAS.values(), MOTIONS.name}


def bodies_of(source: Source) -> dict[str, str]:
    """Bodies of the C functions by name; names of functions over directions without the width."""
    name = source.manifest["name"]
    text = source.files[f"{name}.c"] + source.files[f"{name}_directions.h"]
    text = re.sub(r"DIRECTIONS\((\w+)\)", r"\1", re.sub(r"/\*.*?\*/", "", text, flags=re.S))
    found: dict[str, str] = {}
    for head, body in re.findall(
        r"^(?:static )?(?:int|void|double \*)[ *]?(\w+)\([^;{]*\)\n\{\n(.*?)^\}", text, re.S | re.M
    ):
        found[head.removeprefix(f"{name}_")] = body
    return found


def called(functions: dict[str, str], start: str) -> set[str]:
    """Names of the functions that a function calls, directly or through others."""
    seen: set[str] = set()
    todo = [start]
    while todo:
        body = re.sub(r"(\w+)_1\(&(d|one)\)", r"\1(&\2)", functions[todo.pop()])  # over one direction, not of kind 1
        body = re.sub(r"(\w+)_\d+\(&e\)", r"\1(&e)", body)  # over columns
        names = set(re.findall(r"(\w+)\(", body))
        todo += (names & functions.keys()) - seen
        seen |= names & functions.keys()
    return seen


def sweeps_in_c(functions: dict[str, str], start: str) -> set[str]:
    reached = called(functions, start)
    found = {"start", *SWEEP} & reached
    # sweeps that have no loop of their own: functions of links are called after those of another sweep
    found |= {s.then for name, s in SWEEP.items() if s.then and name in found and _of_links(s.then, reached)}
    forms = ("", "_tangents", "_transposed")  # the only formula of a group is a function with the name of the group
    found |= {group for group in EVERY_FORMULA for form in forms if f"{group}{form}" in reached}
    for name in reached:
        formula = re.fullmatch(r"d?(tau|coefficient|outputs|energy|initial_q|initial_u)(_of_link)?_\d+", name)
        if formula:
            found.add(FORMULAS[formula[1]])
    return found


def _of_links(sweep: str, reached: set[str]) -> bool:
    return any(re.fullmatch(rf"{sweep}_\d+", name) for name in reached)


@cache
def source_of(name: str) -> Source:
    """The generated source of an example, or of `SPRINGS`."""
    model = parse_model(SPRINGS) if name == "springs" else load_model(EXAMPLES / f"{name}.yaml")
    return write_solver(model, "kinds", reactions=True)


SEVERAL = ("springs", "four_bar", "satellite", "tree", "bricard", "stewart", "andrews", "chain")
"""Between them they have every kind of link, loop and element."""


@pytest.mark.parametrize("name", SEVERAL)
def test_functions_run_the_sweeps_that_the_manifest_names(name: str) -> None:
    source = source_of(name)
    functions = bodies_of(source)
    operations = source.manifest["operations"]
    for function, described in source.manifest["functions"].items():
        run = sweeps_in_c(functions, function)
        told = {s.removesuffix("_1") for s in described["sweeps"]}
        assert told == run, (name, function)
        assert set(described["sweeps"]) <= set(operations)


def calls_in_numpy(source: Source) -> dict[str, Counter[str]]:
    """How often each function of the NumPy module calls each sweep and formula, found by running it."""
    manifest = source.manifest
    module: dict[str, Any] = {}
    exec(source.files[f"{manifest['name']}_numpy.py"], module)
    calls: Counter[str] = Counter()

    def counting(name: str, function: Any) -> Any:
        def call(a: Any) -> None:
            calls[name] += 1
            function(a)

        return call

    formulas = {f"{name}{along}" for name in EVERY_FORMULA for along in ("", "_tangents", "_transposed")}
    for name in {"start", *SWEEP, *formulas} & module.keys():
        module[name] = counting(name, module[name])
    rng = np.random.default_rng(7)
    state = {"q": np.array(manifest["initial"]["q"]), "p": np.array(manifest["parameters"]), "t": np.array(0.3)}
    sizes = {n: a.size for n, a in arrays(source.system).items()}
    found = {}
    for function, described in manifest["functions"].items():
        given = [state[a] if a in state else rng.standard_normal(sizes[a]) for a in described["arguments"]]
        seeds = [rng.standard_normal((2, sizes[s[1:]]) if s != "dt" else 2) for s in described.get("seeds", ())]
        calls.clear()
        module[function](*given, *seeds)
        found[function] = Counter(calls)
    return found


def one_by_one_sweeps(source: Source, function: str) -> list[str]:
    """Sweeps of a function that takes columns one after the other in NumPy, all at once in C, of which the manifest tells."""
    found = {p.name: p for p in procedures(source.system, True, None)}[function]
    if not any(isinstance(step, Together) for step in walk(found.steps)):
        return []
    return [s for s in counted(for_target(found, False), OUTSIDE) if s in source.manifest["operations"]]


OTHERS = sorted({f.stem for f in EXAMPLES.glob("*.yaml")} - {*SEVERAL})


@pytest.mark.parametrize("name", [*SEVERAL, *(pytest.param(n, marks=pytest.mark.campaign) for n in OTHERS)])
def test_functions_run_the_sweeps_as_often_as_the_manifest_says(name: str) -> None:
    source = source_of(name)
    for function, run in calls_in_numpy(source).items():
        described = source.manifest["functions"][function]
        told = Counter(s.removesuffix("_1") for s in one_by_one_sweeps(source, function) or described["sweeps"])
        matrices = len(described["results"]) - 1 if function == "jacobians" else 1
        expected: Counter[str] = Counter()
        for sweep, times in told.items():
            if sweep in EVERY_FORMULA:  # their tangents have no name of their own
                values, tangents, backwards = (run[f"{sweep}{way}"] for way in ("", "_tangents", "_transposed"))
                assert times == max(values, tangents / matrices, backwards), (name, function, sweep)
                expected += Counter({sweep: values, f"{sweep}_tangents": tangents, f"{sweep}_transposed": backwards})
            else:
                expected[sweep] = times * (matrices if sweep in SWEEP and SWEEP[sweep].lanes else 1)
        assert expected == run, (name, function)


def test_a_sweep_for_values_counts_as_one_direction() -> None:
    operations = write_solver(parse_model(SPRINGS)).manifest["operations"]
    for sweep in ("solve_in", "balance_back"):
        each, one = operations[sweep], operations[f"{sweep}_1"]
        assert one["per_call"] == {k: v + each["per_direction"][k] for k, v in each["per_call"].items()}
        assert one["per_call"]["multiplications"] > 0
        assert not any(one["per_direction"].values())


def test_the_pivot_check_of_a_planar_mechanism_costs_little() -> None:
    """Two bounds, and the size that the lower link hands on; no entry of the inertia is computed for the check alone."""
    source = write_solver(load_model(EXAMPLES / "double_pendulum.yaml"))
    operations = source.manifest["operations"]
    sweeps = source.manifest["functions"]["accelerations"]["sweeps"]
    assert sum(sum(operations[sweep]["per_call"].values()) for sweep in sweeps) <= 106
    stored = {name for block in source.program.blocks["triangularize"].values() for _, name, _ in block.stores}
    assert not stored & {"acc.J.xx", "acc.J.zz", "acc.M.yy"} and "acc.sJ" in stored


def test_the_virtual_motion_of_a_ladder_costs_one_projection() -> None:
    """Products with second derivatives: the conditions of the virtual motion have no right side, so no motion of the
    links is computed before its forces are projected onto the sources."""

    def operations(size: int) -> tuple[int, int]:
        manifest = sized("LADDER", size).source(functions=("hessian_products",)).manifest
        sweeps = of_manifest(manifest, "hessian_products")
        times = Counter(manifest["functions"]["hessian_products"]["sweeps"])
        values = [name for name in sweeps if name.startswith("virtual_")]
        assert values and {times[name] for name in values} == {1}
        return plain(total(sweeps)), plain(total(sweeps, among=values))

    every, virtual = zip(operations(5), operations(4), strict=True)
    assert virtual[0] - virtual[1] <= 4  # for one more loop, which has two links
    assert every[0] - every[1] <= 1010


def test_energies_take_inputs_where_springs_read_them() -> None:
    with_inputs = write_solver(parse_model(SPRINGS)).manifest["functions"]["energies"]["arguments"]
    without = write_solver(parse_model(SPRINGS.replace("k*(1 + pull)", "k").replace("*(1 + 0.1*t)", "")))
    assert with_inputs == ["q", "u", "p", "inputs", "t"]
    assert without.manifest["functions"]["energies"]["arguments"] == ["q", "u", "p"]


def test_operations_are_those_that_comments_in_the_c_give() -> None:
    """Also where a sweep over several links is one function."""
    source = write_solver(load_model(EXAMPLES / "double_pendulum.yaml"))
    operations = source.manifest["operations"]
    for sweep in source.manifest["functions"]["sensitivities"]["sweeps"]:
        if sweep not in SWEEP:
            continue
        text = source.files["double_pendulum_directions.h" if SWEEP[sweep].lanes else "double_pendulum.c"]
        comment = re.search(rf"operations:((?:(?!\*/).)*)\*/\n[^;{{]*\b(?:{sweep}|DIRECTIONS\({sweep}\))\(", text, re.S)
        assert comment is not None, sweep
        found = sum(map(int, re.findall(r"\d+", comment[1])))
        assert found == sum(n for per in operations[sweep].values() for n in per.values()), sweep


def test_the_report_counts_what_accelerations_run(tmp_path: Path) -> None:
    """The sweeps of other functions, such as positions for outputs, are not counted."""
    report = generate(EXAMPLES / "double_pendulum.yaml", tmp_path, compile=False, check=False)
    sweeps = report.sweeps["accelerations"]
    assert "pose" in report.operations and "pose" not in sweeps
    counts = [report.operations[sweep]["per_call"] for sweep in sweeps]
    assert report.flops("accelerations") == sum(sum(of.values()) - of["functions"] for of in counts) <= 106
    assert f"udot: {report.flops('accelerations')} operations" in str(report)
    report = generate(EXAMPLES / "double_pendulum.yaml", tmp_path, compile=False, check=False, functions=["outputs"])
    assert "udot" not in str(report)
