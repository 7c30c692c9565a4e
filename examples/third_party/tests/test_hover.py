from gvla2.testing import check_component, check_skill
from gvla2_hover import gvla2_planners
from gvla2_hover.skill import gvla2_skills


def test_it_is_a_planner():
    (component,) = gvla2_planners()
    check_component(component, "planner")


def test_it_has_a_skill():
    (skill,) = gvla2_skills()
    check_skill(skill)
