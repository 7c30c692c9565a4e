"""A known cabinet with drawers, of which cameras see only a part, and what stands on it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Views
from gvla2.perception.gallery import LEAST
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.perceiver import ClassicalPerceiver

DEEP, WIDE, TALL, WALL = 0.20, 0.24, 0.20, 0.01
OPEN = 0.12
REACH = 0.16
HEIGHTS = {"bottom_drawer": -0.045, "top_drawer": 0.045}
"""Of the drawers' middles over the cabinet's."""


def painted(rgb, *boxes):
    """Boxes, each (size, middle), in one colour."""
    made = [trimesh.creation.box(size, rigid(None, middle)).subdivide().subdivide() for size, middle in boxes]
    whole = trimesh.util.concatenate(made)
    whole.visual.vertex_colors = np.tile([*rgb, 255], (len(whole.vertices), 1)).astype(np.uint8)
    return whole


def body():
    """Open at +x, with a shelf between the drawers."""
    across, up = (DEEP, WIDE, WALL), 0.5 * (TALL - WALL)
    side, aside = (DEEP, WALL, TALL), 0.5 * (WIDE - WALL)
    return painted(
        (190, 140, 80),
        (across, (0, 0, -up)), (across, (0, 0, 0)), (across, (0, 0, up)), (side, (0, -aside, 0)),
        (side, (0, aside, 0)), ((WALL, WIDE, TALL), (-0.5 * (DEEP - WALL), 0, 0)),
    )  # fmt: skip


def drawer():
    """Closed, its middle at the origin; the bar of its handle is 3 cm before the front."""
    front, wide, high = 0.5 * DEEP, WIDE - 0.03, 0.075
    long, side = 0.17, (0.17, 0.006, 0.05)
    return painted(
        (60, 90, 190),
        ((0.008, wide, high), (front - 0.004, 0, 0)), ((long, wide, 0.006), (front - 0.09, 0, -0.03)),
        (side, (front - 0.09, 0.5 * wide - 0.003, 0)), (side, (front - 0.09, -0.5 * wide + 0.003, 0)),
        ((0.006, wide, 0.05), (front - 0.17, 0, 0)), ((0.012, 0.10, 0.012), (front + 0.03, 0, 0)),
        ((0.03, 0.01, 0.01), (front + 0.012, 0.04, 0)), ((0.03, 0.01, 0.01), (front + 0.012, -0.04, 0)),
    )  # fmt: skip


@pytest.fixture
def gallery(tmp_path, tmp_path_factory, world, monkeypatch):
    """A cabinet as a URDF, one of whose drawers opens towards negative values, a brick and a bottle."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "gallery_cache"))
    folder = tmp_path / "gallery"
    (folder / "parts").mkdir(parents=True)
    body().export(folder / "parts" / "body.ply")
    drawer().export(folder / "parts" / "drawer.ply")

    def link(name, mesh):
        return f'<link name="{name}"><visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>'

    text = link("body", "parts/body.ply")
    limits = {"bottom_drawer": ("1 0 0", 0.0, REACH), "top_drawer": ("-1 0 0", -REACH, 0.01)}
    for name, (axis, low, high) in limits.items():
        text += link(name, "parts/drawer.ply") + (
            f'<joint name="{name}_joint" type="prismatic"><parent link="body"/><child link="{name}"/>'
            f'<origin xyz="0 0 {HEIGHTS[name]}"/><axis xyz="{axis}"/><limit lower="{low}" upper="{high}"/></joint>'
        )
    (folder / "wooden_cabinet.urdf").write_text(f'<robot name="cabinet">{text}</robot>')
    world.brick().export(folder / "painted_brick.glb")
    world.bottle((200, 200, 30)).export(folder / "yellow_bottle.glb")
    return folder


