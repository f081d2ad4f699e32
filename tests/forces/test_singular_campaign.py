"""Random expressions at singular points: derivatives against limits in 400 digits, in every target and direction.

A product of factors that vanish at u = 0, each a power, a logarithm, a norm, an angle or a chosen branch, times smooth ones.
Where quotients to both sides have a limit, a derivative that is a finite number has to be it, and all ways of generated code
have to agree on which derivatives are finite.
"""

from __future__ import annotations

import random
import warnings
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import codegen
from codegen.model import Model, parse_model
from codegen.reference import DenseEngine

NAMES = ("u.a", "u.b", "q.a", "k", "n", "c")
AT = (0.0, 0.0, 0.3, 2.0, 1.6, 0.0)
FUNCTIONS: dict[str, Any] = {
    name: getattr(mpmath, name) for name in ("sqrt", "log", "cos", "sin", "exp", "atan2", "tanh")
}
FUNCTIONS |= {"abs": abs, "max": max, "min": min, "__builtins__": {}}


def factor(rng: random.Random) -> tuple[str, str]:
    """A factor in the grammar of models, and as Python's."""
    x = rng.choice(["u.a", "u.b", "(u.a - 2*u.b)", "c", "sin(u.a)", "u.a*k"])
    y = rng.choice(["u.a", "u.b", "q.a*u.b"])
    e = rng.choice(["n", "(n - 1)", "0.5", "1.5", "2", "(n/2)", "3"])
    kind = rng.randrange(9)
    if kind == 0:
        text = f"abs({x})**{e}"
    elif kind == 1:
        text = f"sqrt({x}**2 + {y}**2)"
    elif kind == 2:
        text = f"(k*{x}**2 + {y}*{y})**{e}"
    elif kind == 3:
        text = f"max(0, {x})**{e}"
    elif kind == 4:
        text = x
    elif kind == 5:
        text = f"log(abs({x}))"
    elif kind == 6:
        text = f"sqrt(k*abs({x}))"
    elif kind == 7:
        inner = rng.choice([f"sqrt({x})", f"log({x})", f"{x}**(n - 1)"])
        return f"if({x} > 0, {inner}, 0)", f"(({inner}) if {x} > 0 else 0)"
    else:
        text = f"atan2({x}, {y})"
    return text, text


def expression(rng: random.Random) -> tuple[str, str]:
    found = [factor(rng) for _ in range(rng.randint(2, 4))]
    found += [(s, s) for s in rng.sample(["k", "cos(q.a)", "exp(u.b)", "(1 + u.a)", "n"], rng.randint(0, 2))]
    rng.shuffle(found)
    return "*".join(a for a, _ in found), "*".join(b for _, b in found)


def limit(code: Any, name: str) -> float | None:
    """The derivative by a name: None where quotients to both sides, over two steps, do not agree or the value has no limit."""
    with mpmath.workdps(400):
        start = dict(zip(NAMES, (mpmath.mpf(repr(x)) for x in AT), strict=True))

        def value(step: Any, beside: Any) -> Any:
            v = start | {name: start[name] + step}
            for key in ("u.a", "u.b", "c"):  # a little beside the point where a logarithm or a quotient has no value
                v[key] = v[key] or beside * {"u.a": 1, "u.b": mpmath.mpf(3) / 7, "c": mpmath.mpf(5) / 11}[key]
            return eval(code, FUNCTIONS | {"v": v, "k": v["k"], "n": v["n"], "c": v["c"]})  # a text of this test

        found = []
        for digits in (20, 30):
            h = mpmath.mpf(10) ** -digits
            for sign in (1, -1):
                beside = h**6 * sign
                middle, there = value(0, beside), value(sign * h, beside)
                if mpmath.im(middle) != 0 or mpmath.im(there) != 0:
                    return None
                found.append(mpmath.re((there - middle) / (sign * h)))
        if not all(map(mpmath.isfinite, found)):
            return None
        spread = max(found) - min(found)
        return float(found[-1]) if spread < 1e-3 * (1 + abs(found[-1])) else None


