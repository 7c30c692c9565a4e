"""From a sentence to an intent: what to do, to what, where to, how far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.phrases import Phrase, read_phrase
from gvla2_plugins.skill.words import is_gerund, noun_class, spell, take_length, tokenise, verbs_of

STOPS = frozenset(",.;:!?")
DYNAMIC = ("onto", "on to", "into", "in to", "to", "over to", "across to", "up to", "all the way to", "toward",
           "towards", "against")  # fmt: skip
"""Wordings that always tell where something goes, not where it is."""


@dataclass(frozen=True)
class Intent:
    """What a sentence asks for. ``skill`` is "" when no verb was understood; ``verb`` is how it was worded.

    ``relation`` is that of the goal (on, in, to, beside, ...); ``amount`` metres; ``direction`` a unit vector (x, y)
    in the robot's frame. ``trouble`` says why a sentence with known words cannot be followed. ``notes`` are
    guesses made on the way.
    """

    skill: str = ""
    verb: str = ""
    theme: Phrase | None = None
    goal: Phrase | None = None
    relation: str = ""
    amount: float | None = None
    direction: tuple[float, float] | None = None
    trouble: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Match:
    skill: str
    words: tuple[str, ...]
    at: tuple[int, ...]


@dataclass(frozen=True)
class _Chunk:
    """Words after a relation ("" for the first), and what singles out among them."""

    relation: str
    dynamic: bool
    tokens: tuple[str, ...]
    selectors: tuple[str, ...]

    def phrase(self) -> Phrase:
        return read_phrase(self.tokens, self.selectors)


def parse(sentence: str, labels: Sequence[str] = (), spelling: float = 0.7) -> Intent:
    """The intent of any text; never raises. ``labels`` of the scene count as known words."""
    known = frozenset(word for label in labels for word in tokenise(label))
    tokens, notes = spell(tokenise(sentence), spelling, known)
    intents = [i for i in (_clause(c) for c in _clauses(tokens)) if i is not None]
    return replace(_combine(intents), notes=tuple(notes))


def _clauses(tokens: Sequence[str]) -> list[list[str]]:
    """Clauses: parted at stops, at "and", "then", "by pushing" and "to press"; negated ones are left out."""
    clauses: list[list[str]] = [[]]
    skipping = False
    for i, token in enumerate(tokens):
        following = tokens[i + 1] if i + 1 < len(tokens) else ""
        if token in STOPS or token in ("and", "then", "but", "while"):
            clauses.append([])
            skipping = False
        elif _phrase_at(tokens, i, lexicon.NEGATIONS):
            clauses.append([])
            skipping = True
        elif (token in ("by", "through") and is_gerund(following)) or (
            token in ("to", "so") and verbs_of(following) and not _noun_use(tokens, i + 1) and clauses[-1]
        ):
            clauses.append([])
            skipping = False
        elif not skipping:
            clauses[-1].append(token)
    return [c for c in clauses if c]


def _phrase_at(tokens: Sequence[str], i: int, phrases: Sequence[str]) -> str:
    """The longest of ``phrases`` that stands at position ``i``, or ""."""
    found = [p for p in phrases if list(tokens[i : i + len(p.split())]) == p.split()]
    return max(found, key=len, default="")


def _clause(tokens: list[str]) -> Intent | None:
    """The intent of one clause, None when there is nothing in it."""
    tokens, amount = take_length(tokens)
    match = _verb(tokens)
    if match is None:
        return _verbless(tokens, amount)
    consumed = set(match.at)
    after = [t for i, t in enumerate(tokens) if i not in consumed and i > match.at[0]]
    before = [t for i, t in enumerate(tokens) if i not in consumed and i < match.at[0]]
    chunks, direction = _chunks(after, match.skill)
    if chunks[0].phrase().empty:
        subject = _chunks(before, match.skill)[0][0]
        if not subject.phrase().empty:  # "the block should be pushed"
            chunks[0] = subject
    theme, goal, relation = _roles(match.skill, chunks)
    intent = Intent(match.skill, " ".join(match.words), theme, goal, relation, amount, direction)
    return _settle(intent)


def _verb(tokens: Sequence[str]) -> _Match | None:
    """The verb phrase of a clause: the one with most words, then the first."""
    found: list[_Match] = []
    for i, token in enumerate(tokens):
        bases = verbs_of(token)
        if not bases or _noun_use(tokens, i):
            continue
        for skill, phrases in lexicon.VERBS.items():
            for phrase in phrases:
                first, *rest = phrase.split()
                if first in bases and (at := _rest_at(tokens, i, rest)) is not None:
                    found.append(_Match(skill, (first, *(w for w in rest if w != "*")), at))
        found += [_Match("unsupported", (base,), (i,)) for base in sorted(bases & lexicon.UNSUPPORTED)]
    return max(found, key=lambda m: (len(m.at), -m.at[0], m.skill != "unsupported"), default=None)


def _rest_at(tokens: Sequence[str], i: int, rest: Sequence[str]) -> tuple[int, ...] | None:
    """Positions of a verb at ``i`` and the rest of its phrase, "*" standing for any words between; None if absent."""
    at = [i]
    apart = False
    for word in rest:
        if word == "*":
            apart = True
            continue
        after = at[-1] + 1
        if after < len(tokens) and tokens[after] == word:
            at.append(after)
        elif apart and word in tokens[after:]:
            at.append(max(j for j in range(after, len(tokens)) if tokens[j] == word))
        else:
            return None
        apart = False
    return tuple(at)


def _noun_use(tokens: Sequence[str], i: int) -> bool:
    """Whether a word that can be verb or noun is a noun here: after an article, a colour or an adjective."""
    if i == 0:
        return False
    before = tokens[i - 1]
    adjectives = {w for words in lexicon.SELECTORS.values() for w in words}
    if before in ("this", "that", "another", "s", "single"):
        return bool(noun_class(tokens[i]))
    return (
        before in lexicon.DETERMINERS
        or before in lexicon.COLOUR_WORDS
        or before in adjectives
        or before == "'s"
    )


def _verbless(tokens: Sequence[str], amount: float | None) -> Intent | None:
    """A clause without a known verb: a wish ("I want the cube on the tray", "the lamp should be on"), or just words."""
    wish = any(
        t in tokens for t in ("want", "like", "need", "should", "must", "belongs", "goes", "shall", "let")
    )
    chunks, direction = _chunks(tokens, "place")
    theme, goal, relation = _roles("place", chunks)
    if theme is not None and theme.noun == "lamp" and tokens[-1] == "on":
        return Intent("press", "on", theme)
    if wish and theme is not None and goal is not None:
        return Intent("place", "want", theme, goal, relation, amount, direction)
    words = [t for t in tokens if t.isalpha()]
    known_only = all(t in lexicon.FILLERS | lexicon.DETERMINERS | lexicon.PRONOUNS for t in words)
    if known_only and amount is None and direction is None and goal is None:
        return None
    return Intent("", " ".join(words), theme, goal, relation, amount, direction)


def _chunks(tokens: Sequence[str], skill: str) -> tuple[list[_Chunk], tuple[float, float] | None]:
    """The clause's words parted at relations, selectors set aside, and a direction if there is one."""
    chunks: list[tuple[str, bool, list[str], list[str]]] = [("", False, [], [])]
    direction: tuple[float, float] | None = None
    i = 0
    while i < len(tokens):
        filler = _phrase_at(tokens, i, lexicon.UNTIL)
        wording, kind, value = _marker(tokens, i, skill)
        if filler and len(filler) >= len(wording):
            i += len(filler.split())
        elif kind == "relation":
            chunks.append((value, wording in DYNAMIC or wording.startswith("until"), [], []))
            i += len(wording.split())
        elif kind == "selector":
            chunks[-1][3].append(value)
            i += len(wording.split())
        elif kind == "direction":
            direction = lexicon.DIRECTIONS[wording]
            i += len(wording.split())
        else:
            chunks[-1][2].append(tokens[i])
            i += 1
    return [_Chunk(r, d, tuple(t), tuple(s)) for r, d, t, s in chunks], direction


