"""Random lessons in several languages, by a seed: for the speed and the exactness of retrieval at any size.

Sentences combine words from robots' kitchens, workshops and shells with made-up names with the frequencies of natural
language (Zipf), so that banks have both common and rare words.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import Record, dump

_SETS: tuple[tuple[float, tuple[str, ...], tuple[str, ...], tuple[str, ...], str], ...] = (
    (
        0.6,
        ("pick up", "push", "open", "close", "rotate", "place", "wipe", "stack", "press", "pour", "insert", "fold",
         "restart", "compile", "delete", "rename", "merge", "inspect", "tighten", "slide"),
        ("cube", "mug", "drawer", "bottle", "lamp", "plate", "towel", "sponge", "button", "valve", "cable", "box",
         "file", "branch", "server", "test suite", "config", "wrench", "jar", "pan", "door", "handle", "tray"),
        ("red", "small", "heavy", "wet", "fragile", "wooden", "metal", "blue", "empty", "hot", "left", "upper",
         "old", "broken", "round", "slippery"),
        "{verb} the {adjective} {noun} {name} near the {noun2}, {number} cm from the edge; {reason}",
    ),
    (
        0.15,
        ("hebe", "schiebe", "öffne", "drehe", "drücke", "lege", "wische", "stapele"),
        ("Würfel", "Tasse", "Schublade", "Flasche", "Lampe", "Teller", "Schlüssel", "Kiste", "Tür"),
        ("rote", "kleine", "schwere", "nasse", "leere", "heiße", "linke", "obere"),
        "{verb} die {adjective} {noun} {name} neben {noun2} um {number} cm; {reason}",
    ),
    (
        0.1,
        ("soulève", "pousse", "ouvre", "ferme", "tourne", "essuie"),
        ("cube", "tasse", "tiroir", "bouteille", "lampe", "assiette", "clé", "boîte"),
        ("rouge", "petit", "lourd", "vide", "chaud", "fragile"),
        "{verb} le {noun} {adjective} {name} à {number} cm de {noun2} ; {reason}",
    ),
    (
        0.1,
        ("拿起", "推动", "打开", "关闭", "旋转", "按下"),
        ("方块", "杯子", "抽屉", "瓶子", "台灯", "盘子", "盒子"),
        ("红色", "小", "重", "空", "热", "左边"),
        "{verb}{adjective}{noun} {name} 离{noun2}{number}厘米; {reason}",
    ),
    (
        0.05,
        ("подними", "толкни", "открой", "закрой", "поверни"),
        ("куб", "кружку", "ящик", "бутылку", "лампу", "тарелку"),
        ("красный", "маленький", "тяжёлый", "пустой"),
        "{verb} {adjective} {noun} {name} рядом с {noun2} на {number} см; {reason}",
    ),
)  # fmt: skip
_REASONS = (
    "the fingers slipped twice before", "grasp deeper than the rim", "approach from above", "slow down at the end",
    "check the exit status first", "the path was blocked", "wait until it stops moving", "use both hands",
    "keep the wrist level", "it tips over otherwise", "read the log before trying again", "the light was off",
)  # fmt: skip
_SYLLABLES = (
    "ka", "ro", "mi", "tel", "su", "vin", "or", "pa", "lex", "dun", "ga", "shi", "be", "nor", "qua", "ze",
)  # fmt: skip


def lessons(count: int, seed: int = 0, *, now: float = 1.8e9) -> list[Record]:
    """``count`` records, most of them active hints, all different in text and id."""
    rng = np.random.default_rng(seed)
    return [_record(i, now, rng) for i in range(count)]


def tasks(count: int, seed: int = 1) -> list[MemoryTask]:
    """``count`` queries in the words of :func:`lessons`, of which some name a scene's numbers and a skill."""
    rng = np.random.default_rng(seed)
    return [
        MemoryTask(_sentence(rng).split(";")[0], _signature(rng), _skill(rng) if rng.random() < 0.3 else "")
        for _ in range(count)
    ]


def _record(i: int, now: float, rng: np.random.Generator) -> Record:
    query, content = _sentence(rng).split(";")[0], _sentence(rng)
    fails = rng.random() < 0.3
    age = float(rng.exponential(20.0)) * 86400
    record = Record(
        id="",
        bank="default",
        query=query,
        content=f"{content} ({i})",
        type="failure_avoidance" if fails else "procedural_hint" if rng.random() < 0.8 else "tool_usage",
        state="active" if rng.random() < 0.97 else "summary",
        outcome="verified_fail" if fails else "verified_success" if rng.random() < 0.9 else "uncertain",
        confidence=round(float(rng.beta(5, 2)), 6),
        quality=round(float(rng.beta(5, 2)), 6),
        dedup_key="",
        created=now - age,
        updated=now - age,
        usage=int(rng.geometric(0.4)) - 1,
        skill=_skill(rng),
        signature=dump(_signature(rng)),
    )
    key = hashlib.blake2b(f"{query}\n{record.content}{i}".encode(), digest_size=16).hexdigest()
    return replace(record, id=f"hint-{key[:12]}", dedup_key=key)


def _sentence(rng: np.random.Generator) -> str:
    weights = [entry[0] for entry in _SETS]
    _, verbs, nouns, adjectives, template = _SETS[int(rng.choice(len(_SETS), p=weights))]
    return template.format(
        verb=_one(rng, verbs),
        noun=_one(rng, nouns),
        noun2=_one(rng, nouns),
        adjective=_one(rng, adjectives),
        name=_name(int(rng.zipf(1.3)) % 30_000),
        number=int(rng.integers(1, 60)),
        reason=_one(rng, _REASONS),
    )


def _one(rng: np.random.Generator, words: tuple[str, ...]) -> str:
    """The first words are the common ones."""
    return words[min(int(rng.exponential(len(words) / 3)), len(words) - 1)]


def _name(number: int) -> str:
    """A made-up name, the same for the same number."""
    name = ""
    while True:
        name += _SYLLABLES[number % len(_SYLLABLES)]
        number //= len(_SYLLABLES)
        if not number:
            return name


def _skill(rng: np.random.Generator) -> str:
    return _one(rng, ("pick", "push", "", "press", "place"))


def _signature(rng: np.random.Generator) -> dict[str, Any]:
    if rng.random() < 0.4:
        return {}
    names = ("theme_length", "theme_width", "theme_height", "objects", "distance")
    return {name: round(float(rng.lognormal(-2.5, 0.3)), 4) for name in names if rng.random() < 0.9}
