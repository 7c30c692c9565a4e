"""Discovery, the catalog, building by name, and the bridge to Hydra."""

from collections.abc import Callable
from dataclasses import fields

import pytest

from gvla2 import hookspecs
from gvla2.commands.run import RunConfig
from gvla2.errors import ConfigurationError, UnknownComponentError
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.plugins.discovery import Plugin
from gvla2.plugins.kinds import KINDS, TAKEN, kind_of
from gvla2.plugins.registry import Registry, load_plugins

Install = Callable[..., str]

GOOD = """
@hookimpl
def gvla2_planners():
    return [Component("mine", Config, Made)]
"""


def test_every_hook_is_documented():
    hooks = {name: hook for name, hook in vars(hookspecs).items() if name.startswith("gvla2_")}
    assert hooks.keys() == {kind.hook for kind in KINDS.values()} | {KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK}
    for name, function in hooks.items():
        assert (function.__doc__ or "").startswith("Return"), name
    for kind in KINDS.values():
        assert f"``{kind.name}``" in hooks[kind.hook].__doc__
        assert kind.members(), kind


def test_no_kind_has_a_word_of_run():
    assert {field.name for field in fields(RunConfig)} | {"hydra"} == TAKEN


def test_reference_plugins_are_whole(registry: Registry):
    assert registry.problems == ()
    assert {p.distribution for p in registry.plugins} >= {"gvla2"}
    for kind in KINDS:
        for component in registry.components(kind).values():
            assert component.summary, component
            assert (component.config.__doc__ or "").strip(), component


def test_a_third_party_is_found_beside_the_others(install: Install):
    install(GOOD)
    registry = load_plugins()
    offer = registry.offers("planner")["mine"]
    assert offer.component.summary == "Plans nothing at all."
    assert offer.plugin == Plugin("fake", "fake-dist", "1.2")
    assert registry.problems == ()
    assert "skill" in registry.components("planner")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def broken(:", "SyntaxError: invalid syntax"),
        ("import no_such_module_anywhere", "ModuleNotFoundError: No module named 'no_such_module_anywhere'"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("raise RuntimeError('no\\nluck')", "RuntimeError: no luck"),
        ("1 / 0", "ZeroDivisionError"),
        ("x = 1", "offers nothing"),
    ],
)
def test_a_plugin_that_does_not_load_is_named_and_stops_nobody(install: Install, source: str, message: str):
    install(source, head="")
    registry = load_plugins()
    (problem,) = registry.problems
    assert (problem.plugin, problem.hook) == ("fake", "")
    assert message in problem.message
    assert "skill" in registry.components("planner")


HOOK = "@hookimpl\ndef {}({}):\n    {}\n"


@pytest.mark.parametrize(
    ("source", "hook", "message"),
    [
        (HOOK.format("gvla2_planner", "", "return []"), "gvla2_planner", "Did you mean 'gvla2_planners'?"),
        ("def gvla2_planers(): return []", "gvla2_planers", "Did you mean 'gvla2_planners'?"),
        ("def gvla2_planners(): return []", "gvla2_planners", "is not marked @hookimpl"),
        (HOOK.format("gvla2_planners", "config", "return []"), "gvla2_planners", "must take no arguments"),
        (
            HOOK.format("gvla2_planners", "", "raise ValueError('oh')"),
            "gvla2_planners",
            "failed: ValueError: oh",
        ),
        (HOOK.format("gvla2_planners", "", "raise SystemExit"), "gvla2_planners", "failed: SystemExit"),
        (HOOK.format("gvla2_planners", "", "return None"), "gvla2_planners", "returned None, not a list"),
        (HOOK.format("gvla2_planners", "", "return [3]"), "gvla2_planners", "3, which is not a Component"),
        (HOOK.format("gvla2_planners", "", "yield Made"), "gvla2_planners", "not a Component"),
        (
            HOOK.format("gvla2_planners", "", "yield Component('a', dict, Made)"),
            "gvla2_planners",
            "not a dataclass that extends ComponentConfig",
        ),
        (
            "class Plain(ComponentConfig):\n    depth: int = 3\n"
            + HOOK.format("gvla2_planners", "", "yield Component('a', Plain, Made)"),
            "gvla2_planners",
            "Plain is not marked @dataclass",
        ),
        (
            "@dataclass\nclass Odd(ComponentConfig):\n    object: Made = None\n"
            + HOOK.format("gvla2_planners", "", "yield Component('a', Odd, Made)"),
            "gvla2_planners",
            "Odd does not fit OmegaConf",
        ),
        (
            "@dataclass\nclass Odd(ComponentConfig):\n    name: int = 3\n"
            + HOOK.format("gvla2_planners", "", "yield Component('a', Odd, Made)"),
            "gvla2_planners",
            "Odd does not fit OmegaConf",
        ),
        (
            HOOK.format("gvla2_planners", "", "yield Component('', Config, Made)"),
            "gvla2_planners",
            "the name ''",
        ),
        (
            HOOK.format("gvla2_planners", "", "yield Component('null', Config, Made)"),
            "gvla2_planners",
            "'null'",
        ),
        (
            HOOK.format("gvla2_planners", "", "yield Component('a.b', Config, Made)"),
            "gvla2_planners",
            "'a.b'",
        ),
        (
            HOOK.format("gvla2_planners", "", "yield Component('a', Config, 3)"),
            "gvla2_planners",
            "cannot be called",
        ),
        (
            HOOK.format("gvla2_planners", "", "yield Component('a', Config, Made, needs=['brain'])"),
            "gvla2_planners",
            "needs 'brain', which is not a kind",
        ),
        (
            HOOK.format("gvla2_config_search_path", "", "return ['conf']"),
            SEARCH_PATH_HOOK,
            "a search path is",
        ),
        (
            HOOK.format("gvla2_config_search_path", "", "return ['pkg://nowhere.conf']"),
            SEARCH_PATH_HOOK,
            "be found",
        ),
    ],
)
def test_what_a_hook_does_wrong_is_named_and_the_rest_of_the_plugin_stays(
    install: Install, source: str, hook: str, message: str
):
    install(source + "\n" + HOOK.format("gvla2_verifiers", "", "yield Component('fine', Config, Made)"))
    registry = load_plugins()
    (problem,) = registry.problems
    assert (problem.plugin, problem.hook) == ("fake", hook)
    assert message in problem.message
    assert "fine" in registry.components("verifier")


def test_the_first_of_two_equal_names_wins_and_the_other_is_reported(install: Install):
    both = HOOK.format("gvla2_planners", "", "yield Component('{}', Config, Made, summary='of {}')")
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


def test_plugins_can_be_disabled_and_a_misspelling_is_reported(
    install: Install, monkeypatch: pytest.MonkeyPatch
):
    install("1 / 0")
    monkeypatch.setenv("GVLA2_DISABLE_PLUGINS", "fake, skil")
    registry = load_plugins()
    (problem,) = registry.problems
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
    registry = load_plugins()
    with pytest.raises(UnknownComponentError) as caught:
        registry.get("planner", "skil")
    text = str(caught.value)
    assert text.startswith("No planner named 'skil'. Did you mean 'skill'? Available: ")
    assert "Broken plugins that might have offered it: fake" in text
    with pytest.raises(ConfigurationError, match=r"No kind .* 'planer'. Did you mean 'planner'\?"):
        kind_of("planer")
