"""Exceptions: what a sentence says is not to be done, and not to what. It is heeded, or the sentence is declined."""

from __future__ import annotations

from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.grounding import ground_all, strange
from gvla2_plugins.skill.intents import Denial, Intent

MOVING = ("pick", "fetch", "place", "pull")
"""Skills that take a thing from where it is."""


def excepted(intent: Intent, scene: Scene) -> frozenset[str] | Abstention:
    """The ids that a sentence rules out; a refusal where what it rules out cannot be told or leaves nothing to do."""
    out: set[str] = set()
    for denial in intent.denials:
        words = denial.text.split()
        mishap = any(w.startswith(lexicon.MISHAPS) for w in words)
        if (mishap and intent.skill != "press") or lexicon.REMAINDER & set(words):
            continue  # planning avoids it anyway; "not the others"
        phrase = denial.phrase
        if phrase is None or phrase.pronoun or phrase.everywhere:
            if not _apart(denial, intent):
                return Abstention("other", f"It asks to {intent.skill} and says not to: '{denial.text}'.")
            continue
        found = ground_all(phrase, scene)
        if not denial.verbs and (not found or all(strange(phrase, o) for o in found)):
            return Abstention("nothing_matches", f"What is meant by not '{denial.text}' cannot be told.")
        if phrase.unknown and not found and not _apart(denial, intent):
            return Abstention("other", f"What is not to be done, '{denial.text}', is not understood.")
        out |= {o.id for o in found}
    return frozenset(out)


def _apart(denial: Denial, intent: Intent) -> bool:
    """Whether a denial that names nothing leaves what is asked as it is: it is of another skill, and says no more."""
    words = set(denial.text.split())
    if not denial.verbs:
        return bool(words & (lexicon.SUPPORTS | lexicon.STAYING)) and not words & lexicon.LETTING
    skills = [s for s, phrases in lexicon.VERBS.items() if {p.split()[0] for p in phrases} & denial.verbs]
    asked = MOVING if intent.skill in MOVING else (intent.skill,)
    return (
        bool(skills) and not set(skills) & set(asked) and (denial.phrase is None or not denial.phrase.unknown)
    )
