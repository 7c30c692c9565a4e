"""The site builds, no link leads nowhere, and the plugins of the pages about hooks work as they stand there."""

import dataclasses
import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from hydra import compose, initialize_config_module

import gvla2
from gvla2.commands.hydra_job import composed, schemas
from gvla2.commands.plugins import options
from gvla2.commands.run import run_episodes
from gvla2.evaluation.config import SUITES
from gvla2.hookspecs import KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK
from gvla2.plugins.hydra_config import register
from gvla2.plugins.kinds import KINDS, SLOTS
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.testing import CHECKS, check_component, check_skill
from tests.local_model import LocalModel, said

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "hooks").glob("gvla2_*.md"))
MADE = ("configuration/", "contributing.md", "changes.md")
"""What `scripts/docs` adds when the site is built."""
BLOCK = re.compile(r"^```(\w+)(?: title=\"(\S+)\")?\n(.*?)^```", re.DOTALL | re.MULTILINE)


@pytest.fixture
def plugin(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[ModuleType]:
    """The page's plugin as a registered module; blocks with a file's name as their title lie beside it."""
    page: Path = request.param
    name = f"docs_{page.stem}"
    source = []
    for language, file, block in BLOCK.findall(page.read_text()):
        if file:
            (tmp_path / file).parent.mkdir(parents=True)
            (tmp_path / file).write_text(block)
        elif language == "python":
            source.append(block)
    (tmp_path / f"{name}.py").write_text("\n".join(source))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, name, None)  # so that it is forgotten afterwards
    del sys.modules[name]
    module = importlib.import_module(name)
    gvla2.register(module)
    yield module
    gvla2.unregister(name)


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.stem)
def test_the_links_of_the_page_lead_somewhere(page: Path):
    prose = re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for link in re.findall(r"\]\(([^)#:\s]+)(?:#[^)\s]*)?\)", prose):
        assert (page.parent / link).exists() or link.startswith(MADE), link


@pytest.mark.extras
@pytest.mark.timeout(300)
def test_the_site_builds_without_a_warning(tmp_path: Path):
    pytest.importorskip("material", reason="pip install 'gvla2[docs]'")
    command = f"{sys.executable} -m mkdocs build --strict --quiet --site-dir {tmp_path}/site".split()
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "site" / "configuration" / "choices" / "planner.html").read_text()
    assert "planner.lift_height" in page
    assert "window.Worker = class" in page, "the search works from files"
    assert not re.search(r"<(script|link)[^>]*https?:", page), "nothing is fetched"
    assert "PlanRequest" in (tmp_path / "site" / "hooks" / "gvla2_planners.html").read_text()


