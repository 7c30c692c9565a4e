"""What may enter the bank, and in which state: by verdict, and by what the text looks like."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from gvla2.memory.contracts import Lesson, LifecycleState, Verdict

_INSTRUCTION_LIKE = re.compile(
    r"""
    \b(ignore|disregard|forget|override|bypass)\b .{0,40}
        \b(instruction|prompt|rule|message|constraint|polic|check|limit)
    | \b(ignorier|vergiss|missachte)\w*\b .{0,40} \b(anweisung|regel|befehl)
    | \b(ignore[zr]?|oublie[zr]?)\b .{0,40} \b(instructions|consignes|règles)
    | \b(ignora|olvida|dimentica)\b .{0,40} \b(instrucciones|reglas|istruzioni|regole)
    | \b(игнорируй|забудь)\w*\b .{0,40} \b(инструкци|правил)
    | (忽略|无视|忘记|無視|忘れ) .{0,12} (指令|指示|提示|规则|規則|命令)
    | (指示|命令|ルール|指令) .{0,6} (無視|忘れ)
    | \byou\s+are\s+now\s+(an?|the|my|no\s+longer|free|in)\b
    | \bact\s+as\s+(an?|the|my)\s+(\w+\s+)?(assistant|model|ai|admin\w*|root|user|developer)\b
    | \bnew\s+(system\s+)?(instructions?|prompt)\b | \bsystem\s+(prompt|message)\b
    | (^|\n)\s*(system|assistant|user|developer)\s*: | <\|?\s*/?\s*(im_start|im_end|system|memory)\b
    | \b(reveal|print|send|leak)\b .{0,40} \b(password|secret|api\s*key|token|credential)
    | \brm\s+-rf\b | \bsudo\s | \b(curl|wget)\s+\S+://
    """,
    re.IGNORECASE | re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True)
class Decision:
    """What becomes of a lesson: its ``state`` in the bank, or None when it is not stored; ``note`` says why."""

    state: LifecycleState | None
    note: str = ""


def admit(lesson: Lesson, verdict: Verdict, *, admission: bool = True, failures: bool = True) -> Decision:
    """Decide on one lesson.

    Verified lessons become active. What was uncertain, or could not be judged, is provisional at most, and so is
    text that reads like instructions to a machine. A failed episode teaches constraints, never recipes.
    ``admission`` False is the ablation that lets everything but quarantined text in as active; ``failures`` False
    the one that learns nothing from failures.
    """
    if not lesson.content.strip():
        return Decision(None, "A lesson without words was left out.")
    failed = verdict.outcome == "verified_fail"
    if not failures and (failed or lesson.type == "failure_avoidance"):
        return Decision(None, "Learning from failures is switched off.")
    if failed and lesson.type == "procedural_hint":
        return Decision(
            None, "A recipe from a failed episode was left out: failures teach constraints alone."
        )
    if reads_like_instructions(lesson.content):
        return Decision("provisional", "quarantined: the text reads like instructions")
    if not admission or failed or verdict.outcome == "verified_success":
        return Decision("active")
    why = "could not be judged" if verdict.outcome == "unavailable" else "is uncertain"
    return Decision("provisional", f"the outcome {why}")


def reads_like_instructions(text: str) -> bool:
    """Whether a text talks to a machine rather than about a task; errs on the careful side."""
    plain = unicodedata.normalize("NFKC", text)
    visible = "".join(c for c in plain if c in "\n\t" or unicodedata.category(c)[0] != "C")
    return _INSTRUCTION_LIKE.search(visible) is not None
