"""The planner: from words to skill calls. It never sees a task's name; what a call means, the core tells."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import cast

from gvla2.planning.calls import Relation, SkillCall, SkillOptions
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.scene import Scene
from gvla2.skills.carry_out import carry_out
from gvla2.skills.grounding import suited
from gvla2.skills.table import STANDARD
from gvla2.skills.wording import in_scene_words
from gvla2_plugins.skill import SkillConfig, lexicon
from gvla2_plugins.skill.grammar import parse
from gvla2_plugins.skill.grounding import Grounded, ground, ground_all, ground_button
from gvla2_plugins.skill.intents import Intent, names
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.sorting import sorting

MOVING = ("pick", "fetch", "place", "pull")
"""Skills that take a thing from where it is."""


@dataclass(frozen=True)
class SentenceReading:
    """What a sentence asks for, by the ids of a scene, and what was assumed in reading it."""

    calls: tuple[SkillCall, ...]
    notes: tuple[str, ...] = ()


class SkillPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner` by a grammar and grounding. Deterministic."""

    def __init__(self, config: SkillConfig) -> None:
        self.config = config
        self.options = SkillOptions(**{f.name: getattr(config, f.name) for f in fields(SkillOptions)})

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention, whatever the instruction says."""
        found = read(request.instruction, request.scene)
        if isinstance(found, Abstention):
            return Plan(None, abstention=found, options=self.options)
        made = carry_out(found.calls, request, self.options)
        return replace(made, notes=(*found.notes, *made.notes))


def read(sentence: str, scene: Scene) -> SentenceReading | Abstention:
    """The skill calls of a sentence; an abstention where it cannot be read with certainty.

    Read as it stands; where that fails, in the words that perception has for what is there; then part by part.
    """
    known = in_scene_words(sentence, scene)
    found = _read(sentence, scene)
    if isinstance(found, Abstention) and known != sentence:
        found = _read(known, scene)
    if isinstance(found, Abstention) and found.kind == "other":
        parts = [_read(part, scene) for part in lexicon.THEN.split(known)]
        said = [part for part in parts if isinstance(part, SentenceReading)]
        if len(said) == len(parts) > 1:
            calls, notes = [c for part in said for c in part.calls], [n for part in said for n in part.notes]
            return SentenceReading(tuple(calls), tuple(notes))
    return found


def _read(sentence: str, scene: Scene) -> SentenceReading | Abstention:
    if isinstance(pairs := sorting(sentence, scene), Abstention):
        return pairs
    if pairs:
        return SentenceReading(tuple(SkillCall("place", t.id, c.id, relation="in") for t, c in pairs))
    intent = parse(sentence, [o.label for o in scene.objects])
    if refusal := _not_understood(intent, sentence):
        absent = _theme(intent, scene, frozenset()) if intent.theme and intent.theme.unknown else None
        if isinstance(absent, Abstention) and absent.kind == "nothing_matches" and intent.skill in STANDARD:
            return _unread(absent, intent.theme, scene)
        return refusal
    if isinstance(out := _excepted(intent, scene), Abstention):
        return out
    if intent.theme is not None and "other" in intent.theme.text.split() and not intent.denials:
        return Abstention("ambiguous", f"What is not meant by '{intent.theme.text}' is not said.")
    theme = _theme(intent, scene, out)
    if isinstance(theme, Abstention) and (aimed := _aimed(intent)) is not None:
        intent, theme = aimed, _theme(aimed, scene, out)
    if isinstance(theme, Abstention):
        return _unread(theme, intent.theme, scene)
    ruled_out = ", ".join(o.label for o in scene.objects if o.id in out)
    notes = (*theme.notes, *([f"The sentence rules out {ruled_out}."] if ruled_out else []))
    call = SkillCall(intent.skill, theme.object.id, amount=intent.amount, direction=intent.direction)
    skill = "press" if intent.skill == "press" else suited(intent.skill, theme.object, scene, aimed=True)
    if intent.goal is None or STANDARD[skill].role("goal") is None:  # "pull the drawer out of the cabinet"
        return SentenceReading((call,), notes)
    if intent.goal.pronoun and intent.goal.landmark:
        return Abstention("no_goal", f"What '{intent.goal.text}' stands for is not told.")
    goal = ground(intent.goal, scene, exclude=out | {theme.object.id})
    if isinstance(goal, Abstention):
        own = theme if intent.goal.text == "itself" else ground(intent.goal, scene, exclude=out)
        if goal.kind != "nothing_matches" or isinstance(own, Abstention):
            return _unread(goal, intent.goal, scene)
        goal = own  # nothing else is called so; the core declines it
    call = replace(call, goal=goal.object.id, relation=cast(Relation, intent.relation), direction=None)
    return SentenceReading((call,), (*notes, *goal.notes))


def _unread(why: Abstention, phrase: Phrase | None, scene: Scene) -> Abstention:
    """The refusal; ``unread`` where what is known of the phrase, its colour or its noun, fits something there."""
    if phrase is None or why.kind != "nothing_matches" or not (phrase.colour or phrase.noun):
        return why
    return replace(why, unread=bool(ground_all(replace(phrase, unknown=()), scene)))


def _theme(intent: Intent, scene: Scene, out: frozenset[str]) -> Grounded | Abstention:
    """What it is done to, none of ``out``. Without a name, the one thing that can be moved, if there is only one."""
    seen = replace(scene, objects=tuple(o for o in scene.objects if o.id not in out))
    if intent.skill == "press":
        return ground_button(intent.theme, seen)
    phrase = intent.theme or Phrase("it", pronoun=True)
    return ground(phrase, seen, movable=True)


def _aimed(intent: Intent) -> Intent | None:
    """A taking of what is said to be on something, read as putting it there; None for any other."""
    if intent.theme is None or intent.theme.landmark is None:
        return None
    relation, goal = intent.theme.landmark
    theme = replace(intent.theme, landmark=None)
    if relation == "from" and intent.skill in ("place", "push") and intent.amount is not None:
        return replace(intent, theme=theme, goal=goal, relation="beside")  # "10 cm away from the cup"
    stands = intent.theme.stands and intent.verb != "want"
    if stands or intent.skill != "pick" or relation not in ("on", "in", "to"):
        return None
    if not (goal.noun or goal.colour or goal.unknown):
        return None  # "on its left side"
    return replace(intent, skill="place", theme=theme, goal=goal, relation=relation)


def _not_understood(intent: Intent, instruction: str) -> Abstention | None:
    asked = " ".join(instruction.split())[:200]
    unknown = "it says only what not to do" if intent.denials else "it has no verb that this planner knows"
    trouble = intent.trouble or ("" if intent.skill else unknown)
    if intent.skill not in STANDARD:
        return Abstention("unknown_skill", f"'{asked}': {trouble}; it can {', '.join(STANDARD)}.")
    return Abstention("other", f"'{asked}': {trouble}.") if trouble else None


def _excepted(intent: Intent, scene: Scene) -> frozenset[str] | Abstention:
    """The ids that a sentence rules out; a refusal where what it rules out cannot be told or leaves nothing to do."""
    out: set[str] = set()
    for text, denied in intent.denials:
        words, phrase = text.split(), denied.theme or denied.goal
        found = ground_all(phrase, scene) if names(phrase) else ()
        mishap = any(w.startswith(lexicon.MISHAPS) for w in words) and intent.skill != "press"
        touch = any(w.startswith(lexicon.TOUCHES) for w in words)
        if mishap and touch and phrase is not None and phrase.noun:
            out |= {o.id for o in found}  # "don't touch the red one"
        aimed = phrase is None and intent.skill == "push" and intent.goal is not None
        itself = aimed or (phrase is not None and phrase.pronoun)
        if touch and "touch" in text and intent.skill != "press" and itself:
            return Abstention("other", f"What '{text}' rules out is what is asked for.")
        if mishap or lexicon.REMAINDER & set(words):
            continue  # planning avoids it anyway; "not the others"
        if not found and not _apart(text, denied, intent):
            said = f", '{text}'," if text else ""
            return Abstention("other", f"What is not to be done or not meant{said} is not told.")
        out |= {o.id for o in found}
    return frozenset(out)


def _apart(text: str, denied: Intent, intent: Intent) -> bool:
    """Whether a denial that names nothing there leaves what is asked as it is: it is of another skill, no more."""
    unread = denied.theme is not None and denied.theme.unknown
    if unread or denied.verb == "move" or lexicon.LETTING & {*text.split()}:
        return False
    asked: tuple[str, ...] = MOVING if intent.skill in MOVING else (intent.skill,)
    asked += (*lexicon.WORKED, "push") if intent.skill in lexicon.WORKED else ()  # "open it without pulling"
    return denied.skill in STANDARD and denied.skill not in asked
