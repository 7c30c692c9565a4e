"""URDFs of known objects: their shapes and joints are read as the format says, and every error names the file."""

import numpy as np
import pytest
import trimesh

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.articulated_files import read_articulated
from gvla2.geometry.mesh import TriangleMesh
from gvla2.perception.articulated import joint_of
from gvla2.perception.scans import read_scans, scan_files
from gvla2.robot import urdf
from gvla2.robot.looks import link_surfaces
from gvla2.robot.urdf import read_urdf

BOX = '<visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual>'
SLIDE = '<axis xyz="0 0 2"/><limit lower="0" upper="0.1"/>'


def link(name, visual=""):
    return f'<link name="{name}">{visual}</link>'


def joint(parent, child, inside="", kind="prismatic"):
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{parent}_{child}" type="{kind}">{ends}{inside}</joint>'


@pytest.fixture
def written(tmp_path):
    """Writes a robot's elements, or a whole text, beside ``cube.ply`` of side 2; returns the URDF's path."""
    trimesh.creation.box((2.0, 2.0, 2.0)).export(tmp_path / "cube.ply")

    def write(text, name="chest.urdf"):
        (tmp_path / name).write_text(text if text.startswith("<?") else f'<robot name="r">{text}</robot>')
        return tmp_path / name

    return write


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


def test_shapes_lie_where_links_fixed_joints_and_origins_put_them(written):
    ball = '<visual><geometry><sphere radius="0.02"/></geometry></visual>'
    mesh = (
        '<visual><origin xyz="0 0 1"/><geometry><mesh filename="package://cube.ply" scale="0.1 0.2 0.3"/></geometry>'
        "</visual>"
    )
    can = '<visual><origin rpy="0 1.5707963 0"/><geometry><cylinder radius="0.05" length="0.4"/></geometry></visual>'
    turned = (
        '<origin xyz="0.5 0 0" rpy="1.5707963 0 1.5707963"/>'  # about the fixed x, then about the fixed z
    )
    file = read_articulated(
        written(
            link("base", BOX) + link("tray", mesh) + link("knob", ball) + link("rod", can)
            + joint("base", "tray", turned + SLIDE) + joint("tray", "knob", '<origin xyz="0 0 2"/>', "fixed")
            + joint("base", "rod", '<axis xyz="0 1 0"/><limit effort="1" velocity="1"/>', "continuous")
        )
    )  # fmt: skip
    boxes = [(owner, textured.mesh.vertices) for owner, textured in file.meshes()]
    assert [owner for owner, _ in boxes] == [-1, 0, 0, 1]  # what is fixed to a moving link moves with it
    sizes = [np.ptp(points, axis=0) for _, points in boxes]
    middles = [0.5 * (points.min(axis=0) + points.max(axis=0)) for _, points in boxes]
    assert sizes[0] == pytest.approx([0.1, 0.2, 0.3])
    # The tray's x, y and z axes are the world's y, z and x.
    assert (sizes[1], middles[1]) == (
        pytest.approx([0.6, 0.2, 0.4]),
        pytest.approx([1.5, 0.0, 0.0], abs=1e-6),
    )
    assert (sizes[2], middles[2]) == (pytest.approx([0.04] * 3), pytest.approx([2.5, 0.0, 0.0], abs=1e-6))
    assert sizes[3] == pytest.approx([0.4, 0.1, 0.1], abs=1e-3)
    tray, rod = file.links
    assert (tray.name, tray.slides, tray.low, tray.high) == ("tray", True, 0.0, 0.1)
    assert (tray.axis, tray.origin) == (pytest.approx([1, 0, 0], abs=1e-6), pytest.approx([0.5, 0, 0]))
    assert (rod.slides, rod.high - rod.low) == (False, pytest.approx(2 * np.pi))


