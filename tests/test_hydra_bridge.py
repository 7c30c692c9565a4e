"""A plugin's options on the command line."""

import re
import sys
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import pytest
from hydra import compose, initialize_config_module
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hypothesis import assume, given, settings
from omegaconf import OmegaConf

from gvla2 import cli
from gvla2.commands.hydra_job import at_home, quoted_instruction, report, schemas
from gvla2.commands.hydra_job import composed as run_config
from gvla2.errors import ConfigurationError
from gvla2.plugins.hydra_config import LONGEST_FOLDER_NAME, ComponentSource, register, short_name
from gvla2.plugins.registry import Registry, load_plugins

Install = Callable[..., str]

GOOD = """
@hookimpl
def gvla2_planners():
    return [Component("mine", Config, Made)]
"""


def composed(*overrides: str) -> Any:
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return compose("run", overrides=list(overrides))


def offered(group: str) -> set[str]:
    return set(ComponentSource("test", "gvla2://").list(group, None))


def test_third_party_options_are_overridable_and_typed(install: Install):
    install(GOOD)
    registry = load_plugins()
    register(registry, schemas())
    config = composed("planner=mine", "planner.depth=9")
    assert OmegaConf.to_container(config.planner) == {"name": "mine", "depth": 9}
    assert registry.build(config, "planner").config.depth == 9
    with pytest.raises(HydraException):
        composed("planner=mine", "planner.depth=deep")


def test_options_whose_keys_are_the_users_are_open():
    register(load_plugins(), schemas())
    for words in (
        "robot.hand={max_width: 0.08}",
        "robot.hand.max_width=0.08",
        "+robot.hand={max_width: 0.08}",
    ):
        assert composed("robot=sapien_arm", words).robot.hand == {"max_width": 0.08}
    with pytest.raises(HydraException):
        composed("robot=sapien_arm", "robot.hnad={max_width: 0.08}")


def test_registering_another_registry_replaces_the_first(install: Install):
    module = install(GOOD)
    register(load_plugins(), schemas())
    assert offered("planner") > {"mine", "skill"}
    Path(sys.modules[module].__file__ or "").with_suffix(".py").write_text("1 / 0")
    del sys.modules[module]
    register(load_plugins(), schemas())
    assert "mine" not in offered("planner")
    assert "skill" in offered("planner")


def test_presets_of_a_plugin_are_found(install: Install, tmp_path: Path):
    package = "presets_of_mine"
    (tmp_path / package / "planner").mkdir(parents=True)
    (tmp_path / package / "__init__.py").touch()
    (tmp_path / package / "planner" / "deep.yaml").write_text("defaults: [mine, _self_]\ndepth: 99\n")
    hook = f"@hookimpl\ndef gvla2_config_search_path():\n    return ['pkg://{package}']\n"
    install(GOOD + hook)
    registry = load_plugins()
    register(registry, schemas())
    try:
        assert registry.build(composed("planner=deep"), "planner").config.depth == 99
    finally:
        register(Registry({}), schemas())


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=300))
def test_folder_names_are_short_and_safe(text: str):
    name = short_name(text)
    assert len(name) <= LONGEST_FOLDER_NAME
    assert not set(name) & set('/\\ \n:*?"<>|')


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["+mode=paper"], "'mode'. Did you mean 'branch.mode'?"),
        (["++planner.trys=2"], "'planner.trys'. Did you mean 'planner.tries'?"),
        (["+nonsense.x=1"], "'nonsense'."),
    ],
)
def test_options_that_hydra_would_add_are_refused(words: list[str], message: str):
    with pytest.raises(ConfigurationError) as error:
        run_config("run", words)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"seed:\t3\n", "mine.yaml"),
        (b"seed: 1\nseed: 2\n", "duplicate key"),
        (b"# caf\xe9\n", "not UTF-8 near .*caf"),
    ],
)
def test_a_preset_that_is_no_yaml_is_said_without_a_traceback(
    tmp_path: Path, capsys, content: bytes, said: str
):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_bytes(b"# @package _global_\n" + content)
    assert cli.main(["run", f"--config-dir={tmp_path}", "+experiment=mine"]) == 1
    printed = capsys.readouterr().err
    assert re.search(said, printed)
    assert "Traceback" not in printed


def test_a_launchers_worker_that_was_killed_is_said_without_a_traceback(capsys):
    assert report(BrokenProcessPool("a worker was killed")) == 1
    assert capsys.readouterr().err == "gvla2: BrokenProcessPool: a worker was killed\n"


@pytest.mark.parametrize("words", [["-i"], ["--instruction"], "--instruction={}", "instruction={}"])
@given(
    text=st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1).filter(
        lambda t: t[0] not in "'\""
    )
)
@settings(max_examples=25, deadline=None)
def test_a_sentence_reaches_the_planner_as_it_was_typed(words: list[str] | str, text: str):
    assume(text != "null")
    argv = [*words, text] if isinstance(words, list) else [words.format(text)]
    override = quoted_instruction(argv)
    node = OmegaConf.create({"instruction": OverridesParser.create().parse_overrides(override)[0].value()})
    assert node.instruction == text


@pytest.mark.parametrize(
    "text", ["lift the red cube, please", "it's #1!", "das große Rad", "红色 方块", "${x}", "a \\'b\\"]
)
def test_a_sentence_is_composed_as_it_was_typed(text: str):
    assert run_config("run", quoted_instruction(["-i", text]))[0].instruction == text


def test_a_tilde_is_the_users_home(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", "/home/me")
    assert [at_home(word) for word in ("views=~/a b", "~views", "views=a~/b")] == [
        "views=/home/me/a b", "~views", "views=a~/b",
    ]  # fmt: skip


def test_a_sweep_over_sentences_stays_one():
    assert quoted_instruction(["-m", "instruction=a,b"]) == ["-m", "instruction=a,b"]
