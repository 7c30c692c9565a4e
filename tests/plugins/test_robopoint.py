"""RoboPoint over real HTTP: the server in the model's place sees the picture that was sent, and nothing else."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import PlanningError
from gvla2.skills.table import STANDARD
from gvla2.testing import check_component, check_planner, inputs
from gvla2_plugins.robopoint import RoboPointConfig, gvla2_planners
from gvla2_plugins.robopoint.planner import MAX_POINTS, PointingTask, read_points, read_task, sight
from tests.local_model import LocalModel, said
from tests.plugins import scripted_planners
from tests.plugins.scripted_planners import ScriptedPlanner, passes

REQUEST = replace(scripted_planners.REQUEST, observation=inputs.observation(144))
planner = ScriptedPlanner(gvla2_planners, RoboPointConfig).at
FREE = (0.42, 0.62)
TASKS = {
    "pick up the red cube": ("pick", "red cube", "", ""),
    "pick up the blue cube": ("pick", "blue cube", "", ""),
    "put the red cube on the blue cube": ("place", "red cube", "blue cube", "on"),
    "put the red cube to the left of the blue cube": ("place", "red cube", "blue cube", "left_of"),
    "juggle": ("none", "", "", ""),
}


def task(skill, theme="", goal="", relation=""):
    return said(json.dumps({"skill": skill, "theme": theme, "goal": goal, "relation": relation}))


def points(*uv):
    return said("[" + ", ".join(f"({u:.3f}, {v:.3f})" for u, v in uv) + "]")


@pytest.fixture
def answering(eyes):
    """What RoboPoint would do: read the instruction, point at the object of the colour asked for, or at free table."""

    def answer(request, look=None):
        words = request["messages"][0]["content"]
        if isinstance(words, str):
            return task(*next((t for said, t in TASKS.items() if f"is: {said}\n" in words), TASKS["juggle"]))
        if look is not None:
            return look
        colour = next((c for c in ("red", "blue") if f"on the {c}" in eyes.words(request)), "")
        return points(*eyes.some(request, colour)) if colour else points(FREE, FREE, (0.43, 0.61))

    return answer


def planned(answer, instruction, **options):
    with LocalModel(answer) as model:
        return planner(model, **options).plan(replace(REQUEST, instruction=instruction)), model.requests


def test_it_is_a_planner_as_any_other(answering):
    (component,) = gvla2_planners()
    check_component(component)
    with LocalModel(answering) as model:
        check_planner(planner(model))


@pytest.mark.parametrize("colour", ["red", "blue"])
def test_what_is_pointed_at_is_picked_up(answering, colour):
    plan, _ = planned(answering, f"pick up the {colour} cube")
    assert (plan.skill, plan.roles["theme"]) == ("pick", f"{colour}_cube")
    passes(plan, REQUEST)
    assert plan.transcript[1]["answer"].startswith("[(")
    assert "base64" not in json.dumps(plan.transcript), "the record names the picture and does not hold it"


def test_one_object_is_put_on_another(answering):
    plan, _ = planned(answering, "put the red cube on the blue cube")
    assert plan.roles == {"theme": "red_cube", "goal": "blue_cube"}
    passes(plan, REQUEST)


def test_a_free_place_is_where_the_points_are(answering):
    plan, requests = planned(answering, "put the red cube to the left of the blue cube")
    assert "within the vacant space to the left of the blue cube. Your answer" in str(requests)
    (call,) = plan.calls
    assert call.goal == ""
    assert inputs.WORKSPACE.contains((*call.xy, inputs.TABLE + 0.01))
    passes(plan, REQUEST)


def test_models_with_other_coordinates_have_a_scale(answering, eyes):
    def thousand(request):
        if isinstance(request["messages"][0]["content"], str):
            return answering(request)
        (u, v) = eyes.middle(request, "red")
        return said(f"[({1000 * u:.0f}, {1000 * v:.0f})]")

    plan, requests = planned(thousand, "pick up the red cube", scale=1000.0, longest=128)
    assert eyes.picture(requests[1]).shape == (128, 128, 3)
    assert plan.roles["theme"] == "red_cube"
    assert "between 0 and 1000" in eyes.words(requests[1])


@pytest.mark.parametrize(
    ("look", "kind", "why"),
    [
        (points(FREE, FREE), "nothing_matches", "no object was perceived"),
        (said("I see no cube."), "other", "no list of points"),
        (said("[(1.5, 0.5)]"), "other", "outside the picture"),
    ],
)
def test_bad_answers_move_nothing(answering, look, kind, why):
    plan, _ = planned(lambda request: answering(request, look), "pick up the red cube", tries=2)
    assert (plan.trajectory, plan.abstention.kind) == (None, kind)
    assert why in plan.abstention.message
    assert plan.transcript, "the conversation is kept"


def test_points_on_two_objects_are_ambiguous(answering, eyes):
    def both(request):
        if isinstance(request["messages"][0]["content"], str):
            return answering(request)
        return points(eyes.middle(request, "red"), eyes.middle(request, "blue"))

    assert planned(both, "pick up the red cube")[0].abstention.kind == "ambiguous"


def test_the_answer_about_the_task_is_read_or_refused_with_its_reason():
    text = json.dumps({"skill": "open", "theme": "the drawer", "goal": "", "relation": ""})
    assert read_task(f"Here: ```json\n{text}\n```", STANDARD) == PointingTask("open", "drawer")
    for answer, why in (
        ("the drawer", "JSON"),
        ('{"skill": "juggle", "theme": "a"}', "no skill 'juggle'; there are pick, "),
        ('{"skill": "open", "theme": ""}', "name the object"),
        ('{"skill": "open", "theme": "' + "a" * 90 + '"}', "short texts"),
        ('{"skill": "open", "theme": "a", "relation": "over"}', "no relation 'over'"),
    ):
        with pytest.raises(ValueError, match=why):
            read_task(answer, STANDARD)


# Points of an answer


@pytest.mark.parametrize(
    "text",
    [
        "[(0.25, 0.5), (1, .5)]",
        "Sure! Here you go:\n[(0.25, 0.5), (1.0, 0.5)]\nAnything else?",
        "The cube at (0.9, 0.9) is first. [(0.25,0.5),(1.,0.5),]",
        "[(0.25, 0.5), (1, 0.5)] and once more [(0.25, 0.5), (1, 0.5)]",
    ],
)
def test_points_are_found_in_what_surrounds_them(text):
    assert read_points(text) == ((0.25, 0.5), (1.0, 0.5))
    assert read_points("[(250, 500)]", scale=1000) == ((0.25, 0.5),)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no list of points"),
        ("[(x1, y1), (x2, y2)]", "no list of points"),
        ("[(0.2, 0.3), (1.2, 0.3)]", r"outside the picture; coordinates are 0 to 1"),
        ("[(nan, 0.3)]", "no list of points"),
        ("[(0.2,)]", "no list of points"),
        ("[(0.2, 0.3)] or [(0.4, 0.3)]", "several lists"),
        (f"[{', '.join(['(0.5, 0.5)'] * (MAX_POINTS + 1))}]", f"more than {MAX_POINTS} points"),
        (f"[{', '.join(['(0.5, 0.5)'] * 10_000)}]", "characters; give the list alone"),
    ],
)
def test_everything_else_is_refused_with_its_reason(text, why):
    with pytest.raises(ValueError, match=why):
        read_points(text)


# What pixels show

VIEWS, SCENE = REQUEST.observation, REQUEST.scene
TOP = inputs.RED.world_from_block[:3] @ [0, 0, 0.5 * inputs.RED.side, 1]


def share_of(view, point):
    (u, v), _ = view.camera.project(np.asarray(point))
    return u / view.camera.width, v / view.camera.height


@pytest.mark.parametrize("camera", ["camera_0", "camera_2"])
def test_a_pixel_shows_an_object_or_the_table(camera):
    view = next(view for view in VIEWS.views if view.name == camera)
    seen = sight(view, *share_of(view, TOP), SCENE)
    assert seen.object == "red_cube"
    assert np.linalg.norm(seen.point - TOP) < 0.006
    place = np.array([0.32, 0.02, inputs.TABLE])
    bare = sight(view, *share_of(view, place), SCENE)
    assert bare.object == ""
    assert np.linalg.norm(bare.point - place) < 0.005


def test_what_is_missing_is_named():
    view = VIEWS.views[0]
    with pytest.raises(PlanningError, match="measures no depth"):
        sight(replace(view, depth=None), 0.1, 0.1, SCENE)
    with pytest.raises(PlanningError, match="No depth was measured within 12 pixels"):
        sight(replace(view, depth=np.full_like(view.depth, np.nan)), 0.1, 0.1, SCENE)
