"""The code and versions behind a number."""

from __future__ import annotations

import hashlib
import platform
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("gvla2", "numpy", "scipy", "numba", "scikit-image", "trimesh", "sqlmodel", "torch")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that measurements depend on; absent ones are left out."""
    found = {"python": platform.python_version(), "platform": sys.platform}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def commit() -> str:
    """The commit of the source tree, with ``-dirty`` when files differ from it; "" outside a git checkout."""
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return ""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


@cache
def code_digest(packages: tuple[str, ...]) -> str:
    """Hexadecimal digest of the Python files of packages: rows measured by other code are not mistaken for these.

    Unlike a commit it also covers uncommitted changes. A missing package counts as empty.
    """
    digest = hashlib.sha256()
    for package in packages:
        for path in _sources(package):
            digest.update(f"{package}|{path.name}|".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _sources(package: str) -> Iterable[Path]:
    try:
        spec = find_spec(package)
    except ImportError:
        return []
    if spec is None:
        return []
    if spec.submodule_search_locations is None:
        return [Path(spec.origin)] if spec.origin else []
    return sorted(path for place in spec.submodule_search_locations for path in Path(place).rglob("*.py"))
