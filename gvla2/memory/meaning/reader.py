"""What an English text says: clauses with their words, sides and figures, what it forbids, what comes before what.

Compact on purpose: it reads for the features of :mod:`gvla2.memory.meaning.features`, where a wrong guess costs a
little probability, not a decision.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from gvla2.memory.meaning.function_words import FUNCTION_WORDS, word_set
from gvla2.memory.meaning.opposites import PHRASES, SIDES
from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.quantities import Quantity, quantities
from gvla2.memory.meaning.stems import stem
from gvla2.memory.meaning.synonyms import CANONICAL

MAX_READ = 2000
"""Characters that are read of a text."""

_ENGLISH = word_set(
    """the a of and to is it for with on at by from be are as or not this that before after when if then than into
    while until use do don't never always must should only keep"""
)
_FOREIGN = word_set(
    """der die das den dem des ein eine einen einem und nicht ist mit auf vor nach bei zu zum zur für von im wenn erst statt
    le les des du une est pas avec pour dans sur avant après ne et au aux que qui en el los las una del con por antes
    después no_ se hay para nunca siempre y o il gli della che non prima dopo di da em não antes depois het een van niet
    voor på och att ikke og på jest nie się przed w z na"""
)
_SOFT = word_set(
    """use make sure need needs keep leave get give take let please always best better good well work works ensure properly
    just simply really way thing things set go do be have has had will would can could may might must shall should ought
    want prefer preferably recommended enough fine okay ok right_ about around roughly approximately almost exactly here
    there still again once very quite much many lot so too also only even it its they them this that these those any all
    each every some both one two who which what where why how than per least most up_ out off_ on_ of to in at by for
    from with within onto into upon toward towards via through during as a an the and or but nor if when while until
    i we you he she my our your his her us me were was is are been being am did does done got
    found find turned needed belong belongs come comes stand stands lie lies sit sits stay stays look looks suffice suffices
    plenty begin begins happen happens hang hangs fit fits"""
)
_NEGATORS = word_set(
    """not never no don't dont doesn't mustn't shouldn't can't cannot won't isn't aren't avoid refrain skip omit nothing
    neither forbidden prohibited nobody none stop_ wrong unwise mistake"""
)
_CONDITIONS = word_set("if when whenever while once unless during where")
_IDIOMS = re.compile(
    r"\b(?:do not|don't|never) (?:forget|hesitate|fail|omit|neglect)\b(?: to)?|\bnot only\b|\bno doubt\b|\bnot just\b"
    r"|\bno (?:later|sooner|more|less|fewer|longer|lower|higher) than\b|\bnot (?:a )?(?:bad|wrong)(?: idea)?\b"
    r"|\bnot (?:forbidden|prohibited)\b|\bnothing wrong with\b|\bno matter\b"
)
"""Negations that forbid nothing."""
_NEEDLESS = re.compile(
    r"\bno need\b|\bneed not\b|\bneedn't\b|\bnot (?:necessary|needed|required)\b|\b(?:don't|do not|does not|doesn't) "
    r"(?:need|have) to\b|\bnot enough\b|\bmay also\b|\boptional\b"
)
_SENTENCE = re.compile(r"[!?;\n]+|\.(?=\s|$)")
_ASIDE = re.compile(
    r",\s*(?=(?:the|its|their|that|this|those|these) [^,.]*?\b(?:is|are|was|were|\w+s|had|can|may|will|would|\w+ed)\b)"
)
"""Behind it a statement of its own follows an order: "start from the right end, the left one is blocked"."""
_REASON = re.compile(
    r",?\s*\b(?:so that|because|since (?=the|it|they|this|there|i|we)|otherwise|or else|in order to|lest)\b"
    r"|,\s*(?=(?:it|this|that|they|which|i|we) (?:\w+ )?(?:was|were|is|are|made|makes|made|gave|gives|had|has|did"
    r"|would|will|could|tore|broke|fell|slipped|came|failed|works?|helps?|keeps?)\b)|\bor (?=(?:it|they|the \w+) (?:will|"
    r"gets?|may|might|can|\w+s)\b)"
)
"""What follows tells why, or how it went."""
_STEP = re.compile(
    r",?\s*\b(?:and )?then\b,?\s*|,\s+(?:and|but)\s+|\s+and\s+(?=\w+\s+(?:the|a|an|it|them|its|each|every|all|to|by|for"
    r"|at|in|into|on|with|from|after|before|lightly|slowly|gently|only|until|afterwards?|later|next|last|first)\b)"
    r"|\s+but\s+"
)
_ANY_AND = re.compile(r",?\s*\b(?:and )?then\b,?\s*|,?\s+and\s+|,\s+")
_CHOSEN = re.compile(
    r"(?P<one>.+?),?\s+(?:rather than|instead of|in place of|in preference to|and not)\s+(?P<two>.+)"
    r"|(?P<one4>.+?)\s+(?:(?:is|are|was|were|works?|worked|does|do) (?:\w+ )?better than|beats?)\s+(?P<two4>.+)"
    r"|(?:.*?\b)?(?:prefer|trust|choose|favou?r|pick)\w*\s+(?P<one2>.+?)\s+(?:over|to|before)\s+(?P<two2>.+)"
    r"|(?P<one3>.+?),\s+(?:and |but )?(?:not|never)\s+(?P<two3>.+)"
    r"|(?:do not|don't|never|avoid)\s+(?:use |take |using |taking )(?P<two5>[^,]+?)(?:,| but)\s+(?:but )?(?P<one5>.+)"
)
_NOT = re.compile(r"\b(?:not|never|don't|avoid)\b")
_CASE = re.compile(r"\s*(?:if|when|while|once|unless|after|before|until|with|without|for|in|on|at)\b")
_INSTEAD = re.compile(r"^\s*(?:rather than|instead of)\s+(?P<two>[^,]+),\s*(?P<one>.+)")
_AHEAD = re.compile(r"\b(?:before|prior to|ahead of|until|till)\b")
_BEHIND = re.compile(r"\b(?:after|once|as soon as|following|when_)\b")
_FIRST = re.compile(r"\b(?:first|to begin with|at first)\b")
_LATER = re.compile(r"\b(?:afterwards?|after that|later|last|next|finally|subsequently)\b")
_EVERY = re.compile(r"\b(?:every|each|per)\s*$")
_FRONTED = re.compile(
    r"\s*(?P<case>(?:on|in|at|for|without|with|inside|near|under|from|by|during) [^,]+),(?=.*\w)"
)
_ONCE = re.compile(r"\bonce (?:a|per|every|each) (second|minute|hour|day|week|month|year)\b")
_FULL = re.compile(
    r"\b(?:full|whole|good|entire|solid) (?=(?:seconds?|minutes?|hours?|turns?|met(?:re|er)s?)\b|\d)"
)
_FINE = re.compile(r"\b(is|are|was) right\b(?!-| (?:of|side|hand|next|at)\b)")
_DOES = (
    r"(?:goes|is|are|was|were|has|have|had|must|should|may|can|needs?|belongs?|takes?|gets?|stands?|hangs?|comes?|stays?"
    r"|works?|holds?|slips?|beats?|go|runs?|listens?|looks?|sits?)\b"
)
_NUMBERED = re.compile(
    r"(?P<name>(?:^|(?<=[.;,:] )|(?<=\bon )|(?<=\bat )|(?<=\bthe ))[a-z]{3,}) (?P<number>\d{1,4})"
    rf" (?={_DOES})"
)
"""A number behind a noun and before what it does names one of several: "waypoint 3 was reached"."""
_SUBJECT = re.compile(rf"\s*(?P<who>(?:\w+ ){{0,2}}?\w+) (?={_DOES})")
_COMMA = "xcommax"
_PARTICLES = ("on", "off", "out", "alone")
_DETERMINERS = word_set("the a an its their your each this that")
_PLACES = word_set("side height depth inside ends daytime")
"""Axes whose words may stand alone behind an article: "on the left"; others are nouns there ("the light")."""
_ENDING = word_set("stop quit cease")
_WITH_UP = word_set(
    "is are give roll back set clean clear warm heat cool start speed slow fill follow end shut wind wake tidi"
)
"""Stems of verbs that "up" and "down" are a part of."""
_PREPOSITIONS = word_set(
    "of to in at by for from with into onto on under near inside through along against between"
)
_WORD = re.compile(r"[^\W_](?:[\w]|['-](?=\w))*")

