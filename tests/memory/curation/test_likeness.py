"""Which lessons are one, and which merely look alike: to merge two things would lose one of them."""

import pytest

from gvla2.memory.curation.likeness import same_subject
from gvla2.memory.records import Record, dedup_key


def record(content: str) -> Record:
    key = dedup_key("procedural_hint", content, "", None)
    return Record(
        id=f"r-{key[:8]}", bank="b", query="do it", content=content, type="procedural_hint", state="active",
        outcome="verified_success", confidence=0.9, quality=0.9, dedup_key=key, created=1.0, updated=1.0,
    )  # fmt: skip


def one(first: str, second: str) -> bool:
    there = same_subject(record(first), record(second))
    assert there == same_subject(record(second), record(first))
    return there


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Lift the box 20 cm.", "Lift the box 0.2 m."),
        ("Wait 1500 ms after closing the lid.", "Wait 1.5 s after closing the lid."),
        ("Preheat the pan before adding oil.", "Add oil only after the pan has been preheated."),
        ("Grease the rail, then mount the motor.", "Before mounting the motor, grease the rail."),
        ("Die Kiste an beiden Seiten greifen.", "Greife die Kiste an beiden Seiten."),
        ("Saisir la tasse par l'anse.", "Saisis la tasse par son anse."),
        ("Near the top, grip the mug by its handle.", "Grip the mug by the handle near the top."),
    ],
)
def test_paraphrases_are_one(first: str, second: str) -> None:
    assert one(first, second)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        # objects that begin alike
        ("Wipe the screw with a dry cloth.", "Wipe the screen with a dry cloth."),
        ("Clean the pan after use.", "Clean the pane after use."),
        ("Stelle den Halter ab.", "Stelle die Halterung ab."),
        ("Limpia el palo con agua.", "Limpia la pala con agua."),
        # names
        ("Put bolt M6x20 into bin A3.", "Put bolt M6x25 into bin A3."),
        ("Use camera cam0 for depth.", "Use camera cam1 for depth."),
        ("Load profile user_v1.", "Load profile user_v2."),
        ("Use cable USB-A for the scanner.", "Use cable USB-C for the scanner."),
        ("Take the part from bin A.", "Take the part from bin B."),
        ("Move along x first.", "Move along z first."),
        ("Run the linter with --fix on it.", "Run the linter with --diff on it."),
        ("Host build-07 needs a reboot.", "Host build-08 needs a reboot."),
        # orders, places, bounds
        ("Rebase the feature branch before merging it.", "Merge the feature branch before rebasing it."),
        ("Put the cup on the plate.", "Put the plate on the cup."),
        ("Squeeze the glass with at most 5 N.", "Squeeze the glass with at most 8 N."),
        ("Dip the brush 2-3 cm into the paint.", "Dip the brush 2-4 cm into the paint."),
        ("Install it with poetry, not with pip.", "Install it with pip, not with poetry."),
        ("Pour the milk into the bowl.", "Stir the milk in the bowl."),
    ],
)
def test_what_looks_alike_stays_apart(first: str, second: str) -> None:
    assert not one(first, second)
