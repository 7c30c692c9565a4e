"""Plugins: how they are found, checked and ordered, and kinds that a plugin declares."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from types import SimpleNamespace
from typing import Any, Protocol

import pytest
from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import OmegaConf

import gvla2
from gvla2 import Component, ComponentConfig, hookimpl, hookspecs
from gvla2.commands.hydra_job import schemas
from gvla2.commands.run import RunConfig
from gvla2.component import registered
from gvla2.errors import ConfigurationError, PluginError, UnknownComponentError
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.plugins.discovery import Plugin
from gvla2.plugins.hydra_config import register as offer
from gvla2.plugins.kinds import KINDS, TAKEN, Kind, kind_of
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.testing import ConformanceError, check_component

Install = Callable[..., str]

HOOK = "@hookimpl\ndef {}({}):\n    {}\n"


def yields(what: str) -> str:
    """A plugin whose planner hook yields this."""
    return HOOK.format("gvla2_planners", "", f"yield {what}")


def test_every_hook_is_documented_and_names_its_protocol():
    hooks = {name: hook for name, hook in vars(hookspecs).items() if name.startswith("gvla2_")}
    assert hooks.keys() == {kind.hook for kind in KINDS.values()} | {KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK}
    for name, function in hooks.items():
        assert (function.__doc__ or "").startswith("Return"), name
    for kind in KINDS.values():
        assert f"``{kind.name}``" in hooks[kind.hook].__doc__
        assert kind.protocol().__name__ in hooks[kind.hook].__annotations__["return"]
        assert kind.members(), kind


def test_no_kind_has_a_word_of_run():
    assert {field.name for field in fields(RunConfig)} | {"hydra"} == TAKEN


def test_reference_plugins_are_whole(registry: Registry):
    assert registry.problems == ()
    for kind in KINDS:
        for component in registry.components(kind).values():
            assert component.summary, component
            assert (component.config.__doc__ or "").strip(), component


def test_a_third_party_is_found_beside_the_others(install: Install):
    install(yields("Component('mine', Config, Made)"))
    registry = load_plugins()
    found = registry.offers("planner")["mine"]
    assert found.component.summary == "Plans nothing at all."
    assert found.plugin == Plugin("fake", "fake-dist", "1.2")
    assert registry.problems == ()
    assert "skill" in registry.components("planner")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def broken(:", "SyntaxError: invalid syntax"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("raise RuntimeError('no\\nluck')", "RuntimeError: no luck"),
        ("def gvla2_planners(): return []", "no function marked @hookimpl"),
        ("from gvla2 import hookimpl\n" + HOOK.format("gvla2_planners", "config", "return []"), "{'config'}"),
    ],
)
def test_a_plugin_that_does_not_load_is_named_and_stops_nobody(install: Install, source: str, message: str):
    install(source, head="")
    registry = load_plugins()
    (problem,) = registry.problems
    assert (problem.plugin, problem.hook) == ("fake", "")
    assert message in problem.message
    assert "skill" in registry.components("planner")


ODD = "@dataclass\nclass Odd(ComponentConfig):\n    object: Made = None\n"
PLAIN = "class Plain(ComponentConfig):\n    depth: int = 3\n"


@pytest.mark.parametrize(
    ("source", "hook", "message"),
    [
        (HOOK.format("gvla2_planner", "", "return []"), "gvla2_planner", "Did you mean 'gvla2_planners'?"),
        ("@hookimpl(wrapper=True)\ndef gvla2_planners(): yield", "", "None, which is not a Component"),
        (HOOK.format("gvla2_planners", "", "raise ValueError('oh')"), "", "failed: ValueError: oh"),
        (HOOK.format("gvla2_planners", "", "raise SystemExit"), "", "failed: SystemExit"),
        (HOOK.format("gvla2_planners", "", "return None"), "", "returned None, not a list"),
        (yields("3"), "", "3, which is not a Component"),
        (yields("Component('a', dict, Made)"), "", "not a dataclass that extends ComponentConfig"),
        (PLAIN + yields("Component('a', Plain, Made)"), "", "Plain is not marked @dataclass"),
        (ODD + yields("Component('a', Odd, Made)"), "", "Odd does not fit OmegaConf"),
        (yields("Component('null', Config, Made)"), "", "'null'"),
        (yields("Component('a.b', Config, Made)"), "", "'a.b'"),
        (yields("Component('a', Config, 3)"), "", "cannot be called"),
        (yields("Component('a', Config, Made, needs=['brain'])"), "", "needs 'brain', which is not a kind"),
        (HOOK.format(SEARCH_PATH_HOOK, "", "return ['conf']"), SEARCH_PATH_HOOK, "a search path is"),
    ],
)
def test_what_a_hook_does_wrong_is_named_and_the_rest_of_the_plugin_stays(
    install: Install, source: str, hook: str, message: str
):
    install(source + "\n" + HOOK.format("gvla2_verifiers", "", "yield Component('fine', Config, Made)"))
    registry = load_plugins()
    (problem,) = registry.problems
    assert (problem.plugin, problem.hook) == ("fake", hook or "gvla2_planners")
    assert message in problem.message
    assert "fine" in registry.components("verifier")


def test_the_first_of_two_equal_names_wins_and_the_other_is_reported(install: Install):
    both = yields("Component('{}', Config, Made, summary='of {}')")
    install(both.format("same", "b"), name="bravo", distribution="z-dist")
    install(both.format("same", "a"), name="alpha", distribution="z-dist")
    install(both.format("same", "z"), name="zulu", distribution="a-dist")
    install(both.format("skill", "me"), name="usurper", distribution="a-dist")
    registry = load_plugins()
    assert registry.get("planner", "same").summary == "of z", "the distribution's name comes first"
    assert registry.offers("planner")["skill"].plugin.distribution == "gvla2", "gvla2's own come first"
    shown = {p.plugin: p.message for p in registry.problems}
    assert set(shown) == {"usurper", "alpha", "bravo"}
    assert "'same' is already offered by plugin 'zulu', which wins" in shown["alpha"]


def test_a_plugin_that_is_announced_twice_is_offered_once():
    twice = plugin(lambda: [planner("mine")])
    gvla2.register(twice, "a")
    gvla2.register(twice, "b")
    registry = load_plugins()
    (problem,) = registry.problems
    assert "could not be registered" in problem.message
    assert "mine" in registry.components("planner")


def test_plugins_can_be_disabled_and_a_misspelling_is_reported(
    install: Install, monkeypatch: pytest.MonkeyPatch
):
    install("1 / 0")
    monkeypatch.setenv("GVLA2_DISABLE_PLUGINS", "fake, skil")
    (problem,) = load_plugins().problems
    assert problem.plugin == "skil"
    assert "Did you mean 'skill'?" in problem.message
    monkeypatch.setenv("GVLA2_DISABLE_PLUGINS", "*")
    registry = load_plugins()
    assert not registry.plugins
    assert not registry.problems
    with pytest.raises(UnknownComponentError, match=r"none at all. GVLA2_DISABLE_PLUGINS skips: \*"):
        registry.get("planner", "skill")


def test_what_plugins_print_does_not_reach_stdout(install: Install, capsys: pytest.CaptureFixture[str]):
    install("print('hello')\n" + HOOK.format("gvla2_planners", "", "print('again'); return []"))
    load_plugins()
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "hello\nagain" in captured.err


def test_an_unknown_name_names_neighbours_and_broken_plugins(install: Install):
    install("1 / 0")
    with pytest.raises(UnknownComponentError) as caught:
        load_plugins().get("planner", "skil")
    text = str(caught.value)
    assert text.startswith("No planner named 'skil'. Did you mean 'skill'? Available: ")
    assert "Broken plugins that might have offered it: fake, could not be loaded: ZeroDivisionError" in text
    install(HOOK.format("gvla2_planner", "", "return []"))
    with pytest.raises(
        UnknownComponentError, match=r"fake, gvla2_planner is no hook of gvla2\. Did you mean"
    ):
        load_plugins().get("planner", "mine")
    with pytest.raises(ConfigurationError, match=r"No kind .* 'planer'. Did you mean 'planner'\?"):
        kind_of("planer")


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


def planner(name: str, summary: str = "mine", **options: Any) -> Component[Any]:
    return Component(name, Options, Mine, summary=summary, **options)


def plugin(hook: Callable[[], object], name: str = "gvla2_planners", **marked: Any) -> SimpleNamespace:
    return SimpleNamespace(**{name: hookimpl(hook, **marked)})


@pytest.fixture(autouse=True)
def _nothing_stays_registered() -> Iterator[None]:
    yield
    for name in registered():
        gvla2.unregister(name)


def test_a_plugin_of_this_process_is_offered_replaced_and_taken_back():
    for summary in ("first", "second"):  # a cell of a notebook may run twice
        name = gvla2.register(plugin(lambda summary=summary: [planner("mine", summary)]), "notebook")
    registry = load_plugins()
    found = registry.offers("planner")["mine"]
    assert (name, found.plugin, found.component.summary) == ("notebook", Plugin("notebook"), "second")
    assert registry.problems == ()
    gvla2.unregister("notebook")
    assert "mine" not in load_plugins().components("planner")
    with pytest.raises(PluginError, match=r"No plugin 'notebook' is registered. Registered: none"):
        gvla2.unregister("notebook")
    with pytest.raises(PluginError, match="takes a module or an object"):
        gvla2.register("module.name")


@pytest.mark.parametrize(
    ("first", "second", "wins"),
    [({}, {}, "b"), ({"tryfirst": True}, {}, "a"), ({}, {"trylast": True}, "a")],
)
def test_the_order_is_pluggys_and_this_process_comes_first(first: dict, second: dict, wins: str):
    gvla2.register(plugin(lambda: [planner("skill", "a")], **first), "a")
    gvla2.register(plugin(lambda: [planner("skill", "b")], **second), "b")
    registry = load_plugins()
    assert registry.get("planner", "skill").summary == wins
    assert {problem.plugin for problem in registry.problems} == {"a", "b", "skill"} - {wins}


def test_an_optional_hook_of_another_version_is_no_problem():
    newer = SimpleNamespace(
        gvla2_tomorrow=hookimpl(lambda: [], optionalhook=True),
        gvla2_planners=hookimpl(lambda: [planner("mine")]),
    )
    gvla2.register(newer, "newer")
    registry = load_plugins()
    assert registry.problems == ()
    assert "mine" in registry.components("planner")


class Gripper(Protocol):
    """What a third party's kind asks for."""

    def hold(self) -> float: ...


