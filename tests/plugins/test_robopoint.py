"""RoboPoint over real HTTP: the server in the model's place sees the picture that was sent, and nothing else."""

import json
from dataclasses import replace

import pytest

from gvla2.skills.table import STANDARD
from gvla2.testing import check_component, check_planner, inputs
from gvla2.testing.language import LocalModel, said
from gvla2_plugins.robopoint import RoboPointConfig, gvla2_planners
from gvla2_plugins.robopoint.planner import PointingTask, read_task
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


def test_a_skill_that_does_not_exist_is_asked_for_again_and_then_declined(answering):
    plan, requests = planned(lambda _: task("juggle", "cubes"), "juggle", tries=3)
    assert (plan.abstention.kind, len(requests)) == ("other", 3)
    assert planned(answering, "juggle")[0].abstention.kind == "unknown_skill"


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