def model_of(laws: list[str]) -> Model:
    lines = ["model: drawn", "parameters: {k: 2.0, n: 1.6, c: 0.0}", "bodies:"]
    names = [f"f{i}" for i in range(len(laws))]
    lines += [f"  {b}: {{parent: ground, joint: {{type: prismatic, axis: x}}, mass: 1}}" for b in ("a", "b", *names)]
    lines += [
        "forces:",
        *(f'  {n}: {{type: joint, joint: {n}, value: "{law}"}}' for n, law in zip(names, laws, strict=True)),
    ]
    lines += ["outputs:", *(f'  {n}: {{value: "{law}"}}' for n, law in zip(names, laws, strict=True))]
    return parse_model("\n".join(lines))


def drawn(seed: int, count: int = 12) -> tuple[list[str], np.ndarray]:
    """Expressions, and the limits of their derivatives by `NAMES`; nan where there is none."""
    rng = random.Random(seed)
    laws, rows = [], []
    while len(laws) < count:
        law, python = expression(rng)
        for name in NAMES[:3]:
            python = python.replace(name, f"v['{name}']")
        limits = [limit(compile(python, "law", "eval"), n) for n in NAMES]
        laws.append(law)
        rows.append([np.nan if x is None else x for x in limits])
    return laws, np.array(rows)


def differences(seed: int, folder: Path | None, targets: tuple[str, ...]) -> list[str]:
    """Messages about wrong derivatives of the expressions of one seed."""
    return compared(seed, folder, targets)[0]


def compared(
    seed: int, folder: Path | None, targets: tuple[str, ...]
) -> tuple[list[str], list[str], np.ndarray, dict[str, np.ndarray]]:
    """The same, with the expressions, the limits of their derivatives, and what was found in each way."""
    laws, expected = drawn(seed)
    model, n = model_of(laws), len(laws)
    q, u = np.zeros(n + 2), np.zeros(n + 2)
    q[0] = AT[2]
    found: dict[str, np.ndarray] = {}

    def rows(J: Any) -> np.ndarray:
        return np.column_stack([J.u[-n:, 0], J.u[-n:, 1], J.q[-n:, 0], J.p[-n:]])

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        seeds = {"dq": np.zeros((6, n + 2)), "du": np.zeros((6, n + 2)), "dp": np.zeros((6, 3))}
        seeds["du"][0, 0] = seeds["du"][1, 1] = seeds["dq"][2, 0] = 1.0
        seeds["dp"][3:] = np.eye(3)
        found["dense"] = (
            DenseEngine(model).output_sensitivities(q, u, **seeds)[1].T
        )  # a solution would mix what is infinite
        for target in targets:
            assert folder is not None
            functions = ("accelerations", "jacobians", "gradients", "output_gradients", "sensitivities")
            codegen.generate(model, folder / target, target=target, functions=functions)
            solver = codegen.load(folder / target)
            found[target] = rows(solver.jacobians(q, u))
            found[f"{target} transposed"] = rows(solver.gradients(q, u, weights=np.eye(n + 2)))
            found[f"{target} outputs"] = rows(solver.output_gradients(q, u, weights=np.eye(n)))
    wrong = []
    for way, of in found.items():
        for i, law in enumerate(laws):
            for j, name in enumerate(NAMES):
                x, y = of[i, j], expected[i, j]
                if np.isfinite(x) and np.isfinite(y) and not abs(x - y) <= 1e-6 * (1 + abs(y)):
                    wrong.append(f"seed {seed}, {way}: {law} by {name}: {x}, and the limit is {y}")
                # Jacobians in C multiply with the inverse mass matrix, which mixes what is infinite; the reference does not
                # simplify what it is to compute, nor hold branches
                other = found.get("numpy", of)[i, j]
                if way not in ("c", "dense") and np.isfinite(x) != np.isfinite(other):
                    wrong.append(f"seed {seed}, {way}: {law} by {name}: {x}, and the NumPy target has {other}")
    return wrong, laws, expected, found


@pytest.mark.parametrize("seed", range(2))
def test_a_few(seed: int) -> None:
    assert not differences(seed, None, ())


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(100, 140))
def test_many(tmp_path: Path, seed: int) -> None:
    """40 seeds of 12 expressions and 6 derivatives each."""
    assert not differences(seed, tmp_path, ("c", "numpy"))
