"""Packages for tests of the run time: of two examples, and a very small one written by hand that compiles quickly."""

import json
from pathlib import Path

import pytest

import codegen
from codegen.emit.c.calls import write_calls
from codegen.runtime.sections import CARRIED, STANDALONE
from codegen.runtime.standalone.files.manifest import seal

EXAMPLES = Path(__file__).parents[2] / "examples"

PENDULUM_C = """\
#include <math.h>
#include "pendulum.h"

/* p: gravity, length; udot = -gravity/length*sin(q) - u/10 */
int pendulum_accelerations(const double *q, const double *u, const double *p, double *udot, double *work)
{
    work[0] = p[0]/p[1];
    if (p[1] == 0.0) return 1;
    udot[0] = -work[0]*sin(q[0]) - 0.1*u[0];
    return 0;
}

#define SENSITIVITIES(W) \\
int pendulum_sensitivities_##W(const double *q, const double *u, const double *p, const double *dq, const double *du, \\
                               const double *dp, double *udot, double *dudot, double *work) \\
{ \\
    if (pendulum_accelerations(q, u, p, udot, work)) return 1; \\
    for (int l = 0; l < W; ++l) \\
        dudot[l] = -work[0]*cos(q[0])*dq[l] - 0.1*du[l] - sin(q[0])/p[1]*(dp[l] - work[0]*dp[W + l]); \\
    return 0; \\
}

int pendulum_accelerations_batch(pendulum_batch *b)
{
    for (b->failed = 0; b->failed < b->count; ++b->failed) {
        const long i = b->failed;
        if (pendulum_accelerations(b->q.at + i*b->q.step, b->u.at + i*b->u.step, b->p.at + i*b->p.step, b->udot.at + i,
                                   b->work)) return 1;
    }
    return 0;
}

SENSITIVITIES(1)
SENSITIVITIES(2)
SENSITIVITIES(8)
"""

PENDULUM_H = """\
int pendulum_accelerations(const double *q, const double *u, const double *p, double *udot, double *work);
typedef struct { double *at; long step; } pendulum_rows;
typedef struct { long count, failed; pendulum_rows q, u, p, udot; double *work; } pendulum_batch;
#define SENSITIVITIES_(W) \\
int pendulum_sensitivities_##W(const double *q, const double *u, const double *p, const double *dq, const double *du, \\
                               const double *dp, double *udot, double *dudot, double *work);
SENSITIVITIES_(1)
SENSITIVITIES_(2)
SENSITIVITIES_(8)
"""

PENDULUM_NUMPY = """\
import numpy as np


class SingularJointError(ValueError):
    def __init__(self, link):
        self.link = link


def accelerations(q, u, p):
    if np.any(p[..., 1] == 0):
        raise SingularJointError("rod")
    return ((-p[..., 0] / p[..., 1] * np.sin(q[..., 0]) - 0.1 * u[..., 0])[..., None],)


def sensitivities(q, u, p, dq, du, dp):
    (udot,) = accelerations(q, u, p)
    g, l, s = p[..., 0], p[..., 1], np.sin(q[..., 0])
    dudot = -g / l * np.cos(q[..., 0]) * dq[..., 0] - 0.1 * du[..., 0] - s / l * (dp[..., 0] - g / l * dp[..., 1])
    return udot, dudot[..., None]
"""

PENDULUM = {
    "generator": "ordernm",
    "name": "pendulum",
    "target": "c",
    "coordinate_names": ["rod"],
    "coordinate_units": ["rad"],
    "speed_names": ["rod"],
    "parameter_names": ["gravity", "length"],
    "parameters": [9.81, 0.5],
    "input_names": [],
    "output_names": [],
    "closure_names": [],
    "loops": [],
    "prescribed_names": [],
    "initial": {"q": [0.3], "u": [0.0]},
    "quaternions": [],
    "links": ["rod"],
    "workspace": 1,
    "functions": {
        "accelerations": {"arguments": ["q", "u", "p"], "results": ["udot"]},
        "sensitivities": {
            "arguments": ["q", "u", "p"],
            "seeds": ["dq", "du", "dp"],
            "results": ["udot", "dudot"],
            "widths": [8, 2, 1],
        },
    },
    "batch": ["q", "u", "p", "udot"],
    "operations": {},
}

SIZES = {
    "q": 1, "u": 1, "p": 2, "inputs": 0, "t": 1, "udot": 1, "b": 1, "force_weights": 1, "energy_weights": 2,
    "output_weights": 0, "rate_weights": 1, "q_weights": 1, "u_weights": 1,
}  # fmt: skip


@pytest.fixture
def make_pendulum(tmp_path):
    """Write a package of one link, as `generate` would, with only those run-time files that its C includes."""

    def make(**changes) -> Path:
        folder = tmp_path / "pendulum"
        folder.mkdir()
        (folder / "pendulum.c").write_text(PENDULUM_C)
        (folder / "pendulum.h").write_text(PENDULUM_H)
        (folder / "pendulum_numpy.py").write_text(PENDULUM_NUMPY)
        manifest = PENDULUM | changes
        (folder / "pendulum_calls.c").write_text(write_calls(manifest, SIZES))
        calls = Path(CARRIED) / "calls" / "calls.h"
        (folder / calls).parent.mkdir(parents=True)
        (folder / calls).write_text((STANDALONE / calls.relative_to(CARRIED)).read_text())
        (folder / "model.json").write_text(seal(json.dumps(manifest)))
        return folder

    return make


@pytest.fixture
def pendulum(make_pendulum):
    return make_pendulum()


@pytest.fixture(scope="session")
def packages(tmp_path_factory):
    """Generated packages by name: `double_pendulum`, `satellite` with quaternions and inputs, and `four_bar` with a loop."""
    folder = tmp_path_factory.mktemp("generated")
    for name in ("double_pendulum", "satellite", "four_bar"):
        codegen.generate(EXAMPLES / f"{name}.yaml", folder / name, compile="all")  # nearly all is called
    return folder


@pytest.fixture(scope="session")
def models():
    return {name: codegen.load_model(EXAMPLES / f"{name}.yaml") for name in ("double_pendulum", "satellite")}


@pytest.fixture(scope="session", params=["c", "numpy"])
def satellite(request, packages):
    return codegen.load(packages / "satellite", request.param)


@pytest.fixture(scope="session")
def double_pendulum(packages):
    return codegen.load(packages / "double_pendulum")
