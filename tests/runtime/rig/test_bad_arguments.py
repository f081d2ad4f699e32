"""Bad arguments: a ValueError that names the argument, the value seen, and the value expected."""

import numpy as np
import pytest

NAN, INF = float("nan"), float("inf")


def state(solver):
    q, u = solver.initial
    return {"q": q, "u": u, "p": solver.parameters, "inputs": np.zeros(2), "t": 0.0}


WRONG = {
    "short q": ({"q": np.zeros(5)}, ["q", r"\(5,\)", "6"]),
    "q of the size of u in a batch": ({"q": np.ones((4, 5))}, ["q", r"\(4, 5\)", "6"]),
    "scalar q": ({"q": 1.0}, ["q", r"\(\)", "6"]),
    "long u": ({"u": np.zeros(6)}, ["u", r"\(6,\)", "5"]),
    "short p": ({"p": [1.0]}, ["p", r"\(1,\)", "3", "length"]),
    "short inputs": ({"inputs": [1.0]}, ["inputs", r"\(1,\)", "2", "motor"]),
    "column of inputs": ({"inputs": np.zeros((2, 1))}, ["inputs", r"\(2, 1\)", "2"]),
    "NaN in q": ({"q": [0, 1, 0, 0, NAN, 0]}, ["q", "4", "nan", "finite"]),
    "inf in u": ({"u": np.array([0, INF, 0, 0, 0])}, ["u", "1", "inf", "finite"]),
    "inf and -inf in u": ({"u": np.array([0, INF, -INF, 0, 0])}, ["u", "1", "inf", "finite"]),
    "NaN in a batch": ({"u": np.array([[0.0] * 5, [0, 0, 0, 0, NAN]])}, ["u", "1, 4", "nan", "finite"]),
    "NaN in p": ({"p": [0.8, NAN, 0.02]}, ["p", "1", "nan", "finite"]),
    "NaN by name": ({"p": {"mass": NAN}}, ["p", "mass|1", "nan", "finite"]),
    "NaN t": ({"t": NAN}, ["t", "nan", "finite"]),
    "inf t": ({"t": INF}, ["t", "inf", "finite"]),
    "huge integer t": ({"t": 10**400}, ["t", "too large|inf"]),
    "huge integer in u": ({"u": [10**400, 0, 0, 0, 0]}, ["u", "too large|inf"]),
    "text": ({"q": "pose"}, ["q", "str|<U", "number"]),
    "texts": ({"q": ["1", "2", "3", "4", "5", "6"]}, ["q", "str|<U", "number"]),
    "None inside": ({"u": [None, 0, 0, 0, 0]}, ["u", "None|nan", "number"]),
    "objects": ({"u": [object(), 0, 0, 0, 0]}, ["u", "number"]),
    "complex": ({"u": np.ones(5) * 1j}, ["u", "complex", "number"]),
    "complex in a list": ({"u": [1j, 0, 0, 0, 0]}, ["u", "complex", "number"]),
    "ragged": ({"u": [[1, 2], [3]]}, ["u", "inhomogeneous|ragged|shape", "number"]),
    "dates": ({"u": np.zeros(5, "datetime64[s]")}, ["u", "datetime", "number"]),
    "masked": ({"u": np.ma.masked_array(np.zeros(5), [1, 0, 0, 0, 0])}, ["u", "mask", "number|fill"]),
    "a mapping for t": ({"t": {"x": 1}}, ["t"]),
    "unknown parameter": ({"p": {"lenght": 1.0}}, ["p", "lenght", "length", "mass"]),
    "far unknown parameter": ({"p": {"zzz": 1.0}}, ["p", "zzz", "length, mass, wheel"]),
    "parameter by number": ({"p": {0: 1.0}}, ["p", "0", "length"]),
    "parameter that is a text": ({"p": {"mass": "heavy"}}, ["p", "mass", "number|float"]),
    "quaternion of zeros": ({"q": np.zeros(6)}, ["q", r"ball\.qw", "0", "1e-0?6"]),
    "short quaternion": ({"q": np.array([0, 1e-7, 0, 0, 0, 0])}, ["q", r"ball\.qw", "1e-07", "1e-0?6"]),
    "one short quaternion of many": (
        {"q": np.array([[0.0, 1, 0, 0, 0, 0], [0, 0, 0, 1e-9, 0, 0]])}, ["q", r"ball\.qw", "1e-09", "1e-0?6"]
    ),
    "batches that do not broadcast": ({"q": np.ones((3, 6)), "u": np.ones((4, 5))}, ["q", r"\(3", "u", r"\(4"]),
    "batch of t": ({"t": np.zeros(3), "u": np.ones((4, 5))}, ["t", r"\(3", "u", r"\(4"]),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_wrong_argument(either, case):
    wrong, said = WRONG[case]
    for function, more in (("accelerations", {}), ("sensitivities", {"dq": np.ones(6)}), ("outputs", {})):
        with pytest.raises(ValueError) as error:
            getattr(either, function)(**{**state(either), **wrong}, **more)
        for pattern in said:
            assert error.match(pattern)


SEEDS = {
    "short dq": ({"dq": np.zeros(5)}, ["dq", r"\(5,\)", "6"]),
    "transposed": ({"dq": np.zeros((6, 3))}, ["dq", r"\(6, 3\)", "6", "k"]),
    "scalar dq": ({"dq": 1.0}, ["dq", r"\(\)", "6"]),
    "NaN": ({"du": np.full((2, 5), NAN)}, ["du", "nan", "finite"]),
    "NaN dt": ({"dt": NAN}, ["dt", "nan", "finite"]),
    "text": ({"dt": "x"}, ["dt", "number"]),
    "different k": ({"dq": np.ones((2, 6)), "du": np.ones((3, 5))}, ["directions", "dq.*2", "du.*3"]),
    "different k of dt": ({"dq": np.ones((2, 6)), "dt": np.ones(3)}, ["directions", "dq.*2", "dt.*3"]),
    "batch": ({"dq": np.ones((2, 3, 6)), "du": np.ones((2, 4, 5))}, ["broadcast", "dq", "du"]),
    "nothing": ({}, ["no seed", "dq", "du", "dp", "dinputs", "dt"]),
}


@pytest.mark.parametrize("case", SEEDS)
def test_wrong_seed(either, case):
    wrong, said = SEEDS[case]
    with pytest.raises(ValueError) as error:
        either.sensitivities(**state(either), **wrong)
    for pattern in said:
        assert error.match(pattern)


@pytest.mark.parametrize("case", [c for c in SEEDS if "dt" not in c and c not in ("text", "nothing")])
def test_wrong_seed_of_assembly(either, case):
    wrong, said = SEEDS[case]
    with pytest.raises(ValueError) as error:
        either.assemble_sensitivities(*either.initial, **wrong)
    for pattern in said:
        assert error.match(pattern)


def test_names_of_a_model_without_any(either_bare):
    with pytest.raises(ValueError, match=r"p.*'mass'.*(none|no parameters)"):
        either_bare.accelerations([0, 0], [0, 0], {"mass": 1.0})


def test_messages_stay_short(rig):
    with pytest.raises(ValueError) as error:
        rig.accelerations(np.zeros((100, 7)), np.zeros(5))
    assert len(str(error.value)) < 300


def test_singular_joint_is_named(either):
    q, u = either.initial
    with pytest.raises(codegen_error(either), match=r"disc.*inertia") as error:
        either.accelerations(q, u, {"wheel": 0.0})
    assert "give" in str(error.value)
    for function, more in (("sensitivities", {"dq": np.ones(6)}), ("jacobians", {})):
        with pytest.raises(codegen_error(either), match="disc"):
            getattr(either, function)(q, u, {"wheel": 0.0}, **more)
    for function, more in (("solve_mass", {}), ("solve_mass_sensitivities", {"dq": np.ones(6)})):
        with pytest.raises(codegen_error(either), match="disc"):
            getattr(either, function)(q, u, {"wheel": 0.0}, **more)
    # what needs no acceleration has a value there
    assert np.isfinite(either.mass_matrix(q, {"wheel": 0.0})).all()
    assert np.isfinite(either.energies(q, u, {"wheel": 0.0})).all()


def test_singular_state_of_a_batch_is_counted(rig):
    q, u = rig.initial
    wheels = np.array([[0.02, 0.02, 0.02], [0.02, 0.0, 0.02]])
    p = np.broadcast_to(rig.parameters, (2, 3, 3)).copy()
    p[..., 2] = wheels
    with pytest.raises(codegen_error(rig), match=r"disc.*\[?1, 1\]?|disc.*state 4"):
        rig.accelerations(q, u, p)
    with pytest.raises(codegen_error(rig), match=r"disc.*\[?1, 1\]?|disc.*state 4"):
        rig.sensitivities(q, u, p, dq=np.ones((3, 6)))
    # and the solver works on
    assert np.isfinite(rig.accelerations(q, u)).all()


def codegen_error(solver):
    from codegen.runtime import SingularJointError

    assert issubclass(SingularJointError, ValueError)
    return SingularJointError


def test_unknown_target(rig_folder):
    import codegen

    with pytest.raises(ValueError, match=r"'rust'.*'c'.*'numpy'.*'both'"):
        codegen.load(rig_folder, "rust")


@pytest.mark.parametrize(
    "content", [None, "", "[]", "{}", '{"generator": "other", "name": "x"}', '{"generator": "ordernm"}']
)
def test_a_folder_without_a_solver(tmp_path, content):
    import codegen

    if content is not None:
        (tmp_path / "model.json").write_text(content)
    with pytest.raises(ValueError, match=r"no complete generated solver.*model\.json.*generate"):
        codegen.load(tmp_path)
    with pytest.raises(ValueError, match=r"no complete generated solver.*generate"):
        codegen.load(tmp_path / "nowhere")
