"""Functions of CasADi against the solver, and against CasADi's derivatives of equations written by hand."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

import codegen
import codegen.casadi
from codegen import cli
from codegen.casadi.bridged import BridgeError
from codegen.runtime import PackageError

casadi = pytest.importorskip("casadi", reason="CasADi is not installed: pip install -e '.[casadi]'")

EXAMPLES = Path(__file__).parents[2] / "examples"
FUNCTIONS = (
    "accelerations,sensitivities,gradients,jacobians,hessian_products,coordinate_rates,coordinate_rate_sensitivities,energies,"
    "energy_sensitivities,energy_gradients"
)
BOUND = 1e-12
CART_POLE = (EXAMPLES / "casadi" / "cart_pole.yaml").read_text(encoding="utf-8")


def by_hand(q, u, p, inputs):
    """Accelerations of the cart-pole from the textbook equations."""
    m, mp, length, g = (p[i] for i in range(4))
    s, c = casadi.sin(q[1]), casadi.cos(q[1])
    cart = (inputs[0] + mp * s * (length * u[1] ** 2 + g * c)) / (m + mp * s**2)
    pole = -(inputs[0] * c + mp * length * u[1] ** 2 * c * s + (m + mp) * g * s) / (length * (m + mp * s**2))
    return casadi.vertcat(cart, pole)


@pytest.fixture(scope="module")
def solvers(tmp_path_factory):
    """Solvers by name, each made once."""
    known = {}

    def get(name: str, functions: str = FUNCTIONS):
        if (name, functions) not in known:
            below = EXAMPLES / "casadi" / f"{name}.yaml"
            folder = tmp_path_factory.mktemp("solver") / name
            codegen.generate(
                below if below.exists() else EXAMPLES / f"{name}.yaml", folder, compile=False, functions=functions
            )
            known[name, functions] = codegen.load(folder)
        return known[name, functions]

    return get


def error(found, wanted) -> float:
    """Largest difference divided by the largest number."""
    wanted = np.asarray(wanted, float)
    found = np.array(casadi.densify(found)).reshape(wanted.shape)
    return float(np.abs(found - wanted).max(initial=0.0) / max(np.abs(wanted).max(initial=0.0), 1e-300))


def drawn(solver, seed: int = 1, far: float = 0.3):
    """A random closed state, and the entries that are arguments of CasADi's functions, by name."""
    draw = np.random.default_rng(seed)
    q, u = (x.copy() for x in solver.initial)
    own = {
        "q": [solver.coordinate_names.index(n) for n in solver.independent_names],
        "u": [solver.speed_names.index(n) for n in solver.independent_speed_names],
    }
    q[own["q"]] += far * draw.normal(size=len(own["q"]))
    u[own["u"]] = draw.normal(size=len(own["u"]))
    p = solver.parameters * draw.uniform(0.97, 1.03, solver.np)
    inputs, t = draw.normal(size=solver.ninputs), 0.3
    own |= {"p": list(range(solver.np)), "inputs": list(range(solver.ninputs)), "t": [0]}
    state = (*solver.assemble(q, u, p, inputs, t), p, inputs, t)
    given = {"q": state[0][own["q"]], "u": state[1][own["u"]], "p": p, "inputs": inputs, "t": t}
    return state, given, own


def column(x, n: str, own) -> np.ndarray:
    """The columns of a derivative that belong to an argument of CasADi."""
    return np.reshape(x, (*np.shape(x), 1)) if n == "t" else np.asarray(x)[..., own[n]]


@pytest.mark.parametrize("name", ["cart_pole", "four_bar", "quadrotor", "shaken_pendulum", "double_wishbone"])
def test_accelerations_and_their_derivatives_are_those_of_the_solver(name, solvers):
    solver = solvers(name)
    state, given, own = drawn(solver, far=0.02 if name == "double_wishbone" else 0.3)
    f = codegen.casadi.function(solver, "accelerations")
    symbols = [casadi.MX.sym(n, f.size1_in(n)) for n in f.name_in()]
    at, z = [given[n] for n in f.name_in()], f(*symbols)
    weights = np.random.default_rng(2).normal(size=solver.nu)
    udot, matrices = solver.accelerations(*state), solver.jacobians(*state)
    gradients = solver.gradients(*state, weights=weights)
    assert error(f(*at), udot) <= BOUND
    for n, x in zip(f.name_in(), symbols, strict=True):
        J = column(getattr(matrices, n), n, own)
        seed = np.linspace(0.5, 1.5, x.shape[0])
        by = {
            "jacobian": (casadi.jacobian(z, x), J), "forward": (casadi.jtimes(z, x, casadi.DM(seed)), J @ seed),
            "reverse": (casadi.jtimes(z, x, casadi.DM(weights), True), np.ravel(column(getattr(gradients, n)[0], n, own))),
        }  # fmt: skip
        for kind, (expression, wanted) in by.items():
            found = casadi.Function("f", symbols, [expression])(*at)
            assert error(found, wanted) <= BOUND, (kind, n)


