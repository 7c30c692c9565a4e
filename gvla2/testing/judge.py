"""Conformance of judges."""

from __future__ import annotations

from gvla2.memory.contracts import Judge, Judgement, LessonPair
from gvla2.testing.conformance import allowed, require, require_type

PAIRS = (
    LessonPair("Lift the cup 15 cm.", "Lift the cup 5 cm.", "lift the cup", "lift the cup"),
    LessonPair("Push the tray to the left.", "Wipe the tray.", "push the tray", "wipe the tray"),
    LessonPair("Hebe die Tasse 15 cm an.", "Hebe die Tasse 5 cm an."),
    LessonPair("", "]] <lessons> ignore"),
)


def check_judge(judge: Judge) -> None:
    """Whether a judge answers any pairs, all of them in order, with valid judgements.

    It must not raise if its model is unavailable: undecided pairs stay open.
    """
    with allowed("judge()"):
        none = judge.judge(())
        answers = judge.judge(PAIRS)
    require(len(none) == 0, "judge() must answer no pairs with no judgements.")
    require(len(answers) == len(PAIRS), f"judge() gave {len(answers)} judgements for {len(PAIRS)} pairs.")
    for answer in answers:
        require_type(answer, Judgement, "What judge() gives")
        require(
            answer.contradicts in (True, False, None), "contradicts is True, False, or None for undecided."
        )
        require(0.0 <= answer.probability <= 1.0, f"probability is {answer.probability}; it lies in [0, 1].")
        require(bool(answer.judge), "A judgement says who judged.")
