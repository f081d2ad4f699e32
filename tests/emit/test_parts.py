"""Long functions are split into parts, which give the results of the whole function."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.mechanics import merging
from codegen.program import parts

EXAMPLE = Path(__file__).parents[2] / "examples" / "four_bar.yaml"


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(merging, "LONGEST", 0)  # a merged sweep is too short to be divided
    monkeypatch.setattr(merging, "LONGEST_ALONG", 0)
    monkeypatch.setattr(parts, "LONGEST", 50)
    monkeypatch.setattr(parts, "PART", 30)
    monkeypatch.setattr(parts, "WINDOW", 10)


def test_parts_compute_what_the_whole_does(tmp_path, monkeypatch, small):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O1 -ffp-contract=off")
    model = codegen.load_model(EXAMPLE)
    codegen.generate(model, tmp_path / "parts", compile=False, functions=["accelerations"])
    text = (tmp_path / "parts" / f"{model.name}.c").read_text()
    assert text.count("_part_2(a, values") > 1 and "double values[" in text
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


@pytest.mark.parametrize("example", ["four_bar", "ladder", "closed_chain", "loader", "quadruped"])
def test_parts_over_directions(tmp_path, monkeypatch, small, example):
    """Of functions over directions too, and of those that several links share; forwards and backwards, in C and over states."""
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0 -ffp-contract=off")
    model = codegen.load_model(EXAMPLE.with_name(f"{example}.yaml"))
    asked = ["accelerations", "sensitivities", "gradients", "outputs", "output_sensitivities"]
    codegen.generate(model, tmp_path / "parts", compile="all", functions=asked)
    text = (tmp_path / "parts" / f"{model.name}_directions.h").read_text()
    assert "LANES lane_values[" in text and text.count("STATIC_PART DIRECTIONS(") > 10
    monkeypatch.setattr(parts, "LONGEST", 10**9)
    codegen.generate(model, tmp_path / "whole", compile="all", functions=asked)
    divided, whole = codegen.load(tmp_path / "parts"), codegen.load(tmp_path / "whole")
    q, u = whole.initial
    rng = np.random.default_rng(0)
    at = q, u + 0.3, None, rng.normal(size=len(model.inputs)), 0.2
    seeds = {"dq": rng.normal(size=(9, model.nq)), "dp": rng.normal(size=(9, len(model.parameters)))}
    for name, arguments in (("sensitivities", seeds), ("output_sensitivities", seeds),
                            ("gradients", {"weights": rng.normal(size=(3, model.nu))})):  # fmt: skip
        found, of = getattr(divided, name)(*at, **arguments), getattr(whole, name)(*at, **arguments)
        for a, b in zip(found, of, strict=True):
            np.testing.assert_array_equal(a, b, err_msg=name)
    many = np.tile(q, (5, 1)), np.tile(u, (5, 1)) + 0.1 * np.arange(5)[:, None]
    np.testing.assert_array_equal(divided.accelerations(*many), whole.accelerations(*many))


def test_places_are_used_again(small):
    """What nobody needs any more leaves its place; values per direction have places of their own."""
    from codegen.program.block import Expansion
    from codegen.program.store import Memory, Owner, Store

    given, out = Store("in", Owner("model"), Memory("in")), Store("out", Owner("model"), Memory("out"))
    along = Store("lanes", Owner("model"), Memory("lanes", lanes=True))
    hand = {a: Store(f"hand{a}", Owner("model"), Memory("hand", a)) for a in (False, True)}
    x = Expansion("b", "", lambda store, name: True)
    a, d = x.component(given, "a"), x.component(along, "d")
    value, tangent = x.let("v", a * a), x.let("w", a * d, lanes=True)
    for i in range(100):
        value, tangent = x.let("v", value * a + i), x.let("w", tangent * value, lanes=True)
    x.set_component(out, "v", value)
    x.set_component(along, "w", tangent)
    found, counts = parts.in_parts(x.finish(), lambda i, a: (hand[a], str(i)), lambda at: False)
    assert len(found) > 5 and counts[False] <= 3 and counts[True] <= 3
    memory = {(given, "a"): 1.01, (along, "d"): 0.9}
    for part in found:
        run(part, memory)
    whole = {(given, "a"): 1.01, (along, "d"): 0.9}
    run(x.finish(), whole)
    assert whole == {at: v for at, v in memory.items() if at[0] not in hand.values()}


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
    found, counts = parts.in_parts(block, lambda i, along: (hand, str(i)), lambda at: at in {(store, "a")})
    assert len(found) > 3 and counts[False] >= 2
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
