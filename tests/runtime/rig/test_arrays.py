"""Shapes: batch axes broadcast by NumPy's rules, directions come first, and any array that NumPy accepts is accepted."""

import numpy as np
import pytest

VALUES = ["accelerations", "jacobians", "coordinate_rates", "mass_matrix", "inverse_mass_matrix", "solve_mass",
          "inverse_dynamics", "bias_force", "energies", "outputs", "closure", "assemble"]  # fmt: skip
ALONG = ["sensitivities", "coordinate_rate_sensitivities", "mass_matrix_sensitivities", "solve_mass_sensitivities",
         "inverse_dynamics_sensitivities", "bias_force_sensitivities", "energy_sensitivities", "output_sensitivities",
         "assemble_sensitivities"]  # fmt: skip

LEADS = {"q": (3, 1), "u": (2,), "p": (), "inputs": (3, 2), "t": (1, 2), "udot": (3, 1), "b": (1, 2)}
SEED_LEADS = {"dq": (2,), "du": (3, 1), "dp": (), "dinputs": (1, 2), "dt": (3, 2), "dudot": (1, 1), "db": (3, 1)}


def split(names):
    return names.split()


def seeds_of(names, function):
    return [f"d{n}" for n in names if not (function.startswith("assemble") and n not in ("q", "u", "p"))]


def one(name, value, lead, batch, index):
    """One state of batch arguments; the axis of directions stays first."""
    k = value.shape[: 1 if name.startswith("d") else 0]
    tail = value.shape[len(k) + len(lead) :]
    padded = value.reshape(*k, *(1,) * (len(batch) - len(lead)), *lead, *tail)
    whole = np.broadcast_to(padded, (*k, *batch, *tail))
    return whole[(slice(None), *index)] if k else whole[index]


def close(a, b):
    assert a.shape == b.shape
    np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("function", VALUES)
def test_batch_axes_broadcast(either, tools, function):
    names = split(tools.VALUES[function])
    given = tools.draw(np.random.default_rng(1), either, names, LEADS)
    batch = np.broadcast_shapes(*(LEADS[n] for n in names))
    whole = tools.flat(getattr(either, function)(**given))
    for index in np.ndindex(batch):
        state = {n: one(n, v, LEADS[n], batch, index) for n, v in given.items()}
        for got, expected in zip(whole, tools.flat(getattr(either, function)(**state)), strict=True):
            assert got.shape[: len(batch)] == batch
            close(got[index], expected)


@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize("function", ALONG)
def test_batch_axes_of_seeds_broadcast(either, tools, function, k):
    names = split(tools.ALONG[function])
    rng = np.random.default_rng(2)
    given = tools.draw(rng, either, names, LEADS)
    seed_names = [s for s in seeds_of(names, function) if not (function == "bias_force_sensitivities" and s == "dudot")]
    seeds = tools.draw(rng, either, seed_names, {s: (k, *SEED_LEADS[s]) for s in seed_names})
    batch = np.broadcast_shapes(*(LEADS[n] for n in names), *(SEED_LEADS[s] for s in seed_names))
    whole = tools.flat(getattr(either, function)(**given, **seeds))
    values = len(whole) // 2
    for index in np.ndindex(batch):
        state = {n: one(n, v, LEADS[n], batch, index) for n, v in given.items()}
        along = {n: one(n, v, SEED_LEADS[n], batch, index) for n, v in seeds.items()}
        expected = tools.flat(getattr(either, function)(**state, **along))
        for i, (got, want) in enumerate(zip(whole, expected, strict=True)):
            assert got.shape[: len(batch) + (i >= values)] == ((k,) if i >= values else ()) + batch
            close(got[index] if i < values else got[(slice(None), *index)], want)


@pytest.mark.parametrize("function", ALONG)
def test_seeds_alone_make_a_batch(either, tools, function):
    names = split(tools.ALONG[function])
    rng = np.random.default_rng(3)
    given = tools.draw(rng, either, names)
    dq = rng.normal(size=(2, 5, either.nq))
    for i, a in enumerate(tools.flat(getattr(either, function)(**given, dq=dq))):
        first = tools.flat(getattr(either, function)(**given, dq=dq[:, 3]))[i]
        close(np.moveaxis(a, a.shape.index(5), 0)[3], first)