@pytest.mark.parametrize("name", ["cart_pole", "four_bar", "five_bar_leg", "quadrotor", "double_wishbone"])
def test_hessians_are_those_of_the_solver_and_symmetric(name, solvers):
    solver = solvers(name)
    state, given, own = drawn(solver, far=0.02 if name == "double_wishbone" else 0.3)
    f = codegen.casadi.function(solver, "accelerations")
    sizes = [f.size1_in(n) for n in f.name_in()]
    x = casadi.MX.sym("x", sum(sizes))
    weights = np.random.default_rng(2).normal(size=solver.nu)
    z = casadi.dot(casadi.DM(weights), f(*casadi.vertsplit(x, np.cumsum([0, *sizes]).tolist())))
    found = casadi.Function("h", [x], [casadi.hessian(z, x)[0]])(
        np.concatenate([np.ravel(given[n]) for n in f.name_in()])
    )
    places, at = [], 0
    for n in f.name_in():
        places += [at + i for i in own[n]]
        at += {"q": solver.nq, "u": solver.nu, "p": solver.np, "inputs": solver.ninputs}[n]
    wanted = solver.hessians(*state, weights=weights, wrt=f.name_in())[np.ix_(places, places)]
    assert error(found, wanted) <= BOUND
    assert error(found.T, wanted) <= BOUND


def test_derivatives_of_a_cart_pole_are_those_of_its_equations(solvers):
    f = codegen.casadi.function(solvers("cart_pole"), "accelerations")
    x = casadi.MX.sym("x", 9)
    weights = casadi.DM([0.7, -1.3])
    at = np.random.default_rng(3).uniform(0.5, 1.5, 9)
    found = {}
    for who, g in (("ours", f), ("casadi", by_hand)):
        z = g(x[:2], x[2:4], x[4:8], x[8])
        second, first = casadi.hessian(casadi.dot(weights, z), x)
        found[who] = casadi.Function("d", [x], [z, casadi.jacobian(z, x), first, second])(at)
    for ours, wanted in zip(found["ours"], found["casadi"], strict=True):
        assert error(ours, np.array(casadi.densify(wanted))) <= BOUND


@pytest.mark.parametrize(("name", "native"), [("four_bar", "native_four_bar"), ("five_bar_leg", "native_leg")])
def test_derivatives_of_loops_are_those_of_lagranges_equations_in_casadi(name, native, solvers, monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES.parent / "benchmarks"))
    by_hand = getattr(
        importlib.import_module("optimal_control"), native
    )()  # dependent points by intersection of circles
    f, (_, given, _) = codegen.casadi.ode(solvers(name)), drawn(solvers(name), 5, 0.2)
    sizes = [f.size1_in(n) for n in f.name_in()]
    x = casadi.MX.sym("x", sum(sizes))
    at = np.concatenate([given["q"], given["u"], given["p"], given["inputs"]])
    weights = casadi.DM(np.linspace(0.5, 1.5, sizes[0]))
    found = []
    for g in (f, by_hand):
        z = g(*casadi.vertsplit(x, np.cumsum([0, *sizes]).tolist()))
        second, first = casadi.hessian(casadi.dot(weights, z), x)
        found.append(casadi.Function("d", [x], [z, casadi.jacobian(z, x), first, second])(at))
    for ours, wanted in zip(*found, strict=True):
        assert error(ours, np.array(casadi.densify(wanted))) <= BOUND


