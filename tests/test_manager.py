"""pluggy's rules: order, wrappers, plugins of this process, kinds that a plugin declares."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Protocol

import pluggy
import pytest
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

import gvla2
from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.commands.primary import PRIMARY
from gvla2.component import registered
from gvla2.errors import ConfigurationError, PluginError
from gvla2.hookspecs import KINDS_HOOK, SKILL_HOOK
from gvla2.plugins.hydra_config import register as offer
from gvla2.plugins.kinds import Kind
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.testing import ConformanceError, check_component


@dataclass
class Options(ComponentConfig):
    """Options of mine."""

    force: float = 5.0


class Mine:
    """Plans nothing, holds nothing."""

    def __init__(self, config: ComponentConfig, **needs: object) -> None:
        self.config, self.needs = config, needs

    def plan(self, request: object) -> None:
        return None

    def hold(self) -> float:
        return 1.0


class Gripper(Protocol):
    """What a third party's kind asks for."""

    def hold(self) -> float: ...


def planner(name: str, summary: str = "mine", **options: Any) -> Component[Any]:
    return Component(name, Options, Mine, summary=summary, **options)


def plugin(hook: Callable[[], object], name: str = "gvla2_planners", **marked: Any) -> SimpleNamespace:
    return SimpleNamespace(**{name: hookimpl(hook, **marked)})


@pytest.fixture(autouse=True)
def _nothing_stays_registered() -> Iterator[None]:
    yield
    for name in registered():
        gvla2.unregister(name)


def test_a_plugin_of_this_process_is_offered_and_taken_back():
    name = gvla2.register(plugin(lambda: [planner("mine")]), "notebook")
    registry = load_plugins()
    found = registry.offers("planner")["mine"]
    assert (name, found.plugin.name, found.plugin.origin) == ("notebook", "notebook", "")
    assert registry.problems == ()
    gvla2.unregister("notebook")
    assert "mine" not in load_plugins().components("planner")
    with pytest.raises(PluginError, match=r"No plugin 'notebook' is registered. Registered: none"):
        gvla2.unregister("notebook")


def test_a_cell_of_a_notebook_may_run_twice():
    for summary in ("first", "second"):

        class Plugin:
            @staticmethod
            @hookimpl
            def gvla2_planners(summary: str = summary) -> list[Component[Any]]:
                return [planner("mine", summary)]

        assert gvla2.register(Plugin) == "Plugin"
    registry = load_plugins()
    assert registry.get("planner", "mine").summary == "second"
    assert registry.problems == ()


@pytest.mark.parametrize("nothing", [None, "module.name"])
def test_what_is_no_plugin_is_refused(nothing: object):
    with pytest.raises(PluginError, match="takes a module or an object"):
        gvla2.register(nothing)


def test_the_latest_is_called_first_and_wins():
    gvla2.register(plugin(lambda: [planner("same", "a")]), "a")
    gvla2.register(plugin(lambda: [planner("same", "b"), planner("skill", "b")]), "b")
    registry = load_plugins()
    assert registry.get("planner", "same").summary == "b"
    assert registry.get("planner", "skill").summary == "b", "what this process registers comes before all"
    shown = {(p.plugin, p.message.partition(",")[0]) for p in registry.problems}
    assert shown == {
        ("a", "'same' is already offered by plugin 'b'"),
        ("skill", "'skill' is already offered by plugin 'b'"),
    }


@pytest.mark.parametrize(("marked", "wins"), [({"tryfirst": True}, "a"), ({}, "b")])
def test_tryfirst(marked: dict[str, bool], wins: str):
    gvla2.register(plugin(lambda: [planner("same", "a")], **marked), "a")
    gvla2.register(plugin(lambda: [planner("same", "b")]), "b")
    assert load_plugins().get("planner", "same").summary == wins


def test_trylast_gives_way():
    gvla2.register(plugin(lambda: [planner("skill", "late")], trylast=True), "late")
    registry = load_plugins()
    assert registry.offers("planner")["skill"].plugin.name == "skill"
    assert [p.plugin for p in registry.problems] == ["late"]


def test_tryfirst_of_an_installed_plugin_comes_before_gvla2s_own(install):
    install(
        "@hookimpl(tryfirst=True)\ndef gvla2_planners():\n"
        "    return [Component('skill', Config, Made, summary='theirs')]"
    )
    assert load_plugins().get("planner", "skill").summary == "theirs"