@pytest.mark.parametrize("k", [1, 2, 3, 8, 11, 20])
@pytest.mark.parametrize("batch", [(), (4,)])
def test_any_number_of_directions_agrees(either, tools, k, batch):
    rng = np.random.default_rng(4)
    names = split(tools.ALONG["sensitivities"])
    given = tools.draw(rng, either, names, dict.fromkeys(names, batch))
    seeds = tools.draw(rng, either, [f"d{n}" for n in names], {f"d{n}": (k, *batch) for n in names})
    udot, dudot = either.sensitivities(**given, **seeds)
    assert udot.shape == (*batch, either.nu) and dudot.shape == (k, *batch, either.nu)
    for j in range(k):
        alone = either.sensitivities(**given, **{n: s[j : j + 1] for n, s in seeds.items()})
        close(udot, alone[0])
        close(dudot[j : j + 1], alone[1])


@pytest.mark.parametrize("function", ALONG)
def test_one_direction_keeps_its_axis(either, tools, function):
    names = split(tools.ALONG[function])
    given = tools.draw(np.random.default_rng(5), either, names)
    bare = tools.flat(getattr(either, function)(**given, dq=np.ones(either.nq)))
    axis = tools.flat(getattr(either, function)(**given, dq=np.ones((1, either.nq))))
    for i, (a, b) in enumerate(zip(bare, axis, strict=True)):
        assert i < len(bare) // 2 or a.shape[0] == 1
        close(a, b)


def test_a_scalar_dt_is_one_direction(either, tools):
    given = tools.draw(np.random.default_rng(6), either, split(tools.ALONG["sensitivities"]))
    assert either.sensitivities(**given, dt=1.0)[1].shape == (1, either.nu)
    assert either.sensitivities(**given, dt=[1.0, 2.0])[1].shape == (2, either.nu)


@pytest.mark.parametrize("function", ALONG)
def test_a_missing_seed_is_zero(either, tools, function):
    names = split(tools.ALONG[function])
    given = tools.draw(np.random.default_rng(7), either, names)
    call = getattr(either, function)
    seeds = [s for s in seeds_of(names, function) if not (function == "bias_force_sensitivities" and s == "dudot")]
    zeros = {s: np.zeros(3) if s == "dt" else np.zeros((3, tools.sizes(either)[s[1:]])) for s in seeds}
    dq = np.random.default_rng(8).normal(size=(3, either.nq))
    for a, b in zip(tools.flat(call(**given, dq=dq)), tools.flat(call(**given, **{**zeros, "dq": dq})), strict=True):
        close(a, b)
    with pytest.raises(ValueError, match=r"no seed given.*dq"):
        call(**given)


def test_columns_of_jacobians_are_directions(either, tools):
    given = tools.draw(np.random.default_rng(9), either, split(tools.VALUES["jacobians"]), {"q": (2,)})
    J = either.jacobians(**given)
    assert J.q.shape == (2, either.nu, either.nq) and J.t.shape == (2, either.nu)
    for name, matrix in (("q", J.q), ("u", J.u), ("p", J.p), ("inputs", J.inputs)):
        columns = either.sensitivities(**given, **{f"d{name}": np.eye(matrix.shape[-1])[:, None]})[1]
        close(np.moveaxis(matrix, -1, 0), columns)
    close(J.t[None], either.sensitivities(**given, dt=[1.0])[1])


