"""``ordernm simulate --inputs FILE``: signals over time from tables and archives, and errors for other files."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.cli import main
from codegen.model import parse_model
from codegen.simulating import RequestError, inputs_of

MODEL = """
model: pushed_cart
inputs: [push, way, gate]
bodies:
  base: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}
  cart: {parent: base, joint: {type: prismatic, axis: x}, mass: 2}
motion: {base: way}
forces:
  motor: {type: joint, joint: cart, value: push*gate - 3*u.cart}
outputs: {x: {value: q.cart}, motor: {driving_force: base}}
"""
T = np.linspace(0.0, 2.0, 21)
SIGNALS = {"push": np.sin(T), "way": 0.1 * np.cos(3 * T), "gate": (T > 0.95).astype(float)}


def asked(*inputs: str, between: tuple[str, ...] = ()) -> dict:
    return inputs_of(argparse.Namespace(inputs=list(inputs), between=list(between)))


@pytest.fixture
def files(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rows = [
        "t, push ,way,gate",
        *(",".join(map(repr, map(float, row))) for row in zip(T, *SIGNALS.values(), strict=True)),
    ]
    Path("signals.csv").write_text("\n".join(rows) + "\n\n")
    np.savez("signals.npz", time=T, **SIGNALS)
    Path("pushed_cart.yaml").write_text(MODEL)
    return tmp_path


@pytest.mark.parametrize("name", ["signals.csv", "signals.npz"])
def test_a_file_is_the_signals_that_it_holds(files: Path, name: str) -> None:
    found = asked(name, between=("cubic", "push=linear,gate=hold"))
    assert {n: x[2] for n, x in found.items()} == {"push": "linear", "way": "cubic", "gate": "hold"}
    for n, x in SIGNALS.items():
        assert np.array_equal(found[n][0], T) and np.array_equal(found[n][1], x)


def test_a_motion_by_files_is_that_of_python(files: Path, capsys) -> None:
    between = ["--between", "way=cubic,gate=hold"]
    assert (
        main(["simulate", "pushed_cart.yaml", "-t", "1.5", "--inputs", "signals.csv", *between, "-o", "run.npz"]) == 0
    )
    run = codegen.load_trajectory("run.npz")
    codegen.generate(parse_model(MODEL), "cart")
    inputs = {"push": (T, SIGNALS["push"]), "way": (T, SIGNALS["way"], "cubic"), "gate": (T, SIGNALS["gate"], "hold")}
    other = codegen.load("cart").simulate(run.t, inputs=inputs, rtol=1e-6, atol=1e-6)
    assert np.abs(run.outputs - other.outputs).max() < 1e-4 and np.abs(run["x"]).max() > 0.01
    assert main(["simulate", "pushed_cart.yaml", "-t", "1.5", "--inputs", "signals.csv"]) == 2
    assert "joined by straight lines" in capsys.readouterr().err
    assert main(["simulate", "pushed_cart.yaml", "-t", "1.5", "--inputs", "absent.csv"]) == 2
    assert "absent.csv: No such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"), ("t,push\n0,1\n0.5\n", r"bad.csv:3: 1 values, expected 2"),
        ("0,1\n1,2\n", "first line must contain names"),
        ("t,push\n0,x\n", r"bad.csv:2: push is 'x', expected a finite number"), ("t,push\n0,nan\n", "expected a finite number"),
        ("t,push\n1,1\n0,2\n", "time 0 follows 1; times must increase"), ("push,way\n1,2\n", "the times, named t or time"),
        ("t\n0\n1\n", "no signal"), ("t,push,push\n0,1,2\n", "each name may be given once"),
        ("t,push\n", "has names but no numbers"),
        ("t,,push\n0,1,2\n", "first line must contain names"), ("t,time,push\n0,1,2\n", "named t or time"),
        ("t;push\n0;1\n", "names and values are separated by commas, not by semicolons"),
    ],
)  # fmt: skip
def test_bad_tables_are_refused_with_their_lines(files: Path, text: str, says: str) -> None:
    Path("bad.csv").write_text(text)
    with pytest.raises(RequestError, match=says):
        asked("bad.csv")


def test_bad_archives_are_refused(files: Path) -> None:
    for content, says in (
        (b"", "not an archive"), (b"PK\x03\x04 damaged", "not an archive"), (b"no archive at all", "not an archive"),
    ):  # fmt: skip
        Path("bad.npz").write_bytes(content)
        with pytest.raises(RequestError, match=says):
            asked("bad.npz")
    for arrays, says in (
        ({"t": T, "push": T[:-1]}, r"push has shape \(20,\), expected \(21,\)"), ({"push": T}, "named t or time"),
        ({"t": T, "push": np.array(["a"] * 21)}, "not an archive of numerical arrays"),
        ({"t": T, "push": T + 1j}, "not an archive of numerical arrays: Cannot cast .*complex"),
        ({"t": T, "push": T * np.nan}, "finite numbers"),
    ):  # fmt: skip
        np.savez("bad.npz", **arrays)
        with pytest.raises(RequestError, match=says):
            asked("bad.npz")


def test_what_is_asked_for_twice_or_of_nothing_is_refused(files: Path) -> None:
    for inputs, between, says in (
        (["push=1", "signals.csv"], [], "push is given twice"), (["signals.csv", "signals.npz"], [], "given twice"),
        (["push=1"], ["cubic"], "names no .csv or .npz file"), (["signals.csv"], ["wave"], "expected one of linear, hold"),
        (["signals.csv"], ["other=cubic"], "no file has this signal"),
        (["signals.txt"], [], r"or a signal file, \.csv or \.npz"),
        (["signals.csv"], ["cubic", "hold"], "given twice"),
    ):  # fmt: skip
        with pytest.raises(RequestError, match=says):
            asked(*inputs, between=tuple(between))
