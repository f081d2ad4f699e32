"""Both engines with mpmath numbers: rounding errors of the float64 engines, and derivatives against differences in 60 digits."""

import mpmath
import numpy as np
import pytest
from random_models import ALL, expression, random_seeds, random_state, random_tree, relative_error, vector

from codegen.model.model import Body, Joint, Model, Parameter
from codegen.reference import DenseEngine, RecursiveEngine

ENGINES = (RecursiveEngine, DenseEngine)
SEEDS = [*range(3), *(pytest.param(i, marks=pytest.mark.campaign) for i in range(3, 6))]


def tree(seed, n=4):
    rng = np.random.default_rng(seed)
    model = random_tree(rng, n, ALL)
    return model, random_state(rng, model), random_seeds(rng, model, 2)


def difference(function, arguments, directions, j):
    """The central difference of a function's result with respect to argument direction j, flat."""
    h = mpmath.mpf(10) ** -20
    up = function(*(a + h * d[j] for a, d in zip(arguments, directions, strict=True)))
    down = function(*(a - h * d[j] for a, d in zip(arguments, directions, strict=True)))
    return np.ravel((np.array(up, dtype=object) - np.array(down, dtype=object)) / (2 * h))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("seed", SEEDS)
def test_derivatives_are_those_of_central_differences(engine, seed):
    """An independent witness: at 60 digits and steps of 1e-20 a central difference has about 38 digits."""
    with mpmath.workdps(60):
        model, state, seeds = tree(seed)
        e = engine(model, numbers="mpmath")
        udot = e.arithmetic.array(np.linspace(-1, 1, model.nu))
        values = dict(zip(("q", "u", "p", "inputs", "t"), (e.arithmetic.array(a) for a in state), strict=True))
        values["udot"] = udot
        directions = {name[1:]: e.arithmetic.array(seed) for name, seed in seeds.items()}
        directions["udot"] = directions["u"] * directions["u"]
        everything = ("q", "u", "p", "inputs", "t")
        for method, tangents, names in (
            (e.accelerations, e.sensitivities, everything),
            (e.outputs, e.output_sensitivities, everything),
            (e.inverse_dynamics, e.inverse_dynamics_sensitivities, ("q", "u", "udot", "p", "inputs", "t")),
            (e.mass_matrix, e.mass_matrix_sensitivities, ("q", "p")),
            (e.energies, e.energy_sensitivities, everything),
            (e.coordinate_rates, e.coordinate_rate_sensitivities, everything),
        ):
            arguments, along = [values[n] for n in names], [directions[n] for n in names]
            _, tangent = tangents(*arguments, **{f"d{n}": directions[n] for n in names})
            tangent = np.array(tangent, dtype=object)
            tangent = tangent.T if method == e.energies else tangent  # (dT, dV), each (k,)
            for j in range(2):
                error = relative_error(np.ravel(tangent[j]), difference(method, arguments, along, j))
                assert error < 1e-34, method.__name__


@pytest.mark.parametrize("seed", SEEDS)
def test_the_engines_agree_to_50_digits(seed):
    with mpmath.workdps(50):
        model, state, seeds = tree(seed + 50, 6)
        (a, da), (b, db) = (e(model, numbers="mpmath").sensitivities(*state, **seeds) for e in ENGINES)
        assert all(isinstance(x, mpmath.mpf) for x in [*a, *b, *da.ravel(), *db.ravel()])
        assert relative_error(a, b) < 1e-45
        assert relative_error(da, db) < 1e-45


@pytest.mark.parametrize("engine", ENGINES)
def test_rounding_of_random_trees(engine):
    with mpmath.workdps(50):
        for seed in range(6):
            model, state, seeds = tree(seed + 20, 6)
            exact, dexact = RecursiveEngine(model, numbers="mpmath").sensitivities(*state, **seeds)
            udot, dudot = engine(model).sensitivities(*state, **seeds)
            assert relative_error(udot, exact) < 1e-12
            assert relative_error(dudot, dexact) < 1e-12


def chain(n):
    """CHAIN(n): uniform rods of length L, 1 kg/m, radius 0.05 m, hinges at the top about y, x, y, x, ...; hanging along -z."""
    central = expression("L*(3*0.05**2 + L**2)/12")
    inertia = (central, central, expression("L*0.05**2/2"), *(expression(0),) * 3)
    bodies = [
        Body(
            f"rod{k}",
            k - 1,
            Joint("revolute", (vector(*((0, 1, 0), (1, 0, 0))[k % 2]),), vector(0, 0, "-L" if k else 0)),
            expression("L"),
            vector(0, 0, "-L/2"),
            inertia,
        )
        for k in range(n)
    ]
    return Model("chain", vector(0, 0, -9.81), (Parameter("L", 1.0),), (), tuple(bodies))


def chain_state(n):
    k = np.arange(1, n + 1)
    return 0.3 * np.sin(k), 0.2 * np.cos(k)


# The recursion stays at a few units in the last place however long the chain; the dense method loses what the
# condition of M asks for (1e4 at 12 bodies, 1e6 at 40).
@pytest.mark.parametrize(
    ("engine", "n", "tolerance"),
    [(RecursiveEngine, 4, 1e-14), (RecursiveEngine, 12, 2e-14), (RecursiveEngine, 100, 1e-13)]
    + [(DenseEngine, 4, 1e-14), (DenseEngine, 12, 1e-12), (DenseEngine, 40, 1e-10)],
)
def test_rounding_of_chains(engine, n, tolerance):
    q, u = chain_state(n)
    seeds = {"dq": np.cos(q)[None], "du": np.sin(u)[None], "dp": [[1.0]]}
    with mpmath.workdps(50):
        exact, dexact = RecursiveEngine(chain(n), numbers="mpmath").sensitivities(q, u, **seeds)
    udot, dudot = engine(chain(n)).sensitivities(q, u, **seeds)
    assert relative_error(udot, exact) < tolerance
    assert relative_error(dudot, dexact) < tolerance
