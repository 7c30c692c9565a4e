from gvla2.plugins.registry import load_plugins
from gvla2.testing import check_component


def test_it_is_a_task():
    check_component(load_plugins().get("task", "ball_in_bowl"), "task")