TWO = link("base", BOX) + link("a", BOX)
BROKEN = {
    "not XML": ("<?oh", "Cannot read"),
    "another format": ("<?xml version='1.0'?><sdf/>", "<sdf>, not <robot>"),
    "nothing to see": (link("base"), "<visual>"),
    "no shape": (link("base", "<visual/>"), "no shape"),
    "missing mesh": (
        link("base", '<visual><geometry><mesh filename="gone.ply"/></geometry></visual>'),
        "gone.ply",
    ),
    "circle": (link("a", BOX) + link("b") + joint("a", "b", SLIDE) + joint("b", "a", SLIDE), "circle"),
    "no parent": (TWO + '<joint name="j" type="fixed"><child link="a"/></joint>', "no parent link"),
    "zero axis": (
        TWO + joint("base", "a", '<axis xyz="0 0 0"/><limit lower="0" upper="1"/>'),
        "axis .* is 0",
    ),
    "limits are words": (TWO + joint("base", "a", '<limit lower="shut" upper="1"/>'), 'lower="shut"'),
    "limits are endless": (TWO + joint("base", "a", '<limit lower="0" upper="inf"/>'), 'upper="inf"'),
    "slides without limits": (TWO + joint("base", "a"), "'base_a' .prismatic. has no <limit"),
    "comma": (link("base", BOX.replace("0.1 0.2 0.3", "0,1 0,2 0,3")), "size.*of link 'base' needs 3 finite"),
    "expression": (link("base", BOX.replace("0.3", "${h}")), "xacro expands"),
    "two roots": (TWO, "several roots, base, a"),
    "twice": (link("base", BOX) * 2, "two links called 'base'"),
    "carried twice": (
        TWO + joint("base", "a", SLIDE) + joint("base", "a", "", "fixed").replace("base_a", "j"),
        "two joints",
    ),
    "child unknown": (TWO + joint("base", "b", SLIDE), "its child link 'b' does not exist"),
    "type unknown": (TWO + joint("base", "a", SLIDE, "screw"), "the type 'screw'"),
    "two numbers": (TWO + joint("base", "a", '<origin xyz="0 1"/>' + SLIDE), "3 finite numbers"),
}


def test_prefixes_without_a_declaration_byte_order_marks_and_windows_paths(written, tmp_path):
    (tmp_path / "a b").mkdir()
    trimesh.creation.box((2.0, 2.0, 2.0)).export(tmp_path / "a b" / "cube.ply")
    names = ("a b\\cube.ply", "package://a b/cube.ply", f"file://{tmp_path}/a%20b/cube.ply")
    for name in names:
        mesh = f'<visual><geometry><mesh filename="{name}" scale=""/></geometry></visual>'
        path = written(
            "<?xml version='1.0'?><robot name='r'>" + link("base", mesh + "<drake:compliance/>") + "</robot>"
        )
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b">", b">\r\n"))
        ((_, cube),) = read_articulated(path).meshes()
        assert cube.mesh.bounds.tolist() == [[-1, -1, -1], [1, 1, 1]]


