"""Any arm by its URDF: one of boxes and cylinders made here, and those of a package, lift a cube; errors that help."""

import itertools
from importlib.metadata import PackageNotFoundError, distribution

import numpy as np
import pytest
import trimesh

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance
from gvla2.robot.workcell import make_cell
from gvla2.testing import check_component
from gvla2.testing.robot import check_robot
from gvla2_plugins.sapien import SapienArmConfig, gvla2_robots
from gvla2_plugins.sapien.world import ignoring_groups

ARM = {c.name: c for c in gvla2_robots()}["sapien_arm"]

AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
HEIGHTS = (0.10, 0.15, 0.36, 0.16, 0.16, 0.08)
"""Of each joint over the one before, metres, where all are at zero and the arm stands upright."""

SOLID = '<collision><origin xyz="0 0 {z}"/><geometry>{shape}</geometry></collision>'
FINGERS = {"finger_a": "-1 0 0", "finger_b": "1 0 0"}
"""They close as their joints grow, along the tool's x: neither is what the simulation takes as given."""


FOLDED, DEEP = [-0.5, -1.7, -2.3, 0.4, -1.1, 2.2], -0.065
"""Joints, radians, at which the hand is so far in the base, metres."""


def link(name: str, shape: str = "", z: float = 0.0) -> str:
    return f'<link name="{name}">{SOLID.format(shape=shape, z=z) if shape else ""}</link>'


def joint(name: str, kind: str, parent: str, child: str, at: str, rest: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/>{rest}</joint>'
    )


def urdf(travel: float = 0.035, shapes: bool = True, extra: str = "") -> str:
    """Six joints with a wrist whose axes meet, and a gripper of its own."""
    parts = [link("base", '<cylinder radius="0.07" length="0.08"/>', 0.04)]
    before = "base"
    for i, (axis, up) in enumerate(zip(AXES, HEIGHTS, strict=True)):
        long = [*HEIGHTS, 0.04][i + 1]
        kind, limit = "revolute", 'lower="-2.8" upper="2.8" velocity="2"'
        if i == 5:
            kind, limit = "continuous", 'velocity="2"'
        parts.append(link(f"link{i + 1}", f'<cylinder radius="0.03" length="{long - 0.02}"/>', 0.5 * long))
        parts.append(
            joint(
                f"j{i + 1}",
                kind,
                before,
                f"link{i + 1}",
                f"0 0 {up}",
                f'<axis xyz="{axis}"/><limit {limit} effort="9"/>',
            )
        )
        before = f"link{i + 1}"
    parts += [link("flange"), joint("flange", "fixed", "link6", "flange", "0 0 0.05")]
    parts += [
        link("hand", '<box size="0.12 0.05 0.04"/>', 0.02),
        joint("hand_joint", "fixed", "flange", "hand", "0 0 0"),
    ]
    for name, axis in FINGERS.items():
        side = -1 if axis.startswith("1") else 1
        limit = f'<axis xyz="{axis}"/><limit lower="0" upper="{travel}" velocity="1" effort="9"/>'
        limit += '<mimic joint="finger_a_joint"/>' if name == "finger_b" else ""
        parts.append(link(name, '<box size="0.012 0.02 0.05"/>', 0.025))
        parts.append(joint(f"{name}_joint", "prismatic", "hand", name, f"{side * 0.041} 0 0.04", limit))
    text = f'<robot name="six">{"".join(parts)}{extra}</robot>'
    return text if shapes else text.replace("collision>", "ignored>")


@pytest.fixture
def make(tmp_path):
    """Options of the arm made here, the URDF's own and others."""

    def options(text: str | None = None, **changed) -> SapienArmConfig:
        file = tmp_path / "six.urdf"
        file.write_text(urdf() if text is None else text)
        given = {
            "urdf": str(file),
            "tool_link": "flange",
            "gripper_joints": ["finger_a_joint"],
            "image_size": 64,
        }
        return SapienArmConfig(**{**given, **changed})

    return options


class Block:
    """A cube in the middle of where tasks are laid out; nothing is asked."""

    instructions = ("",) * 4

    def sample(self, rng, site, instruction=None):
        solid = Primitive("box", (0.04, 0.04, 0.04), (1.0, 0.0, 0.0))
        cube = Body("block", (solid,), rigid(translation=(*site.centre, site.table_height + 0.02)), mass=0.2)
        return TaskInstance("", Layout((cube,)), {"relaxed": lambda w: False, "strict": lambda w: False})


