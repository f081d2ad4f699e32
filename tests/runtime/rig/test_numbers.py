"""Results that the run time computes itself: agreement of targets, assembly, closure, energies, outputs; threads, processes."""

import copy
import math
import multiprocessing
import pickle
import threading

import numpy as np
import pytest

import codegen
from codegen.reference import RecursiveEngine


@pytest.fixture(scope="module")
def both(rig_folder):
    return codegen.load(rig_folder, "c"), codegen.load(rig_folder, "numpy")


def test_targets_agree(both, tools):
    rng = np.random.default_rng(20)
    for function, names in {**tools.VALUES, **tools.ALONG}.items():
        given = tools.draw(rng, both[0], names.split(), dict.fromkeys(names.split(), (3,)))
        seeds = {"dq": rng.normal(size=(4, 3, 6)), "dp": rng.normal(size=(4, 3, 3))} if function in tools.ALONG else {}
        results = [tools.flat(getattr(s, function)(**given, **seeds)) for s in both]
        for a, b in zip(*results, strict=True):
            assert a.shape == b.shape and a.dtype == b.dtype == np.float64
            np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11)


def test_the_solver_has_the_names_of_the_model(rig):
    assert rig.coordinate_names == ("arm", "ball.qw", "ball.qx", "ball.qy", "ball.qz", "disc")
    assert rig.speed_names == ("arm", "ball.wx", "ball.wy", "ball.wz", "disc")
    assert rig.parameter_names == ("length", "mass", "wheel") and rig.input_names == ("motor", "wind")
    assert rig.output_names == ("height", "speed", "energy", "power")
    assert rig.independent_names == rig.coordinate_names and rig.independent_speed_names == rig.speed_names
    assert rig.closure_names == rig.prescribed_names == ()
    assert (rig.nq, rig.nu, rig.np, rig.ninputs, rig.noutputs) == (6, 5, 3, 2, 4)
    assert rig.initial[0].tolist() == [0.3, 1, 0, 0, 0, 0] and rig.initial[1].tolist() == [0, 0.5, 0, 0, 0]
    assert "rig" in repr(rig) and "nq=6" in repr(rig)


def test_derivatives_in_inputs_and_time(either, tools):
    # a model with time and inputs against the generic engine; random trees are compared elsewhere
    engine = RecursiveEngine(tools.rig_model)
    rng = np.random.default_rng(21)
    given = tools.draw(rng, either, "q u p inputs t".split())
    seeds = tools.draw(rng, either, "dq du dp dinputs dt".split(), dict.fromkeys("dq du dp dinputs dt".split(), (3,)))
    for a, b in zip(
        either.sensitivities(**given, **seeds), engine.sensitivities(*given.values(), **seeds), strict=True
    ):
        np.testing.assert_allclose(a, np.asarray(b), rtol=1e-10, atol=1e-10)


