"""Visuals of bodies: the entries that are read, and errors about wrong ones."""

import pytest

import ordernm

BODY = """
model: shown
parameters: {{size: 0.2}}
bodies:
  arm:
    parent: ground
    joint: {{type: revolute, axis: y}}
    mass: 1
    com: [0, 0, 0.1]
    visuals: {visuals}
"""


def read(visuals):
    return ordernm.parse_model(BODY.format(visuals=visuals)).bodies[0].visuals


def test_solids_have_sizes_places_and_colours():
    (one,) = read('[{type: capsule, length: size, radius: 3 cm, at: [0, 0, size/2], color: "#4477AA"}]')
    assert (one.type, one.color, one.file) == ("capsule", "#4477aa", "")
    assert [str(e) for e in (*one.sizes, *one.axis, *one.at)] == ["0.03", "size", "0", "0", "1", "0", "0", "size/2"]
    assert one.rotation == ()


def test_without_visuals_the_shape_is_shown_and_an_empty_list_hides_the_body():
    text = BODY.format(visuals="[]")
    shaped = text.replace("visuals: []", "shape: {type: sphere, radius: size}")
    assert ordernm.parse_model(text).bodies[0].visuals == ()
    assert [v.type for v in ordernm.parse_model(shaped).bodies[0].visuals] == ["sphere"]
    assert ordernm.parse_model(text.replace("    visuals: []\n", "")).bodies[0].visuals is None


def test_the_builder_has_them_too():
    b = ordernm.ModelBuilder("built")
    b.body("arm", axis="y", mass=1, com=[0, 0, 1], visuals=[{"type": "sphere", "radius": 0.1}])
    assert [v.type for v in b.build().bodies[0].visuals] == ["sphere"]
    ground = ordernm.ModelBuilder("built", visuals=[{"type": "box", "size": [1, 1, 0.1]}])
    ground.body("arm", axis="y", mass=1, com=[0, 0, 1])
    assert [v.type for v in ground.build().visuals] == ["box"]


def test_the_ground_has_visuals_and_that_of_a_submodel_is_its_body(tmp_path):
    floor = "visuals:\n- {type: box, size: [1, size, 0.1]}\n"
    (tmp_path / "part.yaml").write_text(BODY.format(visuals="[]") + floor)
    assert [str(e) for e in ordernm.load_model(tmp_path / "part.yaml").visuals[0].sizes] == ["1", "size", "0.1"]
    text = "model: whole\nsubmodels:\n  left: {use: part.yaml, at: [0, 1, 0]}\nvisuals:\n- {type: sphere, radius: 1}\n"
    model = ordernm.parse_model(text, folder=tmp_path)
    assert [v.type for v in model.visuals] == ["sphere"]
    assert [[v.type for v in b.visuals] for b in model.bodies if b.name == "left"] == [["box"]]


@pytest.mark.parametrize(
    ("visuals", "message"),
    [
        ("{type: box}", "visuals: a mapping; a list of visuals is needed"),
        ("[3]", "visuals[0]: '3'; a mapping is needed with a type"),
        ("[{type: sphere, radius: -size}]", "is negative; a size must be at least 0"),
        ("[{type: sphere, radius: unknown}]", "unknown"),
    ],
)
def test_wrong_visuals_of_the_ground_are_errors(visuals, message):
    with pytest.raises(ordernm.ModelError) as caught:
        ordernm.parse_model(BODY.format(visuals="[]") + f"visuals: {visuals}\n")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("visuals", "message"),
    [
        (
            "[{type: cone}]",
            "unknown visual type 'cone'; one of box, sphere, ellipsoid, cylinder, capsule, mesh is allowed",
        ),
        ("[{type: box, size: [1, 2]}]", "three numbers are needed"),
        ("[{type: box, size: [1, 2, 3 kg]}]", "3 kg is a mass (kg); a length (m) is needed"),
        ("[{type: sphere, radius: -size}]", "is negative; a size must be at least 0"),
        (
            "[{type: sphere, radius: 1, color: red}]",
            '\'red\'; a colour is "#rrggbb" or "#rrggbbaa", in quotation marks',
        ),
        ("[{type: mesh}]", "key 'file' is missing"),
        ("[{type: cylinder, length: 1, radius: 1, axis: [0, 0, 0]}]", "visuals[0].axis"),
        ("[{type: sphere, radius: nothing}]", "nothing"),
        ("{type: sphere, radius: 1}", "visuals"),
    ],
)
def test_wrong_entries_are_named(visuals, message):
    with pytest.raises(ordernm.ModelError) as error:
        read(visuals)
    assert message in str(error.value)
