"""Functions and motions in JAX and PyTorch: cost above the solver, backward beside forward, and motions against diffrax.

    python benchmarks/learning.py [--states 4096] [--rounds 200]

Calls take turns, each twice, and the second is timed; times are the least of all rounds, on one thread. The motion is that of
examples/double_pendulum.yaml over 5 s. diffrax (PyPI) integrates equations written by hand, with its own adjoint; both compute
tip_x at the end and its gradient by the six parameters. Errors are those of the gradient, relative, against a tolerance of 1e-13.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import ordernm
import ordernm.jax
from ordernm.runtime import Final

EXAMPLES = Path(__file__).parents[1] / "examples"
FUNCTIONS = ["accelerations", "sensitivities", "gradients"]
END = 5.0
TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)


def least(rounds: int, **calls: Callable[[], Any]) -> dict[str, float]:
    """Least time of each call in microseconds."""
    found = dict.fromkeys(calls, np.inf)
    for turn in range(rounds + 2):
        for name, call in calls.items():
            call()  # so that caches hold the arrays and the code of this call, not those of the last one
            start = time.perf_counter()
            call()
            spent = time.perf_counter() - start
            if turn > 1:
                found[name] = min(found[name], 1e6 * spent)
    return found


def overhead(name: str, states: int, rounds: int) -> None:
    """Prints times of a batch of accelerations and of its gradient."""
    import torch

    import ordernm.torch

    folder = Path(mkdtemp()) / name
    ordernm.generate(EXAMPLES / f"{name}.yaml", folder, functions=FUNCTIONS)
    solver = ordernm.load(folder)
    solver.batch_threads = 1
    rng = np.random.default_rng(0)
    q, u = (x + 0.1 * rng.normal(size=(states, len(x))) for x in solver.initial)
    p, out, ones = solver.parameters, np.empty((states, solver.nu)), np.ones((1, states, solver.nu))
    in_jax = ordernm.jax.function(solver, "accelerations")
    forward = jax.jit(in_jax)
    backward = jax.jit(jax.grad(lambda *x: in_jax(*x).sum(), argnums=(0, 1, 2)))
    given = tuple(map(jnp.asarray, (q, u, p)))
    in_torch = ordernm.torch.function(solver, "accelerations")
    plain = tuple(map(torch.from_numpy, (q, u, p)))  # the same memory, in caches for both or for none
    taped = tuple(x.clone().requires_grad_() for x in plain)
    found = in_torch(*taped)
    weights = torch.ones_like(found)
    times = least(
        rounds,
        solver=lambda: solver.accelerations(q, u, p, out=out),
        jax=lambda: forward(*given).block_until_ready(),
        torch=lambda: in_torch(*plain),
        gradients=lambda: solver.gradients(q, u, p, weights=ones),
        jax_gradient=lambda: jax.block_until_ready(backward(*given)),
        torch_gradient=lambda: torch.autograd.grad(found, taped, weights, retain_graph=True),
    )
    print(f"{name}, {states} states, us: " + ", ".join(f"{n} {t:.0f}" for n, t in times.items()))
    base = times["solver"]
    print(
        f"  above the solver: JAX {times['jax'] / base - 1:+.1%}, PyTorch {times['torch'] / base - 1:+.1%}; gradient over "
        f"forward: JAX {times['jax_gradient'] / times['jax']:.1f}, PyTorch {times['torch_gradient'] / times['torch']:.1f}, "
        f"solver.gradients {times['gradients'] / base:.1f}"
    )


def written_by_hand(t: Any, y: Any, p: Any) -> Any:
    """Two uniform bars, angles relative."""
    l1, l2, m1, m2, stiffness, damping = p
    a, b, wa, wb = y[0], y[0] + y[1], y[2], y[2] + y[3]
    torque = -stiffness * y[1] - damping * y[3]
    first = m1 * (0.04**2 + l1**2) / 12 + m1 * l1**2 / 4 + m2 * l1**2
    second = m2 * (0.04**2 + l2**2) / 12 + m2 * l2**2 / 4
    both, turned = m2 * l1 * l2 / 2 * jnp.cos(a - b), m2 * l1 * l2 / 2 * jnp.sin(a - b)
    fa = -torque - turned * wb**2 - (m1 / 2 + m2) * l1 * 9.81 * jnp.sin(a)
    fb = torque + turned * wa**2 - m2 * l2 / 2 * 9.81 * jnp.sin(b)
    over = first * second - both**2
    ua, ub = (second * fa - both * fb) / over, (first * fb - both * fa) / over
    return jnp.stack([y[2], y[3], ua, ub - ua])


def by_diffrax(start: Any, tolerance: float) -> Callable[[Any], Any]:
    """The horizontal place of the tip at the end, by diffrax."""
    import diffrax

    def tip(p: Any) -> Any:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(written_by_hand), diffrax.Dopri8(), 0.0, END, 1e-2, start, args=p, max_steps=4096,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        ).ys[-1]  # fmt: skip
        return -(p[0] * jnp.sin(found[0]) + p[1] * jnp.sin(found[0] + found[1]))

    return tip


def motions(rounds: int) -> None:
    """Prints time and error of the gradient of a motion by tolerance."""
    folder = Path(mkdtemp()) / "double_pendulum"
    ordernm.generate(EXAMPLES / "double_pendulum.yaml", folder)
    solver = ordernm.load(folder)
    start, p = jnp.asarray(np.concatenate(solver.initial)), jnp.asarray(solver.parameters)
    same = written_by_hand(0.0, start, p)[2:] - solver.accelerations(*solver.initial)
    assert np.abs(same).max() < 1e-12, same

    def ours(tolerance: float) -> Callable[[Any], Any]:
        given = {"rtol": tolerance, "atol": tolerance}
        f = ordernm.jax.judge(solver, END, [Final("tip_x")], wrt=solver.parameter_names, **given)
        return jax.jit(jax.value_and_grad(lambda p: f(p)[0]))

    exact = np.asarray(ours(1e-13)(p)[1])
    calls: dict[str, Callable[[], Any]] = {}
    errors: dict[str, float] = {}
    for tolerance in TOLERANCES:
        peer = jax.jit(jax.value_and_grad(by_diffrax(start, tolerance)))
        for name, f in (("ordernm", ours(tolerance)), ("diffrax", peer)):
            found = np.asarray(f(p)[1])
            errors[f"{name} {tolerance:g}"] = float(np.abs(found - exact).max() / np.abs(exact).max())
            calls[f"{name} {tolerance:g}"] = lambda f=f: jax.block_until_ready(f(p))
    times = least(rounds, **calls)
    for name in calls:
        print(f"{name}: {times[name]:.0f} us, error {errors[name]:.1e}")
    for name in (n for n in calls if n.startswith("diffrax")):
        better = [times[n] for n in calls if n.startswith("ordernm") and errors[n] <= errors[name]]
        if better:
            print(f"{name}: {times[name] / min(better):.1f} times as long as ordernm with at most its error")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--states", type=int, default=4096)
    parser.add_argument("--rounds", type=int, default=200)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    for name in ("double_pendulum", "arm", "quadruped"):
        overhead(name, given.states, given.rounds)
    motions(max(3, given.rounds // 10))


if __name__ == "__main__":
    main()
