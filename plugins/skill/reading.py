"""Reading: from a sentence to commands, by the grammar in ``instruction.lark``; no scene is looked at.

English is ambiguous, and so is the grammar: a sentence has one or several readings, each a sequence of commands. A
sentence that the grammar does not derive is an :class:`UnreadableError` with the words that stopped it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import Any, Literal

from lark import Lark, Token, Transformer, Tree, v_args
from lark.exceptions import UnexpectedInput, VisitError
from lark.visitors import CollapseAmbiguities

from gvla2.planning.calls import WAYS
from gvla2.planning.colours import first_colour

Number = Literal["the", "any", "all", "it"]
LONGEST = 300
"""Characters of a sentence that is read at most; the number of readings grows with its length."""
GOALS = re.compile(r"on ?to|over|around|in ?to|over to|towards?|to|against|(?:to|onto) .*")
"""Wordings of relations that always say where something goes, never where it is."""
UNITS = {"mm": 0.001, "millim": 0.001, "cm": 0.01, "centim": 0.01, "m": 1.0, "met": 1.0, "inch": 0.0254}
"""Beginnings of length units, in metres; the longest that fits counts."""
_UP = frozenset(
    ("up", "high", "up high", "into the air", "up into the air", "in the air", "up to the target height")
)
VERBS: dict[str, tuple[str, frozenset[str]]] = {
    "TAKE": ("pick", _UP | {"out", "off"}),
    "PUT": ("place", frozenset(("down", "over", "in", "inside"))),
    "PUSH": ("push", frozenset(("over", "down", "in"))),
    "SLIDE": ("push", frozenset(("out", "over"))),
    "PULL": ("pull", frozenset(("out", "up", "off"))),
    "SWING": ("", frozenset(("over", "down", "up", "back"))),
    "OPEN": ("open", frozenset(("up",))),
    "CLOSE": ("close", frozenset()),
    "TWIST": ("twist", frozenset(("off",))),
    "PRESS": ("press", frozenset(("down", "in", "on"))),
    "TURN": ("", frozenset(("on", "off"))),
    "SORT": ("place", frozenset()),
}
"""Verb classes of the grammar: the skill that each asks for by itself, and particles that it may have."""
STATES = ("TAKE", "PUSH", "SLIDE", "PULL", "SWING", "OPEN", "CLOSE")
"""Verb classes that may be followed by the state that they lead to: "swing the lid open"."""
SIDES_OF = {"left": "left_of", "right": "right_of", "front": "front_of", "back": "behind", "rear": "behind"}
HOLDS = ("handle", "rim", "grip", "edge", "lip", "side", "top", "knob", "neck", "shaft", "end", "body")
"""Where something may be said to be held."""


class UnreadableError(Exception):
    """The grammar does not derive the sentence; ``verb`` is the first word of a clause where that is no verb."""

    def __init__(self, message: str, verb: str = "") -> None:
        super().__init__(message)
        self.verb = verb


@dataclass(frozen=True)
class Noun:
    """A noun phrase: ``words`` without its determiner, the last one the head; none for a pronoun (``number`` "it").

    ``where`` restricts it to what is somewhere, of some kind, or has some part; ``besides`` is what it excludes.
    ``owner`` is what it belongs to ("the lid of the box"); :data:`ITS` for "its lid".
    """

    text: str
    words: tuple[str, ...] = ()
    number: Number = "the"
    where: tuple[Where, ...] = ()
    besides: tuple[Noun, ...] = ()
    owner: Noun | None = None


ITS = Noun("it", number="it")


@dataclass(frozen=True)
class Place:
    """A relation to other objects: ``on``, ``in``, ``to``, ``from``, ``beside``, ``left_of``, ``right_of``,
    ``front_of``, ``behind``, ``between`` (two nouns), ``matching`` (the container of each object's colour; no noun).
    ``goal``: its wording always says where something goes.
    """

    relation: str
    nouns: tuple[Noun, ...] = ()
    goal: bool = False


@dataclass(frozen=True)
class Where:
    """A restriction: at a place, of some words ("that is red"), or with a part of some words; ``denied``: not so."""

    place: Place | None = None
    words: tuple[str, ...] = ()
    having: tuple[str, ...] = ()
    denied: bool = False


@dataclass(frozen=True)
class Command:
    """One clause: ``skill`` as in the table of skills ("turn off" for what has none), what it is done to, and where to.

    ``origins`` are places that the themes are taken from. ``amount`` in metres, ``direction`` a unit vector (x, y).
    ``present`` are nouns that must be there for the clause to make sense; ``spared`` are not to be touched.
    """

    skill: str
    themes: tuple[Noun, ...]
    goal: Place | None = None
    origins: tuple[Place, ...] = ()
    amount: float | None = None
    direction: tuple[float, float] | None = None
    present: tuple[Noun, ...] = ()
    spared: tuple[Noun, ...] = ()


Reading = tuple[Command, ...]


def plain(sentence: str) -> str:
    """The sentence in lower case, with plain apostrophes and spaces, without its final stop."""
    text = re.sub(r"(?<=[a-z])[-_](?=[a-z])", " ", sentence.lower().replace("’", "'"))
    text = re.sub(r",? *\b(?:please|kindly)\b,?", " ", text)
    text = re.sub(r"\b(it|that|which|there|what)'s\b", r"\1 is", text)
    text = re.sub(r"n't\b", " not", re.sub(r"(?<!let)'s\b", " 's", text))
    text = re.sub(r"\b(left|right) hand\b", r"\1", text)
    return " ".join(text.split()).rstrip(" .!?,;")


@cache
def grammar() -> Lark:
    """The parser of ``instruction.lark``."""
    text = files("gvla2_plugins.skill").joinpath("instruction.lark").read_text()
    return Lark(text, parser="earley", lexer="dynamic", ambiguity="explicit", propagate_positions=True)


@cache
def verbs() -> str:
    """A regular expression of all verbs."""
    return "|".join(grammar().get_terminal(name).pattern.to_regexp() for name in VERBS)


def readings(sentence: str) -> list[Reading]:
    """All readings of a sentence, without doubles; raises :class:`UnreadableError` where there is none.

    Where a place can be a goal or tell where the object is, it is the goal of a verb that needs one.
    """
    text = plain(sentence)
    if len(text) > LONGEST:
        raise UnreadableError(f"The instruction has {len(text)} characters; at most {LONGEST} are read.")
    try:
        forest = grammar().parse(text)
    except UnexpectedInput as error:
        raise _unread(text, getattr(error, "pos_in_stream", None)) from None
    found: dict[Reading, None] = {}
    why = ""
    for tree in CollapseAmbiguities().transform(forest):
        try:
            found[_Reader(text).transform(tree)] = None
        except VisitError as error:
            if not isinstance(error.orig_exc, UnreadableError):
                raise
            why = why or str(error.orig_exc)
    if not found:
        raise UnreadableError(why)
    aimless = {
        reading: sum(c.skill in ("place", "push") and c.goal is None and c.direction is None for c in reading)
        for reading in found
    }
    return [reading for reading, count in aimless.items() if count == min(aimless.values())]


def _unread(text: str, at: int | None) -> UnreadableError:
    """The failure at a character of the text (None: at its end)."""
    opened = re.sub(r"^(?:please|could you|can you|would you|will you|\s)+", "", text)
    if not re.match(verbs(), opened):
        word = (opened.split() or [""])[0]
        return UnreadableError(f"'{word}' is no verb that the skill planner knows", word)
    if at is None or at < 0 or at >= len(text):
        return UnreadableError(
            f"'{text}' ends too early: what is to be done, to what, or where to is missing"
        )
    return UnreadableError(f"'{text[at:].strip()}' cannot be read")


class _Reader(Transformer[Token, Any]):
    """From an unambiguous parse tree to commands; raises :class:`UnreadableError` where a clause makes no sense."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self._text = text

    # Noun phrases

    def words(self, tokens: list[Token]) -> tuple[str, ...]:
        return tuple(word for token in tokens for word in token.split())

    def determiner(self, tokens: list[Token]) -> Number:
        return {"THE": "the", "ANY": "any", "ALL": "all"}[tokens[0].type]  # type: ignore[return-value]

    def owner(self, children: list[Any]) -> Noun:
        if isinstance(children[0], Token):
            return ITS
        (words,) = [c for c in children if isinstance(c, tuple)]
        return Noun(" ".join(words), words)

    def pronoun(self, tokens: list[Token]) -> Noun:
        if tokens[0].startswith(("every", "any")):
            return Noun(str(tokens[0]), ("object",), "all")
        return replace(ITS, text=str(tokens[0]))

    @v_args(meta=True)
    def named(self, meta: Any, children: list[Any]) -> Noun:
        number: Any = next((c for c in children if isinstance(c, str)), "the")
        (words,) = [c for c in children if isinstance(c, tuple)]
        owner = next((c for c in children if isinstance(c, Noun)), None)
        besides: tuple[Any, ...] = next((tuple(c.children) for c in children if isinstance(c, Tree)), ())
        if besides and number == "the" and not words[-1].endswith("s"):
            raise UnreadableError(f"'{besides[0].text}' is excepted from what is one")
        where = tuple(c for c in children if isinstance(c, Where))
        return Noun(self._text[meta.start_pos : meta.end_pos], words, number, where, besides, owner)

    @v_args(meta=True)
    def owned(self, meta: Any, children: list[Any]) -> Noun:
        owner, words, *where = children
        return Noun(self._text[meta.start_pos : meta.end_pos], words, "the", tuple(where), (), owner)

    def nps(self, nouns: list[Noun]) -> tuple[Noun, ...]:
        for before, noun in pairwise(nouns):
            bare = noun.words[:1] == tuple(noun.text.split()[:1])
            if bare and (re.match(verbs(), noun.text) or first_colour(before.words[-1:])):
                raise UnreadableError(f"'{noun.text}' is no object of its own")
        return tuple(nouns)

    # Places

    def relation(self, tokens: list[Token]) -> tuple[str, bool]:
        token = tokens[0]
        return token.type.lower(), bool(GOALS.fullmatch(token)) and token.type in ("ON", "IN", "TO")

    def place(self, children: list[Any]) -> Place:
        if isinstance(children[0], tuple):
            (relation, goal), noun = children
            side = SIDES_OF.get(" ".join(noun.words).removesuffix(" side"), "")
            if noun.owner is not None and side and relation == "to":
                return Place(side, (noun.owner,))  # "to the stove's front"
            return Place(relation, (noun,), goal)
        return Place("between", tuple(children[1:]))

    def matching(self, _: list[Token]) -> Place:
        return Place("matching", (), True)

    def at(self, children: list[Any]) -> Where:
        *denied, place = children
        if place.goal or place.relation == "from":
            raise UnreadableError("it says where something goes or comes from, not where it is")
        return Where(place, denied=bool(denied))

    def being(self, children: list[Any]) -> Where:
        *denied, words = children
        return Where(words=words, denied=bool(denied))

    def extreme(self, tokens: list[Token]) -> Where:
        return Where(words=(tokens[0].split()[-1],))

    def having(self, children: list[Any]) -> Where:
        return Where(having=children[-1])

    # Clauses

    def verb(self, tokens: list[Token]) -> Token:
        return tokens[0]

    def command(self, children: list[Any]) -> Command:
        verb = next(c for c in children if isinstance(c, Token))
        themes = next(c for c in children if isinstance(c, tuple))
        return _command(verb.type, themes, [c for c in children if isinstance(c, Tree)])

    def elided(self, children: list[Any]) -> Command:
        return _command("PUT", (replace(ITS, text=""),), [Tree("place_of", children[1:])])

    def same_again(self, children: list[Any]) -> Command:
        themes, where = children
        if not isinstance(where, Place):  # "... and the pudding to the right"
            if where.split()[-1] not in SIDES_OF:
                raise UnreadableError(f"'{where}' cannot be read here")
            where = Place(SIDES_OF[where.split()[-1]], (replace(ITS, text=""),), True)
        return Command("", themes, where)

    def start(self, clauses: list[Any]) -> Reading:
        read: list[Command] = []
        for command in clauses:
            if not read and command.themes[0].text == "":
                raise UnreadableError("what is to be put there is missing")
            if not command.skill and (not read or read[-1].goal is None or not command.goal):
                raise UnreadableError(f"'{command.themes[0].text}' is in a clause without a verb")
            read.append(replace(command, skill=command.skill or read[-1].skill))
        return tuple(read)


def _command(verb: str, themes: tuple[Noun, ...], adverbs: Sequence[Tree[Any]]) -> Command:
    """The command of a verb's class, its objects, and its adverbs by their rules in the grammar."""
    particles = {str(c) for c in _of(adverbs, "particle")}
    places = [*_of(adverbs, "place_of"), *_of(adverbs, "place_until")]
    origins = tuple(p for p in places if p.relation == "from")
    goals = [p for p in places if p.relation != "from"]
    if verb == "PUT" and particles & {"in", "inside"}:
        goals.append(Place("in", (ITS,), True))
    states = [str(c) for c in _of(adverbs, "state") if isinstance(c, Token)]
    strange = particles - VERBS[verb][1]
    skill = _skill(verb, themes, particles, states, goals, origins)
    away = bool(origins) and not goals and verb in ("PUT", "PUSH")
    if strange or not skill or len(goals) > 1 or away:
        said = ", ".join([*sorted(strange), *(p.nouns[0].text for p in places if p.nouns)]) or verb.lower()
        raise UnreadableError(f"'{said}' cannot be read with this verb")
    goal = next(iter(goals), None)
    if goal is not None and skill not in ("place", "push"):
        raise UnreadableError(f"'{skill}' has no goal {goal.relation} something")
    made = Command(
        skill, themes, goal, origins,
        amount=next(map(_metres, _of(adverbs, "amount")), None),
        direction=next(map(_way, _of(adverbs, "direction")), None),
    )  # fmt: skip
    ways, amounts = list(_of(adverbs, "direction")), list(_of(adverbs, "amount"))
    several = len(ways) > 1 or len(amounts) > 1
    if several or (ways and goal) or ("back" in ways and skill != "push"):
        raise UnreadableError(f"'{' '.join([*ways, *amounts])}' cannot be read here")
    for kept in (t for t in adverbs if t.data == "except"):
        if len(themes) > 1 or themes[0].number != "all":
            raise UnreadableError("something is excepted from what is one")
        nouns: tuple[Any, ...] = tuple(kept.children)
        made = replace(made, themes=(replace(themes[0], besides=nouns),))
    for noun in _of(adverbs, "by_part"):
        if not noun.words or noun.words[-1] not in HOLDS:
            raise UnreadableError(f"'by {noun.text}' cannot be read")
    for how in adverbs:
        if how.data in ("by_pushing", "by_pressing"):
            made = _by(made, how.data, next(_of([how], how.data)))
        elif how.data == "purpose":
            made = _for(made, how.children)
        elif how.data == "without":
            made = _sparing(made, how.children)
    return made


def _of(adverbs: Sequence[Tree[Any]], rule: str) -> Iterator[Any]:
    for tree in adverbs:
        if tree.data == rule:
            yield tree.children[-1]


def _skill(
    verb: str,
    themes: Sequence[Noun],
    particles: set[str],
    states: Sequence[str] = (),
    goals: Sequence[Place] = (),
    origins: Sequence[Place] = (),
) -> str:
    """The skill that a verb with its particles, states and places asks for; "" where that is none."""
    moves = bool(goals) and all(place.goal for place in goals)
    heads = {noun.words[-1] for noun in themes if noun.words}
    if states:
        return ("open" if states[0] == "open" else "close") if verb in STATES else ""
    match verb:
        case "TURN":
            turned = {"on": "press", "off": "turn off"}.get(" ".join(particles), "")
            return "twist" if not particles and heads <= {"knob", "dial"} else turned
        case "SWING":
            ways = {w in ("over", "down") for w in particles}
            return "" if len(ways) != 1 else "close" if ways == {True} else "open"
        case "PUSH" if heads & {"button", "switch", "pushbutton"}:
            return "press"
        case "PUSH" if "down" in particles:
            return "close" if heads & {"lid", "flap"} else ""
        case "SLIDE" if "out" in particles or origins:
            return "place" if moves else "pull"
        case "TAKE" | "PULL" if goals:
            return "place" if moves else ""
    return VERBS[verb][0]


def _for(command: Command, how: Sequence[Any]) -> Command:
    """The command with what it is for: "press the button to switch the lamp on"."""
    verb, noun = how[0], next(c for c in how if isinstance(c, Noun))
    particles = {str(c) for c in how[1:] if isinstance(c, Token)}
    if command.skill in ("press", "open", "close") and command.skill == _skill(verb.type, (noun,), particles):
        return replace(command, present=(*command.present, noun))
    raise UnreadableError(f"what it is for, '{verb} {noun.text}', cannot be read")


def _by(command: Command, way: str, noun: Noun) -> Command:
    """The command with what it is done by: "move it there by pushing it", "switch it on by pressing the button"."""
    if way == "by_pushing" and command.skill in ("push", "place"):
        return replace(command, skill="push", present=(*command.present, noun))
    if command.skill == "press" and noun.words:
        return replace(command, themes=(noun,), present=(*command.present, *command.themes))
    raise UnreadableError(f"'{way.replace('_', ' ')} {noun.text}' cannot be read here")


def _sparing(command: Command, how: Sequence[Any]) -> Command:
    """The command with what is not to happen: lifting what is pushed, or what no motion does anyway."""
    if isinstance(how[0], Noun) or how[0].type == "PRONOUN":
        if command.skill in ("push", "place"):
            return replace(command, skill="push")
        raise UnreadableError("'without lifting it' cannot be read here")
    verb, noun = str(how[0]), how[-1]
    if noun.words:
        return replace(command, spared=(*command.spared, noun))
    if verb.startswith(("touch", "mov", "hit", "bump", "disturb")):
        raise UnreadableError(f"'without {verb} {noun.text}' rules out what is asked for")
    return command


def _metres(token: str) -> float:
    number, unit = re.fullmatch(r"(?:by |for )?([\d.]+) ?([a-z]+)", token).groups()  # type: ignore[union-attr]
    return float(number) * UNITS[max((u for u in UNITS if unit.startswith(u)), key=len)]


def _way(token: str) -> tuple[float, float]:
    """The direction of its wording, from the robot's view."""
    if "left" in token or "right" in token:
        return WAYS["left" if "left" in token else "right"]
    return WAYS["back" if "toward" in token or token.startswith("back") else "forward"]