def kind(name: str = "gripper", hook: str = "gvla2_grippers", default: str = "soft") -> Kind:
    return Kind(name, hook, lambda: Gripper, "grippers", default)


def gripper_plugin(own: Kind, name: str = "soft", made: type = Mine) -> SimpleNamespace:
    return SimpleNamespace(
        gvla2_kinds=hookimpl(lambda: [own]),
        gvla2_grippers=hookimpl(lambda: [Component(name, Options, made, summary="soft")]),
        gvla2_planners=hookimpl(lambda: [planner("grips", needs=("gripper",))]),
    )


def composed(registry: Registry, *overrides: str) -> Any:
    offer(registry, schemas())
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return OmegaConf.to_object(compose("run", overrides=list(overrides)))


def test_a_kind_of_ones_own_is_a_group_with_a_default_that_others_need():
    gvla2.register(gripper_plugin(kind()), "grippers")
    registry = load_plugins()
    assert registry.problems == ()
    assert list(registry.kinds)[-1] == "gripper"
    config = composed(registry, "planner=grips", "gripper.force=7")
    assert config.gripper == Options(name="soft", force=7.0)
    assert registry.build(config, "planner").needs["gripper"].config.force == 7.0
    check_component(registry.get("gripper", "soft"), registry.kinds["gripper"])