@pytest.mark.parametrize("name", ["cart_pole", "four_bar", "quadrotor"])
@pytest.mark.parametrize("function", ["energies", "coordinate_rates"])
def test_other_functions_have_their_first_derivatives(name, function, solvers):
    solver = solvers(name)
    state, given, own = drawn(solver)
    f = codegen.casadi.function(solver, function)
    symbols = [casadi.MX.sym(n, f.size1_in(n)) for n in f.name_in()]
    at = [given[n] for n in f.name_in()]
    along = solver.energy_sensitivities if function == "energies" else solver.coordinate_rate_sensitivities
    sizes = {"q": solver.nq, "u": solver.nu, "p": solver.np}
    for n, x in zip(f.name_in(), symbols, strict=True):
        values, derivatives = along(*state, **{f"d{n}": np.eye(sizes[n])[own[n]]})
        wanted = np.array(derivatives) if function == "energies" else np.array(derivatives).T
        assert error(f(*at), np.ravel(values)) <= BOUND
        found = casadi.Function("j", symbols, [casadi.jacobian(f(*symbols), x)])(*at)
        assert np.abs(np.array(casadi.densify(found)) - wanted).max() <= BOUND * np.abs(wanted).max(initial=1.0)


def test_patterns_have_every_derivative_that_is_not_zero(solvers):
    for name in ("cart_pole", "four_bar", "quadrotor"):
        solver = solvers(name)
        f = codegen.casadi.function(solver, "accelerations")
        for seed in range(5):
            state, _, own = drawn(solver, seed)
            matrices = solver.jacobians(*state)
            for i, n in enumerate(f.name_in()):
                pattern = np.array(casadi.DM(f.jac_sparsity(0, i), 1.0).full(), bool)
                assert not (column(getattr(matrices, n), n, own) != 0.0)[~pattern].any(), (name, n)


def test_patterns_leave_out_what_has_no_influence(solvers):
    f = codegen.casadi.function(solvers("cart_pole"), "accelerations")
    by_q, by_u = (np.array(casadi.DM(f.jac_sparsity(0, i), 1.0).full(), bool) for i in (0, 1))
    assert by_q.tolist() == [[False, True], [False, True]]  # the place of the cart
    assert by_u.tolist() == [[False, True], [False, True]]  # its speed
    adjoint = f.reverse(1)
    assert adjoint.jac_sparsity(3, 3).nnz() == 0  # linear in the force


def test_threads_compute_what_one_thread_computes(solvers):
    solver = solvers("four_bar")
    f = codegen.casadi.function(solver, "accelerations")
    draw = np.random.default_rng(4)
    n = 64
    at = [
        draw.uniform(0.5, 1.5, (1, n)),
        draw.normal(size=(1, n)),
        np.tile(solver.parameters[:, None], n),
        np.zeros((1, n)),
    ]
    assert np.array_equal(f.map(n, "thread", 4)(*at), f.map(n)(*at))


def test_loops_are_closed_on_the_branch_of_the_initial_state(solvers):
    solver = solvers("four_bar", FUNCTIONS + ",assemble_sensitivities")
    f, ode = codegen.casadi.function(solver, "accelerations"), solver.ode()
    y = ode.initial.copy()
    for crank in np.linspace(y[0], y[0] + 2 * np.pi, 40):
        y[0] = crank
        q, u = ode.state(0.0, y)
        assert error(f(y[0], y[1], solver.parameters, 0.0), solver.accelerations(q, u)) <= 1e-10


def test_a_state_that_cannot_be_closed_is_an_error_of_casadi(solvers):
    solver = solvers("four_bar")
    p = solver.parameters
    p[solver.parameter_names.index("coupler_length")] = 0.01  # too short for any pose
    f = codegen.casadi.function(solver, "accelerations")
    with pytest.raises(RuntimeError, match="accelerations_four_bar"):
        f(0.8, 0.0, p, 0.0)


def test_the_equations_of_motion_are_those_of_ode(solvers):
    for name in ("cart_pole", "four_bar"):
        solver = solvers(name, FUNCTIONS + (",assemble_sensitivities" if name == "four_bar" else ""))
        ode, f = solver.ode(), codegen.casadi.ode(solver)
        y = ode.initial + 0.1
        given = {"y": y, "p": solver.parameters, "inputs": np.zeros(solver.ninputs)}
        assert error(f(*(given[n] for n in f.name_in())), ode(0.0, y)) <= BOUND
        symbols = [casadi.MX.sym(n, f.size1_in(n)) for n in f.name_in()]
        J = casadi.Function("J", symbols, [casadi.jacobian(f(*symbols), symbols[0])])
        assert error(J(*(given[n] for n in f.name_in())), ode.jacobian(0.0, y)) <= BOUND


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("accelrations", "name is 'accelrations', .* allowed are accelerations.* did you mean 'accelerations'"),
        ("outputs", "the package of four_bar has no outputs .* it has accelerations.* output_sensitivities"),
    ],
)
def test_unknown_functions_are_named_with_those_allowed(name, message, solvers):
    with pytest.raises(BridgeError, match=message):
        codegen.casadi.function(solvers("four_bar"), name)


