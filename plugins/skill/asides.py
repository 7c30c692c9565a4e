"""Asides: what a sentence tells or asks beside its wish. Left unread, or kept only as what the wish is about."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from gvla2.planning.colours import FAMILIES
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.clauses import STOPS, noun_use
from gvla2_plugins.skill.words import noun_class, verbs_of, vocabulary


def wishes(tokens: Sequence[str], known: frozenset[str]) -> list[str]:
    """The tokens without asides, and with no more of statements and questions than the thing that they name.

    ``known`` are the words of the scene's labels.
    """
    kept: list[str] = []
    for words, stop in _segments(tokens):
        if (
            words[0] == "so"
            and words[1:2] != ["that"]
            and not lexicon.CONDITIONS & set(kept)
            and _no_wish(kept)
        ):
            kept, words = _topic(kept, known), words[1:]  # "we are to have some wine, so open it"
            kept += [","] * bool(kept)
        for at in (i for i, word in enumerate(words) if word in lexicon.SINCE and i):
            if _aside(words[at:], known):  # "open it for Nan"
                words = words[:at]
                break
            if words[at] == "so" and _aside(
                words[:at], known
            ):  # "it looks like rain so take the umbrella out"
                words = words[at + 1 :]
                break
        if _aside(words, known):
            words = []
        elif _tells(words, stop):
            words = _topic(words, known)
        kept += [*words, stop]
    return [t for i, t in enumerate(kept) if t and (t not in STOPS or (i and kept[i - 1] not in STOPS))]


def _segments(tokens: Sequence[str]) -> list[tuple[list[str], str]]:
    """The words between stops, each with the stop after it."""
    found: list[tuple[list[str], str]] = [([], "")]
    for token, following in pairwise([*tokens, ""]):
        if token in STOPS or (token in ("and", "but") and following in lexicon.SUBJECTS):
            found[-1] = (found[-1][0], token)
            found.append(([], ""))
        else:
            found[-1][0].append(token)
    return [(words, stop) for words, stop in found if words]


def _aside(words: Sequence[str], known: frozenset[str]) -> bool:
    """Whether it holds no wish, nothing that turns or delays one, and nothing of the scene."""
    said = set(words)
    if words == ["honey"]:
        return True
    if said & (lexicon.TURNING | set(lexicon.NUMBERS) - {"a", "an", "one"}) or _named(words, known):
        return False
    if said <= lexicon.PLACES | {"off", "out", "up", "down"}:  # "lamp: on"
        return False
    speaks = words[0] in lexicon.SUBJECTS or words[0] in lexicon.SINCE
    if "not" in said and not (
        {"i", "we", "my", "our"} & set(words[: words.index("not")]) or words[0] == "can"
    ):
        return False
    keeps = lexicon.WISHING | lexicon.STAYING | lexicon.LETTING
    about = lexicon.PRONOUNS & {*words[:1], *(w for v, w in pairwise(words) if v in keeps)}
    if about and said & keeps:
        return False
    if words[0] in ("so", "to") and len(words) > 1 and verbs_of(words[1]):
        return False
    if speaks:
        return words[1:2] not in (["it"], ["them"]) or len(words) > 2
    if words[0] in ("the", "an", "this", "these", "those"):  # "the guests are here", but not "the ketchup"
        return bool(said & lexicon.BEING)
    acting = any(verbs_of(word) and not noun_use(words, i) for i, word in enumerate(words))
    follows = words[1:2] and words[1] in lexicon.DETERMINERS | lexicon.PRONOUNS | {
        "me",
        "us",
        "up",
        "in",
        "into",
        "on",
    }
    return not acting and not (follows and words[0] not in vocabulary())


def _tells(words: Sequence[str], stop: str) -> bool:
    """Whether it says how things are or were, or asks that: no wish, whatever verbs are in it."""
    said = set(words)
    if lexicon.REPORTING.search(" ".join(words)):
        return True
    if said & lexicon.CONDITIONS and "remember" not in said:
        return False
    first = next((w for w in words if w not in ("please", "and", "well", "hey", "oh", "so", "now")), "")
    if lexicon.ASKED_OF & said and lexicon.MODALS & said:
        return False
    if first in lexicon.ASKED and (stop == "?" or first in lexicon.BEING - {"has", "have"}):
        return True
    acts = [i for i, word in enumerate(words) if verbs_of(word) and not noun_use(words, i)]
    if not acts:
        plain = not said & (
            lexicon.WISHING - lexicon.BEING | lexicon.PLACES | {"to", "that"} | lexicon.SHINING
        )
        return stop == "?" or (bool(said & lexicon.BEING) and plain)
    before = words[: acts[0]]
    if "too" in before or {"stop", "stopped", "thanks", "hope", "remember"} & set(before):
        return True
    if (lexicon.WISHING - lexicon.BEING | {"to"} | lexicon.MODALS) & set(before):
        return False
    told = before and (before[0] in lexicon.SUBJECTS or lexicon.BEING & set(before))
    return bool(told) or (stop == "?" and not lexicon.MODALS & said and acts[0] == 0)


def _no_wish(words: Sequence[str]) -> bool:
    """Whether it begins with no verb of doing: a reason."""
    first = next((w for w in words if w not in lexicon.MODALS | {"you", "just"}), "")
    return not verbs_of(first)


def _topic(words: Sequence[str], known: frozenset[str]) -> list[str]:
    """The first thing that is named, with its article and colour."""
    nouns = [
        i
        for i, word in enumerate(words)
        if noun_class(word) or word in known - set(FAMILIES) | set(lexicon.CONTENTS)
    ]
    if not nouns:
        return []
    begin = end = next((i for i in nouns if noun_class(words[i]) != "object"), nouns[0])
    while begin and (words[begin - 1] in FAMILIES or words[begin - 1] in lexicon.DETERMINERS):
        begin -= 1
    return list(words[begin : end + 1])


def _named(words: Sequence[str], known: frozenset[str]) -> bool:
    """Whether something is named that may be in the scene: by a noun, a colour, a side, or as the other one."""
    sides = {word for wordings in lexicon.SELECTORS.values() for w in wordings for word in w.split()}
    for i, word in enumerate(words):
        if word == "can" and not noun_use(words, i):
            continue
        vague = noun_class(word) == "object"
        if vague and i and words[i - 1] in ("the", "this", "that", "other"):
            return True
        if not vague and (noun_class(word) or word in FAMILIES or word in lexicon.CONTENTS):
            return True
        if word in known and not verbs_of(word):
            return True
        if word in ("left", "right", "middle", "front", "other") or (
            word in sides and words[i - 1 : i] == ["the"]
        ):
            return True
    return False
