"""What is installed is what is in the tree: packages, YAML, templates, and it works away from the checkout."""

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
MAPPED = {"gvla2": "gvla2", "conf": "gvla2/conf", "plugins": "gvla2_plugins"}
"""Folders of the checkout and where a wheel has them."""
DATA = {
    ".md",
    ".txt",
    ".jsonl",
    ".yaml",
    ".jinja",
    ".css",
    ".js",
    ".typed",
    ".json",
    ".urdf",
    ".srdf",
    ".dae",
    ".stl",
    ".lark",
    ".toml",
}


def tree() -> set[str]:
    """Every file of the checkout that must be installed, as a wheel names it."""
    return {
        f"{target}/{file.relative_to(ROOT / source).as_posix()}"
        for source, target in MAPPED.items()
        for file in (ROOT / source).rglob("*")
        if (file.suffix in DATA | {".py"} or file.name == "LICENSE") and "__pycache__" not in file.parts
    }


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel, built from a copy so that no build folder is left in the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    skip = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in MAPPED:
        shutil.copytree(ROOT / name, folder / name, ignore=skip)
    for name in ("pyproject.toml", "setup.py", "LICENSE", "README.md"):
        if (ROOT / name).exists():
            shutil.copy(ROOT / name, folder)
    command = [
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--no-isolation",
        "--outdir",
        str(folder / "dist"),
        ".",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return next((folder / "dist").glob("gvla2-*.whl"))


def test_every_folder_of_code_is_a_package():
    there = tree()
    folders = {name.rpartition("/")[0] for name in there if name.endswith(".py")}
    assert not [f for f in folders if f"{f}/__init__.py" not in there]


def test_every_plugin_folder_is_announced():
    import gvla2_plugins

    folders = {p.parent.name for p in (ROOT / "plugins").glob("*/__init__.py")}
    assert PROJECT["project"]["entry-points"]["gvla2"] == {"gvla2": "gvla2_plugins"}
    assert set(gvla2_plugins.PLUGINS) == {f"gvla2_plugins.{name}" for name in folders}


def test_the_wheel_has_every_file(wheel: Path):
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    assert tree() - packed == set()
    extra = {name for name in packed - tree() if ".dist-info/" not in name}
    assert extra == set()


def test_the_wheel_works_away_from_the_checkout(wheel: Path, tmp_path: Path):
    site, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    elsewhere.mkdir()
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--disable-pip-version-check"]
    subprocess.run([*command, "--target", str(site), str(wheel)], check=True)

    def python(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=elsewhere,
            env={**os.environ, "PYTHONPATH": str(site)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    places = python(
        "-c", "import gvla2, gvla2.conf, gvla2_plugins.skill as s; print(gvla2.__file__, s.__file__)"
    )
    assert all(place.startswith(str(site)) for place in places.split())
    listing = python("-m", "gvla2.cli", "plugins")
    assert "skill" in listing
    assert "broken" not in listing
    assert "name: l515" not in listing
    assert "kind: l515" in python("-m", "gvla2.cli", "run", "--cfg", "job", "depth_noise=l515")