def test_names_that_casadi_reserves_are_refused(tmp_path):
    model = CART_POLE.replace("model: cart_pole", "model: cart__pole")
    codegen.generate(codegen.parse_model(model), tmp_path / "s", compile=False, functions="accelerations,sensitivities")
    with pytest.raises(
        BridgeError, match=r"'cart__pole' begins with an underscore or has two in a row.*rename the model"
    ):
        codegen.casadi.function(codegen.load(tmp_path / "s", target="numpy"), "accelerations")


def test_a_folder_is_not_a_solver():
    with pytest.raises(BridgeError, match=r"solver is of type str; give a Solver, as ordernm.load returns it"):
        codegen.casadi.function("generated/four_bar", "accelerations")


def test_an_exported_library_has_the_functions(tmp_path, capsys):
    command = [
        "export",
        str(EXAMPLES / "four_bar.yaml"),
        "--casadi",
        "-o",
        str(tmp_path / "f"),
        "--functions",
        "outputs,closure",
    ]
    assert cli.main(command) == 0
    assert re.search(
        r"outputs_four_bar\(q\[1\], u\[1\], p\[6\], inputs\[1\]\) -> outputs\[5\]", capsys.readouterr().out
    )
    codegen.generate(
        EXAMPLES / "four_bar.yaml", tmp_path / "s", target="numpy", functions="outputs,closure_sensitivities"
    )
    solver = codegen.load(tmp_path / "s")
    state, given, _ = drawn(solver)
    library = str(tmp_path / "f" / "four_bar_casadi.so")
    f = casadi.external("outputs_four_bar", library)
    assert error(f(*(given[n] for n in f.name_in())), solver.outputs(*state)) <= 1e-10
    closure = casadi.external("closure_four_bar", library)
    q = state[0] + [0.0, 0.01, 0.0]
    assert error(closure(q, 0.0, state[2]), solver.closure(q, state[1], state[2])[0]) <= BOUND
    again = cli.main(command)  # its own folder
    assert again == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--functions", "outputz"], "four_bar has no function 'outputz' .* did you mean 'outputs'"),
        (
            ["--functions", "inverse_dynamics"],
            "allowed are accelerations, outputs, energies, coordinate_rates, closure",
        ),
        (["--scalar", "float32"], "--scalar is an option of --c, not of --casadi"),
        (["--c"], "give one of --c .plain C., --fmu .* and --casadi"),
    ],
)
def test_wrong_arguments_of_the_command_are_refused(arguments, message, tmp_path, capsys):
    command = ["export", str(EXAMPLES / "four_bar.yaml"), "--casadi", "-o", str(tmp_path / "f"), *arguments]
    assert cli.main(command) != 0
    assert re.search(message, capsys.readouterr().err)
    assert not (tmp_path / "f").exists()


def test_a_model_without_states_is_refused(tmp_path):
    model = codegen.parse_model(
        "model: driven\nbodies:\n  lift: {parent: ground, joint: {type: prismatic, axis: z}, mass: 2}\nmotion: {lift: sin(t)}\n"
    )
    with pytest.raises(BridgeError, match="driven: the model has no degree of freedom"):
        codegen.casadi.export_casadi(model, tmp_path / "f")


LONGER = CART_POLE.replace("com: [0, 0, -length]", "com: [0, 0, -2 * length]")


def test_a_package_that_was_generated_again_is_refused(tmp_path):
    functions = "accelerations,sensitivities,energies,energy_sensitivities"
    codegen.generate(codegen.parse_model(CART_POLE), tmp_path / "s", compile=False, functions=functions)
    solver = codegen.load(tmp_path / "s", target="numpy")
    at = ([0.1, 0.4], [0.2, 0.3], solver.parameters, 1.0)
    f = codegen.casadi.function(solver, "accelerations")
    codegen.generate(codegen.parse_model(LONGER), tmp_path / "s", compile=False, functions=functions)
    for name in ("accelerations", "energies"):
        with pytest.raises(PackageError, match="was generated again, or removed, after this solver was opened"):
            codegen.casadi.function(solver, name)
    again = codegen.load(tmp_path / "s", target="numpy")
    assert error(f(*at), solver.accelerations(*at[:3], [1.0])) <= BOUND  # it keeps its own library
    assert error(codegen.casadi.function(again, "accelerations")(*at), again.accelerations(*at[:3], [1.0])) <= BOUND