def test_the_configuration_reference_has_every_option_of_every_component(registry: Registry, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts" / "docs")
    pages = importlib.import_module("reference").reference(registry)
    for kind in KINDS:
        page = pages[f"configuration/choices/{kind}.md"]
        for name, component in registry.components(kind).items():
            assert f"## `{kind}={name}`" in page
            assert all(f"| `{kind}.{o.name}` |" in page for o in options(component.config))
    for command, config in schemas().items():
        for option in options(config):
            if not option.name.endswith(".name"):
                assert f"| `{option.name}` |" in pages[f"configuration/{command}.md"]


def test_every_hook_has_a_page_and_no_other():
    hooks = {kind.hook for kind in KINDS.values()} | {KINDS_HOOK, SEARCH_PATH_HOOK, SKILL_HOOK}
    assert {page.stem for page in PAGES} == hooks


@pytest.mark.parametrize("plugin", PAGES, ids=lambda page: page.stem, indirect=True)
def test_the_plugin_of_the_page_conforms(plugin: ModuleType):
    registry, hook = load_plugins(), plugin.__name__.removeprefix("docs_")
    assert registry.problems == ()
    assert callable(getattr(plugin, hook))
    with LocalModel(lambda request: said("DONE")) as model:
        given = {"language": {"name": "endpoint", "base_url": model.url}}
        for kind in registry.kinds.values():
            for component in getattr(plugin, kind.hook, list)():
                assert registry.get(kind.name, component.name).build is component.build
                needs = {
                    n: registry.build(given | {n: given.get(n, registry.kinds[n].default)}, n)
                    for n in component.needs
                }
                check_component(component, kind, **needs)
                assert kind.name in CHECKS or hook == KINDS_HOOK
    for skill in getattr(plugin, SKILL_HOOK, list)():
        assert registry.skills[skill.name].propose is skill.propose
        check_skill(skill)
    page = (ROOT / "docs" / "hooks" / f"{hook}.md").read_text()
    for command, words in re.findall(r"`gvla2 (\w+) ([^`]*)`", page):
        _check_choices(registry, command, words)


@pytest.mark.parametrize("name", ["index", "tutorial", "howto", "cluster", "expectations"])
def test_the_commands_of_the_page_name_what_there_is(name: str, registry: Registry):
    page = (ROOT / "docs" / f"{name}.md").read_text().replace("\\\n", "")
    found = re.findall(r"^gvla2 (\w+) ([^#\n]*)|`gvla2 (\w+) ([^`]*)`", page, re.MULTILINE)
    for command, words in [(line or shown, after or then) for line, after, shown, then in found]:
        if command in schemas() and "planner=point" not in words:  # the reader's own
            _check_choices(registry, command, re.sub(r"\bhydra\S*=\S*", "", words))


def _check_choices(registry: Registry, command: str, words: str) -> None:
    """Every component, option and key of a command line exists; of a sweep's values the last is looked at."""
    given = [
        word.partition("=")[::2] for word in shlex.split(words) if re.match(r"\w[\w.]*=(?![A-Z]{2})", word)
    ]
    chosen = {key: value.rpartition(",")[2] for key, value in given if key in registry.groups}
    for group, name in chosen.items():
        assert name in registry.components(SLOTS.get(group, group)), (command, words)
    for key, _ in given:
        group, _, option = key.partition(".")
        if option and group in registry.groups:
            config = registry.get(
                SLOTS.get(group, group), chosen.get(group, registry.kinds[group].default)
            ).config
            assert option in {o.name for o in options(config)}, (command, words)
        elif group not in registry.groups:
            known = [schemas()[command], *(SUITES.values() if command == "bench" else ())]
            assert group in {field.name for one in known for field in dataclasses.fields(one)}, (
                command,
                words,
            )


@pytest.mark.parametrize(
    "plugin", [p for p in PAGES if p.stem == SEARCH_PATH_HOOK], ids=["presets"], indirect=True
)
def test_the_preset_of_the_page_is_found(plugin: ModuleType, registry: Registry):
    assert plugin.gvla2_config_search_path()[0] in load_plugins().search_paths
    register(load_plugins(), schemas())
    try:
        with initialize_config_module("gvla2.conf", version_base="1.3"):
            config = compose("run", overrides=["+experiment=careful", "replan=0"])
    finally:
        register(registry, schemas())
    assert (config.replan, config.planner.speed, config.depth_noise.kind) == (0, 0.1, "realistic")


@pytest.mark.parametrize(
    "plugin", [p for p in PAGES if p.stem == "gvla2_planners"], ids=["point"], indirect=True
)
def test_the_planner_of_the_tutorial_does_what_it_says(
    plugin: ModuleType, registry: Registry, tmp_path: Path
):
    (command,) = re.findall(
        r"^gvla2 run (planner=point .*)$", (ROOT / "docs" / "tutorial.md").read_text(), re.M
    )
    offered = load_plugins()
    small = ["memory=none", "quiet=true", "robot.image_size=128", "robot.video_size=16"]
    try:
        config, _ = composed("run", [*shlex.split(command), *small], offered)
        run_episodes(config, offered, tmp_path)
    finally:
        register(registry, schemas())
    shown = json.loads((tmp_path / "result.json").read_text())
    assert shown["verdict"] == "uncertain"
    assert shown["failure"]["kind"] == "goal_not_reached"
