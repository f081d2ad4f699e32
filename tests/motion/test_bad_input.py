"""Wrong arguments and states, and motions that end early: messages, and the results up to the end."""

from __future__ import annotations

import pickle
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motion.models import FALLING, Made, driven, example, parsed

import codegen
from codegen.runtime import At, AtEvent, Event, Final, Integral, LeastSquares, NoCompilerError, SimulationError

ANOTHER_FINAL = type("Final", (), {"output": "swing"})()
"""As a package of another version has it."""
ANOTHER_EVENT = type("Event", (), {"output": "swing"})()
CHAOTIC = ({"crank": 0.8}, {"crank": 3.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"t": -1.0}, r"t is -1 s, expected a positive number"),
        ({"t": 0}, r"t is 0 s, expected a positive number"),
        ({"t": np.nan}, r"entries that are not finite; expected seconds, or increasing times"),
        ({"t": np.inf}, r"entries that are not finite"),
        ({"t": []}, r"t has shape \(0,\)"),
        ({"t": [0.0]}, r"at least two are needed"),
        ({"t": [0.0, 1.0, 1.0]}, r"times must increase"),
        ({"t": [1.0, 0.0]}, r"times must increase"),
        ({"t": [[0.0, 1.0]]}, r"t has shape \(1, 2\)"),
        ({"t": "soon"}, r"t: .*expected a number of seconds"),
        ({"t": None}, r"expected seconds"),
        ({"rtol": 1e-15}, r"rtol is 1e-15, below the rounding of floating-point numbers; allowed are 1e-14 and more"),
        ({"rtol": 0.0}, r"rtol is 0.0, expected a positive number"),
        ({"rtol": "small"}, r"rtol is 'small', expected a positive number"),
        ({"atol": 0.0}, r"atol has entries that are not positive"),
        ({"atol": [1e-9] * 5}, r"atol is .* expected a positive number, or 6 of them"),
        ({"atol": [1e-9] * 5 + [np.nan]}, r"atol has entries that are not positive"),
        ({"sensitivities": "base", "atol_sensitivities": [1, 2]}, r"atol_sensitivities is .* or 1 of them"),
        ({"method": "euler"}, r"method is 'euler'; allowed are 'rk4', 'dop853', 'radau'"),
        ({"method": "rk4"}, r"method 'rk4' takes constant steps: give step, s"),
        ({"step": -0.1}, r"step is -0.1, expected a positive number"),
        ({"largest_step": np.inf}, r"largest_step is inf"),
        ({"most_steps": 0}, r"most_steps is 0, expected a positive number"),
        ({"on_failure": "ignore"}, r"on_failure is 'ignore'; allowed are 'raise' and 'return'"),
        ({"sensitivities": "bas"}, r"'bas' is not known; expected one of .*did you mean 'base'\?"),
        ({"sensitivities": "q0.crnk"}, r"did you mean 'q0.crank'\?"),
        ({"sensitivities": "inputs.moter"}, r"did you mean 'inputs.motor'\?"),
        ({"sensitivities": "q0.rocker"}, r"q0.rocker is dependent; name an independent one: crank"),
        ({"sensitivities": ("base", "base")}, r"sensitivities contain a name twice"),
        ({"sensitivities": (3,)}, r"sensitivities contain 3, expected names"),
        ({"sensitivities": True}, r"sensitivities is True, expected a name or a sequence of names"),
        ({"sensitivities": "inputs.motor[7]"}, r"the input has 1 value, counted from 0"),
        ({"dq0": np.zeros((2, 4))}, r"dq0"),
        ({"sensitivities": ("base", "friction"), "dq0": np.zeros((1, 3))}, r"dq0 has shape \(1, 3\), expected \(2, 3\)"),
        ({"q": np.zeros(4)}, r"q has shape \(4,\)"),
        ({"q": {"crnk": 1.0}}, r"'crnk'.*crank"),
        ({"p": np.ones((2, 6))}, r"p has shape \(2, 6\), expected \(6,\): one motion at a time"),
        ({"q": np.zeros((2, 3))}, r"leading axes \(2,\), expected \(nq,\) and \(nu,\): one motion at a time"),
        ({"inputs": [1.0, 2.0]}, r"inputs have shape \(2,\), expected \(1,\): one number for each of motor; or \(times"),
        ({"inputs": {"moter": 1.0}}, r"inputs: 'moter' is not known; expected one of motor"),
        ({"inputs": ([0, 1], [[1.0], [2.0], [3.0]])}, r"values of inputs have shape \(3, 1\), expected \(2, 1\)"),
        ({"inputs": ([0, 1], [[1.0], [2.0]], "spline")}, r"expected \(4, 1\): control points, two more than times"),
        ({"inputs": ([0, 1], [[1.0], [2.0]], "curve")}, r"joined by 'curve'; allowed are 'hold', 'linear', 'spline', 'cubic'"),
        ({"inputs": ([1, 0], [[1.0], [2.0]])}, r"times of inputs: they must increase"),
        ({"inputs": ([0, np.nan], [[1.0], [2.0]])}, r"times of inputs has entries that are not finite"),
        ({"inputs": ([0], [[1.0]])}, r"at least 2 entries"),
        ({"events": "trace_y"}, r"events: the model has no output 'trace_y'; it has trace_x"),
        ({"events": 3.0}, r"events contain 3.0"),
        ({"events": ANOTHER_EVENT}, r"this Event belongs to another version of ordernm .* generate the package again"),
        ({"events": [3.0]}, r"events contain 3.0, expected names of outputs"),
        ({"events": Event("swing", direction="left")}, r"direction is 'left'; allowed are 'up', 'down', 'both'"),
        ({"events": Event("swing", np.nan)}, r"the level of swing is nan"),
        ({"events": Event("swing", level="max")}, r"the level of swing is 'max', expected a finite number"),
        ({"events": Event("swing", level=None)}, r"the level of swing is None, expected a finite number"),
        ({"events": Event("swing", direction=["up"])}, r"direction is \['up'\]; allowed are 'up', "),
        ({"events": Event("swing", stop="no")}, r"stop is 'no'; allowed are True and False"),
    ],
)  # fmt: skip
def test_arguments(four_bar: Any, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        four_bar.simulate(**({"t": 1.0} | arguments))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"functionals": []}, r"no functional is given"),
        ({"functionals": "swing"}, r"'swing' is not a functional"),
        ({"functionals": 3.0}, r"3.0 is not a functional; allowed are Final, At"),
        ({"functionals": ANOTHER_FINAL}, r"this Final belongs to another version of ordernm .* generate the package again"),
        ({"functionals": [Final("swing"), ANOTHER_FINAL]}, r"this Final belongs to another version of ordernm"),
        ({"functionals": Final("swng")}, r"Final: the model has no output 'swng'"),
        ({"functionals": At("swing", 2.0)}, r"At: times from 2 to 2 s are not within the motion, 0 to 1 s"),
        ({"functionals": At("swing", np.nan)}, r"times must be finite"),
        ({"functionals": At("swing", [0.1, 0.2])}, r"At: t is \[0.1, 0.2\], expected one time, s; give an At for each"),
        ({"functionals": LeastSquares([0.0, 0.5], {"swing": [1.0]})}, r"swing has \(1,\) samples, expected \(2,\)"),
        ({"functionals": LeastSquares([0.5, 0.5], {"swing": [1.0, 1.0]})}, r"times must be finite and increasing"),
        ({"functionals": AtEvent("swing", Event("swng"))}, r"events: the model has no output 'swng'"),
        ({"functionals": AtEvent("swing", Event("swing", direction="left"))}, r"direction is 'left'"),
        ({"functionals": Final("t")}, r"no output 't'"),
        ({"functionals": Final("swing"), "method": "backwards"}, r"method is 'backwards'; allowed are 'auto'"),
        ({"functionals": Final("swing"), "integrator": "euler"}, r"integrator is 'euler'; allowed are 'rk4'"),
        ({"functionals": Final("swing"), "integrator": "rk4"}, r"integrator 'rk4' takes constant steps: give step"),
        ({"functionals": Final("swing"), "t": [0, 1, 2]}, r"expected the end of the motion, or its start and end"),
        ({"functionals": Final("swing"), "t": -1.0}, r"the end must be later than the start"),
        ({"functionals": Final("swing"), "t": (2.0, 1.0)}, r"the end must be later than the start"),
        ({"functionals": Final("swing"), "wrt": "bse"}, r"did you mean 'base'"),
    ],
)  # fmt: skip
def test_arguments_of_judge(four_bar: Any, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        four_bar.judge(**({"t": 1.0} | arguments))


def test_judging_what_an_event_has_ended(falling: Any) -> None:
    lands = AtEvent("t", Event("z"))
    for f, message in [
        (Final("z"), r"z at t = 1 s is requested, but an event has ended the motion at 0.638550857 s; use AtEvent"),
        (Integral("z"), r"the integral of z: an event has ended the motion before t = 1 s"),
        (LeastSquares([0.1, 0.9], {"z": [1, 2]}), r"an event has ended the motion before the last sample"),
    ]:
        with pytest.raises(SimulationError, match=message):
            falling.judge(1.0, [lands, f], wrt="g")
    with pytest.raises(SimulationError, match=r"the event z = -9 did not occur by t = 1 s"):
        falling.judge(1.0, AtEvent("t", Event("z", -9.0)), wrt="g")


def test_initial_states_by_name(four_bar: Any, recwarn: Any) -> None:
    """Independent coordinates suffice; dependent ones that change are reported, and so are dependent speeds alone."""
    first, *others = four_bar.coordinate_names
    found = four_bar.simulate(0.1, {first: 0.8}, {first: 1.0})
    assert found.q[0, 0] == 0.8 and found.u[0, 0] == 1.0 and found.closure_drift < 1e-12
    assert not recwarn.list
    with pytest.warns(RuntimeWarning, match="the initial state does not close the loops"):
        four_bar.simulate(0.1, {first: 0.8, others[0]: -0.3})
    says = rf"u: {others[0]} follow from the independent speeds \({first}\), so these values have no effect"
    for call in (
        lambda: four_bar.simulate(0.1, u={others[0]: 1.0}),
        lambda: four_bar.assemble(None, {others[0]: 1.0}),
        lambda: four_bar.accelerations(four_bar.initial[0], {others[0]: 1.0}),
    ):
        with pytest.warns(RuntimeWarning, match=says):
            call()


def test_initial_states_that_are_open(four_bar: Any) -> None:
    with pytest.warns(RuntimeWarning, match=r"the initial state does not close the loops"):
        found = four_bar.simulate(0.1, q=[0.8, -0.3, -1.9])
    assert found.q[0, 0] == 0.8 and found.closure_drift < 1e-12
    with pytest.warns(
        RuntimeWarning, match=r"initial speeds do not keep the loops closed; dependent ones have been changed"
    ):
        found = four_bar.simulate(0.1, four_bar.initial[0], [3.0, 1.0, 1.0])
    assert found.u[0, 0] == 3.0
    with pytest.raises(codegen.runtime.AssemblyError):
        four_bar.simulate(0.1, p={"crank_length": 9.0})


def test_rates_without_bounds_collapse_the_step(made: Callable[..., Made]) -> None:
    solver = made(driven, "1.0", "1/(1 - q.stone)").solver
    for options in ({}, {"sensitivities": ("q0.stone", "u0.stone")}):
        with pytest.raises(
            SimulationError,
            match=r"ends at t = 0\.\d+ s: steps have become too small, because of [qu].stone",
        ) as e:
            solver.simulate(5.0, u=[2.0], **options)
        so_far = e.value.trajectory
        assert so_far is not None and len(so_far) > 10 and 0.9 < so_far["z"][-1] <= 1.0
        assert "too small" in so_far.ended and np.isfinite(so_far.q).all()
    with pytest.warns(RuntimeWarning, match="steps have become too small"):
        found = solver.simulate(np.linspace(0, 5, 1001), u=[2.0], on_failure="return")
    assert 10 < len(found) < 1001
    np.testing.assert_allclose(found.t, np.linspace(0, 5, 1001)[: len(found)])


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 0.01}], ids=["dop853", "rk4"])
def test_rates_that_are_no_numbers(made: Callable[..., Made], options: dict[str, Any]) -> None:
    solver = made(driven, "1.0", "log(1 - q.stone)").solver
    with pytest.raises(
        SimulationError,
        match=r"the motion ends at t = [\d.]+ s: (steps have become too small|the time derivative of u.stone is not finite)",
    ) as e:
        solver.simulate(5.0, u=[4.0], **options)
    assert np.isfinite(e.value.trajectory.q).all() and len(e.value.trajectory) > 3
    with pytest.raises(
        SimulationError, match=r"the motion ends at t = 0 s: the time derivative of u.stone is not finite"
    ) as e:
        solver.simulate(5.0, q=[2.0], **options)
    assert len(e.value.trajectory) == 0