def lift(config: SapienArmConfig):
    """The robot after it has grasped the cube, lifted it by 0.12 m, and (a second trajectory) opened its hand."""
    robot = ARM.build(config)
    robot.reset(Block(), 0)
    np.testing.assert_allclose(robot.observe().joints, robot.arm.home, atol=1e-3)
    assert robot._world.touching_links() == set()
    cell, hand = robot._cell, robot.arm.hand
    depth = min(0.02, hand.finger_length - hand.tip_beyond_tcp - 0.005)
    place = np.array([*cell.site_centre, cell.table_height + 0.04 - depth])
    up, near = np.array([0.0, 0.0, 0.12]), frozenset({"block", "table"})
    down = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    steps = (
        Waypoint(tuple(place + up), 1.0, "approach", down),
        Waypoint(tuple(place), 1.0, "grasp", down, motion="linear", allowed_contacts=near),
        Waypoint(tuple(place), 0.0, "close", down, motion="linear", allowed_contacts=near),
        Waypoint(tuple(place + up), 0.0, "lift", down, motion="linear", allowed_contacts=near),
    )
    scene = Scene((), cell.table_height, robot.arm.workspace)
    report = robot.execute(Trajectory(steps), scene)
    assert report.abort is None, report.waypoints[-1].message
    assert report.waypoints[-1].held
    height = robot.true_state().pose("block")[2, 3] - cell.table_height
    assert height == pytest.approx(0.14, abs=0.008)
    assert robot.true_state().held("block")
    width = robot.observe().gripper_width
    opened = robot.execute(Trajectory((Waypoint(tuple(place + up), 1.0, "open", down),)), scene)
    assert opened.abort is None
    assert not robot.true_state().held("block")
    assert robot.true_state().pose("block")[2, 3] < cell.table_height + 0.1
    robot.close()
    return robot, width


def test_it_keeps_a_robots_contract(make):
    check_component(ARM)
    check_robot(ARM.build(make()), Block())


def test_an_arm_of_boxes_lifts_a_cube_with_its_own_fingers(make):
    robot, width = lift(make())
    assert width == pytest.approx(0.04, abs=0.002)
    hand, frame = robot.arm.hand, robot.arm.kinematics
    assert hand.max_width == pytest.approx(0.07, abs=1e-6)
    assert hand.finger_length == pytest.approx(0.05, abs=1e-6)
    assert (hand.finger_thickness, hand.finger_breadth) == pytest.approx((0.012, 0.02), abs=1e-6)
    assert (hand.palm_breadth, hand.palm_depth) == pytest.approx((0.12, 0.05), abs=1e-6)
    assert frame.dof == 6
    assert frame.high[5] == pytest.approx(2 * np.pi - 0.01)


def test_an_arm_without_fingers_gets_a_hand(make):
    bare = urdf().partition('<link name="hand">')[0] + "</robot>"
    _, measured = lift(make(bare, gripper_joints=[], tool_rpy=[0.0, 0.0, 0.3]))
    assert measured == pytest.approx(0.04, abs=0.002)


def test_home_is_found_clear_of_everything_and_the_same_each_time(make):
    one, other = make_cell(make()).arm, make_cell(make()).arm
    np.testing.assert_array_equal(one.home, other.home)
    assert one.clearance(one.home, 1.0, Scene((), 0.0, one.workspace)).distance > 0.01
    assert one.forward(one.home)[2, 2] == pytest.approx(-1.0, abs=1e-4)  # the hand points down


@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_a_collada_shape_is_as_large_as_its_unit_says(make, tmp_path, unit):
    box = trimesh.creation.box((0.06, 0.06, 0.34))
    box.apply_translation([0, 0, 0.18])
    box.apply_scale(1 / unit)
    text = box.export(file_type="dae").replace(b"</asset>", f'<unit meter="{unit}"/></asset>'.encode())
    (tmp_path / "forearm.dae").write_bytes(text)
    forearm = (
        '<link name="fore"><collision><geometry><mesh filename="forearm.dae"/></geometry></collision></link>'
    )
    fixed = joint("fore", "fixed", "link2", "fore", "0 0 0")
    arm = make_cell(make(urdf(extra=forearm + fixed))).arm
    assert arm.clearance(arm.home, 1.0, Scene((), 0.0, arm.workspace)).distance > 0.01


@pytest.mark.parametrize(("mass", "xx", "xy"), [(-1, 0.1, 0), (1, -0.1, 0), (1, 0.001, 5)])
def test_an_inertia_that_no_body_has_is_left_out_and_said(make, caplog, mass, xx, xy):
    rest = f'<inertia ixx="{xx}" iyy="0.1" izz="0.1" ixy="{xy}" ixz="0" iyz="0"/>'
    inertial = f'<inertial><mass value="{mass}"/>{rest}</inertial>'
    robot = ARM.build(make(urdf().replace('<link name="link3">', f'<link name="link3">{inertial}')))
    robot.reset(Block(), 0)
    robot.close()
    assert "<inertial> of link3" in caplog.text


