"""What is to be preferred to what: "use A, not B" against "use B, not A"."""

import pytest

from gvla2.memory.meaning.conflicts import contradiction

TURNED_ROUND = [
    (
        "Use the suction cup, not the gripper, for the foil.",
        "Use the gripper, not the suction cup, for the foil.",
    ),
    ("Clone with ssh instead of https.", "Clone with https instead of ssh."),
    ("Instead of scp, use rsync for the copy.", "Instead of rsync, use scp for the copy."),
    ("Prefer uv over pip for the lock file.", "Prefer pip over uv for the lock file."),
    (
        "Trust the laser rather than the sonar near glass.",
        "Trust the sonar rather than the laser near glass.",
    ),
    ("Nimm den Hammer statt der Zange.", "Nimm die Zange statt des Hammers."),
    ("Utilise npm plutôt que yarn.", "Utilise yarn plutôt que npm."),
    ("Usa la pala en lugar de la escoba.", "Usa la escoba en lugar de la pala."),
]
OTHERS = [
    ("Use pip, not poetry, in the container.", "Use poetry, not pip, on the laptop."),
    ("Use rsync instead of scp.", "Use rsync rather than scp to copy."),
    ("Instead of scp, use rsync.", "Copy with rsync."),
    ("Prefer uv over pip.", "Prefer uv over poetry."),
    ("Prefer a top grasp to open the box.", "Open the box with a top grasp."),
    ("Nimm den Hammer statt der Zange.", "Nimm die Zange statt der Schere."),
]


@pytest.mark.parametrize(("first", "second"), TURNED_ROUND)
def test_a_choice_turned_round_is_a_contradiction(first: str, second: str) -> None:
    assert contradiction(first, second) is not None
    assert contradiction(second, first) is not None


@pytest.mark.parametrize(("first", "second"), OTHERS)
def test_another_choice_is_none(first: str, second: str) -> None:
    assert contradiction(first, second) is None
    assert contradiction(second, first) is None
