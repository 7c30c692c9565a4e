"""The README's commands and its plugin are what it says they are."""

import re
import sys
from pathlib import Path

from gvla2.testing import check_component

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str, number: int = 0) -> str:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)[number]


def test_the_extras_of_the_commands_exist():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for extra in re.findall(r"\.\[(\w+)\]", block("sh")):
        assert f"\n{extra} = [" in project


def test_the_plugin_of_the_readme_conforms(tmp_path, monkeypatch):
    (tmp_path / "readme_plugin.py").write_text(block("python"), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "readme_plugin", None)  # so that it is forgotten afterwards
    del sys.modules["readme_plugin"]
    module = __import__("readme_plugin")
    (component,) = module.gvla2_planners()
    check_component(component, "planner")
    assert component.summary == "Hovers above the first object."