Words = frozenset[str]
Order = tuple[Words, Words]
Sides = tuple[tuple[str, int], ...]
"""Axes and signs in reading order."""


@dataclass(frozen=True)
class Clause:
    """One statement: ``words`` are stems of what it is about, ``names`` those of single things ("nr12"), ``sides``
    its opposing words by axis, ``when`` the stems of its conditions (sides as "axis+").

    ``labels`` are those near a figure, ``roles`` the prepositions that things stand behind, ``things`` those words that come behind an article or a preposition. ``named`` are sides that tell which thing is meant ("the left drawer"), ``lacks`` what it does without. ``forbidden``: the text says not to; ``open``: it need not be.
    """

    words: Words
    names: Words
    sides: Sides
    named: Sides
    figures: tuple[Quantity, ...]
    when: Words
    things: Words = frozenset()
    labels: Words = frozenset()
    roles: tuple[tuple[str, str], ...] = ()
    lacks: Words = frozenset()
    forbidden: bool = False
    open: bool = False


@dataclass(frozen=True)
class Reading:
    """A text taken apart. ``orders`` are pairs of what comes before and what after; ``choices`` what is taken and
    what left; ``words`` all stems.
    """

    clauses: tuple[Clause, ...]
    orders: tuple[Order, ...]
    choices: tuple[Order, ...]
    words: Words