@pytest.mark.parametrize(
    ("variable", "below"), [("ROS_PACKAGE_PATH", "arm"), ("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "")]
)
def test_meshes_of_packages_of_ros(written, tmp_path, monkeypatch, variable, below):
    folder = tmp_path / "ros" / ("share" if variable.startswith("AMENT") else "") / "arm"
    folder.mkdir(parents=True)
    (tmp_path / "cube.ply").rename(folder / "cube.ply")
    monkeypatch.setenv(variable, f":{tmp_path / 'ros' / below}")
    urdf._in_package.cache_clear()
    mesh = '<visual><geometry><mesh filename="package://arm/cube.ply"/></geometry></visual>'
    (path,) = {
        m.get("filename") for m in read_urdf(written(link("base", mesh))).iterfind("link/visual//mesh")
    }
    assert path == str(folder / "cube.ply")


def test_a_mirrored_mesh_keeps_its_outside_out(written):
    mesh = '<visual><geometry><mesh filename="cube.ply" scale="1 -0.5 1"/></geometry></visual>'
    path = written(link("base", mesh))
    ((_, cube),) = read_articulated(path).meshes()
    (surface,) = link_surfaces(read_urdf(path)).values()
    assert cube.mesh.volume == pytest.approx(4.0)
    assert TriangleMesh(surface.vertices, surface.faces).volume == pytest.approx(4.0)


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_wrong_is_said_with_the_file(written, case):
    text, said = BROKEN[case]
    with pytest.raises(GeometryError, match=said) as caught:
        read_articulated(written(text))
    assert "chest.urdf" in str(caught.value)


def test_an_unknown_shape_is_said_when_it_is_drawn(written):
    path = written(link("base", '<visual><geometry><capsule radius="1"/></geometry></visual>'))
    with pytest.raises(GeometryError, match=r"chest\.urdf: a <capsule> cannot be drawn"):
        read_articulated(path).meshes()


def test_a_model_is_one_object_and_its_meshes_are_none(written, tmp_path):
    cube = '<visual><geometry><mesh filename="cube.ply" scale="0.1 0.1 0.1"/></geometry></visual>'
    path = written(link("base", cube) + link("red_lid", BOX) + joint("base", "red_lid", SLIDE))
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "block.glb")
    assert set(scan_files(tmp_path)) == {"block"}
    assert scan_files(tmp_path, joints=True)["chest"] == path
    chest = next(scan for scan in read_scans(tmp_path) if scan.name == "chest")
    assert [each.name for each in chest.links] == ["red lid"]
    assert set(chest.owners) == {-1, 0}
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "chest.ply")
    with pytest.raises(ConfigurationError, match="two scans called 'chest'"):
        scan_files(tmp_path, joints=True)


def test_a_scan_without_what_lies_inside_it(written, tmp_path):
    inner = '<visual><geometry><box size="0.02 0.02 0.02"/></geometry></visual>'
    written(link("base", BOX) + link("ball", inner) + joint("base", "ball", SLIDE))
    (scan,) = (each for each in read_scans(tmp_path) if each.links)
    inside, left = ((each.owners == 0).sum() for each in (scan, scan.skin))
    assert left < 0.3 * inside
    assert (scan.skin.owners == -1).sum() == (scan.owners == -1).sum()
    assert np.ptp(scan.skin.points, axis=0) == pytest.approx([0.1, 0.2, 0.3], abs=0.01)


@pytest.mark.parametrize(
    ("value", "low", "high", "way", "position", "reach"),
    [
        (0.05, 0.0, 0.2, 1.0, 0.05, 0.2),
        (-0.1, -0.16, 0.01, -1.0, 0.1, 0.16),
        (0.3, 0.1, 0.5, 1.0, 0.2, 0.4),
        (-0.3, -0.5, -0.1, -1.0, 0.2, 0.4),
        (0.0, 0.0, 0.0, -1.0, 0.0, 0.0),
    ],
)
def test_a_part_opens_towards_its_farther_limit(value, low, high, way, position, reach):
    made = joint_of(True, np.array([1.0, 0.0, 0.0]), np.zeros(3), value, low, high)
    assert made.axis[0] == way
    assert (made.position, made.reach) == (pytest.approx(position), pytest.approx(reach))


def test_a_primitive_has_its_materials_colour_its_own_or_by_name(tmp_path):
    file = tmp_path / "box.urdf"
    box = '<geometry><box size="1 1 1"/></geometry>'
    file.write_text(
        '<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material><link name="base">'
        f'<visual>{box}<material name="red"/></visual>'
        f'<visual>{box}<material name=""><color rgba="0 0.5 1 0.3"/></material></visual><visual>{box}</visual>'
        "</link></robot>"
    )
    colours = [mesh.rgb[0, 0] for _, mesh in read_articulated(file).meshes()]
    assert np.allclose(colours, [[1, 0, 0], [0, 0.5, 1], [0.7, 0.7, 0.7]])
