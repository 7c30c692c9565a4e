"""RoboPoint over real HTTP: the server in the model's place sees the picture that was sent, and nothing else."""

import json
from dataclasses import replace

import pytest

from gvla2.testing import check_component, check_planner, inputs
from gvla2.testing.language import LocalModel, said
from gvla2_plugins.robopoint import RoboPointConfig, gvla2_planners
from tests.plugins import scripted_planners
from tests.plugins.scripted_planners import ScriptedPlanner, passes

REQUEST = replace(scripted_planners.REQUEST, observation=inputs.observation(144))
planner = ScriptedPlanner(gvla2_planners, RoboPointConfig).at
FREE = (0.42, 0.62)


def points(*uv):
    return said("[" + ", ".join(f"({u:.3f}, {v:.3f})" for u, v in uv) + "]")


@pytest.fixture
def pointing(eyes):
    """What RoboPoint would do: points on the object of the colour that is asked for, or on free table."""

    def answer(request):
        words = eyes.words(request)
        if "Which skill" in words:
            return said(
                json.dumps({"skill": "push", "theme": "blue cube", "goal": "red cube", "relation": ""})
            )
        colour = next((c for c in ("red", "blue") if f"on the {c}" in words), "")
        return points(*eyes.some(request, colour)) if colour else points(FREE, FREE, (0.43, 0.61))

    return answer


def test_it_is_a_planner_as_any_other(pointing):
    (component,) = gvla2_planners()
    check_component(component)
    with LocalModel(pointing) as model:
        check_planner(planner(model))


def test_what_is_pointed_at_is_picked_up(pointing):
    with LocalModel(pointing) as model:
        for colour in ("red", "blue"):
            plan = planner(model).plan(replace(REQUEST, instruction=f"pick up the {colour} cube"))
            assert (plan.skill, plan.roles["theme"]) == ("pick", f"{colour}_cube")
            passes(plan, REQUEST)
    assert len(model.requests) == 2, "a plain instruction takes one question"
    assert plan.transcript[0]["answer"].startswith("[(")
    assert "base64" not in json.dumps(plan.transcript), "the record names the picture and does not hold it"


def test_one_object_is_put_on_another(pointing):
    with LocalModel(pointing) as model:
        plan = planner(model).plan(replace(REQUEST, instruction="put the red cube on the blue cube"))
    assert plan.roles == {"theme": "red_cube", "goal": "blue_cube"}
    passes(plan, REQUEST)


def test_a_free_place_is_where_the_points_are(pointing):
    with LocalModel(pointing) as model:
        plan = planner(model).plan(
            replace(REQUEST, instruction="put the red cube to the left of the blue cube")
        )
    assert "within the vacant space to the left of the blue cube. Your answer" in str(model.requests)
    (call,) = plan.calls
    assert call.goal == ""
    assert inputs.WORKSPACE.contains((*call.xy, inputs.TABLE + 0.01))
    passes(plan, REQUEST)


def test_an_instruction_that_is_not_plain_is_read_by_the_model(pointing):
    with LocalModel(pointing) as model:
        plan = planner(model).plan(
            replace(REQUEST, instruction="shove the blue cube, will you, against the red one")
        )
    assert (
        (plan.calls[0].skill, plan.calls[0].theme) == ("push", "blue_cube") if plan.calls else plan.abstention
    )
    assert model.requests[0]["response_format"]["json_schema"]["schema"]["properties"]["skill"]["enum"]


def test_other_models_count_otherwise(eyes):
    def thousand(request):
        (u, v) = eyes.middle(request, "red")
        return said(f"[({1000 * u:.0f}, {1000 * v:.0f})]")

    with LocalModel(thousand) as model:
        plan = planner(model, scale=1000.0, grid=True, longest=128).plan(
            replace(REQUEST, instruction="pick up the red cube")
        )
        assert eyes.picture(model.requests[0]).shape == (128, 128, 3)
    assert plan.roles["theme"] == "red_cube"
    assert "between 0 and 1000" in eyes.words(model.requests[0])


@pytest.mark.parametrize(
    ("answer", "kind", "said_"),
    [
        (points(FREE, FREE), "nothing_matches", "no object was perceived"),
        (said("I see no cube."), "other", "no list of points"),
        (said("[(1.5, 0.5)]"), "other", "outside the picture"),
    ],
)
def test_bad_answers_move_nothing(answer, kind, said_):
    with LocalModel(lambda _: answer) as model:
        plan = planner(model, tries=2).plan(replace(REQUEST, instruction="pick up the red cube"))
    assert plan.trajectory is None
    assert plan.abstention.kind == kind
    assert said_ in plan.abstention.message
    assert plan.transcript, "what was said is kept"


def test_points_on_two_objects_are_ambiguous(eyes):
    def both(request):
        return points(eyes.middle(request, "red"), eyes.middle(request, "blue"))

    with LocalModel(both) as model:
        plan = planner(model).plan(replace(REQUEST, instruction="pick up the cube"))
    assert plan.abstention.kind == "ambiguous"


def test_a_skill_that_is_not_there_is_asked_for_again_and_then_declined():
    answer = said('{"skill": "juggle", "theme": "cubes", "goal": "", "relation": ""}')
    with LocalModel(lambda _: answer) as model:
        plan = planner(model, tries=3).plan(replace(REQUEST, instruction="juggle with all cubes"))
        assert len(model.requests) == 3
    assert plan.abstention.kind == "other"
    with LocalModel(lambda _: said('{"skill": "none", "theme": "", "goal": "", "relation": ""}')) as model:
        plan = planner(model).plan(replace(REQUEST, instruction="juggle with all cubes"))
    assert plan.abstention.kind == "unknown_skill"
