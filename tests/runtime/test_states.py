"""States: accepted at once if closed, in batches, and with some coordinates given by name."""

import copy
import pickle
import threading
from pathlib import Path

import numpy as np
import pytest

import codegen


@pytest.fixture(scope="module", params=["c", "numpy"])
def four_bar(request, packages):
    return codegen.load(packages / "four_bar", request.param)


@pytest.fixture
def evaluations(four_bar, monkeypatch):
    """Names of the generated functions without directions that a call evaluates."""
    called = []
    run, calls = four_bar._target.run, four_bar._calls

    def counted(task):
        called.append(task.f.name)
        run(task)

    class Counted(dict):
        def __missing__(self, wanted):
            def counted_alone(given, seeds, out):
                found = calls[wanted](given, seeds, out)
                if found is not None:
                    called.append(getattr(wanted, "name", wanted))
                return found

            return counted_alone

    monkeypatch.setattr(four_bar._target, "run", counted)
    for place, name in ((four_bar, "_calls"), (four_bar._target, "calls")):
        monkeypatch.setattr(place, name, Counted())
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


# ---- by name ---------------------------------------------------------------------------------------------------------


def test_a_mapping_leaves_the_others_at_their_initial_values(four_bar):
    q0, u0 = four_bar.initial
    names = four_bar.coordinate_names
    q, u = four_bar.assemble({"crank": 1.0})
    guess = q0.copy()
    guess[names.index("crank")] = 1.0
    np.testing.assert_array_equal(q, four_bar.assemble(guess, u0)[0])
    assert np.abs(four_bar.closure(q, u)[0]).max() < 1e-14
    np.testing.assert_array_equal(u, four_bar.assemble(guess)[1])
    full = u0.copy()
    full[four_bar.speed_names.index("crank")] = 0.5
    np.testing.assert_array_equal(four_bar.accelerations(q, {"crank": 0.5}), four_bar.accelerations(q, full))
    several, _ = four_bar.assemble({"crank": [0.9, 1.0, 1.1]})
    assert several.shape == (3, four_bar.nq)
    np.testing.assert_array_equal(several[1], q)
    with pytest.raises(ValueError, match=r"q: 'cranck' is not known; .*did you mean 'crank'"):
        four_bar.assemble({"cranck": 1.0})
    with pytest.raises(ValueError, match=r"u: 'c' is not known; expected one of crank, coupler, rocker"):
        four_bar.accelerations(q, {"c": 1.0})


def test_mappings_leave_out_a_closed_state_at_other_parameters(four_bar):
    p = {"crank_length": 1.1 * four_bar.parameters[0]}
    q, u = four_bar.initial_state(p)
    assert np.abs(q - four_bar.initial[0]).max() > 1e-2  # other lengths close otherwise
    np.testing.assert_array_equal(four_bar.accelerations({}, {}, p), four_bar.accelerations(q, u, p))
    np.testing.assert_array_equal(four_bar.closure({"crank": q[0]}, {}, p)[0], four_bar.closure(q, u, p)[0])
    q, u = four_bar.assemble({"crank": 1.0}, p=p)
    assert np.abs(four_bar.closure(q, u, p)[0]).max() < 1e-13


def test_mappings_at_parameters_that_the_initial_crank_cannot_close(four_bar):
    """Rods too short for the crank where it is, and long enough for one that points at the rocker's hinge."""
    p = {"coupler_length": 0.3, "rocker_length": 0.48}
    with pytest.raises(codegen.runtime.AssemblyError):
        four_bar.initial_state(p)
    q, u = four_bar.assemble({"crank": 0.1}, p=p)
    assert np.abs(four_bar.closure(q, u, p)[0]).max() < 1e-13


def test_seeds_by_name_are_zero_elsewhere(four_bar):
    q, u = four_bar.initial
    dq = np.zeros(four_bar.nq)
    dq[four_bar.coordinate_names.index("crank")] = 1.0
    by_name = four_bar.sensitivities(q, u, dq={"crank": 1.0}, du={"crank": 0.0}, dinputs={"motor": 2.0})[1]
    np.testing.assert_array_equal(by_name, four_bar.sensitivities(q, u, dq=dq, dinputs=[2.0])[1])


