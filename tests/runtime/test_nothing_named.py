"""A model without parameters, inputs and outputs: messages say so, and name a remedy."""

import numpy as np
import pytest

import codegen
from codegen.runtime import Event, Final

MODEL = """
model: bare
bodies:
  rod: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [1, 0, 0]}
"""


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bare")
    functions = ("accelerations", "sensitivities", "motion")
    codegen.generate(codegen.parse_model(MODEL), folder, functions=functions, compile="all")
    return codegen.load(folder)


@pytest.mark.parametrize("given", [{"l": 1.0}, [1.0], {"l": 1.0, "m": 2.0}])
def test_parameters_and_inputs(bare, given):
    q, u = bare.initial
    with pytest.raises(ValueError, match="the model has no parameters; leave p out"):
        bare.accelerations(q, u, given)
    with pytest.raises(ValueError, match="the model has no inputs; leave inputs out"):
        bare.accelerations(q, u, inputs=given)
    with pytest.raises(ValueError, match="the model has no parameters; leave dp out"):
        bare.sensitivities(q, u, dp=given if isinstance(given, dict) else np.eye(2))


@pytest.mark.parametrize("given", [{"m": 1.0}, [1.0], 1.0, lambda t: [t], ([0.0, 1.0], [0.0, 1.0])])
def test_inputs_over_time(bare, given):
    with pytest.raises(ValueError, match="the model has no inputs; leave inputs out"):
        bare.simulate(0.1, inputs=given)
    assert bare.simulate(0.1, inputs=[]).t[-1] == 0.1


def test_outputs(bare):
    message = "the model has no output 'tip'; it has none; add one under `outputs` of the model file"
    with pytest.raises(ValueError, match=f"events: {message}"):
        bare.simulate(0.1, events=[Event("tip")])
    with pytest.raises(ValueError, match=f"Final: {message}"):
        bare.judge(0.1, Final("tip"), wrt=["q0.rod"])
