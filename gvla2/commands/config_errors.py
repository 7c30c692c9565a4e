"""Hydra's errors in gvla2's style: what was asked, what exists, what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import Any

from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    MissingConfigException,
    OverrideParseException,
)
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import (
    ConfigAttributeError,
    ConfigKeyError,
    MissingMandatoryValue,
    OmegaConfBaseException,
)

from gvla2.commands.primary import CONFIG_MODULE
from gvla2.errors import Gvla2Error, UnknownComponentError
from gvla2.plugins.discovery import closest, describe
from gvla2.plugins.registry import Registry


def explain(error: BaseException, registry: Registry | None = None) -> str:
    """One message for a person; ``registry`` lets it name broken plugins."""
    match error:
        case Gvla2Error():
            return str(error)
        case MissingConfigException():
            return _missing_choice(error, registry)
        case MissingMandatoryValue():
            return f"The option '{error.full_key}' has no default. Give it on the command line: {error.full_key}=..."
        case ConfigCompositionException() if isinstance(error.__cause__, OmegaConfBaseException):
            return _wrong_option(str(error), error.__cause__, registry)
        case OverrideParseException():
            return _unreadable(error)
        case HydraException():
            return str(error)
        case OmegaConfBaseException():
            return _wrong_option("The configuration is wrong:", error, registry)
        case _ if isinstance(error.__cause__, OmegaConfBaseException):
            return _wrong_option(str(error), error.__cause__, registry)
    notes = getattr(error, "__notes__", ())
    return " ".join([describe(error).rstrip(".") + ".", *notes]) if notes else describe(error)


def unreadable_choice(
    error: ValueError, overrides: Sequence[str], registry: Registry
) -> UnknownComponentError | None:
    """Hydra's refusal of a number where a choice is wanted (``planner=0.5``), named; None for another error."""
    if not str(error).startswith("Config group override must be"):
        return None
    for override in overrides:
        kind, _, values = override.lstrip("+").partition("=")
        offered = _offered(kind, registry)
        for value in values.split(","):  # a sweep has several
            if offered and value not in offered:
                note = registry.broken_note(kind) if kind in registry.groups else ""
                return UnknownComponentError(kind, value, offered, note)
    return None


def _offered(group: str, registry: Registry | None) -> list[str]:
    """The choices of a kind, or of a group that is files; none for what is no group."""
    if registry is not None and group in registry.groups:
        return list(registry.components(group))
    folder = files(CONFIG_MODULE) / group
    found = [Path(file.name) for file in folder.iterdir()] if folder.is_dir() else []
    return sorted(file.stem for file in found if file.suffix == ".yaml")


def _missing_choice(error: MissingConfigException, registry: Registry | None) -> str:
    group, _, name = (error.missing_cfg_file or "").rpartition("/")
    if not group:
        return str(error)
    name = name.removesuffix(".yaml")
    note = registry.broken_note(group) if registry is not None and group in registry.groups else ""
    return str(UnknownComponentError(group, name, error.options or _offered(group, registry), note))


def _unreadable(error: OverrideParseException) -> str:
    lines = [line for line in error.message.splitlines() if not line.startswith(("Error parsing", "See "))]
    key = error.override.partition("=")[0]
    return (
        f"'{error.override}' cannot be read: {' '.join(lines)}. A value with commas, equal signs or quotes needs its "
        f"own quotes inside the shell's: '{key}=\"...\"'."
    )


def _wrong_option(headline: str, cause: OmegaConfBaseException, registry: Registry | None) -> str:
    """For an unknown option, similar names or which other choices have it; for a wrong type, OmegaConf's message."""
    key = str(cause.full_key or cause.key or "")
    if isinstance(cause, ConfigKeyError | ConfigAttributeError):
        parent = cause.parent_node
        known = [str(k) for k in parent] if isinstance(parent, DictConfig) else []
        place, _, option = key.rpartition(".")
        of = f" of '{place}'" if place else ""
        chosen = (
            OmegaConf.select(parent, "name") if isinstance(parent, DictConfig) and "name" in known else None
        )
        of += f" ({chosen})" if chosen else ""
        listing = ", ".join(k for k in known if k not in ("name", "hydra")) or "none"
        advice = _of_a_part(option, parent) or _of_others(option, place, registry) or closest(option, known)
        return f"No option '{option}'{of}.{advice} Options: {listing}."
    reason = str(cause).partition("\n")[0]
    if "is not a ListConfig" in reason:
        return f"The option '{key}' takes a list: {key}=[...]."
    return f"The option '{key}' is wrong: {reason}" if key else f"{headline} {reason}".strip()


def _of_others(option: str, kind: str, registry: Registry | None) -> str:
    """Advice where other components of the kind have the option, as in a sweep over them."""
    if registry is None or kind not in registry.groups:
        return ""
    owners = [
        name
        for name, one in registry.components(kind).items()
        if option in {field.name for field in fields(one.config)}
    ]
    preset = f"a preset each (experiment=A,B) gives every {kind} of a sweep its own options"
    return f" {', '.join(owners)} {'has' if len(owners) == 1 else 'have'} it; {preset}." if owners else ""


def _of_a_part(option: str, parent: Any) -> str:
    """Advice where a chosen component has the option: ``objects.root=`` was meant as ``task.objects.root=``."""
    if not isinstance(parent, DictConfig):
        return ""
    parts = {str(part): OmegaConf.select(parent, str(part)) for part in parent}
    owners = [
        f"'{name}.{option}'"
        for name, part in parts.items()
        if isinstance(part, DictConfig) and option in part
    ]
    return f" Did you mean {' or '.join(owners)}?" if owners else ""