def test_too_many_steps(four_bar: Any) -> None:
    with pytest.raises(
        SimulationError, match=r"after 20 steps, kept small by [qu].crank; allow more with most_steps, or loosen rtol"
    ) as e:
        four_bar.simulate(10.0, most_steps=20)
    assert len(e.value.trajectory) + e.value.trajectory.stats["rejected"] == 21
    with pytest.raises(SimulationError, match="after 20 constant steps; allow more with most_steps, or a larger step"):
        four_bar.simulate(10.0, method="rk4", step=1e-3, most_steps=20)


def test_singular_on_the_way(made: Callable[..., Made]) -> None:
    """The mass vanishes at the beginning; sensitivities or not, it is told which joint."""
    solver = made(driven, "a", "1 - q.stone").solver
    with pytest.raises((SimulationError, ValueError), match="stone"):
        solver.simulate(1.0, p=[0.0])
    with pytest.raises((SimulationError, ValueError), match="stone"):
        solver.judge(1.0, Final("z"), p=[0.0], wrt="a")


def test_a_linkage_driven_beyond_its_reach(made: Callable[..., Made]) -> None:
    """Not every crank turns round: with a short coupler it is at the end of its reach."""
    solver = made(example, "four_bar").solver
    p = solver.parameters.copy()
    for name, x in {"coupler_length": 0.5, "crank_length": 0.6, "friction": 0.0}.items():
        p[solver.parameter_names.index(name)] = x
    q, u = solver.assemble({"crank": 0.8}, {"crank": 4.0}, p)
    with pytest.raises(SimulationError, match=r"the motion ends at t = 0\.\d+ s: ") as e:
        solver.simulate(5.0, q, u, p, rtol=1e-10, atol=1e-10)  # longer steps may leap over the pose
    so_far = e.value.trajectory
    assert len(so_far) > 3 and so_far.closure_drift < 1e-8 and np.isfinite(so_far.q).all()


