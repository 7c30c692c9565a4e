"""From a sentence to an intent: what to do, to what, where to, how far. Clauses are cut, read, and combined."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from gvla2.planning.colours import FAMILIES, NEARLY
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.clauses import clauses, noun_use, phrase_at, wishes
from gvla2_plugins.skill.intents import Intent, combine, settle
from gvla2_plugins.skill.phrases import Phrase, read_phrase
from gvla2_plugins.skill.words import noun_class, take_length, tokenise, verbs_of

DYNAMIC = frozenset((*lexicon.RELATIONS["to"], "onto", "on to", "into", "in to")) - {"at"}
"""Wordings that always tell where something goes, not where it is."""
MARKERS = {
    **{wording: ("relation", name) for name, listed in lexicon.RELATIONS.items() for wording in listed},
    **{wording: ("selector", name) for name, listed in lexicon.SELECTORS.items() for wording in listed},
    **dict.fromkeys(lexicon.UNTIL, ("until", "")),
}
"""Wordings that part a clause, or single something out; what each is, and which."""
DIRECTED = {wording: ("direction", wording) for wording in lexicon.DIRECTIONS}
"""The same for skills that move something somewhere: "left" is a direction then, unless a noun follows."""
VERB_PHRASES: dict[str, list[tuple[str, list[str]]]] = {}
"""Verb to the skills that its phrases ask for, and the rest of each phrase."""
for _skill, _phrase in ((skill, p.split()) for skill, listed in lexicon.VERBS.items() for p in listed):
    VERB_PHRASES.setdefault(_phrase[0], []).append((_skill, _phrase[1:]))
OWNED = ("lid", "handle", "drawer")


@dataclass(frozen=True)
class _Chunk:
    """Words after a relation ("" for the first), and what they name; ``dynamic`` None: where something stands."""

    relation: str
    dynamic: bool | None
    phrase: Phrase


def heard(sentence: str, labels: Sequence[str] = ()) -> list[str]:
    """The words of a sentence's wishes, plainly put. ``labels`` are those of the scene."""
    text = " ".join(w if w in FAMILIES else NEARLY.get(w, w) for w in tokenise(sentence))
    for wording, plainer in lexicon.PLAINER:
        text = re.sub(wording, plainer, text)
    return wishes(text.split(), frozenset(word for label in labels for word in tokenise(label)))


def parse(sentence: str, labels: Sequence[str] = ()) -> Intent:
    """The intent of any text; never raises. ``labels`` of the scene count as known words."""
    tokens = heard(sentence, labels)
    if unread := lexicon.UNREAD.search(" ".join(tokens)):
        return Intent(trouble=f"what '{unread[0]}' means here is not read with certainty")
    parts, denied = clauses(tokens)
    read = [
        replace(said, joint=joint, denied=no, means=words[0] in ("use", "using"))
        for words, joint, no in parts
        if (said := _clause(words)) is not None
    ]
    intent = combine(read)
    denials = tuple((" ".join(words), _clause(list(words)) or Intent()) for words in denied)
    if intent.skill == "place" and any(d.skill == "pick" for _, d in denials):
        intent = replace(intent, skill="push")  # "move it there without lifting it"
    return replace(intent, denials=denials)


def _clause(tokens: list[str]) -> Intent | None:
    """The intent of one clause, None when there is nothing in it."""
    tokens, amount = take_length(tokens)
    if bare := next((t for t in tokens if t[-1].isdigit()), ""):
        return Intent("pick", trouble=f"what '{bare}' counts is not said, or it is a length too many")
    if (match := _verb(tokens)) is None:
        return _verbless(tokens, amount)
    skill, words, at = match
    rest = [i for i in range(len(tokens)) if i not in at or (i != at[0] and _tells_more(tokens, i, at[0]))]
    chunks, direction = _chunks([tokens[i] for i in rest if i > at[0]], skill)
    ahead = _chunks([tokens[i] for i in rest if i < at[0]], skill)[0]
    chunks += [c for c in ahead[1:] if c.dynamic]  # "to the square push the block"
    if chunks[0].phrase.empty and not ahead[0].phrase.empty:  # "the block should be pushed"
        chunks[0] = ahead[0]
    odd = {c.relation for c in chunks[1:] if c.phrase.unknown and not (c.phrase.noun or c.phrase.colour)}
    if skill in (*lexicon.WORKED, "press") and odd & ({"with", "in"} if skill == "press" else {"with"}):
        return Intent(skill, trouble="what it is to be done with, or where, is not understood")
    if skill == "push" and any(c.relation == "with" and c.phrase.noun for c in chunks[1:]):
        return Intent(skill, trouble="what it is to be done with is not in the hand")
    theme, goal, relation = _roles(skill, chunks)
    nothing = theme is None or theme.everywhere
    if nothing and skill in ("unsupported", *lexicon.WORKED) and lexicon.HAND & set(tokens):
        return None  # "close your hand and push ...", "with the gripper closed"
    if skill == "push" and goal is None and direction is None and "up" in tokens:
        skill = "pull"  # "slide the umbrella up"
    return settle(Intent(skill, " ".join(words), theme, goal, relation, amount, direction))


