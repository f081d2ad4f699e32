"""Gradients of functionals: sensitivities along the motion and the discrete adjoint agree to rounding.

On random trees and random mechanisms, split joints and quaternions among them; forward and backwards make the same steps, so
nothing but rounding may differ.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from motion.models import EXAMPLES, Made, example, mechanism, parsed, split, tree

import codegen.runtime.standalone.motion.adjoint as motion_adjoint
import codegen.runtime.standalone.motion.functional_gradients as judging
from codegen.runtime import At, AtEvent, Event, Final, Integral, LeastSquares
from codegen.runtime.standalone.motion.functionals import WeightedResults

END = 0.4

INTEGRATORS: dict[str, dict[str, Any]] = {
    "dop853": {}, "rk4": {"integrator": "rk4", "step": 0.011}, "radau": {"integrator": "radau", "rtol": 1e-7, "atol": 1e-7},
}  # fmt: skip

MODELS = {
    "tree": (tree, 7),
    "mechanism": (mechanism, 7),
    "split": (split, "rods_on_platform"),
    "four_bar": (example, "four_bar"),
}


def inputs_over_time(rng: np.random.Generator, n: int, kind: str) -> Any:
    if kind == "constant" or not n:
        return rng.uniform(-1, 1, n)
    times = [-0.1, 0.07, 0.16, 0.27, 0.35, 0.5]
    return times, rng.uniform(-1, 1, (len(times) + 2 * (kind == "spline"), n)), kind


def directions(solver: Any, inputs: Any, rng: np.random.Generator, k: int) -> list[str]:
    """Names of k directions of all kinds, as far as there are so many."""
    names = [*solver.parameter_names, *(f"q0.{n}" for n in solver.independent_names)]
    names += [f"u0.{n}" for n in solver.independent_speed_names]
    for n in solver.input_names:
        names += [f"inputs.{n}"]
        names += [f"inputs.{n}[{i}]" for i in range(len(inputs[1]))] if isinstance(inputs, tuple) else []
    return [str(x) for x in rng.permutation(names)[:k]]


def functionals(solver: Any, rng: np.random.Generator, level: float | None) -> list[Any]:
    first, last = solver.output_names[0], solver.output_names[-1]
    times = np.sort(rng.uniform(0, END, 9))
    times[0], times[-1] = 0.0, END
    samples = rng.uniform(-1, 1, (2, 9))
    samples[0, 3] = np.nan
    found: list[Any] = [
        Final(first), At(last, 0.3 * END), Integral("kinetic"), At(first, 0.0),
        LeastSquares(times, {first: samples[0], last: samples[1]}, {first: 0.3, last: rng.uniform(0.5, 1, 9)}), Integral(first),
        LeastSquares([0.1, 0.2], {last: [0.3, 0.4]}), Final("kinetic"),
    ]  # fmt: skip
    found.append(weighted_results(solver, times))
    if level is not None:
        event = Event("height" if "height" in solver.output_names else first, level, stop=False)
        found[1:1] = [AtEvent("t", event), AtEvent("kinetic", event)]
    return found


def weighted_results(solver: Any, times: Any) -> WeightedResults:
    """Random weights of all coordinates and speeds, quaternions and dependent ones among them, and of two outputs."""
    rng = np.random.default_rng(solver.nq)
    outputs = np.zeros((len(times), solver.noutputs))
    outputs[:, [0, -1]] = rng.normal(size=(len(times), 2))
    return WeightedResults(times, rng.normal(size=(len(times), solver.nq + solver.nu)), outputs)


def both(made: Made, wanted: Any, wrt: list[str], inputs: Any, **options: Any) -> tuple[Any, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tuple(
            made.solver.judge(END, wanted, made.q, p=made.p, inputs=inputs, wrt=wrt, method=method, **options)
            for method in ("forward", "adjoint")
        )


def agree(forward: Any, adjoint: Any, limit: float = 1e-11) -> None:
    assert forward.method == "forward" and adjoint.method == "adjoint"
    assert forward.counts["steps"] == adjoint.counts["steps"]
    np.testing.assert_allclose(forward.values, adjoint.values, rtol=1e-13, atol=1e-15)
    difference = np.abs(forward.gradients - adjoint.gradients).max(axis=1)
    size = np.abs(forward.gradients).max(axis=1)
    assert (difference <= limit * np.maximum(size, 1e-3)).all(), difference / size
    assert size.max() > 1e-3 or len(forward.names) == 1  # an input's value may have gone before it acts


def crossed(made: Made, inputs: Any, options: dict[str, Any]) -> float | None:
    """A level that the height, or first output, crosses well within the motion."""
    name = "height" if "height" in made.solver.output_names else made.solver.output_names[0]
    kept = {"method" if n == "integrator" else n: x for n, x in options.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        x = made.solver.simulate(np.linspace(0, END, 41), made.q, p=made.p, inputs=inputs, **kept)[name]
    i = 5 + int(np.argmax(np.abs(np.diff(x[5:35]))))
    return float(0.5 * (x[i] + x[i + 1])) if abs(x[i + 1] - x[i]) > 1e-5 else None


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", MODELS)
def test_forward_is_adjoint(made: Callable[..., Made], name: str, integrator: str) -> None:
    of = made(*MODELS[name])
    events = 0
    for i, kind in enumerate(("constant", "hold", "linear", "spline")):
        rng = np.random.default_rng([i, len(name)])
        inputs = inputs_over_time(rng, of.solver.ninputs, kind)
        options = INTEGRATORS[integrator]
        level = crossed(of, inputs, options)
        events += level is not None
        for k in (1, 7, 8, 9, 17):
            wrt = directions(of.solver, inputs, rng, k)
            agree(*both(of, functionals(of.solver, rng, level), wrt, inputs, **options))
    assert events


def test_one_functional_uses_single_lanes(made: Callable[..., Made]) -> None:
    of = made(*MODELS["tree"])
    wrt = directions(of.solver, None, np.random.default_rng(1), 17)
    weighted = weighted_results(of.solver, np.array([0.1, 0.3]))
    squares = LeastSquares([0.2, 0.3], {"speed": [0, 1]})
    for f in (Final("height"), Integral("kinetic"), At("speed", 0.111), squares, weighted):
        agree(*both(of, f, wrt, None))


@pytest.mark.parametrize("name", ["tree", "mechanism", "split"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_steps_that_are_made_again_are_the_same(
    made: Callable[..., Made], monkeypatch: pytest.MonkeyPatch, name: str, integrator: str
) -> None:
    of = made(*MODELS[name])
    again, kept = [], []
    made_again, let_go = motion_adjoint.made_again, judging.FunctionalGradients._run

    def counted(*arguments: Any) -> Any:
        again.append(len(arguments[-1]))
        return made_again(*arguments)

    def run(self: Any, *arguments: Any, **options: Any) -> Any:
        found = let_go(self, *arguments, **options)
        kept.append(sum(x.nbytes for s in found.segments for x in s.steps))
        return found

    monkeypatch.setattr(motion_adjoint, "made_again", counted)
    monkeypatch.setattr(judging.FunctionalGradients, "_run", run)
    rng = np.random.default_rng(3)
    inputs = inputs_over_time(rng, of.solver.ninputs, "linear")
    wrt = directions(of.solver, inputs, rng, 8)
    options = {"largest_step": 0.004} | INTEGRATORS[integrator]
    wanted = functionals(of.solver, rng, None)
    whole = both(of, wanted, wrt, inputs, **options)
    assert not again
    states = 12 if integrator == "dop853" else 4  # rows have those of all stages
    memory = 32 * 8 * (4 + states * (2 * of.solver.nq + of.solver.nu + 2))
    parts = both(of, wanted, wrt, inputs, memory=memory, **options)
    assert len(again) > 2 and max(again) > 3
    assert kept[-1] < kept[1]
    agree(*parts)
    # the same numbers, not only nearly so, but for a time that is a knot in one and rounded in the other
    np.testing.assert_allclose(parts[1].gradients, whole[1].gradients, rtol=1e-12, atol=1e-13)
    assert parts[1].counts["steps"] == whole[1].counts["steps"]


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_independents_that_change_on_the_way(made: Callable[..., Made], integrator: str) -> None:
    """A crank driven by its piston, which has a dead point at 0.15 s: from there on the crank is independent."""
    text = (EXAMPLES / "slider_crank.yaml").read_text()
    text = text.replace("independent: [wheel]", "independent: [piston]").replace(
        "u: {wheel: 20.0}", "u: {piston: -2.0}"
    )
    of = made(parsed, text, partitions=2, functions=("motion",))
    crossed = AtEvent("speed", Event("stroke", 0.52, stop=False))
    weighted = weighted_results(of.solver, np.linspace(0.0, END, 7))
    wanted = [Final("stroke"), At("speed", 0.11), Integral("kinetic"), crossed, At("stroke", 0.333), weighted]
    wrt = [*of.solver.parameter_names, "q0.piston", "u0.piston", "inputs.load"]
    options = INTEGRATORS[integrator] | ({"step": 0.003} if integrator == "rk4" else {})
    forward, adjoint = both(of, wanted, wrt, [0.5], **options)
    assert forward.counts["partitions_changed"] == adjoint.counts["partitions_changed"] == 1
    agree(forward, adjoint)


@pytest.mark.parametrize(("integrator", "tolerance"), [("dop853", 1e-12), ("radau", 3e-14)])
def test_change_of_independents_against_a_motion_without(
    made: Callable[..., Made], integrator: str, tolerance: float
) -> None:
    """The same crank driven by its piston, and by itself, with the piston's initial speed: then nothing changes on the way.

    Without the gas, whose force has a kink: derivatives across one are as exact as steps are short there.
    """
    text = (EXAMPLES / "slider_crank.yaml").read_text()
    changing = text.replace("independent: [wheel]", "independent: [piston]")
    changing = changing.replace("u: {wheel: 20.0}", "u: {piston: -2.0}")
    of = made(parsed, changing, partitions=2, functions=("motion",)).solver
    plain = made(parsed, text, functions=("motion",)).solver
    p = of.parameters
    p[of.parameter_names.index("gas")] = 0.0
    wrt = [n for n in of.parameter_names if n != "gas"]
    dp = np.array([[n == name for n in of.parameter_names] for name in wrt], float)
    q, u, dq, du = of.initial_sensitivities(p, dp=dp)
    wanted = [Final("stroke"), Integral("kinetic"), At("speed", 0.333)]
    common: dict[str, Any] = {"p": p, "inputs": [0.5], "wrt": wrt}
    exact = plain.judge(END, wanted, q, u, dq0=dq, du0=du, method="forward", rtol=1e-13, atol=1e-13, **common)
    for method in ("forward", "adjoint"):
        found = of.judge(END, wanted, method=method, integrator=integrator, rtol=tolerance, atol=tolerance, **common)
        assert found.counts["partitions_changed"] == 1
        np.testing.assert_allclose(found.gradients, exact.gradients, rtol=1e-8)


def test_split_joints_begin_settled(made: Callable[..., Made]) -> None:
    """Of a quaternion that is independent in part, directions that open the loops count as what assembling makes of them."""
    of = made(*MODELS["split"])
    wrt = [f"q0.{n}" for n in of.solver.independent_names]
    given = of._replace(q=of.solver.initial[0])
    for case in (of, given):
        agree(*both(case, [Final("height"), Final("speed"), At("speed", 0.0)], wrt + ["a", "m"], None))


def test_directions_that_the_caller_gives(made: Callable[..., Made]) -> None:
    of = made(*MODELS["mechanism"])
    rng = np.random.default_rng(5)
    given = {"dq0": rng.normal(size=(3, of.solver.nq)), "du0": rng.normal(size=(3, of.solver.nu))}
    forward, adjoint = both(of, [Final("height"), Integral("kinetic")], [], None, **given)
    assert forward.names == ("direction 0", "direction 1", "direction 2")
    agree(forward, adjoint)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_auto_takes_one_of_both(made: Callable[..., Made], integrator: str) -> None:
    of = made(*MODELS["tree"])
    options = INTEGRATORS[integrator]
    for k in (1, 17):
        wrt = directions(of.solver, None, np.random.default_rng(1), k)
        auto = of.solver.judge(END, Final("height"), of.q, p=of.p, wrt=wrt, **options)
        assert auto.method == ("forward" if k == 1 else "adjoint")
        forward, _ = both(of, Final("height"), wrt, None, **options)
        np.testing.assert_allclose(auto.gradients, forward.gradients, rtol=1e-11, atol=1e-12)
    none = of.solver.judge(END, Final("height"), of.q, p=of.p, **options)
    assert none.method == "none" and none.gradients.shape == (1, 0)


def rounding_decides(made: Made, wanted: Any, wrt: list[str], inputs: Any, **options: Any) -> bool:
    """Whether the last digits of the parameters change how many steps are made: a step that shrinks onto the kink of a force has
    an error of rounding alone, from which the next step's size follows, and with it on which side of the next kink stages lie."""
    rng = np.random.default_rng(0)
    steps = set()
    for _ in range(24):
        p = made.p * (1.0 + rng.integers(-3, 4, made.p.shape) * 2.0**-53)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            of = made.solver.judge(END, wanted, made.q, p=p, inputs=inputs, wrt=wrt, method="forward", **options)
        steps.add(of.counts["steps"])
    return len(steps) > 1


