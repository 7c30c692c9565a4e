"""Intents: what clauses ask for, and what they ask for together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeGuard

from gvla2_plugins.skill.lexicon import CONTENTS, PARTS, WORKED
from gvla2_plugins.skill.phrases import Phrase


@dataclass(frozen=True)
class Intent:
    """What a clause or a sentence asks for. ``skill`` is "" when no verb was understood; ``verb`` is how it was worded.

    ``relation`` is that of the goal (on, in, to, beside, ...); ``amount`` metres; ``direction`` a unit vector (x, y)
    in the robot's frame. ``trouble`` says why a sentence with known words cannot be followed; ``denials``
    what the sentence rules out, in words and as it is read.

    Of a clause: ``brief``: without a verb, as on a telegram; ``joint``: how it follows the one before; ``means``: its
    theme is what to do it with ("use ..."); ``denied``: what it names is not to be acted on.
    """

    skill: str = ""
    verb: str = ""
    theme: Phrase | None = None
    goal: Phrase | None = None
    relation: str = ""
    amount: float | None = None
    direction: tuple[float, float] | None = None
    trouble: str = ""
    denials: tuple[tuple[str, Intent], ...] = ()
    brief: bool = False
    joint: str = ""
    means: bool = False
    denied: bool = False


ABSORBS: dict[str, frozenset[str]] = {
    "place": frozenset(("pick", "pull")),
    "push": frozenset(("pick", "place")),  # "move it there by pushing"
    "pick": frozenset(("pull",)),
    "close": frozenset(("push", "pull")),
    "twist": frozenset(("pick", "place", "pull", "open")),
    "open": frozenset(("pick", "place", "pull")),  # a jar, and its lid is put somewhere
}
"""What else a sentence may ask for that is a part of a skill."""


def combine(intents: Sequence[Intent]) -> Intent:
    """One intent of a sentence's clauses: "grab the cube and put it on the tray" is one placing.

    Clauses without a verb may name what the others are about ("the olive cube: lift it", "find the cube and lift
    it") or say more of it afterwards ("lift the cube, the blue one"); otherwise they name a second thing.
    """
    if unclear := [i for i in intents if i.trouble]:
        return unclear[0]
    acting = [i for i in intents if i.skill]
    if not acting:
        return _telegraph(intents) if intents else Intent()
    if unsupported := [i for i in acting if i.skill == "unsupported"]:
        return replace(unsupported[0], trouble=f"'{unsupported[0].verb}' is no skill of this planner")
    skill = _one_skill([i.skill for i in acting])
    named = [i.theme for i in acting if names(i.theme)]
    said_first = next((i.theme for i in acting if i.theme is not None), None)
    theme = _one_theme(named, skill) if named else said_first
    aim = next((i for i in reversed(intents) if i.goal is not None), Intent())
    if skill == "pick" and aim.goal is not None:
        skill = "place"  # "get it out of the stack and onto the tray"
    amount = next((i.amount for i in reversed(intents) if i.amount is not None), None)
    direction = next((i.direction for i in reversed(intents) if i.direction is not None), None)
    aims = [i.goal for i in intents if names(i.goal)]
    ways = {i.direction for i in intents if i.direction and (i.amount is not None or not aims)}
    apart = any(_refined(a, b) is None for a, b in pairwise(aims))
    if apart or len(ways) + bool(aims) > 1 or len({i.amount for i in intents} - {None}) > 1:
        ask = "ask for one at a time"
        return replace(acting[0], trouble=f"it gives several directions, lengths or places; {ask}")
    asked = skill or acting[0].skill
    whole = Intent(asked, acting[0].verb, theme, aim.goal, aim.relation, amount, direction)
    if not skill:
        return replace(whole, trouble="it asks for several different actions; ask for one at a time")
    known, several = bool(named), (bool(named) and theme is None) or _goes_on(acting)
    first = next(k for k, i in enumerate(intents) if i.skill)
    for k, extra in enumerate(intents):
        topic = None if extra.skill else extra.theme
        if topic is None or topic.everywhere or topic.empty or (topic.pronoun and not topic.landmark):
            continue  # but "it's behind the box"
        if not (topic.noun or topic.colour or set(topic.unknown) <= set(CONTENTS)):
            if k < first and known:  # "time to lift it"
                continue
            return replace(whole, trouble=f"'{topic.text}' is not understood")
        told = None if several else _with_topic(whole, known, extra, topic, ahead=k < first)
        if told is not None:
            whole, known = told, True
        elif not extra.denied:
            several = True
    if several:
        return replace(whole, trouble="it names several things to act on; ask for one at a time")
    return settle(whole)


def _telegraph(intents: Sequence[Intent]) -> Intent:
    """What is wished for without a verb: "ring on the red post, please", "umbrella out of the stand"."""
    named = [i.theme for i in intents if names(i.theme)]
    if len(named) != 1 or not intents[0].brief or "up" in named[0].text.split():
        return replace(intents[0], skill="")
    relation, place = named[0].landmark or ("", None)
    aim = next((i for i in intents if i.goal is not None), Intent(goal=place, relation=relation))
    if aim.goal is None or aim.relation == "from":
        return Intent("pick" if aim.goal else "", "want", named[0])
    skill = "place" if aim.relation in ("on", "in", "to") else ""
    return Intent(skill, "want", replace(named[0], landmark=None), aim.goal, aim.relation)


def names(theme: Phrase | None) -> TypeGuard[Phrase]:
    """Whether a theme is named, in words of its own."""
    return theme is not None and not theme.pronoun and not theme.everywhere


def _goes_on(acting: Sequence[Intent]) -> bool:
    """Whether something else is done to the whole after a part of it was worked: "unscrew the lid, lift the jar"."""
    first = next((k for k, i in enumerate(acting) if i.skill in ("twist", "open")), len(acting))
    moved = [i.theme for i in acting[first + 1 :] if i.skill in ("pick", "place")]
    return any(names(theme) and theme.noun not in PARTS for theme in moved)


def _with_topic(whole: Intent, named: bool, extra: Intent, topic: Phrase, *, ahead: bool) -> Intent | None:
    """The intent with what a clause without a verb adds to it; None where that is something else."""
    if not (ahead or extra.joint == "stop") or (extra.means and whole.skill != "press"):
        return None
    if ahead and named and whole.goal is not None and whole.goal.pronoun:
        return replace(whole, goal=topic)  # "there is a tray; put the cube on it"
    if not named:
        return replace(whole, theme=topic)
    assert whole.theme is not None
    if whole.theme.text.startswith(("a ", "an ")) and topic.noun != "object":
        return None
    if not ahead and whole.goal is not None and (goal := _refined(whole.goal, topic)) is not None:
        return replace(whole, goal=goal)  # what was said last is what it says more of
    theme = _refined(whole.theme, topic)
    if theme is None and whole.theme.noun in PARTS and whole.skill != "press":
        return replace(whole, theme=replace(whole.theme, owner=topic))  # "the jar is stuck, unscrew the lid"
    return None if theme is None else replace(whole, theme=theme)


def _refined(phrase: Phrase, more: Phrase) -> Phrase | None:
    """A phrase with what a second one says of the same thing; None where they contradict each other."""
    nouns = {phrase.noun, more.noun} - {"", "object"}
    if nouns == {"button", "lamp"}:  # "use the button to turn on the light"
        nouns = {"button"}
    colours = {phrase.colour, more.colour} - {""}
    unknown = {phrase.unknown, more.unknown} - {()}
    if max(len(nouns), len(colours), len(unknown)) > 1:
        return None
    named = {"", "bottle"} if all(set(words) <= set(CONTENTS) for words in unknown) else {""}
    if any(
        one.noun not in named and other.unknown and not other.noun
        for one, other in ((phrase, more), (more, phrase))
    ):
        return None  # "the box" and "the ladle", whatever that is
    return replace(
        phrase,
        text=" ".join(dict.fromkeys((*phrase.text.split(), *more.text.split()))),
        noun=next(iter(nouns), phrase.noun or more.noun),
        colour=next(iter(colours), ""),
        unknown=next(iter(unknown), ()),
        selectors=(*phrase.selectors, *more.selectors),
        landmark=phrase.landmark or more.landmark,
        owner=phrase.owner or more.owner,
    )


def settle(intent: Intent) -> Intent:
    """Which skill a wording means, now that it is known what it is done to."""
    noun = intent.theme.noun if intent.theme is not None else ""
    nowhere = intent.goal is None and intent.direction is None
    skill, verb = intent.skill, intent.verb
    lit = noun == "lamp" and skill == "place" and nowhere and verb != "move"  # "put the light on"
    readings = (
        (skill == "fetch", "pick" if nowhere else "place"),
        (lit or (noun == "button" and skill in ("open", "close", "push")), "press"),
        (skill == "place" and verb == "pop" and nowhere and noun == "lid", "open"),  # "pop the cork"
        (noun == "lid" and verb in ("push down", "push on", "press down", "flip on"), "close"),
    )
    return replace(intent, skill=next((meant for holds, meant in readings if holds), skill))


def _one_skill(skills: Sequence[str]) -> str:
    """The one skill that does all of them, or ""."""
    asked = set(skills)
    return next((s for s in sorted(asked) if asked - {s} <= ABSORBS.get(s, frozenset())), "")


def _one_theme(named: Sequence[Phrase], skill: str) -> Phrase | None:
    """The theme that all phrases can mean together; None when they differ."""
    if skill in WORKED:  # "open the red jar by twisting its lid": the lid is the jar's
        named = [p for p in named if p.noun not in PARTS] or named
    theme: Phrase | None = named[0]
    for other in named[1:]:
        theme = theme and _refined(theme, other)
    return theme
