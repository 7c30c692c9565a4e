"""Waypoints relative to objects: derived from a trajectory, and the same places again."""

from gvla2.planning.programs import relative_steps
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.testing import inputs
from gvla2_plugins.agent3d.waypoint_programs import path_of

SCENE = inputs.scene()
RED, BLUE = SCENE.objects
DOWN = Orientation("grasp")


def at(obj, up, gripper, *, carries="", aside=(0.0, 0.0)):
    x, y = obj.centre[:2] + aside
    return Waypoint((float(x), float(y), float(obj.top + up)), gripper, "go", DOWN, carries=carries)


WAY = (
    at(RED, 0.1, 1.0), at(RED, -0.03, 1.0), at(RED, -0.03, 0.9), at(RED, -0.03, 0.0),
    at(RED, 0.15, 0.0, carries="red_cube"), at(BLUE, 0.12, 0.0, carries="red_cube"), at(BLUE, 0.03, 1.0),
    at(BLUE, 0.3, 1.0),
)  # fmt: skip
ROLES = {"theme": "red_cube", "goal": "blue_cube"}


def test_steps_are_relative_to_what_they_are_about_and_end_where_the_hand_lets_go():
    assert relative_steps(Trajectory(WAY), SCENE, ROLES) == [
        ["red_cube", 0, 0, 100, 1],
        ["red_cube", 0, 0, -30, 1],
        ["red_cube", 0, 0, -30, 0],
        ["red_cube", 0, 0, 150, 0],
        ["blue_cube", 0, 0, 120, 0],
        ["blue_cube", 0, 0, 30, 1],
    ]


def test_a_place_on_the_way_to_the_goal_is_reported_along_it():
    way = 0.5 * (BLUE.centre - RED.centre)[:2]
    (step,) = relative_steps(Trajectory((at(RED, 0.1, 0.0, aside=way),)), SCENE, ROLES)
    assert step == ["red_cube", "blue_cube", 102, 100, 0]
    ids = {o.id: o.id for o in SCENE.objects}
    (point,) = path_of([step], ids, SCENE, bare=False)
    assert abs(point.array[:2] - (RED.centre[:2] + way)).max() < 1e-3


def test_nothing_is_reported_without_a_theme():
    assert relative_steps(Trajectory(WAY), SCENE, {}) == []
    assert relative_steps(Trajectory(WAY), SCENE, {"theme": "gone"}) == []


def test_a_hand_that_opens_by_little_before_a_narrow_hold_is_open():
    narrow = [
        at(RED, 0.1, 0.4),
        at(RED, -0.03, 0.4),
        at(RED, -0.03, 0.0),
        at(RED, 0.15, 0.0, carries="red_cube"),
    ]
    steps = relative_steps(Trajectory(tuple(narrow)), SCENE, {"theme": "red_cube"})
    assert [step[-1] for step in steps] == [1, 1, 0, 0]


def test_a_hand_that_never_changes_pushes_and_counts_as_closed():
    pushing = [at(RED, 0.1, 0.7), at(RED, -0.03, 0.7), at(BLUE, -0.03, 0.7)]
    steps = relative_steps(Trajectory(tuple(pushing)), SCENE, ROLES)
    assert [step[-1] for step in steps] == [0, 0, 0]
