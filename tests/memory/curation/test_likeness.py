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
        # idle words
        ("Always use the scraper.", "Use a scraper, please."),
        ("Make sure the lid is closed.", "The lid must be closed."),
        ("Greifen Sie die Kiste immer mit beiden Händen.", "Greife die Kiste bitte mit beiden Händen."),
        ("Lift the lid when it is hot.", "If it is hot, lift the lid."),
        # signs for the same
        ("Cover 5 m² with foil.", "Cover 5 m2 with foil."),
        ("Fill the tank with H₂O.", "Fill the tank with H2O."),
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
        # small words
        ("Enter the cell while the laser is off.", "Enter the cell while the laser is on."),
        ("Clean the blade with the motor off.", "Clean the blade with the motor on."),
        ("Only open the valve when the pump is off.", "Only open the valve when the pump is on."),
        ("Prüfe das Messer, wenn der Motor aus ist.", "Prüfe das Messer, wenn der Motor an ist."),
        ("Ouvre la vanne quand la pompe est allumée.", "Ouvre la vanne quand la pompe est éteinte."),
        ("Abre la tapa cuando la bomba está encendida.", "Abre la tapa cuando la bomba está apagada."),
        ("Weigh the sample with the lid on.", "Weigh the sample with the lid off."),
        ("Put the tray on the shelf.", "Put the tray under the shelf."),
        ("Put the cup in the box.", "Put the cup on the box."),
        ("Plug the cable into the in port.", "Plug the cable into the out port."),
        ("Check some of the parts.", "Check all of the parts."),
        ("Ask the operator or the guard.", "Ask the operator and the guard."),
        ("Wash the dark shirts only.", "Wash the dark shirts too."),
        ("Take two from the bin.", "Take two to the bin."),
        ("Stir until it boils.", "Stir when it boils."),
        ("Nimm die Tasse aus dem Regal.", "Nimm die Tasse an dem Regal."),
        # what changed places
        ("Wire pin A to pin B.", "Wire pin B to pin A."),
        ("Route traffic from X to Y.", "Route traffic from Y to X."),
        ("Verwende Kabel A für Port B.", "Verwende Kabel B für Port A."),
        ("Put a cup on a plate.", "Put a plate on a cup."),
        ("Mueve la caja de la mesa a la silla.", "Mueve la caja de la silla a la mesa."),
        ("Carry it from sink to oven via door.", "Carry it from door to sink via oven."),
        ("Check all of the bolts and some of the nuts.", "Check some of the bolts and all of the nuts."),
        # joined names
        ("Use branch release/1.4.", "Use branch release/14."),
        ("Install package foo_1.0.", "Install package foo_10."),
        ("Merge PR-1-2 last.", "Merge PR-12 last."),
        ("Use host-1.2.3.4 for backups.", "Use host-12.34 for backups."),
        # raised, lowered and mixed numbers
        ("Pump down to 10⁵ Pa.", "Pump down to 105 Pa."),
        ("Print the counter in base 10₂.", "Print the counter in base 102."),
        ("Add 1½ cups of milk.", "Add 11/2 cups of milk."),
    ],
)
def test_what_looks_alike_stays_apart(first: str, second: str) -> None:
    assert not one(first, second)


def test_a_raised_digit_is_no_digit_of_the_number() -> None:
    assert record("Pump down to 10⁵ Pa.").dedup_key != record("Pump down to 105 Pa.").dedup_key
    assert record("Pump down to 10⁵ Pa.").dedup_key == record("pump down to  10^5 Ｐａ.").dedup_key
    assert record("Öffne die Klappe.").dedup_key == record("O\u0308ffne die Klappe.").dedup_key