def _replace_mine() -> Any:
    groups = yield
    return [[planner("mine", "wrapped") if c.name == "mine" else c for c in g] for g in groups]


def _drop_all_but_mine() -> Any:
    groups = yield
    return [[c for c in g if c.name == "mine"] for g in groups]


def _old_style() -> Any:
    outcome = yield
    outcome.force_result([[planner("forced")]])


def test_a_wrapper_sees_and_changes_what_the_others_return():
    gvla2.register(plugin(lambda: [planner("mine")]), "inner")
    gvla2.register(plugin(_replace_mine, wrapper=True), "outer")
    registry = load_plugins()
    assert registry.offers("planner")["mine"].component.summary == "wrapped"
    assert registry.offers("planner")["mine"].plugin.name == "outer"
    assert registry.offers("planner")["skill"].plugin.name == "skill"
    gvla2.register(plugin(_drop_all_but_mine, wrapper=True), "outer")
    assert list(load_plugins().components("planner")) == ["mine"]


def test_a_hookwrapper_of_the_old_style_and_specname():
    gvla2.register(plugin(_old_style, "anything", hookwrapper=True, specname="gvla2_planners"), "old")
    registry = load_plugins()
    assert list(registry.components("planner")) == ["forced"]
    assert registry.problems == ()


def test_plugins_without_a_usable_hook_are_reported_and_stop_nobody():
    for name in ("one", "two"):
        gvla2.register(plugin(lambda: [], "gvla2_planer"), name)
        gvla2.register(plugin(lambda extra: []), f"{name}, with an argument")
    shown = {problem.plugin: problem.message for problem in load_plugins().problems}
    assert shown["one"] == shown["two"] == "is no hook of gvla2. Did you mean 'gvla2_planners'?"
    assert shown["one, with an argument"] == shown["two, with an argument"] == "must take no arguments."


@pytest.mark.parametrize("answer", [None, planner("mine")])
def test_a_hook_that_returns_no_list_is_reported(answer: object):
    gvla2.register(plugin(lambda: answer), "odd")
    (problem,) = load_plugins().problems
    assert problem.message.startswith("returned ")
    assert problem.message.endswith(", not a list.")


def test_an_optional_hook_of_another_version_is_no_problem():
    other = SimpleNamespace(
        gvla2_tomorrow=hookimpl(lambda: [], optionalhook=True),
        gvla2_planners=hookimpl(lambda: [planner("mine")]),
    )
    gvla2.register(other, "newer")
    registry = load_plugins()
    assert registry.problems == ()
    assert "mine" in registry.components("planner")


def _raises_before() -> Any:
    raise ValueError("early")
    yield


def _raises_after() -> Any:
    yield
    raise ValueError("late")


def _never_yields() -> Any:
    if False:
        yield


def _yields_twice() -> Any:
    yield
    yield


def _returns_nonsense() -> Any:
    yield
    return 3


@pytest.mark.parametrize(
    ("wrapper", "message"),
    [
        (_raises_before, "ValueError: early"),
        (_raises_after, "ValueError: late"),
        (_never_yields, "did not yield"),
        (_yields_twice, "has second yield"),
        (_returns_nonsense, "not iterable"),
        (lambda: [], "wrapper without a yield"),
    ],
)
def test_a_broken_wrapper_stops_nobody(wrapper: Any, message: str):
    gvla2.register(plugin(lambda: [planner("mine")]), "inner")
    gvla2.register(plugin(wrapper, wrapper=True), "outer")
    registry = load_plugins()
    (problem,) = registry.problems
    assert (problem.plugin, problem.hook) == ("outer", "gvla2_planners")
    assert message in problem.message
    assert {"mine", "skill"} <= registry.components("planner").keys()


def test_it_is_pluggys_manager():
    from gvla2.plugins.discovery import discover
    from gvla2.plugins.manager import collect

    gvla2.register(plugin(lambda: [planner("mine")]), "inner")
    manager = collect(discover([]), []).manager
    assert type(manager) is pluggy.PluginManager
    assert manager.has_plugin("skill")
    assert [made.plugin_name for made in manager.hook.gvla2_planners.get_hookimpls()][-1] == "inner"
    assert [c.name for c in manager.hook.gvla2_planners()[0]] == ["mine"]