def is_english(text: str) -> bool:
    """Whether a text may be read here; short texts without any telling word count as English where they are ASCII."""
    words = re.findall(r"[^\W\d_]+(?:'[^\W\d_]+)?", text[:MAX_READ].casefold())
    if not words:
        return False
    mine = sum(word in _ENGLISH for word in words)
    theirs = sum(word in _FOREIGN or not word.isascii() for word in words)
    return theirs == 0 or mine > 2 * theirs


@lru_cache(maxsize=4096)
def read(text: str) -> Reading:
    """The reading of an English text; of any other, whatever it may give."""
    clauses: list[Clause] = []
    orders: list[Order] = []
    choices: list[Order] = []
    plain = _NUMBERED.sub(r"\g<name> nr\g<number> ", _FINE.sub(r"\1 fine", plain_text(text[:MAX_READ])))
    plain = _FULL.sub("", _ONCE.sub(r"every 1 \1", _IDIOMS.sub(_positive, plain)))
    for sentence in _SENTENCE.split(plain):
        said = _told(sentence)
        sequence = _FIRST.search(said) or _LATER.search(said)
        steps = [step for step in (_ANY_AND if sequence else _STEP).split(said) if _WORD.search(step)]
        steps = [part for step in steps for part in _apart(step)]
        parts: list[Words] = []
        first = last = -1
        for step in steps:
            taken, left = _choice(step)
            if taken and left:
                choices.append((_stems(taken), _stems(left)))
            clause, order = _clause(step, left)
            clauses.append(clause)
            orders += [order] if order else []
            first = len(parts) if _FIRST.search(step) else first
            last = len(parts) if _LATER.search(step) else last
            parts.append(_everything(clause) if not order else frozenset(order[0] | order[1]))
        if len(parts) > 1 and (first > 0 or last == 0):
            parts.reverse() if len(parts) == 2 else None
        if len(parts) > 1 and (first >= 0 or last >= 0 or "then" in said):
            orders += [(parts[i], parts[j]) for i in range(len(parts)) for j in range(i + 1, len(parts))]
    words = {word for clause in clauses for word in clause.words | clause.when}
    words |= {word for taken, left in choices for word in taken | left}
    return Reading(tuple(clauses), tuple(orders), tuple(choices), frozenset(words))


def _told(sentence: str) -> str:
    """A sentence without what only tells why, or how it went."""
    said = _REASON.split(sentence, maxsplit=1)[0]
    if _CASE.match(said) is None:
        said = _ASIDE.split(said, maxsplit=1)[0]
    return said if _WORD.search(said) else sentence


