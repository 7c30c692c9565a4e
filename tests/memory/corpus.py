"""Random lessons in several languages, by a seed: for the exactness of retrieval.

Sentences combine words from robots' kitchens and shells with made-up names with the frequencies of natural language
(Zipf), so that banks have both common and rare words.
"""

import hashlib

import numpy as np

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.records import Record

LANGUAGES: tuple[tuple[str, ...], ...] = (
    ("{} the {} {} {} near the wall, {} cm from the edge; {}",
     "pick up|push|open|close|rotate|place|wipe|stack|press|restart|compile|delete",
     "red|small|heavy|wet|fragile|wooden|blue|empty|hot|left|upper|old",
     "cube|mug|drawer|bottle|lamp|plate|towel|sponge|file|server|config|jar"),
    ("{} die {} {} {} um {} cm; {}", "hebe|schiebe|öffne|drehe|drücke|lege", "rote|kleine|schwere|nasse|leere",
     "Tasse|Schublade|Flasche|Lampe|Kiste|Tür"),
    ("{}{}{} {} 离杯子{}厘米; {}", "拿起|推动|打开|关闭|旋转", "红色|小|重|空|热", "方块|杯子|抽屉|瓶子|台灯"),
)  # fmt: skip
REASONS = (
    "the fingers slipped twice before|approach from above|check the exit status first|the path was blocked"
)


def lessons(count: int, seed: int = 0, *, now: float = 1.8e9) -> list[Record]:
    """``count`` active records, most of them hints, all different in text and id."""
    rng = np.random.default_rng(seed)
    return [_record(i, now, rng) for i in range(count)]


def tasks(count: int, seed: int = 1) -> list[MemoryTask]:
    """``count`` queries in the words of :func:`lessons`, of which some name a skill."""
    rng = np.random.default_rng(seed)
    return [
        MemoryTask(_sentence(rng).split(";")[0], _skill(rng) if rng.random() < 0.3 else "")
        for _ in range(count)
    ]


def _record(i: int, now: float, rng: np.random.Generator) -> Record:
    query, content = _sentence(rng).split(";")[0], f"{_sentence(rng)} ({i})"
    fails, age = rng.random() < 0.3, float(rng.exponential(20.0)) * 86400
    key = hashlib.blake2b(f"{query}\n{content}".encode(), digest_size=16).hexdigest()
    return Record(
        id=f"hint-{key[:12]}",
        bank="default",
        query=query,
        content=content,
        type="failure_avoidance" if fails else "procedural_hint" if rng.random() < 0.8 else "tool_usage",
        state="active",
        outcome="verified_fail" if fails else "verified_success" if rng.random() < 0.9 else "uncertain",
        confidence=round(float(rng.beta(5, 2)), 6),
        quality=round(float(rng.beta(5, 2)), 6),
        dedup_key=key,
        created=now - age,
        updated=now - age,
        usage=int(rng.geometric(0.4)) - 1,
        skill=_skill(rng),
    )


def _sentence(rng: np.random.Generator) -> str:
    template, verbs, adjectives, nouns = LANGUAGES[int(rng.choice(3, p=(0.7, 0.2, 0.1)))]
    name = "".join("karomitelsuvinorpa"[2 * int(d) :][:2] for d in str(int(rng.zipf(1.3)) % 30_000))
    words = (_one(rng, verbs), _one(rng, adjectives), _one(rng, nouns))
    return template.format(*words, name, int(rng.integers(1, 60)), _one(rng, REASONS))


def _one(rng: np.random.Generator, joined: str) -> str:
    """The first words are the common ones."""
    words = joined.split("|")
    return words[min(int(rng.exponential(len(words) / 3)), len(words) - 1)]


def _skill(rng: np.random.Generator) -> str:
    return _one(rng, "pick|push||press|place")