def _tells_more(tokens: Sequence[str], i: int, verb_at: int) -> bool:
    """Whether a word of a verb's phrase also says something of its own: "turn the lid", "pull it out of the tower"."""
    word, following = tokens[i], "".join(tokens[i + 1 : i + 2])
    if word == "off":  # "screw the lid off the jar", but "screw off the lid"
        named = following in lexicon.DETERMINERS or following in FAMILIES or noun_class(following)
        return bool(named) and i > verb_at + 1
    over = word == "over" and following in lexicon.DETERMINERS  # "flip the lid back over the box"
    return over or word == "from" or following == "of" or noun_class(word) in lexicon.PARTS


def _verb(tokens: Sequence[str]) -> tuple[str, tuple[str, ...], tuple[int, ...]] | None:
    """The verb phrase of a clause, the one with most words, then the first: its skill, its words and where they are."""
    found = []
    for i, token in enumerate(tokens):
        bases = frozenset() if noun_use(tokens, i) else verbs_of(token)
        for base in sorted(bases):
            for skill, rest in VERB_PHRASES[base]:
                if at := _rest_at(tokens, i, rest):
                    found.append((skill, (base, *(w for w in rest if w != "*")), at))
    return max(found, key=lambda m: (len(m[2]), -m[2][0], m[0] != "unsupported"), default=None)


def _rest_at(tokens: Sequence[str], i: int, rest: Sequence[str]) -> tuple[int, ...]:
    """Positions of a verb at ``i`` and the rest of its phrase, "*" standing for any words between; () if absent."""
    at = [i]
    for before, word in pairwise(("", *rest)):
        end = len(tokens) if before == "*" else min(at[-1] + 2, len(tokens))
        spots = [j for j in range(at[-1] + 1, end) if tokens[j] == word]
        if word != "*" and not spots:
            return ()
        at += spots[-1:]
    return tuple(at)


def _verbless(tokens: list[str], amount: float | None) -> Intent | None:
    """A clause without a known verb: a wish ("I want the cube on the tray", "the lamp should be on"), or just words."""
    wish = bool(lexicon.WISHING & set(tokens))
    chunks, direction = _chunks(["it" if t == "it's" else t for t in tokens], "place")
    theme, goal, relation = _roles("place", chunks)
    last = next((t for t in reversed(tokens) if t not in lexicon.FILLERS), "")
    if theme is not None and theme.noun == "lamp" and (last == "on" or last in lexicon.SHINING):
        return Intent("press", last, theme)
    if wish and theme is not None and goal is not None:
        return Intent("place", "want", theme, goal, relation, amount, direction)
    anywhere = [c for c in chunks[1:] if c.phrase.everywhere]  # "off the table", "into the air"
    aloft = any(c.relation == "from" or {"air", "sky"} & set(c.phrase.text.split()) for c in anywhere)
    if lexicon.LETTING & set(tokens) and lexicon.SUPPORTS & set(tokens) and not aloft:
        return Intent("unsupported", "keep")  # "... but keep it on the table"
    words = [t for t in tokens if t.isalpha()]
    idle = lexicon.DETERMINERS | lexicon.FILLERS
    verb = words[1:2] and words[1] in lexicon.DETERMINERS  # "squash the cube onto the tray"
    brief = bool(words) and not verb and words[0] not in idle and words[-1] not in lexicon.FILLERS - {"table"}
    away = aloft or any(c.relation == "from" and not c.phrase.empty for c in chunks[1:])
    named = theme is not None and theme.noun not in ("", "lamp") and not theme.unknown
    needed = named and lexicon.NEEDING.search(" ".join(tokens))  # "I need the umbrella"
    if (aloft and (brief or theme is None)) or (wish and theme is not None and away) or needed:
        return Intent("pick", "want", theme, amount=amount)  # "the cube up in the air"
    if theme is not None and goal is not None and not any(c.dynamic for c in chunks):
        theme = replace(theme, landmark=(relation, goal))  # "there is a cube on the tray"
        goal, relation = None, ""
    return Intent("", " ".join(words), theme, goal, relation, amount, direction, brief=brief)