# ---- initial values that follow parameters ---------------------------------------------------------------------------

EXAMPLE = Path(__file__).parents[2] / "examples" / "four_bar.yaml"
TREE = """\
model: tree
parameters: {lambda: 0.3, k: 2.0}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -0.5], inertia: {xx: 1, yy: 1, zz: 1}}
  b: {parent: a, joint: {type: spherical, at: [0, 0, -1]}, mass: 1, com: [0, 0, -0.5], inertia: {xx: 1, yy: 1, zz: 1}}
initial:
  q: {a: 0.3*lambda, b: [cos(lambda), k/2*sin(lambda), 0, 0]}
  u: {b.wx: lambda**2}
"""


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """Packages whose initial values are expressions of parameters."""
    folder = tmp_path_factory.mktemp("moving")
    text = EXAMPLE.read_text()
    changed = text.replace(
        "q: {crank: 0.8, coupler: -0.4, rocker: -1.9}",
        "q: {crank: 2*crank_length, coupler: -0.4, rocker: -1.5 - crank_length}",
    ).replace("u: {crank: 3.0}", "u: {crank: 7.5*crank_length}")
    assert changed.count("crank_length") == text.count("crank_length") + 3
    codegen.generate(codegen.parse_model(changed), folder / "four_bar")
    codegen.generate(codegen.parse_model(TREE), folder / "tree")
    return folder


@pytest.fixture(params=["c", "numpy"])
def moved(request, moving):
    return {name: codegen.load(moving / name, request.param) for name in ("four_bar", "tree")}


