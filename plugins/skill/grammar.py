"""From a sentence to an intent: what to do, to what, where to, how far. Clauses are cut, read, and combined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.clauses import Clause, clauses, noun_use, phrase_at
from gvla2_plugins.skill.intents import Denial, Intent, Said, combine, settle
from gvla2_plugins.skill.phrases import Phrase, read_phrase
from gvla2_plugins.skill.words import noun_class, spell, take_length, tokenise, verbs_of

__all__ = ["Intent", "parse"]

DYNAMIC = ("onto", "on to", "into", "in to", "to", "over to", "across to", "up to", "all the way to", "toward",
           "towards", "against")  # fmt: skip
"""Wordings that always tell where something goes, not where it is."""


MEANS, OWNED = ("handle", "knob"), ("lid", "handle", "drawer")


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


def parse(sentence: str, labels: Sequence[str] = (), spelling: float = 0.85) -> Intent:
    """The intent of any text; never raises. ``labels`` of the scene count as known words."""
    known = frozenset(word for label in labels for word in tokenise(label))
    tokens, notes = spell(tokenise(sentence), spelling, known)
    if unread := lexicon.UNREAD.search(" ".join(tokens)):
        return Intent(trouble=f"what '{unread[0]}' means here is not read with certainty", notes=tuple(notes))
    parts, denied = clauses(tokens)
    intent = combine([s for s in (_read(c) for c in parts) if s is not None])
    denials = tuple(_denial(words) for words in denied)
    if intent.skill == "place" and any(d.verbs & lexicon.TAKING for d in denials):
        intent = replace(intent, skill="push")  # "move it there without lifting it"
    return replace(intent, notes=tuple(notes), denials=denials)


def _denial(words: Sequence[str]) -> Denial:
    acts = [i for i, t in enumerate(words) if verbs_of(t) and not noun_use(words, i)]
    phrase = read_phrase([t for i, t in enumerate(words) if i not in acts])
    verbs = frozenset(v for i in acts for v in verbs_of(words[i]))
    return Denial(" ".join(words), verbs, None if phrase.empty else phrase)


def _read(clause: Clause) -> Said | None:
    """What a clause says, None when that is nothing."""
    intent = _clause(list(clause.tokens))
    if intent is None:
        return None
    means = clause.tokens[0] in ("use", "using") or clause.tokens[:2] in (("by", "using"), ("please", "use"))
    return Said(intent, clause.joint, means, clause.denied)


def _clause(tokens: list[str]) -> Intent | None:
    """The intent of one clause, None when there is nothing in it."""
    tokens, amount = take_length(tokens)
    match = _verb(tokens)
    if match is None:
        return _verbless(tokens, amount)
    consumed = {i for i in match.at if i == match.at[0] or not _tells_more(tokens, i, match.at[0])}
    after = [t for i, t in enumerate(tokens) if i not in consumed and i > match.at[0]]
    before = [t for i, t in enumerate(tokens) if i not in consumed and i < match.at[0]]
    chunks, direction = _chunks(after, match.skill)
    ahead = _chunks(before, match.skill)[0]
    chunks += [c for c in ahead[1:] if c.dynamic]  # "to the square push the block"
    if chunks[0].phrase().empty:
        subject = ahead[0]
        if not subject.phrase().empty:  # "the block should be pushed"
            chunks[0] = subject
    theme, goal, relation = _roles(match.skill, chunks)
    nothing = theme is None or theme.everywhere
    if match.skill in ("unsupported", "open", "close", "twist") and nothing and lexicon.HAND & set(tokens):
        return None  # "close your hand and push ...", "with the gripper closed"
    intent = Intent(match.skill, " ".join(match.words), theme, goal, relation, amount, direction)
    if match.skill == "push" and goal is None and direction is None and "up" in tokens:
        return replace(intent, skill="pull")  # "slide the umbrella up"
    nowhere = goal is None and direction is None and match.skill == "place"
    if nowhere and match.words[0] in lexicon.CARRYING and _aloft(chunks):
        return replace(intent, skill="pick")
    if nowhere and match.words[0] == "leave" and theme is not None and theme.everywhere:
        return Intent("pick", "leave")  # "I'd like the cube to leave the table"
    if nowhere and theme is not None and theme.noun == "lamp" and "off" in tokens:
        return replace(intent, skill="unsupported", verb="put off")
    return settle(intent)


def _tells_more(tokens: Sequence[str], i: int, verb_at: int) -> bool:
    """Whether a word of a verb's phrase also says something of its own: "turn the lid", "pull it out of the tower"."""
    word, following = tokens[i], "".join(tokens[i + 1 : i + 2])
    if word == "off":  # "screw the lid off the jar", but "screw off the lid"
        named = following in lexicon.DETERMINERS | set(lexicon.COLOUR_WORDS) or bool(noun_class(following))
        return named and i > verb_at + 1
    return word == "from" or (word == "out" and following == "of") or noun_class(word) in lexicon.PARTS