def test_neighbours_are_found_and_real_collisions_kept(make):
    arm = make_cell(make()).arm
    raised = make_cell(make(base_position=[0.2, -0.1, 0.3], table_height=0.3)).arm
    pairs = {frozenset(p) for p in arm.collisions.overlapping}
    assert {frozenset(("link1", "link2")), frozenset(("finger_a", "finger_b"))} <= pairs
    assert frozenset(("base", "link6")) not in pairs
    for one in (arm, raised):  # wherever it stands
        hit = one.clearance(np.array(FOLDED), 1.0, Scene((), -2.0, arm.workspace))
        assert {hit.robot_part, hit.other} == {"base", "hand"}
        assert hit.distance == pytest.approx(DEEP, abs=1e-3)


EXAMPLES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_eef"),
}


@pytest.mark.extras
@pytest.mark.parametrize("name", EXAMPLES)
def test_arms_of_a_package_lift_a_cube(name):
    try:
        distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip('the arms come with the package example-robot-data: pip install "gvla2[arms]"')
    file, tool = EXAMPLES[name]
    lift(SapienArmConfig(urdf=f"package://example-robot-data/robots/{file}", tool_link=tool, image_size=64))


VISUAL = '<visual><geometry><mesh filename="package://six/none.stl"/></geometry></visual>'


def test_just_the_links_that_may_touch_share_a_bit_of_the_engine():
    hand = [frozenset(pair) for pair in itertools.combinations([f"finger_{k}" for k in range(20)], 2)]
    chain = [frozenset((f"link_{k}", f"link_{k + 2}")) for k in range(12)]
    groups = ignoring_groups([*hand, *chain, frozenset(("link_0",))])
    for pair in itertools.combinations(groups, 2):
        assert bool(groups[pair[0]] & groups[pair[1]]) == (frozenset(pair) in {*hand, *chain}), pair
    with pytest.raises(RobotError, match=r"80 pairs .* robot\.srdf"):
        ignoring_groups([frozenset((f"a{k}", f"b{k}")) for k in range(80)])


CAP = (
    '<link name="cap">{}</link><joint name="j" type="fixed"><parent link="base"/><child link="cap"/></joint>'
)
EMPTY = "<visual><geometry/></visual>"


@pytest.mark.parametrize(
    ("text", "changed", "expected"),
    [
        (None, {"gripper_joints": ["finger_x"]}, r"gripper_joints=finger_x .*It has: j1, .*finger_b_joint"),
        (None, {"tool_link": "tool7"}, r"tool_link=tool7 is not in the URDF\. It has: base, link1.*flange"),
        (None, {"gripper_joints": ["j1", "j2"]}, r"two prismatic.*j1 \(revolute\).*This arm has .*finger_a_joint"),
        (None, {"tool_rpy": [0.0, 1.5708, 0.0]}, r"slide along.*z must point out.*robot\.tool_rpy"),
        (None, {"tool_link": "link3", "gripper_joints": [], "tool_rpy": [3.14159, 0, 0]}, "cannot point down"),
        (None, {"tool_link": "link5"}, "link5 and the gripper's hand are not one rigid part"),
        (None, {"home": [0.0, 1.0]}, r"home=\[0\.0, 1\.0\] must be 6 angles.*j1 -2\.79…2\.79"),
        (None, {"home": FOLDED}, r"At robot\.home=.*base is 65 mm in hand"),
        (None, {"hand": {"width": 0.1}}, "robot.hand has no width; it has finger_breadth.*palm_depth"),
        (None, {"base_position": [0.0]}, r"robot\.base_position=\[0\.0\] \(3 numbers\)"),
        (None, {"urdf": "nowhere.urdf"}, r"robot\.urdf=nowhere\.urdf is no file"),
        (None, {"urdf": "package://nobody/arm.urdf"}, "in no installed package"),
        (None, {"tool_link": "base", "gripper_joints": []}, "No joint of six.urdf moves the tool's link 'base'"),
        (urdf(extra=CAP.format(EMPTY)), {}, r"<geometry> of link cap in .*six\.urdf does not hold"),
        (None, {"urdf": "", "tool_link": ""}, r"needs robot\.urdf=\.\.\. and robot\.tool_link=.*your_arm\.md"),
        (urdf().replace("revolute", "floating", 1), {}, "one axis each; these have several: j1"),
        (urdf(shapes=False), {}, "None of the 11 links of .* has a <collision> or <visual>"),
        (urdf(extra=CAP.format(VISUAL)), {}, r"mesh .*six/none\.stl of link cap in .*not exist"),
        (urdf(travel=0.0), {}, r"The gripper cannot open: .*finger_a_joint.*\(0\.0, 0\.0\).*Correct the joints"),
        ("<robot", {}, r"Cannot read a URDF from .*six\.urdf"),
        ("<sdf/>", {}, "<sdf>, not <robot>; a URDF is needed"),
    ],
)  # fmt: skip
def test_errors_name_what_exists_and_what_to_do(make, text, changed, expected):
    with pytest.raises((RobotError, ConfigurationError), match=f"(?s){expected}"):
        make_cell(make(text, **changed))
