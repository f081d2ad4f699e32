"""Calls that go directly to C against the general path, on random functions and kinds of arguments."""

import gc
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.runtime import PointMotion
from codegen.runtime.standalone.calls.single_calls import NoCalls

EXAMPLES = Path(__file__).parents[2] / "examples"
WALK = 120
OF_STATE = (
    "accelerations", "coordinate_rates", "energies", "outputs", "bias_force", "closure", "reactions", "jacobians", "frames",
    "points", "assemble", "frame_jacobians", "point_jacobians",
)  # fmt: skip
ALONG = (
    "sensitivities", "coordinate_rate_sensitivities", "energy_sensitivities", "output_sensitivities",
    "closure_sensitivities", "reaction_sensitivities", "frame_sensitivities", "point_sensitivities",
    "assemble_sensitivities", "bias_force_sensitivities",
)  # fmt: skip
WEIGHTED = {
    "gradients": "nu",
    "output_gradients": "noutputs",
    "coordinate_rate_gradients": "nq",
    "assemble_gradients": "nq",
}
TAKE_OUT = {
    "accelerations", "coordinate_rates", "outputs", "bias_force", "sensitivities", "coordinate_rate_sensitivities",
    "output_sensitivities", "bias_force_sensitivities",
}  # fmt: skip


@pytest.fixture(scope="module", params=["arm", "four_bar", "satellite", "shaken_pendulum", "four_bar in float32"])
def folder(request, tmp_path_factory):
    name, _, scalar = request.param.partition(" in ")
    found = tmp_path_factory.mktemp("kinks") / name
    options = {"scalar": scalar} if scalar else {}
    codegen.generate(
        EXAMPLES / f"{name}.yaml", found, reactions=True, frames=True, check=False, compile="all", **options
    )
    return found


@pytest.fixture(params=["api", "abi"])
def both(request, folder, monkeypatch):
    """A solver, and the same solver with the general path only."""
    monkeypatch.setenv("ORDERNM_CFFI", request.param)
    fast, general = (codegen.load(folder, "c") for _ in range(2))
    general._calls = general._target.calls = NoCalls()
    return fast, general


def kinks(rng, x, names):
    """Equivalent ways to pass an array, and some wrong ones."""
    strided = np.repeat(x, 2, axis=-1)[..., ::2]
    apart = np.frombuffer(b"\0" + x.tobytes(), np.uint8)[1:].view(x.dtype).reshape(x.shape)
    frozen = x.copy()
    frozen.flags.writeable = False
    ways = [x, strided, apart, frozen, np.asfortranarray(x), x[..., ::-1].copy()[..., ::-1], x.tolist(), x.astype(np.float32),
            x.astype(float), x.astype(">f8"), x.view(type("Own", (np.ndarray,), {})), x[..., :-1], x[None]]  # fmt: skip
    if x.ndim == 1 and names:
        some = rng.permutation(len(names))[: rng.integers(1, len(names) + 1)]
        ways += [{names[i]: float(x[i]) for i in some}, {names[i]: x[i] for i in some}, {"nothing of that name": 1.0}]
    if x.size:
        bad = x.copy()
        bad.flat[rng.integers(x.size)] = rng.choice([np.nan, np.inf])
        ways.append(bad)
    return ways[rng.integers(len(ways))]


def states(solver, rng, n):
    """Closed states, one or several, with parameters, inputs and times."""
    lead = () if n is None else (n,)
    q, u = solver.initial
    q = q + 0.02 * rng.normal(size=(*lead, solver.nq))
    u = rng.normal(size=(*lead, solver.nu))
    t = float(rng.uniform()) if n is None or rng.random() < 0.5 else rng.uniform(size=n)
    p = solver.parameters * rng.uniform(0.99, 1.01, solver.np)
    inputs = rng.normal(size=(*lead, solver.ninputs))
    if solver.closure_names:
        q, u = solver.assemble(q, u, p, inputs, t)
    return tuple(x if isinstance(x, float) else x.astype(solver.parameters.dtype) for x in (q, u, p, inputs, t))


def passed(solver, rng, arrays):
    """The same with a kink in some of them; parameters and inputs may be left out."""
    names = (solver.coordinate_names, solver.speed_names, solver.parameter_names, solver.input_names)
    found = [kinks(rng, x, n) if rng.random() < 0.25 else x for x, n in zip(arrays[:4], names, strict=True)]
    for i in (2, 3):
        found[i] = None if rng.random() < 0.2 else found[i]
    times = [arrays[4], 0, True, np.float64(0.3), np.float32(0.3), np.array(0.25)]
    return (*found, times[rng.integers(len(times))] if rng.random() < 0.2 else arrays[4])


def draw_call(solver, rng):
    """A function and its arguments."""
    n = None if rng.random() < 0.6 else int(rng.integers(1, 6))
    q, u, p, inputs, t = states(solver, rng, n)
    given = passed(solver, rng, (q, u, p, inputs, t))
    name = str(rng.choice([*OF_STATE, *ALONG, *WEIGHTED]))
    k, named = int(rng.choice([1, 2, 3, 8, 9])), {}
    middle = [(), (1,), (n,)][rng.integers(3)] if n else ()
    if name in ALONG:
        sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np, "dinputs": solver.ninputs}
        of = (solver.coordinate_names, solver.speed_names, solver.parameter_names, solver.input_names)
        for (seed, size), names in zip(sizes.items(), of, strict=True):
            if rng.random() < 0.6:
                x = rng.normal(size=size if k == 1 and rng.random() < 0.5 else (k, *middle, size)).astype(q.dtype)
                named[seed] = kinks(rng, x, names) if rng.random() < 0.25 else x
        if rng.random() < 0.3:
            named["dt"] = 0.5 if k == 1 else rng.normal(size=(k, *middle)).astype(q.dtype)
    if name in WEIGHTED:
        weights = rng.normal(size=(k, *middle, getattr(solver, WEIGHTED[name]))).astype(q.dtype)
        named["weights_q" if name.startswith("assemble") else "weights"] = weights
    if name in ("points", "point_sensitivities", "frames", "frame_sensitivities"):
        named["accelerations"] = bool(rng.random() < 0.5)
    if name.startswith("point"):
        body = solver._manifest["bodies"][-1]
        named["points"] = [[(body, (0.1, 0.2, -0.3)), body, "ground"], (body, (0.1, 0.2, -0.3)), None][rng.integers(3)]
    return name, given, named