def test_assembly_normalises(either):
    rng = np.random.default_rng(22)
    q, u = rng.normal(size=(4, 6)), rng.normal(size=5)
    q0 = q.copy()
    found, speeds = either.assemble(q, u)
    assert found.shape == (4, 6) and speeds.shape == (4, 5)
    np.testing.assert_allclose(np.linalg.norm(found[:, 1:5], axis=-1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(found[:, 1:5], q0[:, 1:5] / np.linalg.norm(q0[:, 1:5], axis=-1, keepdims=True))
    np.testing.assert_array_equal(found[:, [0, 5]], q0[:, [0, 5]])
    np.testing.assert_array_equal(q, q0)
    again, _ = either.assemble(found, u)
    np.testing.assert_allclose(again, found, rtol=1e-15)
    default = either.assemble()
    for a, b in zip(default, either.initial, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(either.assemble(u=u)[1], u)


def test_assembly_sensitivities_are_its_derivative(either):
    mpmath = pytest.importorskip("mpmath")
    rng = np.random.default_rng(23)
    q, u, dq, du = rng.normal(size=6), rng.normal(size=5), rng.normal(size=(2, 6)), rng.normal(size=(2, 5))
    found = either.assemble_sensitivities(q, u, dq=dq, du=du)
    np.testing.assert_array_equal(found[0], either.assemble(q, u)[0])
    np.testing.assert_array_equal(found[3], du)
    with mpmath.workdps(40):
        for j in range(2):
            for i in range(6):

                def entry(h, i=i, j=j):
                    e = [mpmath.mpf(float(a)) + h * mpmath.mpf(float(b)) for a, b in zip(q, dq[j], strict=True)]
                    return e[i] / mpmath.sqrt(sum(x**2 for x in e[1:5])) if 1 <= i < 5 else e[i]

                assert math.isclose(float(mpmath.diff(entry, 0)), found[2][j, i], rel_tol=1e-12, abs_tol=1e-14)
    radial = np.zeros(6)
    radial[1:5] = q[1:5]
    assert np.abs(either.assemble_sensitivities(q, u, dq=radial)[2]).max() < 1e-15
    assert not either.assemble_sensitivities(q, u, dp=np.ones(3))[2].any()


def test_a_quaternion_of_any_length_is_its_rotation(either, tools):
    rng = np.random.default_rng(24)
    given = tools.draw(rng, either, "q u p inputs t".split())
    long = given["q"].copy()
    long[1:5] *= 3.0
    np.testing.assert_allclose(either.accelerations(**{**given, "q": long}), either.accelerations(**given), rtol=1e-12)
    radial = np.zeros(6)
    radial[1:5] = given["q"][1:5]
    udot, dudot = either.sensitivities(**given, dq=radial)
    assert np.abs(dudot).max() < 1e-13 * np.abs(udot).max()


def test_closure_of_a_tree_is_empty(either):
    position, velocity = either.closure(np.ones((3, 6)), np.ones(5))
    assert position.shape == velocity.shape == (3, 0)


def test_energies_and_outputs_by_hand(either):
    q, u, p = np.array([0.4, 1.0, 0, 0, 0, 0]), np.array([0.7, 0, 0, 0, 0.3]), {"length": 0.5, "mass": 2.0}
    kinetic, potential = either.energies(q, u, p)
    c, w = math.cos(0.4), 0.7
    box = 2 * (0.2**2 + 0.4**2) / 12
    by_hand = 0.5 * w**2 * (2 * 0.25**2 + 2 * 0.25 / 12) + 0.5 * w**2 * (2 * 0.7**2 + box) + 0.5 * 0.02 * (w + 0.3) ** 2
    assert math.isclose(kinetic, by_hand, rel_tol=1e-12)
    assert math.isclose(potential, 9.81 * (2 * -0.25 * c + 2 * -0.7 * c), rel_tol=1e-12)
    height, speed, energy, power = either.outputs(q, u, p, [3.0, 0.5], 2.0)
    assert math.isclose(height, -0.7 * c, rel_tol=1e-12)
    assert math.isclose(speed, -0.5 * c * w, rel_tol=1e-12)
    assert math.isclose(energy, kinetic, rel_tol=1e-12)
    assert math.isclose(power, 3.0 * 0.7 + 2.0 * 0.5, rel_tol=1e-12)


def test_identities(either, tools):
    rng = np.random.default_rng(25)
    g = tools.draw(rng, either, "q u p inputs t udot b".split(), dict.fromkeys("q u p inputs t udot b".split(), (3,)))
    q, u, p, rest = g["q"], g["u"], g["p"], (g["p"], g["inputs"], g["t"])
    M, bias = either.mass_matrix(q, p), either.bias_force(q, u, *rest)
    np.testing.assert_allclose(M, np.swapaxes(M, -1, -2))
    force = np.einsum("...ij,...j", M, g["udot"]) + bias
    np.testing.assert_allclose(either.inverse_dynamics(q, u, g["udot"], *rest), force, rtol=1e-10, atol=1e-12)
    udot = either.accelerations(q, u, *rest)
    np.testing.assert_allclose(np.einsum("...ij,...j", M, udot) + bias, 0, atol=1e-10)
    np.testing.assert_allclose(np.einsum("...ij,...j", M, either.solve_mass(q, g["b"], p)), g["b"], atol=1e-11)
    np.testing.assert_allclose(either.energies(q, u, p)[0], 0.5 * np.einsum("...i,...ij,...j", u, M, u), rtol=1e-11)


def test_threads_share_a_solver(either, tools):
    rng = np.random.default_rng(26)
    names = "q u p inputs t".split()
    states = [tools.draw(rng, either, names) for _ in range(8)]
    batches = [tools.draw(rng, either, names, dict.fromkeys(names, (50,))) for _ in range(8)]
    dq = rng.normal(size=(3, 6))
    rounds = 40 if either.target == "c" else 3

    def work(i):
        return (
            either.accelerations(**states[i]), either.sensitivities(**states[i], dq=dq)[1],
            either.jacobians(**states[i]).p, either.accelerations(**batches[i]), either.mass_matrix(batches[i]["q"]),
        )  # fmt: skip

    expected = [work(i) for i in range(8)]
    wrong = []
    gate = threading.Barrier(8)

    def run(i):
        gate.wait()
        for _ in range(rounds):
            for a, b in zip(work(i), expected[i], strict=True):
                if not np.array_equal(a, b):
                    wrong.append(i)

    threads = [threading.Thread(target=run, args=(i,)) for i in range(8)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert not wrong


def test_first_calls_of_many_threads(rig_folder):
    # functions and workspaces are made at the first call: eight threads make them at once
    solver = codegen.load(rig_folder)
    q, u = solver.initial
    gate, results = threading.Barrier(8), []

    def run():
        gate.wait()
        results.append(np.concatenate([solver.accelerations(q, u), solver.sensitivities(q, u, dq=np.ones(6))[1][0]]))

    threads = [threading.Thread(target=run) for _ in range(8)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(results) == 8 and all(np.array_equal(r, results[0]) for r in results)


def accelerate(solver, q):
    return solver.accelerations(q, np.zeros(5))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # fork in a process with threads
def test_a_forked_process_uses_the_solver(rig):
    qs = [np.array([x, 1.0, 0, 0, 0, 0]) for x in (0.1, 0.2, 0.3)]
    expected = [accelerate(rig, q) for q in qs]
    reader, writer = multiprocessing.Pipe(False)

    def child():
        writer.send([accelerate(rig, q) for q in qs])

    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    assert reader.poll(20)
    found = reader.recv()
    process.join(20)
    assert process.exitcode == 0
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("make", [copy.copy, copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s))])
def test_a_solver_can_be_copied_and_pickled(either, make):
    # what a pool of processes does with its arguments
    other = make(either)
    q, u = either.initial
    assert other.target == either.target and other is not either
    np.testing.assert_array_equal(other.accelerations(q, u), either.accelerations(q, u))