@pytest.mark.parametrize("opened", HEIGHTS)
def test_a_cabinet_its_drawers_and_what_stands_on_it(world, gallery, opened):
    yaw, top = 0.25, world.TABLE + TALL
    place = world.standing(body(), 0.2, 0.02, yaw)
    out = {name: OPEN if name == opened else 0.0 for name in HEIGHTS}
    brick, screen = world.brick(), painted((30, 120, 60), ((0.03, 0.06, 0.30), (0, 0, 0)))
    on_top = rigid(place[:3, :3], (0.19, 0.03, top + 0.02))
    seen = world.Seen(
        [
            (body(), place),
            *((drawer(), place @ rigid(None, (out[name], 0, height))) for name, height in HEIGHTS.items()),
            (brick, on_top),
            (screen, world.standing(screen, 0.25, -0.19, 1.6)),  # hides part of both from one side
        ],
        size=240,
        noise=0.0008,
    )
    perceiver = ClassicalPerceiver(ClassicalConfig(gallery=str(gallery)))
    scene = perceiver.perceive(seen.observation, "", world.WORKSPACE)
    by_name = {obj.label: obj for obj in scene.objects}
    cabinet = by_name["wooden cabinet"]
    assert cabinet.named_by == "gallery"
    assert cabinet.centre == pytest.approx(place[:3, 3], abs=0.01)
    for name, position in out.items():
        part, handle = (by_name[f"{name.replace('_', ' ')}{more}"] for more in ("", " handle"))
        assert (part.parent, handle.parent) == (cabinet.id, part.id)
        assert (part.joint.slides, part.joint.reach) == (True, pytest.approx(REACH))
        assert part.joint.position == pytest.approx(position, abs=0.015)
        assert part.joint.axis @ place[:3, 0] > 0.99
        bar = (place @ [0.5 * DEEP + 0.03 + position, 0, HEIGHTS[name], 1])[:3]
        assert handle.centre == pytest.approx(bar, abs=0.015)
    stacked = by_name["painted brick"]
    assert stacked.named_by == "gallery"
    assert (stacked.bottom, stacked.top) == (
        pytest.approx(top, abs=0.006),
        pytest.approx(top + 0.04, abs=0.006),
    )
    assert stacked.centre == pytest.approx(on_top[:3, 3], abs=0.01)
    # Nothing else is there, but for a few pixels on thin edges, where the samples of a scan lie far apart.
    assert len([obj for obj in scene.objects if not obj.parent and len(obj.points) > LEAST]) == 3


def test_no_cabinet_is_found_where_none_is(world, gallery):
    brick, box = world.brick(), painted((190, 140, 80), ((0.12, 0.10, 0.10), (0, 0, 0)))
    seen = world.Seen(
        [(brick, world.standing(brick, 0.2, -0.12, 0.5)), (box, world.standing(box, 0.3, 0.12))], noise=0.0008
    )
    perceiver = ClassicalPerceiver(ClassicalConfig(gallery=str(gallery)))
    scene = perceiver.perceive(seen.observation, "", world.WORKSPACE)
    assert {obj.label for obj in scene.objects if obj.named_by} == {"painted brick"}
    assert not any(obj.joint for obj in scene.objects)


def test_a_bowl_of_which_two_opposite_walls_are_seen_on_a_cabinet_is_one_object(world, gallery):
    outline = [(0, -0.025), (0.04, -0.025), (0.07, 0.025), (0.064, 0.025), (0.037, -0.019), (0, -0.019)]
    bowl = trimesh.creation.revolve(outline, sections=48)
    bowl.visual.vertex_colors = (30, 130, 60, 255)
    bowl.export(gallery / "green_bowl.glb")
    place = world.standing(body(), 0.2, 0.02)
    on_top = rigid(None, (0.2, 0.02, world.TABLE + TALL + 0.025))
    drawers = [(drawer(), place @ rigid(None, (0, 0, height))) for height in HEIGHTS.values()]
    seen = world.Seen([(body(), place), *drawers, (bowl, on_top)], size=240, noise=0.0008)
    views = []
    for view, truth in zip(seen.observation.views, seen.truth, strict=True):
        points = view.camera.backproject(view.depth)
        hidden = (truth == 4) & (np.abs(points[..., 0] - on_top[0, 3]) < 0.022)  # behind the robot
        views.append(replace(view, robot_mask=hidden))
    perceiver = ClassicalPerceiver(ClassicalConfig(gallery=str(gallery)))
    scene = perceiver.perceive(replace(seen.observation, views=Views(tuple(views))), "", world.WORKSPACE)
    assert sorted(obj.label for obj in scene.objects if not obj.parent) == ["green bowl", "wooden cabinet"]
    found = next(obj for obj in scene.objects if obj.label == "green bowl")
    assert found.centre == pytest.approx(on_top[:3, 3], abs=0.01)
    assert found.opening == pytest.approx(0.125, abs=0.015)
