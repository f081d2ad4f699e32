"""Long functions stand in parts, which compute what the whole does."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.program import parts

EXAMPLE = Path(__file__).parents[2] / "examples" / "four_bar.yaml"


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(parts, "LONGEST", 20)
    monkeypatch.setattr(parts, "PART", 10)
    monkeypatch.setattr(parts, "WINDOW", 4)


def test_parts_compute_what_the_whole_does(tmp_path, monkeypatch, small):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O1 -ffp-contract=off")
    model = codegen.load_model(EXAMPLE)
    codegen.generate(model, tmp_path / "parts", compile=False, functions=["accelerations"])
    text = (tmp_path / "parts" / f"{model.name}.c").read_text()
    assert text.count("_part_2(a, values);") > 1 and "double values[" in text
    monkeypatch.setattr(parts, "LONGEST", 10**9)
    codegen.generate(model, tmp_path / "whole", compile=False, functions=["accelerations"])
    assert "_part_" not in (tmp_path / "whole" / f"{model.name}.c").read_text()
    divided, whole = codegen.load(tmp_path / "parts"), codegen.load(tmp_path / "whole")
    q, u = whole.initial
    assert np.array_equal(divided.initial[0], q)
    for speed in (0.0, 1.0, -3.0):
        np.testing.assert_array_equal(divided.accelerations(q, u + speed), whole.accelerations(q, u + speed))


def test_units_of_a_library_share_the_parts(tmp_path, monkeypatch, small):
    """Each is compiled in one of them; the others call it. Without units all are there."""
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0 -ffp-contract=off")
    model = codegen.load_model(EXAMPLE)
    asked = ["accelerations", "sensitivities", "energies"]
    codegen.generate(model, tmp_path / "parts", compile=False, functions=asked)
    monkeypatch.setattr(parts, "LONGEST", 10**9)
    codegen.generate(model, tmp_path / "whole", compile=False, functions=asked)
    divided, whole = codegen.load(tmp_path / "parts"), codegen.load(tmp_path / "whole")
    q, u = whole.initial
    dq = np.random.default_rng(0).normal(size=(3, model.nq))
    for directions in (dq[0], dq):  # of unit 1 and of unit 2
        found, of = divided.sensitivities(q, u, dq=directions), whole.sensitivities(q, u, dq=directions)
        np.testing.assert_array_equal(found[1], of[1])
    np.testing.assert_array_equal(divided.energies(q, u), whole.energies(q, u))
    gcc = shutil.which("gcc") or "cc"

    def parts_in(*flags):
        out = tmp_path / "of_a_unit.o"
        subprocess.run([gcc, "-c", *flags, "-o", out, tmp_path / "parts" / f"{model.name}.c"], check=True)
        names = subprocess.run(["nm", out], check=True, capture_output=True, text=True).stdout.split("\n")
        return {line.split()[-1] for line in names if "_part_" in line and " T " in line}

    first, second = (parts_in("-DORDERNM_LIBRARY=1", f"-DORDERNM_UNIT={n}") for n in (1, 2))
    assert first and second and not first & second
    assert not parts_in()  # static
    text = (tmp_path / "parts" / f"{model.name}.c").read_text()
    assert len(first | second) == sum(line.startswith("PART ") and line.endswith(")") for line in text.split("\n"))


def test_what_is_loaded_and_stored_again_is_loaded_first(small):
    from codegen.program.block import Expansion
    from codegen.program.store import Memory, Owner, Store

    store, hand = (Store(n, Owner("model"), Memory(n)) for n in ("in", "hand"))
    x = Expansion("b", "", lambda store, name: True)
    a = x.component(store, "a")
    value = x.let("v", a * a)
    x.set_component(store, "a", value)
    for i in range(60):
        value = x.let("v", value * a + i)
        x.set_component(store, str(i), value)
    block = x.finish()
    found, count = parts.in_parts(block, lambda i: (hand, str(i)), lambda at: at in {(store, "a")})
    assert len(found) > 3 and count >= len(found) - 1
    assert [n for part in found for _, n in part.loads.values()].count("a") == 1
    memory = {(store, "a"): 1.01}
    for part in found:
        run(part, memory)
    whole = {(store, "a"): 1.01}
    run(block, whole)
    assert whole == {at: v for at, v in memory.items() if at[0] is store}


def run(block, memory):
    from codegen.program.algebra import value_of_number
    from codegen.program.digits import number

    values = {s: memory[at] for s, at in block.loads.items()}

    def value(e):
        return value_of_number(e.xreplace({s: number(v) for s, v in values.items()}))

    for s in block.statements:
        values[s.target] = value(s.expression)
    for store, name, e in block.stores:
        memory[store, name] = value(e)
