"""The command line of `gvla2 memory`: verb, words, flags, and overrides for Hydra."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gvla2.discovery import closest

_OVERRIDE = re.compile(r"[+~]{0,2}[A-Za-z_][\w./@:-]*=.*", re.DOTALL)
_WITH_VALUE = ("--cfg", "-c", "--package", "-p", "--config-dir", "-cd", "--info", "-i")
_ALONE = ("--resolve", "--hydra-help")
_VERBATIM = re.compile(r"(bank|url|head)=(?!'.*'$|\".*\"$)(.*)", re.DOTALL)
_SWEEPS = ("-m", "--multirun", "--experimental-rerun")


class UsageError(Exception):
    """The command line cannot be understood; the message says how it is used."""


@dataclass
class Invocation:
    """What was asked. ``overrides`` go to Hydra; ``hydra_asks`` where they ask Hydra itself for something."""

    verb: str = ""
    words: list[str] = field(default_factory=list)
    overrides: list[str] = field(default_factory=list)
    json: bool = False
    yes: bool = False
    help: bool = False
    hydra_asks: bool = False


def understood(argv: Sequence[str], verbs: Mapping[str, tuple[int, int | None]]) -> Invocation:
    """Read the command line; ``verbs`` give the least and most words each takes (None: any number).

    Raises :class:`UsageError`.
    """
    asked = Invocation()
    rest = list(argv)
    plain: list[str] = []
    while rest:
        word = rest.pop(0)
        if word == "--":
            plain += rest
            break
        if word in ("-h", "--help"):
            asked.help = True
        elif word == "--json":
            asked.json = True
        elif word in ("-y", "--yes"):
            asked.yes = True
        elif word in _WITH_VALUE:
            asked.overrides += [word, *rest[:1]]
            asked.hydra_asks |= word in ("--cfg", "-c", "--info", "-i")
            rest = rest[1:]
        elif word in _ALONE:
            asked.overrides.append(word)
            asked.hydra_asks |= word == "--hydra-help"
        elif word in _SWEEPS:
            raise UsageError("`gvla2 memory` looks at one bank at a time: it takes no sweeps.")
        elif _OVERRIDE.fullmatch(word):
            asked.overrides.append(word)
        elif word.startswith("-") and len(word) > 1:
            flags = ("--json", "--yes", "--help", *_WITH_VALUE, *_ALONE)
            raise UsageError(f"No option '{word}'.{closest(word, flags)} See `gvla2 memory --help`.")
        else:
            plain.append(word)
    asked.verb, asked.words = (plain[0], plain[1:]) if plain else ("", [])
    if asked.verb and asked.verb not in verbs:
        known = ", ".join(verbs)
        raise UsageError(
            f"No verb '{asked.verb}' of `gvla2 memory`.{closest(asked.verb, verbs)} Verbs: {known}."
        )
    if asked.verb and not asked.help and not asked.hydra_asks:
        _check(asked, *verbs[asked.verb])
    return asked


def as_typed(override: str) -> str:
    """The override with quotes for Hydra where its value is a name: 2026_11 is not a number, true not a boolean.

    A quoted value stays as it is.
    """
    found = _VERBATIM.fullmatch(override)
    if not found:
        return override
    value = re.sub(r"(\\*)('|$)", lambda m: m[1] * 2 + ("\\'" if m[2] else ""), found[2])
    return f"{found[1]}='{value}'"


def wants_json(argv: Sequence[str]) -> bool:
    """Whether a command line, valid or not, asks for JSON."""
    return "--json" in (argv[: argv.index("--")] if "--" in argv else argv)


def _check(asked: Invocation, fewest: int, most: int | None) -> None:
    """Raises :class:`UsageError` for too few or too many words, and for --yes where nothing is asked."""
    see = f"See `gvla2 memory {asked.verb} --help`."
    if len(asked.words) < fewest or not all(word.strip() for word in asked.words):
        raise UsageError(
            f"`gvla2 memory {asked.verb}` needs {'an argument' if fewest == 1 else 'arguments'}. {see}"
        )
    if most is not None and len(asked.words) > most:
        raise UsageError(f"`gvla2 memory {asked.verb}` does not take '{asked.words[most]}'. {see}")
    if asked.yes and asked.verb != "forget":
        raise UsageError(f"--yes is only for forget. {see}")
    if asked.json and asked.verb == "forget" and not asked.yes:
        raise UsageError(f"`gvla2 memory forget --json` cannot ask for consent: it needs --yes. {see}")
