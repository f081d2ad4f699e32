"""Which speeds become dependent, in which ears, at which rank."""

import numpy as np
import pytest
from loops.mechanisms import bricard, four_bar, ladder, pinned

from codegen.loops import closure, complete_speeds, partition


def names(model, speeds):
    return [model.speed_names[s] for s in speeds]


@pytest.mark.parametrize("model", [four_bar(), ladder(5), ladder(30, wrong=0.05), pinned(12), bricard()])
def test_the_initial_configuration_and_completed_speeds_close_all_loops(model):
    found = partition(model)
    u = complete_speeds(model, found, found.q, np.random.default_rng(1).normal(size=model.nu))
    position, velocity = closure(model, found.q, u)
    assert np.abs(position).max() < 1e-13
    assert np.abs(velocity).max() < 1e-13
