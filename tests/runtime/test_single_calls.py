"""Calls with one state: the fast path for plain arrays and the general path give equal bits, for every function."""

import dataclasses
import threading
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.runtime.standalone.calls.single_calls import NoCalls
from codegen.runtime.standalone.state.frame_motion import PointMotion

EXAMPLES = Path(__file__).parents[2] / "examples"

SEEDS = ("dq", "du", "dp", "dinputs", "dt")
MODELS = ("double_pendulum", "satellite", "four_bar", "shaken_pendulum")
OF_STATE = (
    "accelerations", "coordinate_rates", "energies", "outputs", "bias_force", "closure", "reactions", "frames", "points",
    "driving_forces", "jacobians", "point_jacobians", "frame_jacobians", "assemble",
)  # fmt: skip
ALONG = (
    "sensitivities", "coordinate_rate_sensitivities", "energy_sensitivities", "output_sensitivities", "closure_sensitivities",
    "reaction_sensitivities", "frame_sensitivities", "point_sensitivities", "driving_force_sensitivities",
    "assemble_sensitivities", "bias_force_sensitivities",
)  # fmt: skip
WEIGHTED = {
    "gradients": "nu", "coordinate_rate_gradients": "nq", "energy_gradients": None, "output_gradients": "noutputs",
    "assemble_gradients": "nq",
}  # fmt: skip
TAKE_OUT = {
    "accelerations", "coordinate_rates", "outputs", "bias_force", "driving_forces", "inverse_dynamics", "mass_matrix",
    "inverse_mass_matrix", "solve_mass", "sensitivities", "coordinate_rate_sensitivities", "output_sensitivities",
    "driving_force_sensitivities", "bias_force_sensitivities", "inverse_dynamics_sensitivities", "mass_matrix_sensitivities",
    "solve_mass_sensitivities",
}  # fmt: skip


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The package of a model, generated when it is first needed."""
    folder = tmp_path_factory.mktemp("single")

    def made(name):
        if not (folder / name).exists():
            codegen.generate(
                EXAMPLES / f"{name}.yaml", folder / name, reactions=True, frames=True, check=False, compile="all"
            )
        return folder / name

    return made


@pytest.fixture(params=MODELS)
def both(request, package):
    """A solver, the same solver without the fast path, and the number of calls that used the fast path."""
    fast, general = (codegen.load(package(request.param), "c") for _ in range(2))
    general._calls = general._target.calls = NoCalls()
    fast._calls = Counted(fast._calls)
    return fast, general, fast._calls.taken


class Counted(dict):
    """The calls of a solver; records those that went directly to C."""

    def __init__(self, calls):
        super().__init__()
        self.calls, self.taken = calls, []

    def __missing__(self, wanted):
        def counted(given, seeds, out):
            found = self.calls[wanted](given, seeds, out)
            if found is not None:
                self.taken.append(wanted)
            return found

        return counted


def draw(solver, rng, k=None):
    """A random closed state, accelerations or forces, and seeds of all arguments."""
    q, u = solver.initial
    if not solver.closure_names:
        q, u = q + 0.1 * rng.normal(size=q.shape), rng.normal(size=u.shape)
    p = solver.parameters * rng.uniform(0.99, 1.01, solver.np)
    inputs, t = rng.normal(size=solver.ninputs), float(rng.uniform())
    if solver.closure_names:
        q, u = solver.assemble(q, rng.normal(size=u.shape), p, inputs, t)
    lead = () if k is None else (k,)
    sizes = (solver.nq, solver.nu, solver.np, solver.ninputs)
    seeds = {s: rng.normal(size=(*lead, n)) for s, n in zip(SEEDS, sizes, strict=False)}
    seeds["dt"] = rng.normal(size=lead) if lead else float(rng.normal())
    return (q, u, p, inputs, t), rng.normal(size=solver.nu), seeds


def arrays_of(result):
    """All arrays of a result, in order."""
    if result is None or isinstance(result, (str, float)):
        return []
    if isinstance(result, np.ndarray):
        return [result]
    if isinstance(result, (tuple, list)):
        return [a for x in result for a in arrays_of(x)]
    return [a for of in dataclasses.fields(result) if of.name != "names" for a in arrays_of(getattr(result, of.name))]


def same(a, b):
    assert type(a) is type(b)
    pair = a if isinstance(a, tuple) else (a,)
    of_points = any(isinstance(x, PointMotion) for x in pair)  # whose sums the C joins otherwise than NumPy
    for x, y in zip(arrays_of(a), arrays_of(b), strict=True):
        assert x.shape == y.shape and x.dtype == y.dtype
        if of_points:
            np.testing.assert_allclose(x, y, rtol=1e-14, atol=1e-14)
        else:
            np.testing.assert_array_equal(x, y)


def test_places_are_looked_at_again_when_others_have_their_addresses(both):
    fast, general, _ = both
    (q, u, p, inputs, t), _, _ = draw(fast, np.random.default_rng(3))
    expected = general.accelerations(q, u, p, inputs, t)
    for _ in range(50):
        good = np.empty(fast.nu)
        for _ in range(2):
            assert fast.accelerations(q, u, p, inputs, t, out=good) is good
        np.testing.assert_array_equal(good, expected)
        address = id(good)
        del good
        other = np.empty(fast.nu, np.int64)  # mostly at the same address
        with pytest.raises(ValueError, match="out"):
            fast.accelerations(q, u, p, inputs, t, out=other)
        if id(other) == address:
            break
        del other


def calls(solver, k=None, seed=11):
    """Calls of every function of the solver: name, positional and named arguments."""
    rng = np.random.default_rng(seed)
    state, force, seeds = draw(solver, rng, k)
    q, u, p, inputs, t = state
    of_places = {s: x for s, x in seeds.items() if s != "du"}
    lead = () if k is None else (k,)
    more = {"dudot": rng.normal(size=(*lead, solver.nu))}
    found = [(n, state, {}) for n in OF_STATE] if k is None else []
    found += [("mass_matrix", (q, p, inputs, t), {}), ("inverse_mass_matrix", (q, p, inputs, t), {}),
              ("solve_mass", (q, force, p, inputs, t), {}), ("inverse_dynamics", (q, u, force, p, inputs, t), {})]  # fmt: skip
    found += [(n, state, seeds) for n in ALONG]
    found += [("mass_matrix_sensitivities", (q, p, inputs, t), of_places),
              ("solve_mass_sensitivities", (q, force, p, inputs, t), of_places | {"db": more["dudot"]}),
              ("inverse_dynamics_sensitivities", (q, u, force, p, inputs, t), seeds | more)]  # fmt: skip
    for name, size in WEIGHTED.items():
        weights = rng.normal(size=(*lead, 2 if size is None else getattr(solver, size)))
        found.append((name, state, {"weights_q" if name.startswith("assemble") else "weights": weights}))
    left_out = ["inverse_mass_matrix", "solve_mass"] if solver.closure_names else []
    left_out += [] if solver.prescribed_names else ["driving"]
    return [x for x in found if not x[0].startswith(tuple(left_out))]


def made_of_others(solver, name):
    """Whether a member is a loop over C functions, or empty, and not a C function itself."""
    if solver.closure_names:
        return name.startswith(("mass_matrix", "assemble")) or "dynamics_s" in name or "bias_force_s" in name
    return name.startswith(("closure", "assemble"))


@pytest.mark.parametrize("k", [None, 1, 3, 11])
def test_every_function_gives_the_same_bits(both, k):
    fast, general, taken = both
    for name, given, named in calls(fast, k):
        before = len(taken)
        found = getattr(fast, name)(*given, **named)
        assert len(taken) > before or made_of_others(fast, name), name
        same(found, getattr(general, name)(*given, **named))
        if name in TAKE_OUT:
            out = found
            for x in arrays_of(out):
                x[...] = np.nan
            assert getattr(fast, name)(*given, **named, out=out) is not None
            same(out, getattr(general, name)(*given, **named))


def test_results_do_not_share_memory_with_anything(both):
    fast, _, _ = both
    for name, given, named in calls(fast):
        first = getattr(fast, name)(*given, **named)
        kept = [x.copy() for x in arrays_of(first)]
        getattr(fast, name)(*(x if isinstance(x, float) else x * 1.01 for x in given), **named)
        for x, y in zip(arrays_of(first), kept, strict=True):
            np.testing.assert_array_equal(x, y)


def odd(x):
    """Arguments that are no plain arrays but equivalent, or that are errors in both paths."""
    yield x.tolist()
    yield np.repeat(x, 2)[::2]
    yield x[::-1].copy()[::-1]
    frozen = x.copy()
    frozen.flags.writeable = False
    yield frozen
    yield x.astype(">f8")
    yield x.astype(np.longdouble)
    yield x.astype(np.float32)
    yield np.round(x).astype(int)
    yield x.astype(object)
    yield np.ma.masked_array(x, mask=np.arange(x.size) == 0)
    yield np.ma.masked_array(x)
    yield x.astype(complex)
    yield x[None]
    yield x[:-1]
    yield np.append(x, 1.0)
    yield np.frombuffer(b"\0" + x.tobytes(), np.uint8)[1:].view(float)
    yield np.where(np.arange(x.size) == 0, np.nan, x)
    yield np.where(np.arange(x.size) == x.size - 1, np.inf, x)
    yield x.astype("U9")
    yield 1.0
    yield np.array(1.0)
    yield "q"
    yield None


def outcome(f, *given, **named):
    try:
        return f(*given, **named)
    except (ValueError, TypeError, AttributeError, np.linalg.LinAlgError) as error:
        return type(error).__name__ + str(error)


@pytest.mark.parametrize("place", range(5))
def test_odd_arguments_come_out_alike(both, place):
    fast, general, _ = both
    for name, given, named in calls(fast):
        if place >= len(given) or isinstance(given[place], float):
            continue
        for x in odd(given[place]) if given[place].size else ():
            changed = (*given[:place], x, *given[place + 1 :])
            a, b = (outcome(getattr(s, name), *changed, **named) for s in (fast, general))
            if isinstance(a, str) or isinstance(b, str):
                assert isinstance(a, str) and isinstance(b, str) and a == b, (name, x)
            else:
                same(a, b)


@pytest.mark.parametrize("seed", [*SEEDS])
def test_odd_seeds_come_out_alike(both, seed):
    fast, general, _ = both
    for name, given, named in calls(fast, 2):
        if name not in ("sensitivities", "output_sensitivities", "mass_matrix_sensitivities") or seed not in named:
            continue
        x = named[seed]
        others = [*odd(x[0] if x.ndim > 1 else x), x.T, x[:, None], np.asfortranarray(x), x[:0], x.tolist(), x[:1]]
        for changed in others:
            for rest in (named, {}):
                a, b = (outcome(getattr(s, name), *given, **(rest | {seed: changed})) for s in (fast, general))
                if isinstance(a, str) or isinstance(b, str):
                    assert a == b
                else:
                    same(a, b)


@pytest.mark.parametrize(
    "t", [0, 1, True, np.float64(0.25), np.float32(0.25), np.array(0.25), 10**400, "0", None, np.nan, 1j]
)
def test_odd_times_come_out_alike(both, t):
    fast, general, _ = both
    (q, u, p, inputs, _), *_ = draw(fast, np.random.default_rng(2))
    a, b = (outcome(s.coordinate_rates, q, u, p, inputs, t) for s in (fast, general))
    assert a == b if isinstance(a, str) else np.array_equal(a, b)


def test_directions_of_any_number_take_turns(both):
    fast, general, taken = both
    for k in (1, 40, 3, 1, 200, 8):
        (q, u, p, inputs, t), _, seeds = draw(fast, np.random.default_rng(k), k)
        some = {"du": seeds["du"], "dt": seeds["dt"]}
        same(*(s.sensitivities(q, u, p, inputs, t, **some) for s in (fast, general)))
    assert taken.count("sensitivities") >= 5


def test_threads_do_not_disturb_each_other(both):
    fast, general, _ = both
    k = 3
    work = [calls(fast, k, seed) for seed in range(6)]
    expected = [[getattr(general, n)(*given, **named) for n, given, named in of] for of in work]
    wrong = []

    def run(i):
        try:
            for _ in range(15):
                for (n, given, named), x in zip(work[i], expected[i], strict=True):
                    same(getattr(fast, n)(*given, **named), x)
        except BaseException as error:
            wrong.append(error)

    threads = [threading.Thread(target=run, args=(i,)) for i in range(len(work))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


# ---- out= ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_places_that_share_memory_are_refused(package, target):
    solver = codegen.load(package("four_bar"), target)
    (q, u, p, inputs, t), _, seeds = draw(solver, np.random.default_rng(1), 2)
    n = solver.nu
    a = np.zeros((2, n))
    flat = np.zeros(3 * n)
    for q_ in (q, np.stack([q] * 3)):
        lead = q_.shape[:-1]
        whole = np.zeros((2, *lead, n))
        for out in ((whole[0], whole), (whole.reshape(-1)[: whole[0].size].reshape(whole[0].shape), whole)):
            for name in ("sensitivities", "coordinate_rate_sensitivities"):
                along = {"du": seeds["du"].reshape(2, *(1,) * len(lead), n)}
                with pytest.raises(ValueError, match=r"out \(\w+\) and out \(d\w+\) share memory"):
                    getattr(solver, name)(q_, u, p, inputs, t, **along, out=out)
    J = solver.jacobians(q, u, p, inputs, t)
    J.u = J.q
    with pytest.raises(ValueError, match=r"out \(J\.q\) and out \(J\.u\) share memory"):
        solver.jacobians(q, u, p, inputs, t, out=J)
    value, derivative = solver.sensitivities(q, u, p, inputs, t, du=seeds["du"])
    solver.sensitivities(q, u, p, inputs, t, du=seeds["du"], out=(flat[:n], flat[n:].reshape(2, n)))
    same(flat, np.concatenate([value, derivative.ravel()]))
    # over what is read: the results are right all the same
    a[:] = seeds["du"]
    found = solver.sensitivities(q, u, p, inputs, t, du=a, out=(np.empty(n), a))
    same(found, (value, derivative))


def test_places_of_loop_forces_are_checked_alike(package):
    solver = codegen.load(package("four_bar"))
    (q, _, p, *_), _, seeds = draw(solver, np.random.default_rng(1), 1)
    M, dM = solver.mass_matrix_sensitivities(q, p, dq=seeds["dq"])
    with pytest.raises(ValueError, match=r"out \(M\) and out \(dM\) share memory"):
        solver.mass_matrix_sensitivities(q, p, dq=seeds["dq"], out=(dM[0], dM))
    with pytest.raises(ValueError, match=r"out \(M\).*read-only, not contiguous"):
        solver.mass_matrix(q, p, out=np.broadcast_to(M, M.shape))
    with pytest.raises(ValueError, match=r"out is list|expected a tuple of 2 arrays"):
        solver.mass_matrix_sensitivities(q, p, dq=seeds["dq"], out=np.zeros(2))
