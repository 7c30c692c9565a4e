"""The configuration reference, in Markdown, from the dataclasses and presets that are installed."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from pathlib import Path

from gvla2.commands.hydra_job import schemas
from gvla2.commands.plugins import Option, options
from gvla2.component import ComponentConfig
from gvla2.plugins.kinds import Kind
from gvla2.plugins.registry import Registry

ROOT = Path(__file__).parents[2]
PRESETS = ("experiment", "data", "depth_noise")


def reference(registry: Registry) -> dict[str, str]:
    """The pages by their path below ``docs``: an overview, one page a command, one a kind, and the presets."""
    pages = {
        f"configuration/{name}.md": _command(name, config, registry) for name, config in schemas().items()
    }
    pages |= {
        f"configuration/choices/{kind.name}.md": _kind(kind, registry) for kind in registry.kinds.values()
    }
    return {"configuration/index.md": _overview(registry), **pages, "configuration/presets.md": _presets()}


def hooks_table(registry: Registry) -> str:
    """Each kind with its page, its word and default, and what is offered; links as from ``docs/hooks``."""
    rows = [
        f"| [{k.what.partition(':')[0]}]({k.hook}.md) | `{k.name}=` | `{k.default}` | "
        f"[{len(registry.components(k.name))} on offer](../configuration/choices/{k.name}.md) |"
        for k in registry.kinds.values()
    ]
    return "\n".join(["| what | chosen by | `gvla2 run` takes | |", "|---|---|---|---|", *rows])


def contract(kind: Kind) -> str:
    """What stands below the example of a hook: its protocol and where its choices are."""
    protocol = f"{kind.protocol().__module__}.{kind.protocol().__qualname__}"
    return (
        f"## The contract\n\n`gvla2 run {kind.name}=NAME` chooses one (`{kind.default}` where nothing is said); "
        f"[these are on offer](../configuration/choices/{kind.name}.md). `gvla2.testing.check_component(component, "
        f'"{kind.name}")` checks yours.\n\n::: {protocol}\n    options:\n      heading_level: 3\n'
    )


def _overview(registry: Registry) -> str:
    commands = [f"* [`gvla2 {name}`]({name}.md): {_first(config)}" for name, config in schemas().items()]
    kinds = [f"* [`{k.name}=`](choices/{k.name}.md): {k.what}" for k in registry.kinds.values()]
    return "\n".join(
        [
            "# Configuration",
            "",
            "Every option of every command, written from the dataclasses when this site was built. "
            "`gvla2 COMMAND --cfg job` shows a whole configuration, `gvla2 plugins KIND NAME` the options of a choice.",
            "",
            "## Commands",
            "",
            *commands,
            "",
            "## Choices",
            "",
            *kinds,
            "",
            "[Presets](presets.md) set many options under one name.",
        ]
    )


def _command(name: str, config: type, registry: Registry) -> str:
    rows = [o for o in options(config) if not o.name.endswith(".name")]
    text = f"# `gvla2 {name}`\n\n{plain(config)}\n\n{_table(rows)}\n"
    fields = [group for group in registry.groups if f"{group}.name" in {o.name for o in options(config)}]
    if name == "run":
        fields = list(registry.groups)
    if fields:
        links = ", ".join(f"[`{g}=`](choices/{registry.kind_of(g).name}.md)" for g in fields)
        text += f"\n## Choices\n\nComponents are chosen by name, and their options follow: {links}.\n"
    return text


def _kind(kind: Kind, registry: Registry) -> str:
    hook = f"[`{kind.hook}`](../../hooks/{kind.hook}.md)"
    said = f"{kind.what[0].upper()}{kind.what[1:]}. The hook is {hook}; `gvla2 run` takes `{kind.default}` by default."
    parts = [f"# `{kind.name}=`", said]
    for name, offer in registry.offers(kind.name).items():
        parts += [f"## `{kind.name}={name}`", offer.component.summary]
        if offer.component.needs:
            needs = ", ".join(
                f"[`{need}=`]({registry.kind_of(need).name}.md)" for need in offer.component.needs
            )
            parts.append(f"Built with {needs}.")
        if text := plain(offer.component.config):
            parts.append(text)
        rows = options(offer.component.config)
        parts.append(_table(rows, f"{kind.name}.") if rows else "No options.")
    return "\n\n".join(parts) + "\n"


def _presets() -> str:
    parts = [
        "# Presets",
        "`gvla2 bench experiment=NAME` runs what a reported table was measured by; "
        "`gvla2 run +experiment=memory_NAME` is a run with that memory alone.",
    ]
    for group in PRESETS:
        rows = [
            f"| `{group}={f.stem}` | {_comment(f)} |" for f in sorted((ROOT / "conf" / group).glob("*.yaml"))
        ]
        parts.append("\n".join([f"## `{group}=`", "", "| preset | |", "|---|---|", *rows]))
    return "\n\n".join(parts) + "\n"


def _comment(file: Path) -> str:
    """The words that a preset begins with, up to the first full stop."""
    lines = []
    for line in file.read_text().splitlines():
        if line.startswith("# @"):
            continue
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return re.split(r"(?<=[.:;]) ", " ".join(lines))[0].replace("|", r"\|")


def _table(rows: Iterable[Option], before: str = "") -> str:
    lines = [f"| `{before}{o.name}` | {_code(o.type)} | {_code(o.default)} |" for o in rows]
    return "\n".join(["| option | type | default |", "|---|---|---|", *lines])


def _code(text: str) -> str:
    return f"`{text}`".replace("|", r"\|")


def _first(config: type) -> str:
    """The first sentence of a dataclass."""
    return re.split(r"(?<=[.:]) |\n\n", plain(config))[0].rstrip(":")


def plain(config: type) -> str:
    """A dataclass's own words as Markdown, "" where it has none."""
    text = inspect.getdoc(config) or ""
    if text.startswith(f"{config.__name__}(") or text == inspect.getdoc(ComponentConfig):
        return ""
    text = re.sub(r":\w+:`~?(?:[\w.]+\.)?(\w+)`", r"`\1`", text)
    return text.replace("``", "`")