def _positive(found: re.Match[str]) -> str:
    """What is left of a negation that forbids nothing: bounds stay."""
    return found.group() if found.group().endswith(" than") else " "


def _apart(step: str) -> list[str]:
    """A step that forbids one thing and asks for another, as two: "don't pull it, push it"."""
    head, comma, tail = step.partition(",")
    if not comma or _choice(step)[1] or _NOT.search(head) is None or len(tail.split()) < 2:
        return [step]
    return [head, tail] if _CASE.match(head) is None else [step]


def _choice(step: str) -> tuple[str, str]:
    found = _INSTEAD.match(step) or _CHOSEN.fullmatch(step.strip())
    if found is None:
        return "", ""
    groups = found.groupdict()
    one, two = (
        "".join(said or "" for name, said in groups.items() if name.startswith(n)) for n in ("one", "two")
    )
    return one, two


def _clause(step: str, left: str) -> tuple[Clause, Order | None]:
    """The clause of a step; what it leaves out (``left``) is no part of it."""
    text = step.replace(left, " ") if left else step
    if left:
        text = re.sub(r"\b(?:rather than|instead of|in place of|not|never|don't|do|avoid)\b", " ", text)
    fronted = _FRONTED.match(text)
    case = _content(fronted["case"]) if fronted is not None else frozenset()
    if fronted is not None and fronted["case"].startswith("without"):
        case = frozenset(f"no_{root}" for root in case)
    text = text[fronted.end() :] if fronted is not None and not quantities(fronted["case"]) else text
    open_ = _NEEDLESS.search(text) is not None
    order, main, side = _ordered(text)
    figures = []
    kept, last = [], 0
    labels: set[str] = set()
    for found in quantities(main):
        near = [*_WORD.findall(main[: found.start])[-4:], *_WORD.findall(main[found.end :])[:3]]
        labels |= _content(" ".join(near))
        kept.append(main[last : found.start])
        every = found.quantity.dimension == "time" and _EVERY.search(kept[-1]) is not None
        figures.append(found.quantity._replace(dimension="period") if every else found.quantity)
        last = found.end
    main = " ".join([*kept, main[last:]])
    words: set[str] = set()
    sides: list[tuple[str, int]] = []
    lacks: set[str] = set()
    when: set[str] = set(side | case)
    negations = 0
    within = lacking = denied = False
    named: list[tuple[str, int]] = []
    things: set[str] = set()
    roles: list[tuple[str, str]] = []
    place = ""
    noun = False
    joined = [*_joined(_WORD.findall(main.replace(",", f" {_COMMA} "))), ""]
    for before, word, behind in zip(["", *joined], joined, joined[1:], strict=False):
        noun = word in _DETERMINERS or word in _PREPOSITIONS or (noun and word not in FUNCTION_WORDS)
        if noun and word not in FUNCTION_WORDS:
            _take(word, things, [])
            roles += [(place, word)] if word not in _PREPOSITIONS and word not in _DETERMINERS else []
        place = word if word in _PREPOSITIONS else place
        if word == _COMMA:
            within = lacking = denied = False
        elif word == "without":
            lacking = True
        elif word in _CONDITIONS:
            within = True
        elif word in _NEGATORS or (word in _ENDING and behind.endswith("ing")):
            negations += not within
            denied = within
        elif word in ("up", "down") and stem(before) in _WITH_UP:
            continue
        elif within or lacking:
            taken: set[str] = set()
            _take(word, taken, None)
            (when if within else lacks).update(f"no_{root}" if denied else root for root in taken)
        elif before in _DETERMINERS and behind and behind not in FUNCTION_WORDS | {_COMMA}:
            _take(word, words, named)
        elif before in _DETERMINERS:
            _take(word, words, sides, only=_PLACES)
        else:
            _take(word, words, sides)
    forbidden = negations % 2 == 1 and not open_
    if forbidden and any(figure.one_sided for figure in figures):
        figures = [figure.inverted() if figure.one_sided else figure for figure in figures]
        forbidden = False
    if forbidden and _AHEAD.search(text):  # "not before it is dry" asks for it afterwards
        order, forbidden = (order[1], order[0]) if order else None, False
    if forbidden and "unless" in text:  # "not unless it is on" asks for it when it is on
        forbidden = False
    if forbidden and lacks:  # "don't solder without flux" asks for flux
        words, lacks, forbidden = words | lacks, set(), False
    subject = _SUBJECT.match(main)
    if subject is not None:
        things |= _content(subject["who"])
    labels &= things
    names = frozenset(word for word in words if not word.isalpha() and any(map(str.isdigit, word)))
    clause = Clause(
        frozenset(words),
        names,
        tuple(sides),
        tuple(named),
        tuple(figures),
        frozenset(when),
        frozenset(things),
        frozenset(labels),
        tuple(roles),
        frozenset(lacks | _content(left)),
        forbidden,
        open_,
    )
    return clause, order