def test_an_interrupt_leaves_what_was_computed(four_bar: Any) -> None:
    told: list[float] = []

    def stop(t: float, end: float) -> None:
        told.append(t)
        assert end == 1e5
        if len(told) == 4:
            raise KeyboardInterrupt

    began = time.perf_counter()
    found = four_bar.simulate(np.linspace(0, 1e5, 11), inputs=[0.5], progress=stop, most_steps=10**9)
    assert time.perf_counter() - began < 5
    assert found.ended == "interrupted" and len(found) < 11
    assert (np.diff(told) > 0).all()


def test_progress_is_told_about_ten_times_a_second(four_bar: Any) -> None:
    times: list[float] = []

    def progress(t: float, end: float) -> None:
        times.append(time.perf_counter())
        if times[-1] - times[0] > 0.8:
            raise KeyboardInterrupt

    # rows at every step, whose memory fills up in between
    four_bar.simulate(1e5, inputs=[0.5], sensitivities="base", progress=progress, most_steps=10**9)
    assert len(times) <= 12, len(times)


def test_errors_in_progress_come_through(four_bar: Any) -> None:
    def broken(t: float, end: float) -> None:
        raise RuntimeError("the screen is gone")

    with pytest.raises(RuntimeError, match="the screen is gone"):
        four_bar.simulate(1.0, progress=broken)


