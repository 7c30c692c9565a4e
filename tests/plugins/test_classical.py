"""The classical perceiver on ray cast table tops with known truth."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.errors import PerceptionError
from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import rigid, transform_points
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.levels import lean_of, leaning_plate
from gvla2_plugins.classical.perceiver import ClassicalPerceiver
from gvla2_plugins.classical.solids import SeenObject
from tests.benchmarks.perception import score
from tests.plugins.rendered_table import (
    ROBOT_ID,
    TABLE_TOP,
    WORKSPACE,
    put,
    put_lamp,
    put_region,
    render,
    yaw_error,
)


def perceive(observation: Observation, **options) -> Scene:
    return ClassicalPerceiver(ClassicalConfig(**options)).perceive(
        observation, "pick something up", WORKSPACE
    )


def cube(xy, yaw=0.0, colour="red", side=0.05, bottom=0.0):
    return put("box", (side,) * 3, xy, yaw, colour, ("cube",), bottom)


def by_label(scene: Scene, label: str) -> SceneObject:
    found = [o for o in scene.objects if o.label == label]
    assert len(found) == 1, [o.label for o in scene.objects]
    return found[0]


THREE = [
    cube((0.2, -0.2), 0.4, "red"),
    cube((0.35, 0.1), -0.9, "blue", 0.06),
    cube((0.1, 0.25), 1.3, "lime", 0.07),
]


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_cubes_are_found_to_the_millimetre(noise: float):
    scene = perceive(render(THREE, noise=noise))
    assert scene.perceiver == "classical"
    assert scene.table_height == pytest.approx(TABLE_TOP, abs=3e-4)
    assert [o.label for o in scene.objects] == ["lime cube", "red cube", "blue cube"]
    for truth in THREE:
        found = by_label(scene, f"{truth.colour} cube")
        assert found.shape == "box"
        assert np.linalg.norm(found.centre - truth.centre) < 0.002
        assert np.abs(found.extents - truth.size).max() < 0.002 + noise
        assert yaw_error(truth, found) < 2.0
        assert found.bottom == pytest.approx(scene.table_height, abs=5e-4)
        assert found.confidence > 0.8


def test_random_table_tops_with_noise():
    tally = score(6, 2024, 0.002)
    assert tally.found / tally.truths >= 0.99
    assert tally.spurious == 0
    assert np.percentile(tally.centres, 95) < 3.0
    assert np.mean(tally.colours) >= 0.97


@pytest.mark.parametrize("options", [{"jump": 0.0}, {"min_points": 1}, {"gap": float("nan")}])
def test_options_out_of_range_are_refused(options: dict):
    with pytest.raises(PerceptionError, match="out of range"):
        ClassicalPerceiver(ClassicalConfig(**options))


def test_shapes_and_their_words():
    scene = perceive(
        render(
            [
                put("sphere", (0.06,) * 3, (0.2, -0.35), 0, "orange"),
                put("cylinder", (0.05, 0.05, 0.065), (0.2, -0.15), 0, "cyan"),
                put("cylinder", (0.07, 0.07, 0.22), (0.2, 0.05), 0, "green"),
                put("box", (0.16, 0.11, 0.015), (0.2, 0.28), 0.6, "purple"),
                put("box", (0.13, 0.05, 0.06), (0.4, -0.25), -0.5, "white"),
                put("cylinder", (0.08, 0.08, 0.02), (0.42, 0.1), 0, "black"),
            ]
        )
    )
    assert {o.label: o.shape for o in scene.objects} == {
        "orange ball": "sphere",
        "cyan cylinder": "cylinder",
        "green bottle": "cylinder",
        "purple plate": "plate",
        "white box": "box",
        "black disc": "disc",
    }


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_cup_is_seen_to_be_hollow(noise: float):
    wall = trimesh.creation.annulus(0.0425, 0.0465, 0.147, sections=48)
    floor = trimesh.creation.cylinder(0.044, 0.004)
    floor.apply_translation((0, 0, -0.0715))
    mesh = trimesh.util.concatenate([wall, floor])
    mesh.apply_translation((0.25, 0.1, TABLE_TOP + 0.0735))
    cup = Surface(mesh.vertices, mesh.faces, np.array([1.0, 0.0, 1.0]), 7)
    scene = perceive(render([], robot=[cup], noise=noise))
    found = by_label(scene, "magenta cup")
    assert found.shape == "cylinder"
    assert np.abs(found.extents - [0.093, 0.093, 0.147]).max() < 0.003


def test_a_painted_square_is_a_region_and_lies_flat():
    truth = put_region((0.10, 0.10), (0.3, -0.1), 0.5, "teal")
    scene = perceive(render([truth, cube((0.3, 0.15), 0.2, "red")], noise=0.002))
    square = by_label(scene, "teal square")
    assert square.shape == "region"
    assert square.extents[2] < 0.002
    assert np.linalg.norm(square.centre[:2] - truth.centre[:2]) < 0.002
    assert np.abs(square.extents[:2] - 0.10).max() < 0.003
    assert yaw_error(truth, square) < 1.5
    assert square not in scene.obstacles()


@pytest.mark.parametrize("yaw", [0.0, 2.0, -1.2])
def test_a_button_is_an_object_of_its_own(yaw: float):
    lamp = put_lamp((0.3, 0.05), yaw, "red")
    scene = perceive(render(lamp, noise=0.001))
    button, truth = by_label(scene, "red button"), lamp[3]
    assert button.shape == "disc"
    assert np.linalg.norm(button.centre - truth.centre) < 0.003
    assert button.top == pytest.approx(TABLE_TOP + 0.024, abs=0.002)
    housing = scene[button.parent]
    assert housing.top == pytest.approx(TABLE_TOP + 0.010, abs=0.002)
    assert button.bottom == pytest.approx(housing.top, abs=1e-4)
    shade = min((o for o in scene.objects if o.top > TABLE_TOP + 0.09), key=lambda o: o.bottom)
    assert shade.bottom > TABLE_TOP + 0.04, "the lamp's parts must not become one tall obstacle"


def test_an_object_of_one_colour_is_split_by_height():
    rgb = (0.0, 0.5, 0.5)
    whole = [
        put("box", (0.14, 0.14, 0.03), (0.3, 0.0), 0.4, "teal", rgb=rgb),
        put("cylinder", (0.03, 0.03, 0.20), (0.3, 0.0), 0.0, "teal", bottom=0.03, rgb=rgb),
    ]
    scene = perceive(render(whole))
    foot, post = sorted(scene.objects, key=lambda o: o.top)
    assert post.parent == foot.id
    assert foot.top == pytest.approx(TABLE_TOP + 0.03, abs=0.003)
    assert post.label == "teal post"
    assert np.abs(post.extents[:2] - 0.03).max() < 0.004


def test_a_held_cube_hangs_in_the_air():
    held = cube((0.3, -0.05), 0.0, "yellow", bottom=0.25)
    fingers = []
    for side in (-1, 1):
        finger = put("box", (0.02, 0.012, 0.05), (0.3, -0.05 + side * 0.031), 0, "white", bottom=0.265)
        mesh = finger.surface(ROBOT_ID)
        fingers.append(replace(mesh, vertices=transform_points(finger.pose, mesh.vertices)))
    palm = put("box", (0.06, 0.2, 0.06), (0.3, -0.05), 0, "white", bottom=0.32)
    fingers.append(
        replace(palm.surface(ROBOT_ID), vertices=transform_points(palm.pose, palm.surface(0).vertices))
    )
    observation = render([held, cube((0.15, 0.25), 0.3, "navy")], robot=fingers, noise=0.001)
    scene = perceive(replace(observation, world_from_tcp=rigid(translation=held.centre)))
    found = by_label(scene, "yellow cube")
    assert np.linalg.norm(found.centre - held.centre) < 0.006
    assert found.bottom == pytest.approx(TABLE_TOP + 0.25, abs=0.006)
    assert by_label(scene, "navy cube").bottom == pytest.approx(TABLE_TOP, abs=0.001)
    assert any(found.id in note and "stand" in note for note in scene.notes)


def test_a_cube_on_a_cube_stands_on_it_and_is_no_part_of_it():
    scene = perceive(
        render([cube((0.3, 0.0), 0.2, "red", 0.06), cube((0.3, 0.0), 0.5, "cyan", 0.05, bottom=0.06)])
    )
    upper, lower = by_label(scene, "cyan cube"), by_label(scene, "red cube")
    assert upper.parent == ""
    assert upper.bottom == pytest.approx(lower.top, abs=1e-4)
    assert np.abs(upper.extents - 0.05).max() < 0.003
    assert f"{upper.id} stands on {lower.id}." in scene.notes


@pytest.mark.parametrize("blind", [("wrist",), ("left", "right", "wrist")])
def test_blind_cameras_are_done_without(blind: tuple[str, ...]):
    scene = perceive(render(THREE, blind=blind))
    assert len(scene.objects) == 3
    for name in blind:
        assert any(f"'{name}' is not used" in note for note in scene.notes)


def test_a_covered_lens_is_not_believed():
    observation = render(THREE)
    dark = View(observation.views[3].camera, np.zeros((256, 256, 3), np.uint8), observation.views[3].depth)
    colour_only = View(observation.views[0].camera, observation.views[0].image)
    scene = perceive(replace(observation, views=Views((colour_only, *observation.views.views[1:3], dark))))
    assert len(scene.objects) == 3
    assert any("black" in note for note in scene.notes)
    assert any("no depth" in note for note in scene.notes)


def test_without_a_table_there_is_no_scene():
    observation = render([], robot=[])
    above = Box(np.array([-0.2, -0.5, 1.2]), np.array([0.7, 0.5, 1.7]))
    with pytest.raises(PerceptionError, match="measured points lie in the workspace"):
        ClassicalPerceiver(ClassicalConfig()).perceive(observation, "", above)
    rng = np.random.default_rng(0)
    scattered = tuple(
        replace(v, depth=(v.depth + rng.uniform(-0.4, 0.0, v.depth.shape)).astype(np.float32))
        for v in observation.views
    )
    with pytest.raises(PerceptionError, match="No level plane"):
        perceive(replace(observation, views=Views(scattered)))
    with pytest.raises(PerceptionError, match="is empty"):
        ClassicalPerceiver(ClassicalConfig()).perceive(observation, "", Box(WORKSPACE.high, WORKSPACE.low))


def test_the_same_observation_gives_the_same_scene_whatever_is_asked():
    observation = render([*put_lamp((0.35, -0.2), 0.4, "cyan"), *THREE[1:]], noise=0.002)
    perceiver = ClassicalPerceiver(ClassicalConfig())
    one, two = (perceiver.perceive(observation, words, WORKSPACE) for words in ("take the red cube", ""))
    assert [o.id for o in one.objects] == [f"o{k + 1}" for k in range(len(one.objects))]
    assert [o.label for o in one.objects] == [o.label for o in two.objects]
    for a, b in zip(one.objects, two.objects, strict=True):
        np.testing.assert_array_equal(a.world_from_object, b.world_from_object)
        np.testing.assert_array_equal(a.extents, b.extents)
    assert np.all(np.diff([round(o.centre[0], 3) for o in one.objects]) >= 0)


def test_objects_beside_the_workspace_are_left_out():
    scene = perceive(render([cube((0.3, 0.0)), cube((0.80, 0.2), 0.0, "blue")]))
    assert [o.label for o in scene.objects] == ["red cube"]
    assert any("beside the workspace" in note for note in scene.notes)


def test_a_nut_is_a_ring_about_its_hole_whatever_stands_out_on_one_side():
    sides = [((x, 0.0), (0.02, 0.086, 0.02)) for x in (-0.033, 0.033)]
    sides += [((0.0, y), (0.046, 0.02, 0.02)) for y in (-0.033, 0.033)]
    handle = ((0.06, 0.0), (0.04, 0.032, 0.02))
    at = np.array([0.3, 0.1])
    whole = [put("box", size, at + xy, 0.0, "orange") for xy, size in [*sides, handle]]
    (nut,) = perceive(render(whole)).objects
    assert nut.shape == "ring"
    assert nut.centre[:2] == pytest.approx(at, abs=0.003)
    assert nut.opening == pytest.approx(0.046, abs=0.004)


@pytest.mark.parametrize(
    "aside", [0.1, 0.16]
)  # within its outline, and beyond an edge that a frame would hide
def test_a_panel_before_which_a_bar_stands_off_is_a_door(aside: float):
    panel = put("box", (0.4, 0.04, 0.4), np.array([0.3, 0.1]), 0.0, "gray")
    bar = put(
        "box", (0.12, 0.04, 0.03), np.array([0.3 + aside, 0.1 - 0.02 - 0.045 - 0.02]), 0.0, "orange", (), 0.2
    )
    door, handle = sorted(perceive(render([panel, bar])).objects, key=lambda o: o.label, reverse=False)
    assert (door.label, handle.label) == ("gray door", "orange handle")
    assert handle.parent == door.id


def test_a_bin_with_compartments_is_hollow():
    walls = [((x, 0.0), (0.02, 0.3, 0.08)) for x in (-0.14, 0.0, 0.14)]
    walls += [((0.0, y), (0.3, 0.02, 0.08)) for y in (-0.14, 0.14)]
    whole = [put("box", size, np.array([0.3, 0.0]) + xy, 0.0, "blue") for xy, size in walls]
    (tray,) = perceive(render(whole)).objects
    assert tray.opening > 0.1
    assert tray.extents == pytest.approx([0.3, 0.3, 0.08], abs=0.006)


def test_a_round_hole_is_as_wide_as_it_is_and_the_ring_lies_as_its_handle():
    angles = np.arange(16) * np.pi / 8
    around = 0.042 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    at, yaw = np.array([0.3, 0.1]), 0.6
    whole = [
        put("box", (0.024, 0.02, 0.02), at + xy, float(turn), "orange")
        for xy, turn in zip(around, angles, strict=True)
    ]
    whole.append(
        put("box", (0.04, 0.03, 0.02), at + 0.068 * np.array([np.cos(yaw), np.sin(yaw)]), yaw, "orange")
    )
    (nut,) = perceive(render(whole)).objects
    assert nut.opening == pytest.approx(0.06, abs=0.005)
    along = nut.world_from_object[:2, 0]
    assert abs(along @ [np.cos(yaw), np.sin(yaw)]) > 0.99


@pytest.mark.parametrize(
    "points",
    [[[0, 0, 0.1]], [[0, 0, 0.1], [0.1, 0, 0.1]], [[0, 0, z] for z in (0.0, 0.1, 0.2)]],
    ids=["one", "two", "a line"],
)
def test_a_block_of_which_almost_nothing_is_seen_stands_upright(points):
    seen = np.array(points, dtype=np.float64)
    solid = (seen.mean(axis=0), 0.0, np.array([0.1, 0.1, 0.2]), 1.0)
    block = SeenObject("box", np.arange(len(seen)), seen, *solid)
    assert lean_of(block).tolist() == [0.0, 0.0, 1.0]
    assert leaning_plate(block) is None
