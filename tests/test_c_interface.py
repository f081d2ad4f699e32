"""The part of a package for C programmers: its program compiles unchanged and gives the results of Python."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.model import parse_model

EXAMPLES = Path(codegen.__file__).parents[1] / "examples"
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O0"]

ODD = """
model: odd
gravity: [0, 0, -9.81]
bodies:
  a: {parent: ground, joint: {type: spherical}, shape: {type: sphere, radius: 0.1, mass: 1, center: [0, 0, -0.5]}}
  a_qw: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, -1]}, mass: 1, com: [0.2, 0, 0], inertia: {yy: 0.1}}
forces:
  f: {type: joint, joint: a_qw, value: sin(t)}
"""
ROD = """
model: rod
gravity: [0, 0, -9.81]
parameters: {length: {value: 1.0, unit: "m */ |"}, radius: 0.02}
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: cylinder, axis: z, length: length, radius: radius, density: 2700, center: [0, 0, -length/2]}
initial: {q: {rod: 0.5}}
"""
TIED = """
model: tied
gravity: [0, 0, -9.81]
inputs: [motor]
bodies:
  arm: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0.3, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  link: {parent: arm, joint: {type: spherical, at: [0.5, 0, 0]}, mass: 0.5, com: [0, 0, -0.5],
         inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}
  slide: {parent: ground, joint: {type: prismatic, axis: x, at: [0, 0, -1]}, mass: 1}
loops: {foot: {joint: {type: universal, axes: [x, y]}, from: {body: link, at: [0, 0, -1]}, to: slide}}
forces: {drive: {type: joint, joint: arm, value: motor*t - 0.1*u.arm}}
initial: {q: {slide: 0.5}}
"""
MODELS = {"odd": ODD, "rod": ROD, "tied": TIED, "four_bar": (EXAMPLES / "four_bar.yaml").read_text()}


@pytest.fixture(scope="module", params=[*MODELS, "odd in float32", "four_bar in float32"])
def package(request, tmp_path_factory) -> Path:
    name, _, single = request.param.partition(" in ")
    return codegen.generate(
        parse_model(MODELS[name]), tmp_path_factory.mktemp("c") / name, "c", compile=False, scalar=single or "float64"
    ).folder


def test_the_program_of_the_readme_compiles_and_runs(package):
    readme = (package / "README.md").read_text()
    (program,) = re.findall(r"```c\n(.*?)```", readme, re.DOTALL)
    (command,) = re.findall(r"^    (cc .*)$", readme, re.MULTILINE)
    place = package.parent
    (place / "example.c").write_text(program)
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    words = [
        w for w in command.split()[1:] if not w.startswith(("-O", "-march"))
    ]  # as it stands, but quicker and strict
    subprocess.run([compiler, *WARNINGS, *words], cwd=place, check=True, capture_output=True)
    done = subprocess.run([place / "example"], cwd=place, check=True, capture_output=True, text=True)
    udot, dudot = np.array([line.split() for line in done.stdout.splitlines()], float).T
    solver = codegen.load(package)
    q, u = solver.initial
    if solver.closure_names:
        q[solver.coordinate_names.index(solver.independent_names[0])] += 0.001
        q, u = solver.assemble(q, u)
    if solver.np:
        seeds = {"dp": np.eye(solver.np)[0]}
    else:
        seeds = {"dq": np.eye(solver.nq)[solver.coordinate_names.index(solver.independent_names[0])]}
    expected, derivative = solver.sensitivities(q, u, **seeds)
    single = expected.dtype == np.float32  # whose rounding errors grow with the condition of the state
    for found, wanted, bound in ((udot, expected, 1e-9), (dudot, derivative[0], 1e-8)):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=(1e-4 if single else bound) * np.abs(wanted).max())


def test_names_defaults_and_initial_state(package):
    solver = codegen.load(package)
    text = (package / f"{solver.name}_model.h").read_text()
    index = {name: int(i) for name, i in re.findall(r"^    (\w+) = (\d+),?$", text, re.MULTILINE)}
    upper = solver.name.upper()
    for sort, names in (("Q", solver.coordinate_names), ("U", solver.speed_names), ("P", solver.parameter_names),
                        ("INPUT", solver.input_names), ("OUTPUT", solver.output_names)):  # fmt: skip
        words = [name.replace(".", "_") for name in names]
        for i, word in enumerate(words):
            if words.count(word) == 1:
                assert index.pop(f"{upper}_{sort}_{word}") == i
    assert not index
    q, u = solver.initial
    for symbol, numbers in (("PARAMETERS", solver.parameters), ("INITIAL_Q", q), ("INITIAL_U", None)):
        found = re.search(rf"{upper}_{symbol}\[(\d+)\] = \{{(.*?)\n\}};", text, re.DOTALL)
        if symbol == "PARAMETERS" and not solver.np:
            assert found is None
            continue
        values = [float(x) for x in re.sub(r"/\*.*?\*/", "", found.group(2)).replace("f", "").replace(",", " ").split()]
        assert len(values) == int(found.group(1))
        if numbers is not None:
            np.testing.assert_allclose(np.asarray(values, numbers.dtype), numbers, rtol=0, atol=1e-12)
    independent = [solver.speed_names.index(n) for n in solver.independent_speed_names]
    np.testing.assert_array_equal(np.array(values)[independent], u[independent])


def test_return_codes_are_told(package):
    solver = codegen.load(package)
    rows = dict(re.findall(r"^\| (\d+(?: to \d+)?) \| (.*) \|$", (package / "README.md").read_text(), re.MULTILINE))
    assert rows["0"] == "done" and any(row.startswith("link ") for row in rows.values())
    loops = {n.rpartition(".")[0] for n in solver.closure_names}
    assert [row for row in rows.values() if row.startswith("loop ")] == [
        row for row in rows.values() if loops and all(name in row for name in list(dict.fromkeys(loops))[:12])
    ]


def test_large_models_have_no_walls_of_names(tmp_path):
    text = """