def test_initial_values_follow_parameters(moved):
    tree = moved["tree"]
    q, u = tree.initial_state({"lambda": 1.0, "k": 3.0})
    e = np.array([np.cos(1.0), 1.5 * np.sin(1.0), 0.0, 0.0])
    e /= np.linalg.norm(e)
    np.testing.assert_allclose(q, [0.3, *e], rtol=1e-15)
    np.testing.assert_allclose(u, [0.0, 1.0, 0.0, 0.0], rtol=1e-15)
    for a, b in zip(tree.assemble(p={"lambda": 1.0, "k": 3.0}), (q, u), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(tree.assemble({"a": 5.0}, p={"lambda": 1.0, "k": 3.0})[0], [5.0, *q[1:]])
    batch, _ = tree.initial_state({"lambda": [0.3, 1.0], "k": [2.0, 3.0]})
    np.testing.assert_array_equal(batch, [tree.initial[0], q])


def test_initial_values_of_loops_follow_parameters_and_close(moved):
    solver = moved["four_bar"]
    p = {"crank_length": 0.45, "rocker_length": 0.95}
    q, u = solver.initial_state(p)
    assert q[0] == pytest.approx(0.9, rel=1e-15) and u[0] == pytest.approx(3.375, rel=1e-15)
    position, velocity = solver.closure(q, u, p)
    assert max(np.abs(position).max(), np.abs(velocity).max()) < 1e-13
    for a, b in zip(solver.initial_state(), solver.initial, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["four_bar", "tree"])
def test_the_derivative_of_the_initial_state(moved, name):
    solver = moved[name]
    p, dp = solver.parameters * 1.05, np.eye(solver.np)
    q, u, dq, du = solver.initial_sensitivities(p, dp=dp)
    for a, b in zip((q, u), solver.initial_state(p), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-15)
    step = 1e-5  # a coarse check of all of it; what it is made of is exact, and compared below
    for j in range(solver.np):
        ahead, behind = (solver.initial_state(p + s * dp[j]) for s in (step, -step))
        for d, a, b in zip((dq[j], du[j]), ahead, behind, strict=True):
            np.testing.assert_allclose(d, (a - b) / (2 * step), rtol=1e-6, atol=1e-7)
    if name == "four_bar":
        given_q, given_u = np.zeros((solver.np, solver.nq)), np.zeros((solver.np, solver.nu))
        given_q[0, 0], given_u[0, 0] = 2.0, 7.5
        expected = solver.assemble_sensitivities(q, u, p, dq=given_q, du=given_u, dp=dp)
        for a, b in zip((q, u, dq, du), expected, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)


def test_constant_initial_values_have_the_derivative_of_closure_alone(four_bar):
    dp = np.eye(four_bar.np)
    found = four_bar.initial_sensitivities(dp=dp)
    for a, b in zip(found, four_bar.assemble_sensitivities(*four_bar.initial, dp=dp), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14)
    crank = four_bar.coordinate_names.index("crank")
    assert not found[2][:, crank].any() and found[2].any()


# ---- the same arguments for all --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sprung(tmp_path_factory):
    text = """\
model: sprung
parameters: {k: 100.0}
inputs: [length]
bodies:
  block: {parent: ground, joint: {type: prismatic, axis: x}, mass: 2}
forces:
  spring: {type: spring, from: {body: ground}, to: {body: block}, stiffness: k*(1 + t), free_length: length}
"""
    return codegen.generate(codegen.parse_model(text), tmp_path_factory.mktemp("packages") / "sprung").folder


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_energies_take_inputs_and_time(sprung, target):
    solver = codegen.load(sprung, target)
    q, u, p, inputs, t = [0.7], [0.3], [100.0], [0.4], 0.5
    kinetic, potential = solver.energies(q, u, p, inputs, t)
    assert kinetic == pytest.approx(0.09, rel=1e-14)
    assert potential == pytest.approx(0.5 * 150.0 * 0.3**2, rel=1e-13)
    _, (_, dV) = solver.energy_sensitivities(
        q, u, p, inputs, t, dq=[[1.0], [0.0], [0.0]], dinputs=[[0.0], [1.0], [0.0]], dt=[0, 0, 1.0]
    )
    np.testing.assert_allclose(dV, [150.0 * 0.3, -150.0 * 0.3, 0.5 * 100.0 * 0.3**2], rtol=1e-12)


STATE = ["accelerations", "jacobians", "coordinate_rates", "energies", "outputs", "closure", "assemble"]
ALONG = [
    "sensitivities", "coordinate_rate_sensitivities", "energy_sensitivities", "output_sensitivities", "closure_sensitivities",
    "assemble_sensitivities",
]  # fmt: skip


@pytest.mark.parametrize("name", STATE + ALONG)
def test_every_member_of_a_state_takes_and_checks_the_same_arguments(four_bar, name):
    q, u = four_bar.initial
    p, inputs, t = four_bar.parameters, np.zeros(four_bar.ninputs), 0.25
    seeds = (
        {"dp": np.eye(four_bar.np)[:1], "dinputs": np.ones((1, four_bar.ninputs)), "dt": np.ones(1)}
        if name in ALONG
        else {}
    )
    call = getattr(four_bar, name)
    call(q, u, p, inputs, t, **seeds)
    for said, given in {
        "u ": (q, u[:-1], p, inputs, t), "p": (q, u, p[:-1], inputs, t), "inputs": (q, u, p, [np.nan] * inputs.size, t),
        "t is": (q, u, p, inputs, np.inf), "inputs has": (q, u, p, [1.0] * (inputs.size + 1), t),
    }.items():  # fmt: skip
        with pytest.raises(ValueError, match=f"^{said}"):
            call(*given, **seeds)
    if seeds:
        with pytest.raises(ValueError, match=r"^dinputs"):
            call(q, u, p, inputs, t, **{**seeds, "dinputs": [[np.inf] * inputs.size]})


# ---- partitions ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two_partitions(tmp_path_factory):
    return codegen.generate(EXAMPLE, tmp_path_factory.mktemp("packages") / "four_bar", partitions=2).folder


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_other_threads_compute_with_their_partition_while_conditions_are_asked_for(two_partitions, target):
    solver = codegen.load(two_partitions, target)
    q, u = solver.initial
    u = u + [0.3, -0.2, 0.5]  # dependent speeds are ignored: other independent ones are another motion
    expected = solver.accelerations(q, u)
    solver.use_partition(1)
    assert np.abs(solver.accelerations(q, u) - expected).max() > 1e-2
    solver.use_partition(0)
    batch = np.broadcast_to(q, (40, q.size))
    conditions, stop = [], threading.Event()

    def ask():
        while not stop.is_set():
            conditions.append(solver.condition(batch))

    threads = [threading.Thread(target=ask) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        found = [solver.accelerations(x, u) for _ in range(300) for x in (q, q.tolist())]
        assembled = [solver.assemble(q + [0.0, 0.1, 0.1], u)[0][0] for _ in range(20)]
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert len(conditions) > 2 and all(np.array_equal(x, conditions[0]) for x in conditions)
    np.testing.assert_array_equal(found, [expected] * len(found))
    assert assembled == [q[0]] * len(assembled)  # the first partition's independent coordinate is kept


def test_conditions_leave_the_partition_alone(two_partitions):
    solver = codegen.load(two_partitions)
    assert len(solver.partitions) == 2
    q, u = solver.initial
    seen = set()
    stop = threading.Event()

    def watch():
        while not stop.is_set():
            seen.add((solver.partition, solver.independent_names))

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        for _ in range(50):
            assert np.isfinite(solver.condition(q)).all()
    finally:
        stop.set()
        thread.join()
    assert seen == {(0, solver.partitions[0])}
    for wrong in (0.5, "1", None, True, [0]):
        with pytest.raises(ValueError, match=r"partition is .*, expected an integer below 2"):
            solver.use_partition(wrong)
    for wrong in (2, -1):
        with pytest.raises(ValueError, match=f"partition is {wrong}, expected 0 to 1"):
            solver.use_partition(wrong)
    udot = solver.accelerations(q, u)
    solver.use_partition(np.int64(1))
    np.testing.assert_allclose(solver.accelerations(q, u), udot, rtol=1e-10)
    # a copy reads the same entries of u
    independent = solver.independent_names
    assert independent != solver.partitions[0]
    for other in (copy.copy(solver), copy.deepcopy(solver), pickle.loads(pickle.dumps(solver))):
        assert (other.partition, other.independent_names) == (1, independent)
        np.testing.assert_array_equal(other.accelerations(q, 2 * u), solver.accelerations(q, 2 * u))


def test_as_many_partitions_as_there_are(tmp_path):
    """A four-bar has three choices, and all say the same."""
    report = codegen.generate(EXAMPLE, tmp_path / "four_bar", partitions=4, functions="dynamics")
    assert "no fourth partition: no other choice of independent coordinates closes the loops" in report.loops
    solver = codegen.load(tmp_path / "four_bar")
    assert sorted(solver.partitions) == sorted((name,) for name in solver.coordinate_names)
    assert (tmp_path / "four_bar" / "four_bar_third.c").exists()
    q, u = solver.initial
    udot = solver.accelerations(q, u)
    exact = solver.in_precision(30, EXAMPLE)
    for k in (1, 2):
        solver.use_partition(k)
        np.testing.assert_allclose(solver.accelerations(q, u), udot, rtol=1e-11)
        exact.use_partition(k)
        np.testing.assert_allclose(np.array(exact.accelerations(q, u), float), udot, rtol=1e-11)
    assert solver.condition(q).shape == (3,)
    codegen.generate(EXAMPLE, tmp_path / "four_bar", partitions=1, compile=False)
    assert not (tmp_path / "four_bar" / "four_bar_third.c").exists(), "written anew, libraries and all"
    for wrong in (0, 5, True, "2"):
        with pytest.raises(ValueError, match="allowed are 1 to 4"):
            codegen.generate(EXAMPLE, tmp_path / "four_bar", partitions=wrong)
