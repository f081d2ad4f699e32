"""Visuals of robots: solids, meshes and colours, their poses, and those that are left out."""

import numpy as np
import pytest

import codegen
from codegen.runtime.standalone.display.meshes import Meshes
from codegen.runtime.standalone.display.scene import Solid, scene_of

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = f"""<robot name="shown">
  <material name="steel"><color rgba="0.2 0.4 0.6 1"/></material>
  <link name="base"><visual><origin xyz="0 0 -0.05"/><geometry><box size="1 1 0.1"/></geometry></visual></link>
  <link name="arm">{INERTIAL}
    <visual><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.02" length="0.2"/></geometry><material name="steel"/></visual>
    <visual><geometry><mesh filename="arm.stl" scale="0.5 0.5 2"/></geometry></visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
  </link>
  <link name="tool">{INERTIAL}
    <visual><geometry><sphere radius="0.03"/></geometry><material><color rgba="1 0 0 0.5"/></material></visual>
    <visual><geometry><box size="-1 1 1"/></geometry></visual>
  </link>
  <joint name="j" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit effort="1" velocity="1"/></joint>
  <joint name="k" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0 0 0.3"/></joint>
</robot>
"""


def visuals(found, body=0):
    return listed(found.model.bodies[body].visuals)


def listed(every):
    numbers = {}
    return [
        (
            v.type,
            [float(e.evaluate(numbers)) for e in v.sizes],
            [float(e.evaluate(numbers)) for e in v.at],
            v.color,
            v.file,
        )
        for v in every
    ]


def test_those_of_a_urdf_have_their_places_and_colours(tmp_path):
    (tmp_path / "arm.stl").write_text("solid")
    (tmp_path / "shown.urdf").write_text(URDF)
    found = codegen.import_model(tmp_path / "shown.urdf")
    assert visuals(found) == [
        ("cylinder", [0.02, 0.2], [0, 0, 0.1], "#336699", ""),
        ("mesh", [0.5, 0.5, 2], [0, 0, 0], "", "arm.stl"),
        ("sphere", [0.03], [0, 0, 0.3], "#ff000080", ""),
    ]
    assert listed(found.model.visuals) == [("box", [1, 1, 0.1], [0, 0, -0.05], "", "")]
    kept = codegen.import_model(tmp_path / "shown.urdf", keep_fixed=True)
    assert [len(b.visuals) for b in kept.model.bodies] == [1, 2, 1] and kept.model.visuals == ()
    (tmp_path / "models").mkdir()
    elsewhere = codegen.import_model(tmp_path / "shown.urdf", folder=tmp_path / "models")
    assert visuals(elsewhere)[1][-1] == "../arm.stl"


def test_those_of_an_sdf_too(tmp_path):
    (tmp_path / "shown.sdf").write_text("""<sdf version="1.10"><model name="shown">
      <link name="arm"><inertial><mass>1</mass></inertial>
        <visual name="v"><pose>0 0 0.1 0 0 0</pose><geometry><ellipsoid><radii>1 2 3</radii></ellipsoid></geometry>
          <material><diffuse>0 1 0 1</diffuse></material></visual>
        <visual name="w"><geometry><cone><radius>1</radius><length>1</length></cone></geometry></visual></link>
      <joint name="j" type="revolute"><parent>world</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis></joint>
    </model></sdf>""")
    found = codegen.import_model(tmp_path / "shown.sdf")
    assert visuals(found) == [("ellipsoid", [1, 2, 3], [0, 0, 0.1], "#00ff00", "")]
    assert any(line.startswith("<visual> of a cone") for line in found.left_out)


def test_materials_without_a_colour_and_meshes_for_collisions_are_listed(tmp_path):
    shown = URDF.replace('<color rgba="0.2 0.4 0.6 1"/>', "").replace('rgba="1 0 0 0.5"', 'rgba="red"')
    collision = '<collision><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></collision>'
    assert shown.count("</link>") > 1
    (tmp_path / "arm.stl").write_text("solid")
    (tmp_path / "shown.urdf").write_text(shown.replace("</link>", f"{collision}</link>", 1))
    found = codegen.import_model(tmp_path / "shown.urdf")
    assert [color for *_, color, _ in visuals(found)] == ["", "", ""]
    assert {
        "<collision> of a mesh (line 3): no effect within limits and without contact",
        "<material> 'steel' without a valid colour (line 5): no effect on the dynamics",
        "<material> without a valid colour (line 10): no effect on the dynamics",
    } <= {*found.left_out}
    (tmp_path / "shown.sdf").write_text("""<sdf version="1.10"><model name="shown">
      <link name="arm"><inertial><mass>1</mass></inertial>
        <visual name="v"><geometry><sphere><radius>1</radius></sphere></geometry>
          <material><script><name>Gazebo/Grey</name></script></material></visual></link>
      <joint name="j" type="revolute"><parent>world</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis></joint>
    </model></sdf>""")
    found = codegen.import_model(tmp_path / "shown.sdf")
    assert "<material> without a valid colour (line 4): no effect on the dynamics" in found.left_out


