from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.record.drawing import Rect, place
from gvla2.record.pictures import in_sight, perception_overlay, plan_overlay, plan_views

Seen = tuple[Scene, Observation]


def changed(picture: np.ndarray, plain: np.ndarray) -> np.ndarray:
    return np.abs(picture.astype(int) - plain.astype(int)).sum(axis=-1) > 60


def test_boxes_are_drawn_where_the_objects_are(seen: Seen) -> None:
    scene, before = seen
    view = before.views[0]
    empty = replace(scene, objects=())
    plain = np.asarray(perception_overlay(view, empty))
    for k, obj in enumerate(scene.objects):
        alone = replace(scene, objects=(obj,))
        marks = changed(np.asarray(perception_overlay(view, alone)), plain)
        uv, _ = view.camera.project(obj.corners())
        u, v = (uv * plain.shape[0] / view.camera.height).astype(int).T
        near = [marks[max(0, b - 3) : b + 4, max(0, a - 3) : a + 4].any() for a, b in zip(u, v, strict=True)]
        assert all(near), f"object {k}: not every corner is marked"


def test_an_object_behind_a_wall_is_not_in_sight(seen: Seen) -> None:
    scene, before = seen
    view = before.views[0]
    obj = scene.objects[0]
    assert in_sight(view, obj) > 0.5
    wall = np.full_like(view.depth, 0.3)
    assert in_sight(View(view.camera, view.image, wall), obj) == 0
    assert in_sight(View(view.camera, view.image, None), obj) == 1


def test_an_object_behind_the_camera_draws_nothing(seen: Seen) -> None:
    scene, before = seen
    view = before.views[0]
    behind = replace(
        scene.objects[0], world_from_object=rigid(translation=(3.0, 0.0, 2.0)), points=np.zeros((0, 3))
    )
    without = perception_overlay(view, replace(scene, objects=()))
    assert perception_overlay(view, replace(scene, objects=(behind,))).tobytes() == without.tobytes()


def test_the_path_shows_in_the_front_camera_first(seen: Seen, episode) -> None:  # type: ignore[no-untyped-def]
    _, before = seen
    trajectory = episode().plan.trajectory
    names = [v.name for v in plan_views(before.views, trajectory)]
    assert names[0] == "front"
    assert "wrist" not in names


def test_waypoints_out_of_the_picture_are_no_error(seen: Seen) -> None:
    _, before = seen
    far = Trajectory((Waypoint((9.0, 9.0, 9.0), 1.0, "away"), Waypoint((-9.0, 0.0, -3.0), 0.0, "gone")))
    for view in before.views:
        assert plan_overlay(view, far, np.array([0.2, 0.0, 1.0])).width >= 128


def test_labels_in_a_crowd_do_not_cover_one_another() -> None:
    taken: list[Rect] = []
    for x in (100, 200, 200, 200, 200):
        spot = place(Rect(x - 10, 140, x + 10, 160), (90, 20), taken, Rect(0, 0, 400, 300))
        assert not any(map(spot.overlaps, taken))
        taken.append(spot)
