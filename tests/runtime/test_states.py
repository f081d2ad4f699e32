"""States: assembled at once where they are closed, in batches, and from some coordinates by name."""

import numpy as np
import pytest

import codegen


@pytest.fixture(scope="module", params=["c", "numpy"])
def four_bar(request, packages):
    return codegen.load(packages / "four_bar", request.param)


@pytest.fixture
def evaluations(four_bar, monkeypatch):
    """Names of the generated functions without directions that were called."""
    called = []
    values = four_bar._target.values

    def counted(f, *arguments):
        called.append(f.name)
        return values(f, *arguments)

    monkeypatch.setattr(four_bar._target, "values", counted)
    return called


def test_a_closed_state_is_left_at_once(four_bar, evaluations):
    q, u = four_bar.assemble({"crank": 1.3, "coupler": -0.4, "rocker": 1.0})
    evaluations.clear()
    again = four_bar.assemble(q, u)
    assert evaluations == ["closure", "completion"]
    assert np.array_equal(again[0], q)
    np.testing.assert_allclose(again[1], u, rtol=1e-14, atol=1e-14)


def test_of_a_batch_only_open_states_are_moved(four_bar, evaluations):
    q, u = four_bar.initial
    batch = np.tile(q, (2, 2, 1))
    batch[1, 0, four_bar.coordinate_names.index("crank")] += 0.1
    evaluations.clear()
    found, _ = four_bar.assemble(batch, u)
    assert evaluations.count("newton_step") < 8
    alone, _ = four_bar.assemble(batch[1, 0], u)
    assert np.array_equal(found[1, 0], alone)
    for state in ((0, 0), (0, 1), (1, 1)):
        assert np.array_equal(found[state], q)
    assert np.abs(four_bar.closure(found, u)[0]).max() < 1e-14