def _chunks(tokens: list[str], skill: str) -> tuple[list[_Chunk], tuple[float, float] | None]:
    """The clause's words parted at relations, selectors set aside, and a direction if there is one."""
    parts: list[tuple[str, bool | None, list[str], list[str]]] = [("", False, [], [])]
    direction: tuple[float, float] | None = None
    i = 0
    while i < len(tokens):
        wording, kind, value = _marker(tokens, i, moving=skill in ("push", "place"))
        if kind == "relation":
            stands = tokens[i - 1 : i] == ["standing"]
            parts.append((value, None if stands else wording in DYNAMIC, [], []))
        elif kind == "selector":
            parts[-1][3].append(value)
        elif kind == "direction":
            direction = lexicon.DIRECTIONS[value]
        elif not kind:
            wording = tokens[i]
            parts[-1][2].append(wording)
        i += len(wording.split())
    return [_Chunk(r, d, read_phrase(t, s)) for r, d, t, s in parts], direction


def _marker(tokens: Sequence[str], i: int, *, moving: bool) -> tuple[str, str, str]:
    """The longest relation, selector or direction at ``i``: wording, kind, value; all "" when there is none."""
    table = {**MARKERS, **DIRECTED} if moving else MARKERS
    wording = phrase_at(tokens, i, table)
    kind, value = table.get(wording, ("", ""))
    following = "".join(tokens[i + len(wording.split()) :][:1])
    if noun_class(following) or following in FAMILIES or following in ("most", "hand"):
        kind, value = MARKERS.get(wording, (kind, value))  # "the left cube"
    if kind == "selector" and following == "of" and " " not in wording:
        return "", "", ""  # "the middle of the square" singles nothing out
    return wording, kind, value


def _roles(skill: str, chunks: Sequence[_Chunk]) -> tuple[Phrase | None, Phrase | None, str]:
    """Theme, goal and the goal's relation. What is no goal says where the theme (or the goal) is."""
    theme = chunks[0].phrase
    shown = next((c.phrase for c in chunks[1:2] if c.relation == "with"), None)
    if shown is not None and shown.noun in lexicon.PARTS and theme.noun == "object" and not theme.colour:
        theme = replace(theme, colour=shown.colour)  # "the thing with the green handle"
    told = [c for c in chunks[1:] if c.relation != "with" and not c.phrase.empty and not c.phrase.everywhere]
    aim = _aim(skill, theme, told)
    goal, relation = None, ""
    for chunk in told:
        phrase = chunk.phrase
        if chunk is aim:
            goal, relation = phrase, chunk.relation
        elif goal is not None and chunk.relation != "from":
            goal = replace(goal, landmark=(chunk.relation, phrase))
        elif (skill == "press" and chunk.relation in ("on", "in", "to")) or (
            skill in lexicon.WORKED and theme.noun in OWNED and theme.owner is None
        ):
            theme = replace(theme, owner=phrase)
        else:
            theme = replace(theme, landmark=(chunk.relation, phrase), stands=chunk.dynamic is None)
    return (None if theme.empty and not theme.landmark and not theme.everywhere else theme), goal, relation


def _aim(skill: str, theme: Phrase, told: Sequence[_Chunk]) -> _Chunk | None:
    """Where it goes; a taking says where the thing is, unless "it" is already known: "bring it beside the cup"."""
    if skill in ("pick", "press", "unsupported", "open", "close"):
        return None
    taking = skill == "pull" or (skill in ("fetch", "twist") and not theme.pronoun)
    aims = [c for c in told if c.relation != "from" and (c.dynamic or (c.dynamic is not None and not taking))]
    return next((c for c in aims if c.dynamic), aims[0] if aims else None)
