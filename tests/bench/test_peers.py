"""Other programs in the benchmark: each solves the same problem; programs that are not installed are listed and skipped."""

import numpy as np
import pytest

from codegen.bench.peers import comparing, programs
from codegen.bench.problem import Motion
from codegen.bench.problems.motions import ANGLES, BY_LENGTH, CART_POLE, CHAIN_MOTION, RODS
from codegen.measure import articulated_chain
from codegen.measure.models import chain_state


def test_pinocchio_has_the_same_chain():
    pytest.importorskip("pinocchio")
    (loose, *_) = programs.pinocchio(CHAIN_MOTION, RODS, *chain_state(RODS))
    values, derivatives = loose.run()
    assert values == pytest.approx(ANGLES, abs=1e-5) and derivatives is None


def test_mujoco_has_the_same_chain():
    pytest.importorskip("mujoco")
    (coarse, *_) = programs.mujoco(CHAIN_MOTION, RODS, *chain_state(RODS))
    values, derivatives = coarse.run()
    assert values == pytest.approx(ANGLES, abs=1e-7) and derivatives is None


def test_casadi_has_the_same_chain_and_its_derivative():
    casadi = pytest.importorskip("casadi")
    q, u = chain_state(RODS)
    z, L, rate = programs.casadi_rates(RODS)
    function = casadi.Function("rate", [z, L], [rate])
    dq, du = 0.1 * np.sin(np.arange(4)), 0.2 * np.cos(np.arange(4))

    def udot(h):
        parts = list(q + h * dq), list(u + h * du), 1 + h
        return np.array(articulated_chain.accelerations(*parts, np.sin, np.cos, 1.0, 0.05, 9.81))

    found = np.split(np.asarray(function(np.concatenate([q, u, dq, du]), 1.0)).ravel(), 4)
    assert found[0] == pytest.approx(u) and found[2] == pytest.approx(du)
    assert found[1] == pytest.approx(udot(0.0), rel=1e-12)
    h = 1e-5
    assert found[3] == pytest.approx((udot(h) - udot(-h)) / (2 * h), rel=1e-7)


@pytest.mark.campaign
def test_cvodes_solves_the_chain_with_its_derivatives():
    pytest.importorskip("casadi")
    *_, tight = programs.casadi(CHAIN_MOTION, RODS, *chain_state(RODS))
    values, (by_length,) = tight.run()
    assert values == pytest.approx(ANGLES, abs=1e-10)
    assert by_length == pytest.approx(BY_LENGTH, abs=1e-9)


def test_without_others_scipy_and_ours_are_compared_and_the_rest_is_told(tmp_path, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0")
    monkeypatch.setattr(comparing.importlib.util, "find_spec", lambda name: object() if name == "scipy" else None)
    monkeypatch.setattr(programs, "SCIPY", (("DOP853", (1e-4,)), ("Radau", ())))
    monkeypatch.setattr(comparing, "TREES", ("cart_pole",))
    short = Motion(**{**vars(CART_POLE), "end": 0.1, "exact": lambda: SHORT})
    found = comparing.compare_with_peers([short], tmp_path, True, lambda *a: None)
    assert found["skipped"].keys() == {"CasADi", "Pinocchio", "MuJoCo"}
    assert found["skipped"]["CasADi"] == "casadi is not installed (pip install ordernm[peers])"
    rows = found["problems"]["cart_pole"]
    assert {row["who"] for row in rows} == {"ordernm, from Python", "SciPy, our accelerations"}
    assert all(row["error"] < 1e-3 and row["seconds"] > 0 for row in rows)


SHORT = (1.5217266372411218006, -0.98218222742784641825, 0.0012036744627212517131, 0.048175990056133427544)
"""The light cart and its pole at 0.1 s, from the same quadrature."""
