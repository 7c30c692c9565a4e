"""Discovery, the catalog, building by name, and the bridge to Hydra."""

import dataclasses
import json
import re
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import pytest
from hydra import compose, initialize_config_module
from hydra.core.config_store import ConfigStore
from hydra.errors import HydraException
from hypothesis import given, settings
from omegaconf import OmegaConf

from gvla2 import Component, ComponentConfig, hookspecs
from gvla2.catalog import Offer, Registry, load_plugins
from gvla2.commands.primary import PRIMARY
from gvla2.discovery import Plugin
from gvla2.errors import ConfigurationError, Gvla2Error, PluginError, UnknownComponentError
from gvla2.hydra_bridge import LONGEST_FOLDER_NAME, register, short_name
from gvla2.kinds import HOOKS, KINDS, SEARCH_PATH_HOOK, kind_of

HEAD = """
from dataclasses import dataclass, field
from gvla2 import Component, ComponentConfig, hookimpl

@dataclass
class Config(ComponentConfig):
    '''Options of mine.'''
    depth: int = 3

class Made:
    '''Plans nothing at all.'''
    def __init__(self, config): self.config = config
    def plan(self, request): return None
"""

Install = Callable[..., str]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Install:
    """Puts a distribution with one plugin module on the path: ``install(source, name=...)`` -> module's name."""
    monkeypatch.syspath_prepend(tmp_path)
    tag = re.sub(r"\W", "_", request.node.name)

    def make(source: str, name: str = "fake", distribution: str = "fake-dist", head: str = HEAD) -> str:
        module = f"{name}_{tag}"
        (tmp_path / f"{module}.py").write_text(head + textwrap.dedent(source))
        info = tmp_path / f"{distribution.replace('-', '_')}-1.2.dist-info"
        info.mkdir(exist_ok=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.2\n")
        points = info / "entry_points.txt"
        before = points.read_text() if points.exists() else "[gvla2]\n"
        points.write_text(f"{before}{name} = {module}\n")
        return module

    return make


GOOD = """
@hookimpl
def gvla2_planners():
    return [Component("mine", Config, Made)]
"""


def test_every_hook_is_documented_and_has_a_kind():
    hooks = {name for name in vars(hookspecs) if name.startswith("gvla2_")}
    assert hooks == {*HOOKS, SEARCH_PATH_HOOK}
    for name in hooks:
        assert (vars(hookspecs)[name].__doc__ or "").startswith("Return"), name
    for kind in KINDS.values():
        assert f"``{kind.name}``" in vars(hookspecs)[kind.hook].__doc__
        assert kind.members(), kind


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
        (HOOK.format("gvla2_planners", "", "return None"), "gvla2_planners", "TypeError: 'NoneType'"),
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
            "@dataclass\nclass Odd(ComponentConfig):\n    thing: Made = None\n"
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
            "needs 'brain', which is no kind",
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


def test_the_first_of_two_equal_names_wins_and_the_other_is_told(install: Install):
    both = HOOK.format("gvla2_planners", "", "yield Component('{}', Config, Made, summary='of {}')")
    install(both.format("same", "b"), name="bravo", distribution="z-dist")
    install(both.format("same", "a"), name="alpha", distribution="z-dist")
    install(both.format("same", "z"), name="zulu", distribution="a-dist")
    install(both.format("skill", "me"), name="usurper", distribution="a-dist")
    registry = load_plugins()
    assert registry.get("planner", "same").summary == "of z", "the distribution's name comes first"
    assert registry.offers("planner")["skill"].plugin.distribution == "gvla2", "gvla2's own come first"
    told = {p.plugin: p.message for p in registry.problems}
    assert set(told) == {"usurper", "alpha", "bravo"}
    assert "'same' is already offered by plugin 'zulu', which wins" in told["alpha"]


def test_plugins_can_be_disabled_and_a_misspelling_is_told(install: Install, monkeypatch: pytest.MonkeyPatch):
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


# -- building ---------------------------------------------------------------------------------------------------


@dataclasses.dataclass
class Nested:
    gain: float = 2.0


@dataclasses.dataclass
class Options(ComponentConfig):
    depth: int = 3
    inner: Nested = dataclasses.field(default_factory=Nested)


@dataclasses.dataclass
class Demanding(ComponentConfig):
    depth: int = 3

    def __post_init__(self) -> None:
        if self.depth < 0:
            raise ConfigurationError("depth must not be negative")


class Stand:
    """Has every method of every kind."""

    model = "stand"
    arm = instructions = None
    closed = 0

    def __init__(self, config: ComponentConfig, **needs: object) -> None:
        self.config, self.needs = config, needs

    def close(self) -> None:
        type(self).closed += 1

    def any(self, *_: object) -> None: ...

    plan = embed = rank = verify = recall = learn = predict = any


def a_registry(**components: Component[Any]) -> Registry:
    return Registry({kind: {c.name: Offer(c, Plugin("p"))} for kind, c in components.items()}, [Plugin("p")])


@pytest.mark.parametrize(
    "root",
    [
        {"planner": {"name": "mine", "depth": 5, "inner": {"gain": 0.5}}},
        OmegaConf.create({"planner": {"name": "mine", "depth": "5", "inner": {"gain": 0.5}}}),
        {"planner": Options(name="mine", depth=5, inner=Nested(0.5))},
        OmegaConf.create({"planner": OmegaConf.structured(Options(name="mine", depth=5, inner=Nested(0.5)))}),
    ],
)
def test_build_takes_any_form_of_configuration(root: object):
    built = a_registry(planner=Component("mine", Options, Stand)).build(root, "planner")
    assert built.config == Options(name="mine", depth=5, inner=Nested(0.5))


def test_a_bare_name_takes_the_defaults():
    built = a_registry(planner=Component("mine", Options, Stand)).build({"planner": "mine"}, "planner")
    assert built.config == Options(name="mine")


def test_needs_are_built_first_and_shared():
    made: list[str] = []

    def maker(name: str) -> Callable[..., Stand]:
        def build(config: ComponentConfig, **needs: object) -> Stand:
            made.append(name)
            return Stand(config, **needs)

        return build

    registry = a_registry(
        memory=Component("m", Options, maker("memory"), needs=("retriever", "embedder")),
        retriever=Component("r", Options, maker("retriever"), needs=("embedder",)),
        embedder=Component("e", Options, maker("embedder")),
    )
    root = {"memory": "m", "retriever": "r", "embedder": "e"}
    memory = registry.build(root, "memory")
    assert made == ["embedder", "retriever", "memory"]
    assert memory.needs["embedder"] is memory.needs["retriever"].needs["embedder"]
    both = registry.build_all(root, ["embedder", "memory"])
    assert both["embedder"] is both["memory"].needs["embedder"]


def test_a_circle_of_needs_is_told():
    registry = a_registry(
        memory=Component("m", Options, Stand, needs=("retriever",)),
        retriever=Component("r", Options, Stand, needs=("memory",)),
    )
    with pytest.raises(ConfigurationError, match="circle: memory -> retriever -> memory"):
        registry.build({"memory": "m", "retriever": "r"}, "memory")


@pytest.mark.parametrize(
    ("component", "root", "error", "message"),
    [
        (
            Component("a", Options, lambda c: object()),
            "a",
            PluginError,
            r"built a object, which lacks plan\(\)",
        ),
        (Component("a", Options, lambda c: None), "a", PluginError, "built a NoneType"),
        (
            Component("a", Options, lambda c: 1 / 0),
            "a",
            PluginError,
            "of plugin 'p' could not be built: ZeroDiv",
        ),
        (Component("a", Options, lambda: 1), "a", PluginError, "could not be built: TypeError"),
        (Component("a", Options, Stand), "b", UnknownComponentError, "No planner named 'b'"),
        (Component("a", Options, Stand), None, ConfigurationError, "chooses no planner"),
        (Component("a", Options, Stand), {"name": "a", "dept": 1}, ConfigurationError, "'dept'"),
        (Component("a", Options, Stand), {"name": "a", "depth": "x"}, ConfigurationError, "Integer"),
        (
            Component("a", Options, Stand),
            Demanding(name="a"),
            ConfigurationError,
            "takes a Options, not a Demanding",
        ),
        (
            Component("a", Demanding, Stand),
            {"name": "a", "depth": -1},
            ConfigurationError,
            "must not be negative",
        ),
        (Component("a", Options, Stand, needs=("prior",)), "a", ConfigurationError, "chooses no prior"),
    ],
)
def test_building_fails_in_words(
    component: Component[Any], root: object, error: type[Exception], message: str
):
    with pytest.raises(error, match=message):
        a_registry(planner=component).build({"planner": root}, "planner")


def test_a_component_may_answer_through_getattr():
    class Proxy:
        def __init__(self, config: ComponentConfig) -> None:
            self.inner = Stand(config)

        def __getattr__(self, name: str) -> object:
            return getattr(self.inner, name)

    assert a_registry(planner=Component("a", Options, Proxy)).build({"planner": "a"}, "planner").plan


def test_after_a_failure_what_was_built_is_closed():
    def fail(config: ComponentConfig) -> None:
        raise Gvla2Error("no")

    registry = a_registry(memory=Component("m", Options, Stand), planner=Component("p", Options, fail))
    before = Stand.closed
    with pytest.raises(Gvla2Error, match="no"):
        registry.build_all({"memory": "m", "planner": "p"}, ["memory", "planner"])
    assert Stand.closed == before + 1


# -- Hydra ------------------------------------------------------------------------------------------------------


def composed(*overrides: str) -> Any:
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return compose("run", overrides=list(overrides))


def test_third_party_options_are_overridable_and_typed(install: Install):
    install(GOOD)
    registry = load_plugins()
    register(registry, PRIMARY)
    config = composed("planner=mine", "planner.depth=9")
    assert OmegaConf.to_container(config.planner) == {"name": "mine", "depth": 9}
    assert registry.build(config, "planner").config.depth == 9
    with pytest.raises(HydraException):
        composed("planner=mine", "planner.depth=deep")


def test_registering_another_registry_replaces_the_first(install: Install):
    module = install(GOOD)
    register(load_plugins(), PRIMARY)
    assert "mine.yaml" in ConfigStore.instance().repo["planner"]
    Path(sys.modules[module].__file__ or "").with_suffix(".py").write_text("1 / 0")
    del sys.modules[module]
    register(load_plugins(), PRIMARY)
    assert "mine.yaml" not in ConfigStore.instance().repo["planner"]
    assert "skill.yaml" in ConfigStore.instance().repo["planner"]


def test_presets_of_a_plugin_are_found(install: Install, tmp_path: Path):
    package = "presets_of_mine"
    (tmp_path / package / "planner").mkdir(parents=True)
    (tmp_path / package / "__init__.py").touch()
    (tmp_path / package / "planner" / "deep.yaml").write_text("defaults: [mine, _self_]\ndepth: 99\n")
    install(GOOD + HOOK.format("gvla2_config_search_path", "", f"return ['pkg://{package}']"))
    registry = load_plugins()
    register(registry, PRIMARY)
    try:
        assert registry.build(composed("planner=deep"), "planner").config.depth == 99
    finally:
        register(Registry({}), PRIMARY)


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=300))
def test_folder_names_are_short_and_safe(text: str):
    name = short_name(text)
    assert len(name) <= LONGEST_FOLDER_NAME
    assert not set(name) & set('/\\ \n:*?"<>|')


def test_long_overrides_get_different_folders():
    a, b = (short_name("x=" + "1" * 200 + end) for end in "ab")
    assert a != b


def test_listing_loads_no_heavy_library():
    code = (
        "import sys, json; from gvla2.plugins import load_plugins; r = load_plugins();"
        "print(json.dumps(sorted(set(sys.modules) & {'numpy', 'scipy', 'torch', 'sapien', 'ompl', 'numba'})))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