def test_every_kind_of_array_is_taken(either, tools):
    rng = np.random.default_rng(10)
    given = tools.draw(
        rng, either, split(tools.VALUES["accelerations"]), dict.fromkeys(["q", "u", "p", "inputs"], (4,))
    )
    given["t"] = 0.5
    expected = either.accelerations(**given)

    def spread(x):
        wide = np.zeros((8, 3 * x.shape[-1]))
        wide[::2, ::3] = x
        return wide[::2, ::3]

    def frozen(x):
        x = x.copy()
        x.setflags(write=False)
        return x

    def unaligned(x):
        raw = np.empty(x.nbytes + 1, np.uint8)[1:].view(np.uint8)
        y = np.frombuffer(raw.data, np.float64).reshape(x.shape)
        raw[:] = np.frombuffer(x.tobytes(), np.uint8)
        assert not y.flags.aligned
        return y

    kinds = {
        "lists": lambda x: x.tolist(), "Fortran order": np.asfortranarray, "strides": spread, "read-only": frozen,
        "big endian": lambda x: x.astype(">f8"), "long double": lambda x: x.astype(np.longdouble),
        "backwards": lambda x: x[::-1, ::-1].copy()[::-1, ::-1], "unaligned": unaligned,
        "objects": lambda x: x.astype(object),
    }  # fmt: skip
    for kind, make in kinds.items():
        made = {n: v if n == "t" else make(v) for n, v in given.items()}
        close(either.accelerations(**made), expected)
        row = {n: v if n == "t" else make(v)[2] for n, v in given.items()}
        np.testing.assert_allclose(either.accelerations(**row), expected[2], rtol=1e-11, err_msg=kind)


def test_integers_and_single_precision(either):
    q, u = [0, 1, 0, 0, 0, 2], [1, 2, 3, 0, 1]
    expected = either.accelerations(np.array(q, float), np.array(u, float), t=1.0)
    for dtype in (np.int8, np.int64, np.uint16, np.float16, np.float32):
        close(either.accelerations(np.array(q, dtype), np.array(u, dtype), t=1), expected)
    close(either.accelerations(tuple(q), q[:0] + u, t=np.array(1)), expected)
    close(either.accelerations(q, u, t=np.float32(1)), expected)


@pytest.mark.parametrize("function", VALUES + ALONG)
def test_an_empty_batch_gives_empty_results(either, tools, function):
    names = split({**tools.VALUES, **tools.ALONG}[function])
    given = tools.draw(np.random.default_rng(11), either, names, {"q": (0,)})
    seeds = {"dq": np.ones((3, either.nq))} if function in ALONG else {}
    for a in tools.flat(getattr(either, function)(**given, **seeds)):
        assert 0 in a.shape and a.dtype == np.float64


def test_no_directions_leave_the_values(either, tools):
    given = tools.draw(np.random.default_rng(12), either, split(tools.VALUES["accelerations"]))
    udot, dudot = either.sensitivities(**given, dq=np.zeros((0, either.nq)))
    assert dudot.shape == (0, either.nu)
    close(udot, either.accelerations(**given))


@pytest.mark.parametrize("function", VALUES + ALONG)
def test_arguments_are_not_modified_and_results_are_new(either, tools, function):
    names = split({**tools.VALUES, **tools.ALONG}[function])
    rng = np.random.default_rng(13)
    for batch in ((), (3,)):
        given = tools.draw(rng, either, names, dict.fromkeys(names, batch))
        seeds = {"dq": rng.normal(size=(2, *batch, either.nq))} if function in ALONG else {}
        before = {n: np.copy(v) for n, v in {**given, **seeds}.items()}
        first = tools.flat(getattr(either, function)(**given, **seeds))
        for n, v in {**given, **seeds}.items():
            np.testing.assert_array_equal(v, before[n])
        kept = [a.copy() for a in first]
        for a in first:
            assert not any(np.shares_memory(a, v) for v in {**given, **seeds}.values() if isinstance(v, np.ndarray))
        again = tools.flat(getattr(either, function)(**given, **seeds))
        for a, b, c in zip(first, again, kept, strict=True):
            np.testing.assert_array_equal(a, b)
            assert not np.shares_memory(a, b) or not a.size
            b.fill(7.0) if b.ndim and b.flags.writeable else None
            np.testing.assert_array_equal(a, c)