def _marker(tokens: Sequence[str], i: int, skill: str) -> tuple[str, str, str]:
    """The longest relation, selector or direction at ``i``: wording, kind, value; all "" when there is none."""
    found: list[tuple[str, str, str]] = []
    for relation, wordings in lexicon.RELATIONS.items():
        if wording := _phrase_at(tokens, i, wordings):
            found.append((wording, "relation", relation))
    for selector, wordings in lexicon.SELECTORS.items():
        if wording := _phrase_at(tokens, i, wordings):
            found.append((wording, "selector", selector))
    moves = skill in ("push", "place")
    if wording := _phrase_at(tokens, i, tuple(lexicon.DIRECTIONS)):
        side = "left" if "left" in wording else "right" if "right" in wording else ""
        if moves:
            found.append((wording, "direction", wording))
        elif side and " " in wording:  # "pick up the cube to the left"
            found.append((wording, "selector", side))
    if not found:
        return "", "", ""
    longest = max(len(w) for w, _, _ in found)
    best = [f for f in found if len(f[0]) == longest]
    following = tokens[i + len(best[0][0].split()) :][:1]
    adjective = bool(following) and (
        bool(noun_class(following[0]))
        or following[0] in lexicon.COLOUR_WORDS
        or following[0] in ("most", "hand")
    )
    if following == ["of"] and " " not in best[0][0] and best[0][1] == "selector":
        return "", "", ""  # "the middle of the square" singles nothing out
    wanted = "selector" if adjective else "direction"
    return next((f for f in best if f[1] == wanted), best[0])