def _ordered(text: str) -> tuple[Order | None, str, Words]:
    """What a step says comes before what, its main part, and the words of the other part."""
    for pattern, ahead in ((_AHEAD, True), (_BEHIND, False)):
        found = pattern.search(text)
        if found is None:
            continue
        head, tail = text[: found.start()], text[found.end() :]
        if not _WORD.search(head):  # "before lifting, close the hand"
            side_text, comma, main = tail.partition(",")
            if not comma:
                continue
        else:
            side_text, _, rest = tail.partition(",")
            main = head + (" , " + rest if rest else "")
        if quantities(side_text) and (not quantities(head) or not _content(side_text)):
            continue  # "after 5 minutes", "they slipped until I took 8 newtons"
        side = _content(side_text)
        mine = _content(main)
        if side and mine:
            order = (mine, side) if ahead else (side, mine)
            return order, main, side
    return None, text, frozenset()


def _take(
    word: str, words: set[str], sides: list[tuple[str, int]] | None, only: frozenset[str] = frozenset()
) -> None:
    """Sort a word in: to ``sides`` where it has some (of the axes ``only``; to ``words`` as "axis+" where ``sides`` is
    None), else to ``words`` by its stem, else nowhere.
    """
    word = word.removesuffix("'s")
    root = stem(word)
    known = [side for side in SIDES.get(root, ()) if not only or side[0] in only]
    if known:
        if sides is None:
            words |= {_side(axis, sign) for axis, sign in known}
        else:
            sides.extend(known)
        return
    if "-" in word:
        for part in word.split("-"):
            _take(part, words, sides, only)
        return
    if word[:2] == "un" and len(word) > 6:
        root = "un" + stem(word[2:])
        reverse = [(axis, -sign) for axis, sign in SIDES.get(stem(word[2:]), ())]
        if reverse and sides is not None:
            sides.extend(reverse)
            return
    if word not in _SOFT and word not in FUNCTION_WORDS and len(word) > 1:
        words.add(CANONICAL.get(root, root))


def _side(axis: str, sign: int) -> str:
    return f"{axis}{'+' if sign > 0 else '-'}"


def _content(text: str) -> Words:
    found: set[str] = set()
    rest, last = [], 0
    for quantity in quantities(text):
        rest.append(text[last : quantity.start])
        last = quantity.end
    for word in _joined(_WORD.findall(" ".join([*rest, text[last:]]))):
        if word not in _NEGATORS and word not in _CONDITIONS:
            _take(word, found, None)
    return frozenset(found)


def _stems(text: str) -> Words:
    return _content(text)


def _everything(clause: Clause) -> Words:
    return clause.words | {_side(axis, sign) for axis, sign in clause.sides}


def _joined(words: list[str]) -> Iterator[str]:
    """The words, those that mean something together as one; "turn the light on" is "turn on the light"."""
    i = 0
    while i < len(words):
        for rest, meant in PHRASES.get(stem(words[i]), ()):
            if tuple(words[i + 1 : i + 1 + len(rest)]) == rest:
                yield meant
                i += 1 + len(rest)
                break
            if len(rest) == 1 and rest[0] in _PARTICLES and rest[0] in words[i + 2 : i + 6]:
                yield meant
                i += 1
                break
        else:
            ends = i + 1 == len(words) or words[i + 1] == _COMMA or words[i + 1] in _CONDITIONS
            yield {"on": "enabled", "off": "disabled"}.get(words[i], words[i]) if ends and i else words[i]
            i += 1
