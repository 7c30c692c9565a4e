"""The Dockerfile, as far as can be told without building it: its files, commands and libraries exist."""

import re
import tomllib
from pathlib import Path

from gvla2.agents.dockerfile import read_recipe
from gvla2.commands import COMMANDS
from gvla2.commands.checkup import SYSTEM_PACKAGES

ROOT = Path(__file__).parents[1]
FILE = ROOT / "Dockerfile"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
RECIPE = read_recipe(FILE)
RUN = [step[0].partition(" && ")[2] for word, step in RECIPE.steps if word == "run"]


def test_what_it_copies_is_there_and_is_all_that_an_installation_needs():
    copied = {source for word, (*sources, _) in RECIPE.steps if word == "copy" for source in sources}
    assert all((ROOT / source).exists() for source in copied)
    mapped = PROJECT["tool"]["setuptools"]["package-dir"].values()
    named = {PROJECT["project"]["readme"], *PROJECT["project"]["license-files"], "pyproject.toml", "setup.py"}
    assert copied == {*mapped, *named}


def test_nothing_that_it_copies_is_ignored():
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    copied = {source for word, (*sources, _) in RECIPE.steps if word == "copy" for source in sources}
    assert not copied & set(ignored)


def test_it_installs_as_the_readme_does_and_then_examines_itself():
    readme = (ROOT / "README.md").read_text()
    first = re.search(r"```sh\n(.*?)\n", readme)
    assert first is not None
    install = next(command for command in RUN if "pip install" in command)
    assert first[1] == f"{install} && .venv/bin/gvla2 run"
    assert RUN[-1] == "gvla2 doctor"
    assert RECIPE.variables["PATH"].startswith(f"{RECIPE.folder}/.venv/bin:")
    assert set(re.findall(r"gvla2 (\w+) task=", FILE.read_text())) <= set(COMMANDS)


def test_it_brings_the_libraries_that_the_doctor_asks_for():
    brought = next(command for command in RUN if "apt-get install" in command)
    assert {word for word in brought.split() if word.startswith("lib")} <= set(SYSTEM_PACKAGES.values())


def test_its_python_is_one_of_ours():
    version = re.search(r"^FROM python:(3\.\d+)-slim$", FILE.read_text(), re.MULTILINE)
    assert version is not None
    assert f"Programming Language :: Python :: {version[1]}" in PROJECT["project"]["classifiers"]