model: endless
bodies:
  repeat k in 1..1200:
    link(k): {parent: link(k-1), joint: {type: prismatic, axis: x}, mass: 1, first: {parent: ground}}
"""
    folder = codegen.generate(parse_model(text), tmp_path / "endless", "numpy", compile=False).folder
    header = (folder / "endless_model.h").read_text()
    assert "link_7" not in header and "enum" not in header and "ENDLESS_INITIAL_Q[1200]" in header
    assert len((folder / "README.md").read_text()) < 5000


def test_a_changed_default_compiles_nothing_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0")
    folder = codegen.generate(parse_model(ROD), tmp_path / "rod").folder
    (library,) = folder.glob("*.so")
    made = library.stat().st_mtime_ns
    changed = ROD.replace("value: 1.0", "value: 1.25").replace("rod: 0.5", "rod: 0.75")
    assert codegen.generate(parse_model(changed), folder).written
    assert [(p.name, p.stat().st_mtime_ns) for p in folder.glob("*.so")] == [(library.name, made)]
    solver = codegen.load(folder)
    assert list(solver.parameters) == [1.25, 0.02] and solver.initial[0][0] == 0.75
    text = (folder / "rod_model.h").read_text()
    assert "1.25," in text and "0.75," in text


def test_units_and_names_are_shown_as_they_are(tmp_path):
    """Markdown would make emphasis of N*m*s, a link of [x], and a cell's end of |."""
    text = PENDULUM_OF_UNITS.replace("UNIT", "N*m*s/rad | [kg] <m> `s` $x$ ~y~ _z_ a_b")
    codegen.generate(codegen.parse_model(text), tmp_path / "units", compile=False)
    (row,) = [
        line for line in (tmp_path / "units" / "README.md").read_text().splitlines() if line.startswith("| design")
    ]
    assert r"N\*m\*s/rad \| \[kg\] \<m\> \`s\` \$x\$ \~y\~ \_z\_ a_b" in row and row.endswith(" |")
    assert r"\_odd\_ = 2.0" in row


PENDULUM_OF_UNITS = """\
model: units
parameters:
  L: {value: 1.0, unit: "UNIT"}
  _odd_: {value: 2.0}
bodies:
  rod: {parent: ground, joint: {type: revolute, axis: y}, mass: L, com: [_odd_, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
"""
