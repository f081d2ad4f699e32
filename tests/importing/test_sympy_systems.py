"""Systems of `sympy.physics.mechanics` as models: accelerations are those of sympy's own equations."""

from __future__ import annotations

from pathlib import Path

import pytest
from sympy_systems import EXAMPLES, errors


@pytest.mark.parametrize("name", EXAMPLES)
def test_accelerations_are_those_of_form_eoms(name: str, tmp_path: Path) -> None:
    system, values = EXAMPLES[name]()
    assert max(errors(system, values, tmp_path)) < 1e-10
