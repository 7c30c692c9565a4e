"""Intents: what clauses ask for, and what they ask for together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gvla2_plugins.skill.clauses import Joint
from gvla2_plugins.skill.lexicon import PARTS, WORKED
from gvla2_plugins.skill.phrases import Phrase


@dataclass(frozen=True)
class Denial:
    """What is not to be done, or not to what: its ``text``, the verbs in it, and the thing that it names, if any."""

    text: str
    verbs: frozenset[str] = frozenset()
    phrase: Phrase | None = None


@dataclass(frozen=True)
class Intent:
    """What a sentence asks for. ``skill`` is "" when no verb was understood; ``verb`` is how it was worded.

    ``relation`` is that of the goal (on, in, to, beside, ...); ``amount`` metres; ``direction`` a unit vector (x, y)
    in the robot's frame. ``trouble`` says why a sentence with known words cannot be followed. ``notes`` are
    guesses made on the way; ``denials`` what the sentence rules out.
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
    denials: tuple[Denial, ...] = ()


@dataclass(frozen=True)
class Said:
    """What one clause says. ``joint`` is how it follows the one before; ``means``: its theme is what to do it with
    ("use the button to ..."); ``denied``: what it names is not to be acted on.
    """

    intent: Intent
    joint: Joint = ""
    means: bool = False
    denied: bool = False


def combine(said: Sequence[Said]) -> Intent:
    """One intent of a sentence's clauses: "grab the cube and put it on the tray" is one placing.

    Clauses without a verb may name what the others are about ("the olive cube: lift it", "find the cube and lift
    it") or say more of it afterwards ("lift the cube, the blue one"); otherwise they name a second thing.
    """
    said = [_going_to(s, said) for s in said]
    intents = [s.intent for s in said]
    acting = [i for i in intents if i.skill]
    if not acting:
        return replace(intents[0], skill="") if intents else Intent()
    if unsupported := [i for i in acting if i.skill == "unsupported"]:
        return replace(unsupported[0], trouble=f"'{unsupported[0].verb}' is no skill of this planner")
    if any(i.skill == "press" for i in acting):  # "press the button by pushing it", "bring the lamp to light"
        acting = [i for i in acting if i.skill == "press" or not _means_of_pressing(i)]
    skill = _one_skill({i.skill for i in acting})
    named = [
        i.theme for i in acting if i.theme is not None and not i.theme.pronoun and not i.theme.everywhere
    ]
    theme = (
        _one_theme(named, skill) if named else next((i.theme for i in acting if i.theme is not None), None)
    )
    if skill == "pick" and any(i.goal is not None for i in intents):
        skill = "place"  # "get it out of the stack and onto the tray"
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
    if not skill:
        return replace(whole, trouble="it asks for several different actions; ask for one at a time")
    known, several = bool(named), bool(named) and theme is None
    for extra, ahead in _topics(said):
        told = None if several else _with_topic(whole, known, extra, ahead)
        if told is not None:
            whole, known = told, True
        elif not extra.denied:
            several = True
    if several:
        return replace(whole, trouble="it names several things to act on; ask for one at a time")
    return settle(whole)


def _means_of_pressing(intent: Intent) -> bool:
    """Whether a clause beside a pressing one only says how: "... by pushing it", "bring the lamp ..." to light."""
    if intent.skill == "push":
        return intent.theme is None or intent.theme.pronoun
    lamp = intent.theme is not None and intent.theme.noun == "lamp"
    return lamp and intent.skill == "pick" and intent.verb in ("bring", "get") and intent.goal is None


def _going_to(said: Said, everything: Sequence[Said]) -> Said:
    """In "move to the cube and lift it" the hand is to move, and where to is what the sentence is about."""
    intent = said.intent
    others = any(s.intent.skill for s in everything if s is not said)
    if others and intent.skill == "place" and intent.verb == "move" and intent.theme is None and intent.goal:
        return replace(said, intent=Intent("", intent.verb, intent.goal))
    return said


