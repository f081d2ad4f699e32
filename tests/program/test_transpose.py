"""The transpose of a block is the transpose of the linear map that the block computes."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.program import algebra
from codegen.program.algebra import Symbol
from codegen.program.block import Block, Component, Expansion
from codegen.program.digits import number
from codegen.program.functions import SYMBOLIC
from codegen.program.fusion import fused
from codegen.program.passes import simplify
from codegen.program.store import Life, Memory, Owner, Store
from codegen.program.transpose import Kept, coefficients, deferred, transposed, values

MODEL = Owner("model")
SCALARS, SLOTS = Memory("scalars"), Memory("slots", lanes=True, life=Life.SWEEP)
S, KEPT = Store("s", MODEL, SCALARS), Store("kept_s", MODEL, Memory("kept"))
A, B = Store("a", MODEL, SLOTS), Store("b", MODEL, SLOTS)

NOTHING_KEPT = Kept(lambda store, name: False, lambda store: store, lambda store: True)


def always(store: Store, name: str) -> bool:
    return True


State = dict[Component, float]


def evaluated(e: algebra.Expr, values: dict[Symbol, float]) -> float:
    return algebra.value_of_number(e.xreplace({s: number(v) for s, v in values.items()}))


def run(block: Block, state: State) -> State:
    """The memory after a block has run; locations that the block does not load have no effect."""
    found: dict[Symbol, float] = {s: state.get(at, 0.0) for s, at in block.loads.items()}
    for t in block.statements:
        found[t.target] = evaluated(t.expression, found)
    after = dict(state)
    for store, name, e in block.stores:
        value = evaluated(algebra.expression(e), found)
        at = store.plain, name
        after[at] = after.get(at, 0.0) + value if store.adds else value
    return after


def random_block(rng: np.random.Generator, adds: bool) -> Block:
    """Scalars, lanes linear in lanes, and locations that are loaded, stored, or both."""
    x = Expansion("random", "random", lambda store, name: True)
    scalars = [x.component(S, str(i)) for i in range(4)]
    lanes = [x.component(A, str(i)) for i in range(4)] + [x.component(B, "0")]
    for k in range(12):
        a, b = rng.choice(len(scalars), 2)
        scalars.append(x.let("c", scalars[a] * scalars[b] + int(rng.integers(-2, 3))))
        i, j = rng.choice(len(lanes), 2)
        c, d = scalars[rng.integers(len(scalars))], scalars[rng.integers(len(scalars))]
        value = c * lanes[i] - d * lanes[j] if k % 3 else c * (lanes[i] + d * lanes[j])
        lanes.append(x.let("t", value, lanes=True))
    for i in range(3):
        x.set_component(B.sum if adds and i else B, str(i), lanes[-1 - i])
    x.set_component(A, "1", lanes[-5] + lanes[1])
    x.set_component(A, "9", lanes[-2])  # stored again
    x.set_component(A, "9", algebra.ZERO)
    return x.finish()


@pytest.mark.parametrize("simplified", [False, True])
@pytest.mark.parametrize("adds", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_transposed_is_transposed(seed, adds, simplified):
    rng = np.random.default_rng(seed)
    block = random_block(rng, adds)
    if simplified:
        block = simplify(block)
    back = simplify(transposed(block, "back", "back", always, NOTHING_KEPT))
    scalars = {(S, str(i)): float(rng.uniform(0.5, 1.5)) for i in range(4)}
    places = [(A, str(i)) for i in range(10)] + [(B, str(i)) for i in range(4)]

    def matrix(of: Block) -> np.ndarray:
        found = np.zeros((len(places), len(places)))
        for j, at in enumerate(places):
            after = run(of, {**scalars, **dict.fromkeys(places, 0.0), at: 1.0})
            found[:, j] = [after[p] for p in places]
        return found

    J = matrix(block)
    assert np.count_nonzero(J - np.diag(np.diag(J))) > 5
    np.testing.assert_allclose(matrix(back), J.T, rtol=1e-12, atol=1e-12 * abs(J).max())


def test_scalars_that_a_block_stores_are_kept_and_not_computed_again():
    x = Expansion("b", "", lambda store, name: True)
    a, v = x.component(S, "up"), x.component(A, "v")
    mine = x.let("mine", SYMBOLIC["sin"](a) * a)
    x.set_component(S, "me", mine)
    x.set_component(B, "w", x.let("w", mine * v, lanes=True))
    kept = Kept(lambda store, name: store is S, lambda store: KEPT, lambda store: True)
    before = values(x.finish(), "before", "", kept)
    assert [(store, name) for store, name, _ in before.stores] == [(KEPT, "me")]
    assert list(before.loads.values()) == [(KEPT, "up")]
    back = simplify(transposed(x.finish(), "back", "", always, kept))
    assert (KEPT, "me") in back.loads.values()
    assert (KEPT, "up") not in back.loads.values()
    assert not any("sin" in str(t.expression) for t in back.statements)


def test_what_is_not_linear_is_refused():
    a, b, c = map(Symbol, "abc")
    assert coefficients(c * (a - 2 * b) + a, {a, b}) == {a: c + 1, b: -2 * c}
    for wrong in (a * b, SYMBOLIC["sin"](a), a + c, a**2, a / b):
        with pytest.raises(ValueError):
            coefficients(wrong, {a, b})


C, D = Store("c", MODEL, SLOTS), Store("d", MODEL, SLOTS)


@pytest.mark.parametrize("seed", range(4))
def test_a_deferred_block_and_its_rest_do_what_the_block_does(seed):
    """What depends on a late scalar waits; what it needs of the first part is where that has stored it, or saved."""
    block = random_block(np.random.default_rng(seed), True)
    first, second = deferred(
        block,
        lambda store, n: (store, n) == (S, "2"),
        lambda i: (D, str(i)),
        lambda store, n: store is A,
    )
    late = {s for s, at in block.loads.items() if at == (S, "2")}
    assert not late & first.loads.keys() and first.stores and second.stores
    rng = np.random.default_rng(seed)
    state = {(S, str(i)): rng.uniform(0.5, 1.5) for i in range(4)}
    state |= {(store, str(i)): rng.uniform(-1, 1) for store in (A, B) for i in range(10)}
    expected, found = run(block, state), run(second, run(first, state))
    for at, value in expected.items():
        assert abs(found[at] - value) < 1e-12 * max(1.0, abs(value)), at


@pytest.mark.parametrize("seed", range(6))
def test_fused_blocks_do_what_blocks_do_one_after_the_other(seed):
    rng = np.random.default_rng(seed)
    blocks = [random_block(np.random.default_rng(10 * seed + i), bool(i % 2)) for i in range(3)]
    zero = {(B, "0"), (B, "2"), (A, "3")}
    state = {(S, str(i)): rng.uniform(0.5, 1.5) for i in range(4)}
    state |= {
        (store, str(i)): 0.0 if (store, str(i)) in zero else rng.uniform(-1, 1) for store in (A, B) for i in range(10)
    }
    expected = state
    for block in blocks:
        expected = run(block, expected)
    one = fused("one", "", blocks, lambda store, n: (store, n) in zero)
    assert len({s.target for s in one.statements}) == len(one.statements)
    assert len(set(one.loads.values())) == len(one.loads) and not zero & set(one.loads.values())
    places = [(store.plain, n) for store, n, _ in one.stores]
    assert len(set(places)) == len(places), "each place is stored once"
    assert not any(store.adds for store, n, _ in one.stores if (store.plain, n) in zero)
    for found in (run(one, state), run(simplify(one), state), run(one, state | dict.fromkeys(zero, float("nan")))):
        for at, value in expected.items():
            if at in zero and at not in places:
                continue
            assert abs(found[at] - value) < 1e-11 * max(1.0, abs(value)), at
