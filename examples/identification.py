"""Parameters of a double pendulum from noisy samples of its angles, with standard deviations.

    python examples/identification.py [--folder examples/figures]

Two releases of examples/double_pendulum.yaml from different angles are sampled by encoders 50 times a second with errors of 0.01
rad (seeds are fixed). The fit finds both lengths, the second mass, spring and damper of the elbow, and the release angles of each
experiment. The first mass is given: if all masses, spring and damper grow in proportion, the motion does not change, and the fit
reports this.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pictures import BLACK, BLUE, GREY, ORANGE, figure, folder_asked, solver_of, write

import ordernm

SIGMA = 0.01
RELEASES = ({"upper": 1.2, "lower": -0.4}, {"upper": -0.6, "lower": 1.5})
GUESS = {"length_1": 1.15, "length_2": 0.7, "mass_2": 1.3, "stiffness": 1.5, "damping": 0.1}
VARIABLES = {
    "length_1": (0.3, 3.0),
    "length_2": (0.3, 3.0),
    "mass_2": (0.1, 5.0),
    "stiffness": (0.1, 10.0),
    "damping": (0.0, 1.0),
}


def measure(solver: Any, seconds: float = 4.0, seed: int = 20) -> list[dict[str, Any]]:
    """Samples of both releases, as experiments of `ordernm.fit`; the release angles are known approximately."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, seconds, round(50 * seconds) + 1)
    found = []
    for i, q in enumerate(RELEASES):
        motion = solver.simulate(t, q=q)
        samples = {name: motion[name] + SIGMA * rng.normal(size=len(t)) for name in ("upper", "lower")}
        rough = {name: round(x, 1) + 0.1 for name, x in q.items()}
        found.append({"name": f"release {i + 1}", "times": t, "samples": samples, "q": rough,
                      "variables": ["q0.upper", "q0.lower"]})  # fmt: skip
    return found


def identify(solver: Any, experiments: list[dict[str, Any]], **more: Any) -> ordernm.Fit:
    return ordernm.fit(solver, variables=VARIABLES, p=GUESS, experiments=experiments, sigma=SIGMA, **more)


def truth(solver: Any) -> dict[str, float]:
    """The values from which the samples were computed."""
    found = dict(zip(solver.parameter_names, solver.parameters.tolist(), strict=True))
    found |= {f"q0.{name} (release {i + 1})": x for i, q in enumerate(RELEASES) for name, x in q.items()}
    return found


def draw(solver: Any, experiments: list[dict[str, Any]], fit: ordernm.Fit, folder: Path | None = None) -> Path:
    """Figure: samples and motions, residuals, errors in standard deviations, correlations."""
    made, axes = figure(9.0, 5.6, 2, 2)
    (motion, errors), (rest, related) = axes
    for name, colour in (("upper", BLUE), ("lower", ORANGE)):
        t = experiments[0]["times"]
        motion.plot(t, experiments[0]["samples"][name], ".", color=GREY, markersize=2.5)
        motion.plot(t, fit.trajectories[0][name], color=colour, label=name)
        rest.plot(t, 1e3 * fit.residuals[0][name], ".", color=colour, markersize=3)
    start = solver.simulate(t, q=experiments[0]["q"], p=GUESS)
    motion.plot(t, start["upper"], color=BLUE, linestyle=(0, (1, 1.2)), linewidth=1, label="upper, at the start")
    motion.plot(t, start["lower"], color=ORANGE, linestyle=(0, (1, 1.2)), linewidth=1, label="lower, at the start")
    motion.set_title("Angles of release 1 (rad): samples and motions", loc="left", fontsize=9)
    motion.set_ylim(-1.3, 2.1)
    motion.legend(fontsize=8, loc="upper right", ncols=2)
    rest.axhspan(-2e3 * SIGMA, 2e3 * SIGMA, color="#eeeeee", zorder=0)
    rest.set_title("Residuals (mrad), and twice their standard deviation", loc="left", fontsize=9)
    for axis in (motion, rest):
        axis.set_xlabel("t (s)")
    true = truth(solver)
    off = [(fit[n] - true[n]) / fit.deviation(n) for n in fit.names]
    places = np.arange(len(off))[::-1]
    errors.axvspan(-3, 3, color="#eeeeee", zorder=0)
    errors.errorbar(off, places, xerr=1, fmt="o", color=BLACK, markersize=4, capsize=3, linewidth=1)
    errors.set_yticks(places, [n.replace("release ", "") for n in fit.names], fontsize=8)
    errors.set_xlim(-4, 4)
    errors.set_title("Errors of what was identified, in standard deviations", loc="left", fontsize=9)
    image = related.imshow(fit.correlations, cmap="PuOr", vmin=-1, vmax=1)
    related.set_yticks(range(len(off)), [n.replace("release ", "") for n in fit.names], fontsize=8)
    related.set_xticks([])
    related.grid(False)
    related.set_title("Correlations", loc="left", fontsize=9)
    made.colorbar(image, ax=related)
    return write(made, "identification", folder)


def main() -> None:
    folder = folder_asked(__doc__)
    solver = solver_of("double_pendulum")
    experiments = measure(solver)
    fit = identify(solver, experiments)
    print(fit)
    true = truth(solver)
    worst = max(abs(fit[name] - true[name]) / fit.deviation(name) for name in fit.names)
    print(f"the largest error is {worst:.2f} standard deviations")
    print(
        ordernm.fit(
            solver, variables={**VARIABLES, "mass_1": (0.1, 5.0)}, p=GUESS, experiments=experiments, sigma=SIGMA
        )
    )
    print(draw(solver, experiments, fit, folder))


if __name__ == "__main__":
    main()