def test_meaningless_sensitivities_are_told(made: Callable[..., Made]) -> None:
    solver = made(driven, "1.0", "100*q.stone").solver
    with pytest.warns(
        RuntimeWarning, match=r"sensitivities have grown beyond 1e\+10: the motion is chaotic or unstable"
    ):
        solver.simulate(3.0, sensitivities="q0.stone")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solver.simulate(1.0, sensitivities="q0.stone")


def test_a_solver_that_computes_with_numpy_integrates_in_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "falling"
    codegen.generate(codegen.parse_model(FALLING), folder, target="numpy", check=False)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(
        NoCompilerError, match=r"motions are integrated in compiled code, and no C compiler found: .*set CC"
    ):
        codegen.load(folder).simulate(1.0)
    monkeypatch.delenv("CC")
    solver = codegen.load(folder)
    assert solver.target == "numpy"
    assert solver.simulate([0.0, 0.5])["z"][-1] == pytest.approx(2.0 - 9.81 / 8, rel=1e-12)
    assert solver.judge(0.5, Final("z"), wrt="g").gradients[0, 0] == pytest.approx(-1 / 8, rel=1e-12)


LACKING = {
    "accelerations": {"simulate": "state_rates", "judge": "outputs"},
    "state_rates": {"simulate": None, "along": "initial_sensitivities|state_rate_sensitivities", "event": "outputs"},
    "state_rate_sensitivities": {"simulate": None, "along": None, "event": "outputs"},
    "state_rates,outputs": {
        "simulate": None, "event": "output_sensitivities", "judge": None, "forward": "initial_sensitivities|output_sensitivities",
    },
    "simulate": {"simulate": None, "along": None, "event": None, "judge": None, "forward": None, "adjoint": "gradients"},
    "motion": {"simulate": None, "along": None, "event": None, "judge": None, "forward": None, "adjoint": None},
}  # fmt: skip


