"""The benchmark problems among the examples: motions and their derivatives, against published or exact numbers.

Pendulum, coupled four-bars, Bricard's mechanism and the governor are A01, A02, A04 and A05 of the IFToMM library of
multibody benchmarks; Andrews' mechanism is A03, with the data of the Test Set for IVP Solvers. The numbers of A01, A02 and the
light cart are exact: Jacobi's functions and a quadrature in 40 digits. The others were integrated with other equations: A05
in two coordinates, A04 along its closure curve, Andrews' in 80-bit numbers.
"""

import numpy as np
import pytest
from motions import at, built, motion
from scipy.integrate import solve_ivp


def test_the_pendulum_swings_as_jacobi_says_and_so_do_its_derivatives(tmp_path):
    solver = built("pendulum", tmp_path, "sensitivities", "output_sensitivities")
    dp = np.eye(3)[:2]  # by g and by length

    def rates(t, y):
        y = y.reshape(3, 2)
        udot, dudot = solver.sensitivities(y[0, :1], y[0, 1:], dq=y[1:, :1], du=y[1:, 1:], dp=dp)
        return np.column_stack([y[:, 1], np.append(udot, dudot)]).ravel()

    start = np.array([[-np.pi / 2, 0], [0, 0], [0, 0]]).ravel()
    y = solve_ivp(rates, (0, 10), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1].reshape(3, 2)
    place, dplace = solver.output_sensitivities(y[0, :1], y[0, 1:], dq=y[1:, :1], du=y[1:, 1:], dp=dp)
    assert place[:2] == pytest.approx([-0.2750874625761168600543914, -0.9614192050991250642651351], abs=1e-11)
    exact = [
        [2.128235525459596756605769, -0.6089444722530455003300269],
        [-21.15307796733476104235699, 5.012326067703251293972429],
    ]
    assert dplace[:, :2] == pytest.approx(np.array(exact), rel=1e-10)