def outcome(solver, name, given, named):
    try:
        return getattr(solver, name)(*given, **named)
    except (ValueError, TypeError, AttributeError) as error:
        return f"{type(error).__name__}: {error}"


def arrays_of(x):
    """All arrays of a result."""
    if isinstance(x, np.ndarray):
        return [x]
    if isinstance(x, (tuple, list)):
        return [a for part in x for a in arrays_of(part)]
    names = getattr(type(x), "__dataclass_fields__", {})
    return [a for n in names if n != "names" for a in arrays_of(getattr(x, n))]


def check_same(a, b, what):
    if isinstance(a, str) or isinstance(b, str):
        assert isinstance(a, str) and a == b, what
        return
    points = isinstance(a[0] if isinstance(a, tuple) and a else a, PointMotion)  # whose sums the C joins otherwise
    for x, y in zip(arrays_of(a), arrays_of(b), strict=True):
        assert x.shape == y.shape and x.dtype == y.dtype, what
        if points or what[0] == "point_jacobians":
            allowed = 1e-12 if x.dtype == np.float64 else 2e-5
            np.testing.assert_allclose(x, y, rtol=allowed, atol=allowed, err_msg=str(what))
        else:
            np.testing.assert_array_equal(x, y, err_msg=str(what))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in range(20, 60))])
def test_a_random_walk_over_functions_and_arguments(both, seed):
    fast, general = both
    rng = np.random.default_rng(seed)
    for _ in range(WALK):
        name, given, named = what = draw_call(fast, rng)
        expected = outcome(general, name, given, named)
        check_same(outcome(fast, name, given, named), expected, what)
        if name in TAKE_OUT and not isinstance(expected, str):
            single = isinstance(expected, np.ndarray)
            out = [np.full_like(x, np.nan) for x in arrays_of(expected)]
            found = getattr(fast, name)(*given, **named, out=out[0] if single else tuple(out))
            assert all(x is y for x, y in zip([found] if single else found, out, strict=True)), what
            check_same(tuple(out), tuple(arrays_of(expected)), what)


def test_results_over_arguments_and_seeds(both):
    fast, _ = both
    q, u, p, inputs, t = states(fast, np.random.default_rng(1), None)
    du = np.ones((1, fast.nu), u.dtype)
    expected = fast.sensitivities(q, u, p, inputs, t, du=du)
    places = u.copy(), du.copy()
    found = fast.sensitivities(q, places[0], p, inputs, t, du=places[1], out=places)
    assert found[0] is places[0] and found[1] is places[1]
    check_same(found, expected, "over arguments")
    bad = u.copy()
    bad[0] = np.nan
    with pytest.raises(ValueError, match="u"):
        fast.accelerations(q, bad, p, inputs, t, out=bad)
    assert np.isnan(bad[0]) and np.array_equal(bad[1:], u[1:])  # an error leaves arguments as they are


def test_what_has_no_entries_by_name_is_no_mapping(both):
    fast, _ = both
    q, u, *_ = states(fast, np.random.default_rng(2), None)
    du = np.ones((1, fast.nu), u.dtype)
    fast.sensitivities(q, u, du=du)  # opens what the first call leaves to the general path
    for mapping in ({}, {"t": 1.0}):
        with pytest.raises(ValueError, match="dt is a mapping, expected numbers"):
            fast.sensitivities(q, u, du=du, dt=mapping)


def test_times_that_are_too_large_for_the_scalar(both):
    fast, _ = both
    q, u, *_ = states(fast, np.random.default_rng(2), None)
    largest = float(np.finfo(q.dtype).max)
    for solver in both:
        for t in (2.0 * largest, -2.0 * largest, np.nan):
            for lead in (1, np.ones((3, 1), q.dtype)):
                with pytest.raises(ValueError, match=r"t is -?(inf|nan), expected finite numbers"):
                    solver.accelerations(lead * q, u, t=t)


def test_quaternions_at_the_shortest_length_give_a_result_or_an_error(both):
    fast, general = both
    q, u, *_ = states(fast, np.random.default_rng(2), None)
    rng = np.random.default_rng(7)
    for i in fast._arguments.quaternions:
        for _ in range(300):  # rounding decides, and differs between Python and the C
            x = rng.normal(size=4)
            q[i : i + 4] = 1e-6 * x / np.linalg.norm(x)
            found = [outcome(solver, "accelerations", (q, u), {}) for solver in (fast, general)]
            assert all("quaternion" in x for x in found if isinstance(x, str))
            if not any(isinstance(x, str) for x in found):
                check_same(*found, "short quaternion")


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_calls_keep_no_memory(both):
    fast, _ = both
    rng = np.random.default_rng(5)
    work = [draw_call(fast, rng) for _ in range(60)]

    def run():
        for name, given, named in work:
            outcome(fast, name, given, named)
        gc.collect()

    tracemalloc.start()
    try:
        for _ in range(2):  # NumPy keeps small results of the first calls
            run()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(2):
            run()
        assert tracemalloc.get_traced_memory()[0] - before < 8_000
    finally:
        tracemalloc.stop()