@pytest.mark.parametrize("functions", LACKING)
@pytest.mark.parametrize("draw", [(parsed, FALLING), (example, "four_bar")], ids=["falling", "four_bar"])
def test_chosen_functions(made: Callable[..., Made], functions: str, draw: Any) -> None:
    """A function that was left out is named; in C there is nobody to ask."""
    solver = made(*draw, functions=tuple(functions.split(","))).solver
    p, output = solver.parameter_names[0], solver.output_names[0]
    calls: dict[str, Callable[[], Any]] = {
        "simulate": lambda: solver.simulate(0.1),
        "along": lambda: solver.simulate(0.1, sensitivities=p),
        "event": lambda: solver.simulate(0.1, events=Event(output, 1.99, stop=False)),
        "judge": lambda: solver.judge(0.1, Integral(output)),
        "forward": lambda: solver.judge(0.1, Final(output), wrt=p, method="forward"),
        "adjoint": lambda: solver.judge(0.1, Integral(output), wrt=p, method="adjoint"),
    }
    for call, lacks in LACKING[functions].items():
        if lacks is None:
            calls[call]()
            continue
        if solver.closure_names:
            lacks += "|assemble_sensitivities"
        with pytest.raises(
            AttributeError,
            match=f"was generated without ({lacks})(, .*)?(, which simulate needs)?; generate it with --functions",
        ):
            calls[call]()
    if functions == "state_rates":
        assert solver.simulate(0.1).output_names == ()


def test_several_at_once_on_one_solver(four_bar: Any) -> None:
    """Threads share the solver and nothing else."""
    cases = [{"inputs": [0.1 * i], "sensitivities": ("base", "crank_length")[: i % 3]} for i in range(12)]

    def run(case: dict[str, Any]) -> Any:
        return four_bar.simulate(np.linspace(0, 4, 50), **case)

    alone = [run(c) for c in cases]
    with ThreadPoolExecutor(6) as pool:
        together = list(pool.map(run, cases))
    for a, b in zip(alone, together, strict=True):
        np.testing.assert_array_equal(a.q, b.q)
        np.testing.assert_array_equal(a.doutputs, b.doutputs)
    assert threading.active_count() < 20


def test_pickling(falling: Any) -> None:
    found = falling.simulate(1.0, sensitivities="g", events="z")
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again["z"], found["z"])
    assert again.events[0].t == found.events[0].t and again.events[0].event == found.events[0].event
    judged = falling.judge(1.0, Final("z"), wrt="g")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(judged)).gradients, judged.gradients)
    solver = pickle.loads(pickle.dumps(falling))
    np.testing.assert_array_equal(solver.simulate(1.0)["z"], falling.simulate(1.0)["z"])
    with pytest.raises(SimulationError) as e:
        falling.simulate(1.0, most_steps=1)
    error = pickle.loads(pickle.dumps(e.value))
    assert str(error) == str(e.value) and len(error.trajectory) == len(e.value.trajectory)