def test_defaults_cannot_be_spoiled(rig):
    rig.parameters[:] = 0
    rig.initial[0][:] = 0
    rig.operations.clear()
    assert rig.parameters.tolist() == [0.8, 1.5, 0.02]
    assert rig.initial[0][0] == 0.3 and rig.operations


def test_left_out_arguments(either, tools):
    q, u = either.initial
    expected = either.accelerations(q, u, either.parameters, np.zeros(2), 0.0)
    close(either.accelerations(q, u), expected)
    close(either.accelerations(q, u, None, None), expected)
    close(either.accelerations(np.tile(q, (3, 1)), u), np.tile(expected, (3, 1)))


def test_parameters_by_name(either):
    q, u = either.initial
    close(either.accelerations(q, u, {"mass": 2.0}), either.accelerations(q, u, [0.8, 2.0, 0.02]))
    close(either.accelerations(q, u, {}), either.accelerations(q, u))
    masses = either.accelerations(q, u, {"mass": np.array([2.0, 3.0])})
    close(masses[1], either.accelerations(q, u, {"mass": 3.0}))


def test_one_state_and_a_batch_of_one_are_the_same_numbers(rig, tools):
    # the short way for one state, the loop over a batch and the loop over many are the same C function
    rng = np.random.default_rng(14)
    for function, names in tools.VALUES.items():
        given = tools.draw(rng, rig, split(names))
        single = tools.flat(getattr(rig, function)(**given))
        batch = tools.flat(getattr(rig, function)(**{n: np.asarray(v)[None] for n, v in given.items()}))
        lists = tools.flat(getattr(rig, function)(**{n: np.asarray(v).tolist() for n, v in given.items()}))
        for a, b, c in zip(single, batch, lists, strict=True):
            np.testing.assert_array_equal(a, b[0])
            np.testing.assert_array_equal(a, c)


def test_a_time_the_model_does_not_use(either_bare):
    # t, p and inputs that a model has no use for are checked and take part in the batch all the same
    q, u = [0.1, 0.2], [0.3, 0.4]
    expected = either_bare.accelerations(q, u)
    close(either_bare.accelerations(q, u, t=2.5), expected)
    close(either_bare.accelerations(q, u, t=np.array([2.5, 3.0])), np.stack([expected] * 2))
    close(either_bare.accelerations(np.array(q), np.array(u), [], [], np.zeros(())), expected)
    for t in (np.nan, np.inf, [0.0, np.nan]):
        with pytest.raises(ValueError, match=r"t.*nan|t.*inf"):
            either_bare.accelerations(np.array(q), np.array(u), t=t)
    with pytest.raises(ValueError, match="p"):
        either_bare.accelerations(np.array(q), np.array(u), np.ones(1))


def test_a_model_with_nothing(either_bare, tools):
    s = either_bare
    assert (s.np, s.ninputs, s.noutputs) == (0, 0, 0)
    rng = np.random.default_rng(15)
    for batch in ((), (3,)):
        for function, names in tools.VALUES.items():
            given = tools.draw(rng, s, split(names), dict.fromkeys(split(names), batch))
            for a in tools.flat(getattr(s, function)(**given)):
                assert a.shape[: len(batch)] == batch and np.isfinite(a).all()
        for function, names in tools.ALONG.items():
            given = tools.draw(rng, s, split(names), dict.fromkeys(split(names), batch))
            results = tools.flat(getattr(s, function)(**given, dq=rng.normal(size=(2, *batch, 2))))
            assert results[-1].shape[: 1 + len(batch)] == (2, *batch)
    J = s.jacobians([0.1, 0.2], [0, 0])
    assert J.p.shape == (2, 0) and J.inputs.shape == (2, 0) and not J.t.any()
    assert not s.sensitivities([0.1, 0.2], [0.3, 0.4], dt=1.0)[1].any()
    assert not s.sensitivities([0.1, 0.2], [0.3, 0.4], dp=np.zeros((2, 0)))[1].any()
    assert s.energies([0.1, 0.2], [0, 0])[1] == 0.0  # no gravity
