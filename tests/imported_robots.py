"""Texts of small robots."""

ARM = """\
<robot name="Two Link-Arm">
  <link name="base">
    <inertial>
      <mass value="3"/>
      <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0.001" iyz="0"/>
    </inertial>
  </link>
  <link name="upper-arm">
    <inertial>
      <origin xyz="0 0 0.25" rpy="0 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.045" iyy="0.045" izz="0.0004" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><origin xyz="0 0 0.25"/><geometry><cylinder radius="0.02" length="0.5"/></geometry></visual>
  </link>
  <link name="forearm">
    <inertial>
      <origin xyz="0.1 0.02 0.2" rpy="0.3 0.1 -0.4"/>
      <mass value="1.5"/>
      <inertia ixx="0.03" iyy="0.02" izz="0.015" ixy="0.001" ixz="-0.002" iyz="0.0005"/>
    </inertial>
  </link>
  <link name="tool0">
    <inertial>
      <origin xyz="0 0.01 0.05"/>
      <mass value="0.25"/>
      <inertia ixx="0.001" iyy="0.002" izz="0.0015" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="upper-arm"/>
    <origin xyz="0 0 0.1" rpy="0 1.5707963267948966 0"/>
    <axis xyz="0 1 0"/>
    <dynamics damping="0.3"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper-arm"/><child link="forearm"/>
    <origin xyz="0 0 0.5" rpy="0.1 -0.2 0.3"/>
    <axis xyz="1 0 1"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="forearm"/><child link="tool0"/>
    <origin xyz="0.1 0 0.3" rpy="0 0.5 0"/>
  </joint>
</robot>
"""
"""Names with a blank and a hyphen; the upper arm's inertia is not that of its cylinder, a fixed tool has mass."""

MASS = '<inertial><mass value="{}"/><inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial>'


def link(name: str, mass: float = 1.0, moments: tuple[float, float, float] = (0.1, 0.1, 0.1), more: str = "") -> str:
    """A link of a URDF."""
    return f'<link name="{name}">{MASS.format(mass, *moments)}{more}</link>\n'


def joint(
    name: str,
    parent: str,
    child: str,
    type: str = "revolute",
    axis: str = "0 0 1",
    more: str = "",
    at: str = "0 0 0.5",
    rpy: str = "0 0 0",
) -> str:
    """A joint of a URDF."""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return (
        f'<joint name="{name}" type="{type}">{ends}<origin xyz="{at}" rpy="{rpy}"/><axis xyz="{axis}"/>{more}</joint>\n'
    )


def robot(*parts: str, name: str = "robot") -> str:
    """A URDF with these elements, each on lines of its own."""
    return f'<robot name="{name}">\n{"".join(parts)}</robot>\n'