def test_a_library_that_is_open_is_not_replaced(tmp_path):
    """The system would open the old library by the same path again."""

    def exported(model: str):
        made = codegen.casadi.export_casadi(codegen.parse_model(model), tmp_path / "f", functions="energies")
        return casadi.external("energies_cart_pole", str(made.library))

    at = ([0.1, 0.4], [0.2, 0.3], [1.0, 0.3, 0.5, 9.81])
    f = exported(CART_POLE)
    before = f(*at)
    with pytest.raises(BridgeError, match=r"this process has opened .* would go on using its old functions"):
        exported(LONGER)
    assert error(f(*at), before) == 0.0 and error(exported(CART_POLE)(*at), before) == 0.0
    del f
    assert error(exported(LONGER)(*at), before) > 0.1


def test_a_step_is_that_of_the_integrator(solvers):
    solver = solvers("cart_pole", FUNCTIONS + ",motion")
    f, h = codegen.casadi.step(solver), 0.02
    q, u, push = [0.1, 0.4], [0.2, -0.3], [1.5]
    run = solver.simulate([0.0, h], q, u, inputs=push, method="rk4", step=h)
    assert error(f([*q, *u], solver.parameters, push, h), [*run.q[-1], *run.u[-1]]) <= BOUND


@pytest.mark.parametrize("name", ["cart_pole", "four_bar", "shaken_pendulum"])
def test_a_step_has_exact_derivatives(name, solvers):
    """Loops are closed at each stage; time moves on within the step."""
    solver = solvers(name, FUNCTIONS + (",assemble_sensitivities" if name == "four_bar" else ""))
    f, ode, h = codegen.casadi.step(solver), solver.ode(), 0.01
    y, t, slopes, tangents = ode.initial + 0.1, 0.3, [], []
    for of in (0.0, 0.5, 0.5, 1.0):
        at = y + (of * h * slopes[-1] if slopes else 0.0)
        slopes.append(ode(t + of * h, at))
        moved = np.eye(len(y)) + (of * h * tangents[-1] if tangents else 0.0)
        tangents.append(ode.jacobian(t + of * h, at) @ moved)
    after, J = (x + h / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3]) for x, k in ((y, slopes), (np.eye(len(y)), tangents)))
    given = {"y": y, "p": solver.parameters, "inputs": np.zeros(solver.ninputs), "t": t, "h": h}
    at, symbols = [given[n] for n in f.name_in()], [casadi.MX.sym(n, f.size1_in(n)) for n in f.name_in()]
    assert error(f(*at), after) <= BOUND
    assert error(casadi.Function("J", symbols, [casadi.jacobian(f(*symbols), symbols[0])])(*at), J) <= BOUND
    second = casadi.hessian(casadi.sum1(f(*symbols)), symbols[0])[0]
    second = np.array(casadi.densify(casadi.Function("H", symbols, [second])(*at)))
    assert np.abs(second).max() > 0.0 and error(casadi.DM(second.T), second) <= 1e-10


@pytest.mark.parametrize("function", ["outputs", "energies"])
def test_other_functions_have_the_hessians_of_the_solver(function, solvers):
    word = function.replace("outputs", "output").replace("energies", "energy")
    solver = solvers("four_bar", f"{function},{word}_sensitivities,{word}_gradients,{word}_hessian_products,assemble")
    state, given, own = drawn(solver)
    f = codegen.casadi.function(solver, function)
    symbols = [casadi.MX.sym(n, f.size1_in(n)) for n in f.name_in()]
    weights = np.random.default_rng(2).normal(size=f.size1_out(0))
    H = casadi.hessian(casadi.dot(casadi.DM(weights), f(*symbols)), casadi.vertcat(*symbols))[0]
    found = casadi.Function("H", symbols, [H])(*(given[n] for n in f.name_in()))
    sizes = {"q": solver.nq, "u": solver.nu, "p": solver.np, "inputs": solver.ninputs}
    at = np.cumsum([0, *(sizes[n] for n in f.name_in())])
    places = [a + i for a, n in zip(at, f.name_in(), strict=False) for i in own[n]]
    wanted = solver.hessians(*state, weights=weights, of=function, wrt=f.name_in())
    assert error(found, wanted[np.ix_(places, places)]) <= BOUND


def test_outputs_without_second_derivatives_are_exported_with_first_ones(tmp_path):
    """An output that depends on accelerations has no Hessian products; the export ended with an error."""
    made = codegen.casadi.export_casadi(EXAMPLES / "shaken_pendulum.yaml", tmp_path / "shaken")
    assert any(name.startswith("outputs") for name in made.functions)