GRIPPER = Kind("gripper", "gvla2_grippers", f"{__name__}:Gripper", "grippers", default="soft")


def gripper_plugin(kind: Kind = GRIPPER, name: str = "soft") -> SimpleNamespace:
    return SimpleNamespace(
        gvla2_kinds=hookimpl(lambda: [kind]),
        gvla2_grippers=hookimpl(lambda: [Component(name, Options, Mine, summary="soft")]),
        gvla2_planners=hookimpl(lambda: [planner("grips", needs=("gripper",))]),
    )


def composed(registry: Registry, *overrides: str) -> Any:
    offer(registry, PRIMARY)
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return OmegaConf.to_object(compose("run", overrides=list(overrides)))


def test_a_kind_of_ones_own_is_a_group_with_a_default_that_others_need():
    gvla2.register(gripper_plugin(), "grippers")
    registry = load_plugins()
    assert registry.problems == ()
    assert list(registry.kinds)[-1] == "gripper"
    config = composed(registry, "planner=grips", "gripper.force=7")
    assert config.gripper == Options(name="soft", force=7.0)
    built = registry.build(config, "planner")
    assert built.needs["gripper"].config.force == 7.0
    check_component(registry.get("gripper", "soft"), registry.kinds["gripper"])


def test_what_breaks_the_protocol_of_a_kind_of_ones_own_is_reported():
    class Slack:
        """Holds nothing."""

        def __init__(self, config: ComponentConfig) -> None: ...

    broken = gripper_plugin()
    broken.gvla2_grippers = hookimpl(lambda: [Component("soft", Options, Slack, summary="slack")])
    gvla2.register(broken, "grippers")
    registry = load_plugins()
    with pytest.raises(PluginError, match=r"The gripper 'soft' of plugin 'grippers' built a Slack.*hold\(\)"):
        registry.build(composed(registry), "gripper")
    with pytest.raises(ConformanceError, match=r"Slack is not a gripper: it lacks hold\(\)"):
        check_component(registry.get("gripper", "soft"), registry.kinds["gripper"])


def test_a_kind_without_its_default_leaves_other_runs_alone():
    gvla2.register(gripper_plugin(name="hard"), "grippers")
    registry = load_plugins()
    config = composed(registry, "planner=skill")
    assert registry.build(config, "planner")
    with pytest.raises(ConfigurationError, match=r"chooses no gripper. Choose one with gripper=NAME"):
        registry.build(config, "gripper")
    assert composed(registry, "gripper=hard").gripper.name == "hard"
    with pytest.raises(HydraException, match="gripper/hrd"):
        composed(registry, "gripper=hrd")


def test_a_kind_whose_default_is_none_may_hold_nothing():
    gvla2.register(
        gripper_plugin(Kind("gripper", "gvla2_grippers", "a:B", "grippers"), name="hard"), "grippers"
    )
    registry = load_plugins()
    config = composed(registry, "planner=grips")
    assert config.gripper.name == "none"
    assert registry.build(config, "planner").needs == {"gripper": None}
    assert registry.build({"planner": "grips"}, "planner").needs == {"gripper": None}, (
        "a command without the group"
    )


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("gripper", "not a Kind"),
        (Kind("planner", "gvla2_x", "a:B", "x"), "there is a kind 'planner' already"),
        (Kind("fallback", "gvla2_x", "a:B", "x"), "there is a kind 'fallback' already"),
        (Kind("seed", "gvla2_x", "a:B", "x"), "cannot be a Hydra group"),
        (Kind("my kind", "gvla2_x", "a:B", "x"), "cannot be a Hydra group"),
        (Kind("gripper", "gvla2_planners", "a:B", "x"), "one of its own"),
        (Kind("gripper", SKILL_HOOK, "a:B", "x"), "one of its own"),
        (Kind("gripper", "grippers", "a:B", "x"), "begins with 'gvla2_'"),
        (Kind("gripper", "gvla2_x", "a.B", "x"), "'module:Class'"),
    ],
)
def test_a_kind_that_cannot_be_is_reported(kind: object, message: str):
    gvla2.register(plugin(lambda: [kind], KINDS_HOOK), "odd")
    registry = load_plugins()
    (problem,) = registry.problems
    assert (problem.plugin, problem.hook) == ("odd", KINDS_HOOK)
    assert message in problem.message
    assert composed(registry)