def _aloft(chunks: Sequence[_Chunk]) -> bool:
    """Whether something says that the thing is to be in the air: "off the table", "into the air"."""
    return any(
        (c.relation == "from" and lexicon.SUPPORTS & set(c.tokens))
        or (c.relation in ("on", "in", "to") and {"air", "sky"} & set(c.tokens))
        for c in chunks[1:]
        if c.phrase().everywhere
    )


def _verb(tokens: Sequence[str]) -> _Match | None:
    """The verb phrase of a clause: the one with most words, then the first."""
    found: list[_Match] = []
    for i, token in enumerate(tokens):
        bases = verbs_of(token)
        if not bases or noun_use(tokens, i):
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


def _verbless(tokens: Sequence[str], amount: float | None) -> Intent | None:
    """A clause without a known verb: a wish ("I want the cube on the tray", "the lamp should be on"), or just words."""
    wish = bool(lexicon.WISHING & set(tokens))
    chunks, direction = _chunks(tokens, "place")
    theme, goal, relation = _roles("place", chunks)
    last = next((t for t in reversed(tokens) if t not in lexicon.FILLERS), "")
    if theme is not None and theme.noun == "lamp" and (last == "on" or last in lexicon.SHINING):
        return Intent("press", last, theme)
    if wish and theme is not None and goal is not None:
        return Intent("place", "want", theme, goal, relation, amount, direction)
    out = any(c.relation == "from" and not c.phrase().empty for c in chunks[1:])
    if wish and theme is not None and (_aloft(chunks) or out):
        return Intent("pick", "want", theme, amount=amount)
    words = [t for t in tokens if t.isalpha()]
    known_only = all(t in lexicon.FILLERS | lexicon.DETERMINERS | lexicon.PRONOUNS for t in words)
    if known_only and amount is None and direction is None and goal is None:
        return None
    if theme is None and goal is not None and lexicon.LOOKING & set(tokens):
        theme, goal, relation = goal, None, ""  # "go to the cube"
    elif theme is not None and goal is not None and not any(c.dynamic for c in chunks):
        theme, goal, relation = (
            replace(theme, landmark=(relation, goal)),
            None,
            "",
        )  # "there is a cube on the tray"
    return Intent("", " ".join(words), theme, goal, relation, amount, direction)


def _chunks(tokens: Sequence[str], skill: str) -> tuple[list[_Chunk], tuple[float, float] | None]:
    """The clause's words parted at relations, selectors set aside, and a direction if there is one."""
    chunks: list[tuple[str, bool, list[str], list[str]]] = [("", False, [], [])]
    direction: tuple[float, float] | None = None
    i = 0
    while i < len(tokens):
        filler = phrase_at(tokens, i, lexicon.UNTIL)
        wording, kind, value = _marker(tokens, i, skill)
        if filler and len(filler) >= len(wording):
            i += len(filler.split())
        elif kind == "relation":
            chunks.append((value, wording in DYNAMIC or wording.startswith(("until", "so", "till")), [], []))
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
        if wording := phrase_at(tokens, i, wordings):
            found.append((wording, "relation", relation))
    for selector, wordings in lexicon.SELECTORS.items():
        if wording := phrase_at(tokens, i, wordings):
            found.append((wording, "selector", selector))
    moves = skill in ("push", "place")
    if wording := phrase_at(tokens, i, tuple(lexicon.DIRECTIONS)):
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
        elif skill in lexicon.WORKED and (phrase.noun in MEANS or phrase.pronoun):
            continue  # "by its handle", "out of it"
        elif (skill == "press" and chunk.relation in ("on", "in", "to")) or (
            skill in lexicon.WORKED and theme.noun in OWNED and theme.owner is None
        ):
            theme = replace(theme, owner=phrase)
        else:
            theme = replace(theme, landmark=(chunk.relation, phrase))
    return (None if theme.empty and not theme.landmark and not theme.everywhere else theme), goal, relation


def _goal_index(skill: str, told: Sequence[tuple[_Chunk, Phrase]]) -> int:
    if skill in ("pick", "press", "unsupported", "open", "close"):
        return -1
    aims = [k for k, (c, _) in enumerate(told) if c.relation != "from"]
    if skill in ("fetch", "pull"):
        aims = [k for k in aims if told[k][0].dynamic]
    dynamic = [k for k in aims if told[k][0].dynamic]
    return (dynamic or aims or [-1])[0]