def test_fixed_scenery_is_on_the_ground(tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")
    (tmp_path / "shown.xml").write_text("""<mujoco model="shown"><worldbody>
      <geom type="plane" size="1 1 1"/><geom type="box" size="1 2 3" pos="0 0 -1"/>
      <body pos="5 0 0"><geom type="sphere" size="0.2" pos="0 1 0"/>
        <body><joint type="hinge" axis="0 1 0"/><geom type="sphere" size="0.1"/></body></body></worldbody></mujoco>""")
    mjcf = codegen.import_model(tmp_path / "shown.xml").model
    assert [x[:3] for x in listed(mjcf.visuals)] == [("box", [2, 4, 6], [0, 0, -1]), ("sphere", [0.2], [5, 1, 0])]
    (tmp_path / "shown.sdf").write_text("""<sdf version="1.10"><model name="shown">
      <link name="stand"><pose>0 0 1 0 0 0</pose><inertial><mass>1</mass></inertial>
        <visual name="v"><geometry><sphere><radius>0.5</radius></sphere></geometry></visual></link>
      <link name="arm"><inertial><mass>1</mass></inertial></link>
      <joint name="f" type="fixed"><parent>world</parent><child>stand</child></joint>
      <joint name="j" type="revolute"><parent>stand</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis></joint>
    </model></sdf>""")
    sdf = codegen.import_model(tmp_path / "shown.sdf").model
    assert [x[:3] for x in listed(sdf.visuals)] == [("sphere", [0.5], [0, 0, 1])]


def test_geoms_without_a_colour_have_that_of_their_material(tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")
    (tmp_path / "shown.xml").write_text("""<mujoco model="shown"><asset><material name="steel" rgba="0 0 1 1"/></asset>
      <worldbody><body><joint type="hinge" axis="0 1 0"/>
        <geom type="sphere" size="0.1" material="steel"/>
        <geom type="sphere" size="0.2" pos="1 0 0" material="steel" rgba="1 0 0 1"/>
        <geom type="sphere" size="0.3" pos="2 0 0"/></body></worldbody></mujoco>""")
    found = codegen.import_model(tmp_path / "shown.xml")
    assert [v[3] for v in visuals(found)] == ["#0000ff", "#ff0000", "#808080"]


def test_meshes_of_an_mjcf_are_where_mujoco_has_them(tmp_path):
    """MuJoCo moves the vertices of a mesh to its principal axes; the file has them where they were."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo reads MJCF: pip install mujoco")
    trimesh = pytest.importorskip("trimesh", reason="reads meshes: pip install trimesh")
    (tmp_path / "assets").mkdir()
    mesh = trimesh.creation.box((0.2, 0.4, 0.6))
    mesh.apply_translation((0.3, -0.1, 0.2))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3)))
    mesh.export(tmp_path / "assets" / "part.stl")
    (tmp_path / "shown.xml").write_text("""<mujoco model="shown"><compiler meshdir="assets"/>
      <asset><mesh name="part" file="part.stl" scale="1 2 0.5"/></asset>
      <worldbody><body pos="0 0 1" euler="10 20 30"><joint type="hinge" axis="0 1 0"/>
        <geom type="mesh" mesh="part" pos="0.1 0.2 0.3" euler="40 50 60" rgba="1 0 0 1"/>
        <geom type="sphere" size="0.1" group="3"/></body></worldbody></mujoco>""")
    found = codegen.import_model(tmp_path / "shown.xml")
    ((kind, _, _, color, file),) = visuals(found)
    assert (kind, color, file) == ("mesh", "#ff0000", "assets/part.stl")
    codegen.generate(found.model, tmp_path / "made", target="numpy", frames=True)
    solver = codegen.load(tmp_path / "made", target="numpy")
    scene = scene_of(solver._manifest, np.array(solver.parameters))
    (solid,) = scene.solids
    assert isinstance(solid, Solid)
    vertices, _ = Meshes(tmp_path).surface(solid)
    frames = solver.frames(solver.initial[0])
    ours = solid.placed(vertices) @ frames.rotation[0].T + frames.position[0]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "shown.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    theirs = model.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    assert all(np.abs(ours - x).max(axis=1).min() < 1e-6 for x in theirs)
    assert all(np.abs(theirs - x).max(axis=1).min() < 1e-6 for x in ours)