def _roles(skill: str, chunks: Sequence[_Chunk]) -> tuple[Phrase | None, Phrase | None, str]:
    """Theme, goal and the goal's relation. What is no goal says where the theme (or the goal) is."""
    theme = chunks[0].phrase()
    told = [(c, c.phrase()) for c in chunks[1:] if c.relation != "with"]
    told = [(c, p) for c, p in told if not p.empty and not p.everywhere]
    goal_at = _goal_index(skill, told)
    goal, relation = None, ""
    for k, (chunk, phrase) in enumerate(told):
        if k == goal_at:
            goal, relation = phrase, chunk.relation
        elif goal is not None and chunk.relation != "from":
            goal = replace(goal, landmark=(chunk.relation, phrase))
        elif skill == "press" and chunk.relation in ("on", "in", "to"):
            theme = replace(theme, owner=phrase)
        else:
            theme = replace(theme, landmark=("on" if chunk.relation == "from" else chunk.relation, phrase))
    return (None if theme.empty and not theme.landmark and not theme.everywhere else theme), goal, relation


def _goal_index(skill: str, told: Sequence[tuple[_Chunk, Phrase]]) -> int:
    if skill in ("pick", "press", "unsupported"):
        return -1
    aims = [k for k, (c, _) in enumerate(told) if c.relation != "from"]
    if skill == "fetch":
        aims = [k for k in aims if told[k][0].dynamic]
    dynamic = [k for k in aims if told[k][0].dynamic]
    return (dynamic or aims or [-1])[0]


def _settle(intent: Intent) -> Intent:
    """Which skill a wording means, now that it is known what it is done to."""
    noun = intent.theme.noun if intent.theme is not None else ""
    if intent.skill == "fetch":
        return replace(intent, skill="place" if intent.goal is not None or intent.direction else "pick")
    if intent.skill == "push" and noun == "button" and intent.goal is None and intent.direction is None:
        return replace(intent, skill="press")
    if intent.skill == "press" and intent.verb == "push down" and noun not in ("", "button", "lamp"):
        return replace(intent, skill="push")
    if intent.skill == "place" and noun == "lamp" and intent.goal is None and intent.direction is None:
        return replace(intent, skill="press")  # "put the light on"
    return intent


def _combine(intents: Sequence[Intent]) -> Intent:
    """One intent of a sentence's clauses: "grab the cube and put it on the tray" is one placing."""
    hand = [i for i in intents if i.skill == "unsupported" and i.theme is not None and i.theme.everywhere]
    intents = [i for i in intents if i not in hand]  # "close your hand and push ..."
    acting = [i for i in intents if i.skill]
    if not acting:
        return replace(intents[0], skill="") if intents else Intent()
    if unsupported := [i for i in acting if i.skill == "unsupported"]:
        return replace(unsupported[0], trouble=f"'{unsupported[0].verb}' is no skill of this planner")
    if any(i.skill == "press" for i in acting):  # "press the button by pushing it"
        acting = [i for i in acting if i.skill != "push" or (i.theme is not None and not i.theme.pronoun)]
    skill = _one_skill({i.skill for i in acting})
    named = [i.theme for i in acting if i.theme is not None and not i.theme.pronoun]
    theme = (
        _one_theme(named, skill) if named else next((i.theme for i in acting if i.theme is not None), None)
    )
    # A clause without a verb of its own may go on with the goal: "push it, without lifting, to the square".
    aims = [i for i in intents if i.goal is not None]
    whole = Intent(
        skill or acting[0].skill,
        acting[0].verb,
        theme,
        aims[-1].goal if aims else None,
        aims[-1].relation if aims else "",
        next((i.amount for i in reversed(intents) if i.amount is not None), None),
        next((i.direction for i in reversed(intents) if i.direction is not None), None),
    )
    extra = [
        i.theme for i in intents if not i.skill and i.theme is not None and (i.theme.noun or i.theme.colour)
    ]
    if not skill:
        return replace(whole, trouble="it asks for several different actions; ask for one at a time")
    if (named and theme is None) or extra:
        return replace(whole, trouble="it names several things to act on; ask for one at a time")
    return whole


def _one_skill(skills: set[str]) -> str:
    """The one skill that does all of them, or ""."""
    for group, whole in (
        ({"pick", "place"}, "place"),
        ({"place", "push"}, "push"),  # "move it there by pushing"
        ({"pick", "push"}, "push"),
    ):
        if skills == group:
            return whole
    return next(iter(skills)) if len(skills) == 1 else ""


def _one_theme(named: Sequence[Phrase], skill: str) -> Phrase | None:
    """The theme that all phrases can mean, the most telling of them; None when they differ."""
    if skill == "press":
        buttons = [p for p in named if p.noun == "button"]
        return max(buttons or named, key=_telling)
    best = max(named, key=_telling)
    for other in named:
        same_noun = other.noun in ("", "object", best.noun)
        if (
            not same_noun
            or other.colour not in ("", best.colour)
            or (other.unknown and other.unknown != best.unknown)
        ):
            return None
    return best


def _telling(phrase: Phrase) -> int:
    return sum(
        (
            bool(phrase.colour),
            phrase.noun not in ("", "object"),
            bool(phrase.selectors),
            bool(phrase.landmark),
        )
    )
