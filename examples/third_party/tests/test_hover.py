from gvla2.testing import check_component
from gvla2_hover import gvla2_planners


def test_it_is_a_planner():
    (component,) = gvla2_planners()
    check_component(component, "planner")