def test_what_breaks_the_protocol_of_a_kind_of_ones_own_is_reported():
    class Slack:
        """Holds nothing."""

        def __init__(self, config: ComponentConfig) -> None: ...

    gvla2.register(gripper_plugin(kind(), made=Slack), "grippers")
    registry = load_plugins()
    with pytest.raises(PluginError, match=r"The gripper 'soft' of plugin 'grippers' built a Slack.*hold\(\)"):
        registry.build(composed(registry), "gripper")
    with pytest.raises(ConformanceError, match=r"Slack is not a gripper: it lacks hold\(\)"):
        check_component(registry.get("gripper", "soft"), registry.kinds["gripper"])


def test_a_kind_without_its_default_leaves_other_runs_alone():
    gvla2.register(gripper_plugin(kind(), "hard"), "grippers")
    registry = load_plugins()
    config = composed(registry, "planner=skill")
    assert registry.build(config, "planner")
    with pytest.raises(ConfigurationError, match=r"chooses no gripper. Choose one with gripper=NAME"):
        registry.build(config, "gripper")
    assert composed(registry, "gripper=hard").gripper.name == "hard"
    with pytest.raises(HydraException, match="gripper/hrd"):
        composed(registry, "gripper=hrd")


def test_a_kind_whose_default_is_none_may_hold_nothing():
    gvla2.register(gripper_plugin(kind(default="none"), "hard"), "grippers")
    registry = load_plugins()
    config = composed(registry, "planner=grips")
    assert config.gripper.name == "none"
    assert registry.build(config, "planner").needs == {"gripper": None}
    without_the_group = {"planner": "grips"}
    assert registry.build(without_the_group, "planner").needs == {"gripper": None}


@pytest.mark.parametrize(
    ("odd", "message"),
    [
        ("gripper", "not a Kind"),
        (kind("planner"), "there is a kind 'planner' already"),
        (kind("fallback"), "there is a kind 'fallback' already"),
        (kind("seed"), "cannot be a Hydra group"),
        (kind("my kind"), "cannot be a Hydra group"),
        (kind(hook="gvla2_planners"), "one of its own"),
        (kind(hook="grippers"), "begins with 'gvla2_'"),
    ],
)
def test_a_kind_that_cannot_be_is_reported(odd: object, message: str):
    gvla2.register(plugin(lambda: [odd], KINDS_HOOK), "odd")
    registry = load_plugins()
    (problem,) = registry.problems
    assert (problem.plugin, problem.hook) == ("odd", KINDS_HOOK)
    assert message in problem.message
    assert composed(registry)