def test_the_coupled_four_bars_go_through_their_flat_poses_with_their_derivatives(tmp_path):
    """The independent crank alone is integrated, with its derivatives: where all bars lie flat, dependent ones lose digits."""
    solver = built(
        "n_four_bar",
        tmp_path,
        "sensitivities",
        "output_sensitivities",
        "initial_sensitivities",
        "assemble_sensitivities",
    )
    chosen = [solver.parameter_names.index(n) for n in ("g", "length", "mass_crank", "mass_coupler", "v0")]
    dp = np.eye(solver.np)[chosen]
    turns = np.array([1, -1, 1, -1, 1])  # couplers stay level

    def whole(y):
        dq, du = np.zeros((2, 5, 5))
        dq[:, 0], du[:, 0] = y[2:7], y[7:]
        return *solver.assemble(turns * y[0], turns * y[1]), {"dq": dq, "du": du, "dp": dp}

    def rates(t, y):
        q, u, seeds = whole(y)
        udot, dudot = solver.sensitivities(q, u, **seeds)
        return np.concatenate([y[1:2], udot[:1], y[7:], dudot[:, 0]])

    q, u, dq, du = solver.initial_sensitivities(dp=dp)
    start = np.concatenate([q[:1], u[:1], dq[:, 0], du[:, 0]])
    y = solve_ivp(rates, (0, 1), start, method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
    q, u, seeds = whole(y)
    values, derivatives = solver.output_sensitivities(q, u, **seeds)
    exact = [
        "-0.1950203019494350936 -0.9807992056621738326 -6.676678036881158066 1.327578325160487214",
        "-0.2375742400388048857 0.04723882295203836654 0.06651264024570170119 1.667975079327659281",
        "4.151054440151047338 -1.844964677663164671 -10.57399913759718163 -28.65259724961396446",
        "-0.07398740618351351220 0.01471151914792051987 0.02071393653366138694 0.5194550961334710332",
        "0.1109811092752702683 -0.02206727872188077980 -0.03107090480049208041 -0.7791826442002065498",
        "-2.015471447319806798 0.4007526188414944624 3.244832099905689874 13.61734004657011415",
    ]
    exact = np.array([[float(x) for x in line.split()] for line in exact])
    assert values[:4] == pytest.approx(exact[0], abs=1e-9)
    assert derivatives[:, :4] == pytest.approx(exact[1:], abs=1e-7)


def test_bricards_mechanism_swings_as_along_its_closure_curve(tmp_path):
    solver = built("bricard", tmp_path, "accelerations", "outputs")
    rows = {
        1.0: [0.2744813192646729, -0.8867079387346791, -0.46233000268736246, 1.0350284595179695, -0.4806211041771693],
        3.0: [-0.7712813589686761, -0.9792693298398109, -0.20256253265371635, 2.8847616044589284, -0.20397399620935652],
        5.0: [
            0.9999327423021317,
            -0.9999999977383532,
            -6.725543606893905e-5,
            6.725995971756937e-5,
            -6.725543612007279e-5,
        ],
    }
    states = motion(solver, *solver.initial, list(rows))
    for (q, u), row in zip(states, rows.values(), strict=True):
        assert [*solver.outputs(q, u)[:3], q[0], q[1]] == pytest.approx(row, abs=1e-10)


def test_andrews_mechanism_arrives_where_it_should(tmp_path):
    """At 0.03 s, after two and a half turns; of the 16 digits that are published, 9 are right in q and 7 in u."""
    solver = built("andrews", tmp_path, "accelerations", "closure")
    q = "15.810771195153704691 -15.756371058411837046 0.040822240119646751159 -0.53473011634207794399" \
        " 0.52440996587995403308 0.53473011634207770118 1.0480807410419377723"  # fmt: skip
    u = "1139.9203022591064587 -1424.3792951775405951 11.032911910618192986 19.293374105031347900" \
        " 0.57356991482946315114 -19.293374105031356086 0.32317914924916315769"  # fmt: skip
    udot = "-24631.763122872729166 51850.319636460715646 324102.60070757890045 566749.42200099581009" \
        " 16743.635418345231852 -566749.42200099580765 9826.5078015451039537"  # fmt: skip
    q, u, udot = (np.array([float(x) for x in line.split()]) for line in (q, u, udot))
    ((found, speeds),) = motion(solver, *solver.initial, [0.03], tolerance=1e-13)
    assert found == pytest.approx(q, abs=1e-11)
    assert speeds == pytest.approx(u, rel=1e-10, abs=1e-9)
    assert solver.accelerations(found, speeds) == pytest.approx(udot, rel=1e-9)
    assert max(np.abs(r).max() for r in solver.closure(found, speeds)) < 1e-9

    published = [15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948, 0.5244099658805304,
                 0.5347301163226948, 1.048080741042263]  # fmt: skip
    assert found == pytest.approx(published, abs=2e-9)


def test_the_governor_is_stiff_and_its_slider_goes_where_it_should(tmp_path):
    """Its state at 0.1, 1 and 10 s, its fastest rate, and a derivative; by an implicit integrator with the solver's Jacobians."""
    solver = built("flyball", tmp_path, "dynamics", "states")

    def jacobian(q, u):
        J = solver.jacobians(q, u)
        return np.block([[np.zeros((4, 4)), np.eye(4)], [J.q, J.u]])

    def rates(t, y):
        q, u, dq, du = y.reshape(4, 4)
        udot, dudot = solver.sensitivities(q, u, dq=dq, du=du, dp={"free_length": 1.0})
        return np.concatenate([u, udot, du, dudot[0]])

    def newton(
        t, y
    ):  # of the derivatives it is right up to second derivatives of udot, which Newton's method can do without
        return np.kron(np.eye(2), jacobian(y[:4], y[4:8]))

    start = np.concatenate([*solver.initial, np.zeros(8)])
    rows = {
        0.1: [0.5238364755695756, 0.49617386907590066, 6.103717808830864, 0.45927181043651294, -0.5226739297538827],
        1.0: [0.5014209223795666, 0.5218333016255472, 6.271125741876561, -0.12215149289767215, 0.14088557947955146],
        10.0: [0.6196229170613666, 0.39007370184464446, 5.548203622654923, -0.7476033541643169, 0.8084670513455873],
    }
    found = solve_ivp(rates, (0, 10), start, method="LSODA", jac=newton, t_eval=list(rows), rtol=1e-10, atol=1e-12).y.T
    for y, row in zip(found, rows.values(), strict=True):
        assert y[[1, 2, 4, 5, 6]] == pytest.approx(row, abs=1e-8)
        assert y[[2, 6]] == pytest.approx(y[[3, 7]], abs=1e-12), "both arms move alike"
    assert min(np.linalg.eigvals(jacobian(found[0, :4], found[0, 4:8])).real) == pytest.approx(
        -7403.412178462742, rel=1e-8
    )
    assert found[-1, 9] == pytest.approx(-1.1457145, abs=1e-6), "the slider's height by the free length of the springs"


def test_a_cart_without_mass_goes_fast_where_the_pole_hangs_down(tmp_path):
    """`swing_up` with a cart of 1e-6 kg under a ball on a bar without mass: 4429 rad/s for a microsecond, twice in a second."""
    solver = built("swing_up", tmp_path, "accelerations", "energies")
    p = {"cart_mass": 1e-6, "pole_length": 1, "pole_mass": 0, "bob_mass": 1, "cart_damping": 0, "pole_damping": 0}
    crossing = 0.4515245356816588751002399
    q, u = at(solver, pole=np.pi / 2), np.zeros(2)
    states = motion(solver, q, u, [0.1, crossing, 1.0], p, tolerance=1e-12)
    exact = "0.0012036744627212517131 1.5217266372411218006 0.048175990056133427544 -0.98218222742784641825"
    assert np.ravel(states[0]) == pytest.approx([float(x) for x in exact.split()], abs=1e-10)
    assert states[1][1][1] == pytest.approx(-4429.449132792925527084625, rel=1e-5)
    exact = "1.9989346249749670084 -1.5246755157586769975 -0.043896062749778665753 0.95210105020290733184"
    assert np.ravel(states[2]) == pytest.approx([float(x) for x in exact.split()], abs=1e-7)