def _topics(said: Sequence[Said]) -> list[tuple[Said, bool]]:
    """The clauses that only name something, and whether they stand ahead of the first action."""
    first = next(k for k, s in enumerate(said) if s.intent.skill)
    return [
        (s, k < first)
        for k, s in enumerate(said)
        if not s.intent.skill
        and s.intent.theme is not None
        and (s.intent.theme.noun or s.intent.theme.colour)
    ]


def _with_topic(whole: Intent, named: bool, extra: Said, ahead: bool) -> Intent | None:
    """The intent with what a clause without a verb adds to it; None where that is something else."""
    topic = extra.intent.theme
    assert topic is not None
    if not (ahead or extra.joint == "stop") or (extra.means and whole.skill != "press"):
        return None
    if ahead and named and whole.goal is not None and whole.goal.pronoun:
        return replace(whole, goal=topic)  # "there is a tray; put the cube on it"
    if not named:
        return replace(whole, theme=topic)
    assert whole.theme is not None
    if whole.skill == "press":
        parts = {"", "object", "button", "lamp"}
        fits = {topic.noun, whole.theme.noun} <= parts and topic.colour in ("", whole.theme.colour)
        return replace(whole, theme=_one_theme([whole.theme, topic], "press")) if fits else None
    if not ahead and whole.goal is not None and (goal := _refined(whole.goal, topic)) is not None:
        return replace(whole, goal=goal)  # what was said last is what it says more of
    theme = _refined(whole.theme, topic)
    return None if theme is None else replace(whole, theme=theme)


def _refined(phrase: Phrase, more: Phrase) -> Phrase | None:
    """A phrase with what a second one says of the same thing; None where they contradict each other."""
    nouns = {phrase.noun, more.noun} - {"", "object"}
    colours = {phrase.colour, more.colour} - {""}
    unknown = {phrase.unknown, more.unknown} - {()}
    if max(len(nouns), len(colours), len(unknown)) > 1:
        return None
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
    if intent.skill == "fetch":
        return replace(intent, skill="place" if intent.goal is not None or intent.direction else "pick")
    if intent.skill in ("open", "close") and noun in ("button", "lamp") and intent.verb.startswith("flip"):
        return replace(intent, skill="press")
    if intent.skill == "push" and intent.verb == "work" and noun in ("lamp", "button"):
        return replace(intent, skill="press")
    if intent.skill == "push" and noun == "button" and intent.goal is None and intent.direction is None:
        return replace(intent, skill="press")
    if (
        intent.skill == "press"
        and intent.verb in ("push down", "push on")
        and noun not in ("", "button", "lamp")
    ):
        return replace(intent, skill="push")
    if intent.skill == "place" and noun == "lamp" and intent.goal is None and intent.direction is None:
        return replace(intent, skill="press")  # "put the light on"
    return intent


def _one_skill(skills: set[str]) -> str:
    """The one skill that does all of them, or ""."""
    for group, whole in (
        ({"pick", "place"}, "place"),
        ({"place", "push"}, "push"),  # "move it there by pushing"
        ({"pick", "push"}, "push"),
        ({"pull", "place"}, "place"),  # where it is held by other things, the scene says so
        ({"twist", "pick"}, "twist"),
        ({"twist", "place"}, "twist"),
        ({"twist", "pull"}, "twist"),
        ({"twist", "open"}, "twist"),
        ({"twist", "pick", "place"}, "twist"),
        ({"pull", "pick"}, "pick"),
        ({"pull", "pick", "place"}, "place"),
        ({"pull", "open"}, "open"),
        ({"pick", "open"}, "open"),
        ({"place", "open"}, "open"),  # a jar, and its lid is put somewhere
        ({"pick", "place", "open"}, "open"),
        ({"push", "close"}, "close"),
        ({"pull", "close"}, "close"),
    ):
        if skills == group:
            return whole
    return next(iter(skills)) if len(skills) == 1 else ""


def _one_theme(named: Sequence[Phrase], skill: str) -> Phrase | None:
    """The theme that all phrases can mean, the most telling of them; None when they differ."""
    if skill == "press":
        buttons = [p for p in named if p.noun == "button"]
        return max(buttons or named, key=_telling)
    if skill in WORKED:  # "open the red jar by twisting its lid": the lid is the jar's
        named = [p for p in named if p.noun not in PARTS] or named
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
