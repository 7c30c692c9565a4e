"""Lifting: bare points of a path become motion that the checks pass, or a reason why not."""

import pytest

from gvla2.errors import PlanningError
from gvla2.planning.checks import check_trajectory
from gvla2.skills.path_lifting import PathPoint, lift
from gvla2.testing import inputs

REQUEST = inputs.plan_request()
RED, BLUE = REQUEST.scene.objects


def over(obj, up, gripper, at="", aside=(0.0, 0.0)):
    x, y = obj.centre[:2] + aside
    return PathPoint((float(x), float(y), float(obj.top + up)), gripper, at)


TAKE = [over(RED, 0.1, 1.0), over(RED, -0.025, 1.0), over(RED, -0.025, 0.0), over(RED, 0.15, 0.0)]


def passes(plan):
    assert plan.trajectory is not None, plan.abstention
    report = check_trajectory(plan.trajectory, REQUEST.scene, REQUEST.arm, REQUEST.start, REQUEST.joints)
    assert report.passed, report.reasons


def test_a_path_that_closes_and_rises_takes_an_object_up():
    plan = lift(TAKE, REQUEST)
    assert (plan.skill, plan.roles) == ("pick", {"theme": "red_cube"})
    assert plan.parameters["grasp_depth"] == pytest.approx(0.025, abs=1e-3)
    passes(plan)


def test_what_is_let_go_of_over_an_object_lies_on_it():
    plan = lift([*TAKE, over(BLUE, 0.15, 0.0), over(BLUE, 0.03, 1.0)], REQUEST)
    assert (plan.skill, plan.roles) == ("place", {"theme": "red_cube", "goal": "blue_cube"})
    passes(plan)


def test_a_place_beside_an_object_is_not_on_it():
    plan = lift([*TAKE, over(BLUE, 0.03, 1.0, at="blue_cube", aside=(0.0, 0.15))], REQUEST)
    assert plan.roles == {"theme": "red_cube"}
    passes(plan)
    opened = next(w for w in plan.trajectory if w.carries and w.gripper > 0.5)
    assert opened.xyz[2] < BLUE.top  # put down on the table, not dropped from the cube's height


def test_a_second_object_is_refused_rather_than_left_out():
    twice = [*TAKE, over(RED, -0.02, 1.0, aside=(0.0, -0.15)), over(BLUE, -0.02, 0.0), over(BLUE, 0.15, 0.0)]
    with pytest.raises(PlanningError, match="closes again"):
        lift(twice, REQUEST)


@pytest.mark.parametrize(
    ("points", "why"),
    [
        ([], "needs 1 to 16"),
        ([over(RED, 0.3, 1.0), over(RED, 0.3, 0.0)], "nothing to hold"),
        ([over(RED, 0.3, 1.0)], "touches nothing"),
    ],
)
def test_paths_without_a_meaning_are_refused(points, why):
    with pytest.raises(PlanningError, match=why):
        lift(points, REQUEST)


def test_what_is_out_of_reach_is_a_typed_refusal():
    plan = lift([*TAKE[:3], over(RED, 5.0, 0.0, aside=(5.0, 5.0))], REQUEST)
    assert plan.trajectory is None
    assert plan.abstention.kind == "unreachable"
