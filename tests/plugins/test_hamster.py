"""HAMSTER over real HTTP: the server in the model's place draws its path into the picture that was sent."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gvla2.planning.pictures import Stroke
from gvla2.testing import check_component, check_planner, inputs
from gvla2.testing.language import LocalModel, said
from gvla2_plugins.hamster import HamsterConfig, gvla2_planners
from gvla2_plugins.hamster.drawn import MOST, thinned
from tests.plugins import scripted_planners
from tests.plugins.scripted_planners import ScriptedPlanner, passes

REQUEST = replace(scripted_planners.REQUEST, observation=inputs.observation(144))
planner = ScriptedPlanner(gvla2_planners, HamsterConfig).at
CLOSE, OPEN = "<action>Close Gripper</action>", "<action>Open Gripper</action>"


def answer(*steps):
    shown = [s if isinstance(s, str) else f"({s[0]:.3f}, {s[1]:.3f})" for s in steps]
    return said(f"<ans>[{', '.join(shown)}]</ans>")


def up(point, by=0.15):
    return point[0], max(0.0, point[1] - by)


def between(a, b, share):
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


@pytest.fixture
def drawing(eyes):
    """Lifts the red object, or takes it in an arc to the blue one, or to a free place for "aside"."""

    def answered(request):
        words, red = eyes.words(request), eyes.middle(request, "red")
        if " on the blue " in words:
            blue = eyes.middle(request, "blue")
            arc = [
                up(between(red, blue, s), 0.2 * np.sin(np.pi * s) + 0.05) for s in np.linspace(0, 1, 12)[1:-1]
            ]
            return answer(up(red), red, CLOSE, *arc, blue, OPEN, up(blue))
        if "aside" in words:
            return answer(red, CLOSE, (0.45, 0.6), OPEN)
        return answer(up(red, 0.2), up(red, 0.1), red, CLOSE, up(red, 0.1), up(red, 0.25))

    return answered


def test_it_is_a_planner_as_any_other(drawing):
    (component,) = gvla2_planners()
    check_component(component)
    with LocalModel(drawing) as model:
        check_planner(planner(model))


@pytest.mark.parametrize("camera", ["camera_0", "camera_2"])
def test_a_drawn_lift_takes_the_object_up(drawing, camera):
    with LocalModel(drawing) as model:
        plan = planner(model, camera=camera).plan(REQUEST)
    assert (plan.skill, plan.roles["theme"]) == ("pick", "red_cube")
    passes(plan, REQUEST)
    assert plan.trajectory.waypoints[-1].carries == "red_cube"
    assert plan.trajectory.waypoints[-1].xyz[2] > inputs.TABLE + 0.14
    assert "base64" not in json.dumps(plan.transcript)


@pytest.mark.parametrize("camera", ["camera_0", "camera_1", "camera_2"])
def test_a_drawn_arc_puts_one_object_on_another(drawing, camera):
    asked = replace(REQUEST, instruction="put the red cube on the blue cube")
    with LocalModel(drawing) as model:
        plan = planner(model, camera=camera).plan(asked)
    assert plan.roles == {"theme": "red_cube", "goal": "blue_cube"}
    passes(plan, REQUEST)
    opened = next(w for w in plan.trajectory if w.carries and w.gripper > 0.5)
    assert np.linalg.norm(np.subtract(opened.xyz, REQUEST.scene["blue_cube"].centre)[:2]) < 0.02
    carried = [w.xyz[2] for w in plan.trajectory if w.carries]
    assert max(carried) > inputs.TABLE + 0.14


def test_a_straight_line_to_free_table_puts_it_there(drawing):
    with LocalModel(drawing) as model:
        plan = planner(model).plan(replace(REQUEST, instruction="put the red cube aside"))
    passes(plan, REQUEST)
    assert plan.skill == "place"
    opened = next(w for w in plan.trajectory if w.carries and w.gripper > 0.5)
    (u, v), _ = REQUEST.observation.views[0].camera.project(np.array([*opened.xyz[:2], inputs.TABLE]))
    assert (u / 144, v / 144) == pytest.approx((0.45, 0.6), abs=0.02)


def test_a_closed_hand_pushes(eyes):
    def pushing(request):
        red = eyes.middle(request, "red")
        camera = REQUEST.observation.views[0].camera
        centre = REQUEST.scene["red_cube"].centre
        ends = [camera.project(centre + np.array([0.0, dy, -0.02]))[0] / 144 for dy in (-0.09, 0.1)]
        return answer(CLOSE, tuple(ends[0]), red, tuple(ends[1]))

    with LocalModel(pushing) as model:
        plan = planner(model).plan(replace(REQUEST, instruction="push the red cube to the left"))
    assert (plan.skill, plan.roles["theme"]) == ("push", "red_cube"), plan.abstention
    passes(plan, REQUEST)


@pytest.mark.parametrize(
    ("text", "said_"),
    [
        ("<ans>[(0.5, 0.5)]</ans>", "closes nowhere"),
        ("<ans>[(0.5, 0.5), <action>Close Gripper</action>]</ans>", "two points at least"),
        (f"<ans>[{'(0.2, 0.2), ' * 300}]</ans>", "more than 200 points"),
        ("<ans>[" + "(0.2, 0.2), <action>Close Gripper</action>, (0.3, 0.2), <action>Open Gripper</action>, " * 9
         + "]</ans>", "closes more than once"),
        ("<ans>[(0.45, 0.6), <action>Close Gripper</action>, (0.45, 0.5)]</ans>", "touches nothing"),
    ],
)  # fmt: skip
def test_bad_answers_move_nothing(text, said_):
    with LocalModel(lambda _: said(text)) as model:
        plan = planner(model, tries=2).plan(REQUEST)
        assert len(model.requests) == 2
    assert plan.trajectory is None
    assert plan.abstention.kind in ("other", "unreachable")
    assert said_ in plan.abstention.message
    assert len(plan.transcript) == 2


def test_places_beyond_reach_are_named():
    """The upper left corner of the picture shows the table far behind the workspace."""
    with LocalModel(lambda _: answer((0.4, 0.5), (0.01, 0.01), CLOSE, (0.5, 0.5))) as model:
        plan = planner(model, tries=1).plan(REQUEST)
    assert "beyond the robot's reach" in plan.abstention.message


def test_long_paths_keep_their_events_and_bends():
    arc = [Stroke(0.2 + 0.006 * k, 0.5 - 0.3 * float(np.sin(np.pi * k / 99)), 0.0) for k in range(100)]
    path = [
        Stroke(0.1, 0.4),
        replace(arc[0], event=True),
        *arc[1:-1],
        replace(arc[-1], gripper=1.0, event=True),
    ]
    kept = thinned(path)
    assert len(kept) <= MOST
    assert [s for s in kept if s.event] == [s for s in path if s.event]
    assert min(s.v for s in kept) < 0.22, "the top of the arc stays"