@pytest.mark.campaign
@pytest.mark.parametrize("first", [100, 200])
def test_campaign(made: Callable[..., Made], capsys: Any, first: int) -> None:
    """Random trees and random mechanisms of every scene and loop joint."""
    told, undecided, ended, resting = [], [], [], []
    for seed in range(first, first + 25):
        rng = np.random.default_rng(seed)
        kind = ("tree", "spatial", "planar", "spherical")[seed % 4]
        try:
            of = made(tree, seed, int(rng.integers(2, 6))) if kind == "tree" else made(mechanism, seed, kind)
        except AssertionError:
            continue  # a draw that is given up
        inputs = inputs_over_time(rng, of.solver.ninputs, ("constant", "hold", "linear", "spline")[seed // 4 % 4])
        wrt = directions(of.solver, inputs, rng, 12)
        try:
            for options in INTEGRATORS.values():
                wanted = functionals(of.solver, rng, None)
                forward, adjoint = both(of, wanted, wrt, inputs, **options)
                if (
                    adjoint.method == "forward"
                ):  # the motion begins at rest at a switch, and only directions show what that means
                    assert np.isfinite(forward.gradients).all()
                    resting.append(seed)
                elif forward.counts["steps"] != adjoint.counts["steps"] and rounding_decides(
                    of, wanted, wrt, inputs, **options
                ):
                    undecided.append(seed)
                else:
                    agree(forward, adjoint)
        except Exception as error:
            # where a torsion has no angle, or the arc cosine of a speed above its range no value, motions end and say so
            named = ("just after this time, the force on", "the derivative of the force on")
            if any(words in str(error) for words in ("by half a turn", *(f"is not finite: {n}" for n in named))):
                ended.append(seed)
            else:
                told.append((seed, kind, type(error).__name__, str(error)[:300]))
    with capsys.disabled():
        for line in told:
            print(line)
    assert not told
    assert len(undecided) <= 1, undecided  # of 75
    assert len(ended) <= 2, ended  # of 25
    assert len(set(resting)) <= 3, resting  # of 25
