"""What texts say, compared by class: order, double negation, axes, names, long lessons; and what looks like it."""

import pytest

from gvla2.memory.meaning.conflicts import Said, conflict, contradiction
from gvla2.memory.meaning.identifiers import marked
from gvla2.memory.meaning.statements import read


def contradict(first: str, second: str) -> bool:
    there = contradiction(first, second)
    assert (there is None) == (contradiction(second, first) is None)
    return there is not None


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Drill the hole before painting.", "Paint before drilling the hole."),
        ("Rebase the topic branch before merging it.", "Merge the topic branch before rebasing it."),
        ("First sand the leg and afterwards glue it.", "First glue the leg and afterwards sand it."),
        ("Wash the brush once the paint is dry.", "Wash the brush before the paint is dry."),
        ("As soon as the belt stops, take the part.", "Take the part before the belt stops."),
        ("Don't pour until the glass is upright.", "Pour before the glass is upright."),
        ("Never unplug the sensor before stopping the log.", "Unplug the sensor before stopping the log."),
        ("Stop the server and only then copy the data.", "Copy the data and only then stop the server."),
        ("Cut the wire, and lastly mark it.", "Mark the wire, and lastly cut it."),
        ("Mount the lens ahead of the filter.", "Mount the lens after the filter."),
        ("Reinige die Linse, bevor du misst.", "Miss, bevor du die Linse reinigst."),
        ("Sobald das Wasser kocht, gib Salz hinzu.", "Gib Salz hinzu, bevor das Wasser kocht."),
        ("Zuerst wiegen, dann mischen.", "Zuerst mischen, dann wiegen."),
        ("Nettoyer la lentille avant de mesurer.", "Mesurer avant de nettoyer la lentille."),
        ("Dès que l'eau bout, ajouter le sel.", "Ajouter le sel avant que l'eau bout."),
        ("Primero pesa y después mezcla.", "Primero mezcla y después pesa."),
        ("En cuanto el agua hierva, añade sal.", "Añade sal antes de que el agua hierva."),
        ("先称重,再搅拌。", "先搅拌,再称重。"),
        ("切割后测量零件。", "切割前测量零件。"),
    ],
)
def test_two_orders_contradict_each_other(first: str, second: str) -> None:
    assert contradict(first, second)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Drill the hole before painting.", "Paint only after drilling the hole."),
        ("Never pour before the glass is upright.", "Pour only once the glass is upright."),
        (
            "Don't unplug the sensor until the log has stopped.",
            "Unplug the sensor after the log has stopped.",
        ),
        ("Grease the rail, then mount the motor.", "Before mounting the motor, grease the rail."),
        ("Cut the wire before marking it.", "Cut the wire before measuring the board."),
        ("Place the fork left of the plate before the knife.", "Place the knife after the fork."),
        ("Press the button once before starting.", "Press the button before starting."),
        ("Bohre das Loch, bevor du malst.", "Male erst, nachdem du das Loch gebohrt hast."),
        ("Starte nicht, bis die Lampe leuchtet.", "Starte, sobald die Lampe leuchtet."),
        ("Ne jamais verser avant le signal.", "Verser seulement après le signal."),
        ("Nunca empieces hasta que la luz esté verde.", "Empieza cuando la luz esté verde."),
        ("先称重,再搅拌。", "搅拌之前先称重。"),
        # two moments of one task
        ("Close the gripper, then lift.", "Open the gripper before approaching the block."),
        ("Open the gripper, approach, then close the gripper.", "Close the gripper around the cup."),
    ],
)
def test_one_order_in_other_words_does_not(first: str, second: str) -> None:
    assert not contradict(first, second)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("Don't drill without glasses.", "Drill with glasses.", False),
        ("Don't drill without glasses.", "Drill without glasses.", True),
        ("Never commit without running the tests.", "Run the tests, then commit.", False),
        ("Schweiße nie ohne Schutzbrille.", "Schweiße mit Schutzbrille.", False),
        ("Fahre ohne Licht.", "Fahre mit Licht.", True),
        ("Ne jamais percer sans lunettes.", "Percer avec des lunettes.", False),
        ("Percer sans lunettes.", "Percer avec lunettes.", True),
        ("Nunca cortes sin guantes.", "Corta siempre con guantes.", False),
        ("Corta sin guantes.", "Corta con guantes.", True),
        ("不要在没有手套的情况下切割。", "戴手套切割。", False),
        ("Never start unless the guard is closed.", "Start only if the guard is closed.", False),
        ("Cook without salt.", "Use no salt for cooking.", False),
        ("You need not wipe the lens.", "Wipe the lens.", False),
        ("You must not wipe the lens.", "Wipe the lens.", True),
        ("Du musst die Linse nicht wischen.", "Wische die Linse.", False),
        ("Avoid welding without gas.", "Weld with gas.", False),
        ("Never push the crate to the left: it falls.", "Push the crate to the left.", True),
        ("Build the image without cache.", "Build the image with cache.", True),
    ],
)
def test_two_negations_are_none(first: str, second: str, expected: bool) -> None:
    assert contradict(first, second) is expected


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("Lift the lid 10 cm.", "Push the lid 30 cm.", False),
        ("Lift the lid 10 cm.", "Lift the lid slowly by 30 cm.", True),
        ("The rod is 2 cm thick.", "The rod is 40 cm long.", False),
        ("The rod is 30 cm long.", "The rod is 60 cm long.", True),
        ("Hebe die Kiste 10 cm.", "Schiebe die Kiste 30 cm.", False),
        ("Open the front hatch before leaving.", "Close the back hatch before leaving.", False),
        ("The first layer needs 0.3 mm.", "The second layer needs 0.2 mm.", False),
        ("Keep the lid on while boiling.", "Take the lid off while boiling.", True),
        ("Keep the lid on while boiling.", "Take the lid off when serving.", False),
        # names: another thing, whatever is said of it
        ("Turn lamp A by 90 degrees.", "Turn lamp B by 20 degrees.", False),
        ("Turn lamp A by 90 degrees.", "Turn lamp A by 20 degrees.", True),
        ("Move 10 cm along x.", "Move 40 cm along z.", False),
        ("Pull the cable at USB-A.", "Push the cable at USB-C.", False),
        ("Limit node-07 to 4 GB.", "Limit node-22 to 64 GB.", False),
        ("Use 4 N for the M6x20.", "Use 9 N for the M6x25.", False),
        ("Run make with -j 2.", "Run make with -j 16.", True),
        ("Pour 20 ml per second.", "Pour 200 ml per second.", True),
        ("Lift the screw 10 cm.", "Lift the screen 40 cm.", False),
    ],
)
def test_other_acts_and_other_things_do_not_contradict(first: str, second: str, expected: bool) -> None:
    assert contradict(first, second) is expected


LONG = "The shelf is narrow and other things stand close by, so a second image helps. {} Report the pose afterwards."
OTHER = "Two of the last runs went wrong here. {} That was confirmed on the next day by another team."


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("Lift the toolbox 15 cm, wait, then move sideways.", "Lift the toolbox 40 cm before any motion.", True),
        ("Lift it 15 cm, wait a second, then move sideways.", "Lift the toolbox 40 cm before any motion.", True),
        ("Heat the nozzle to 240 °C so that the layers stick.", "Heat the nozzle to 190 °C and wait.", True),
        ("Turn the key clockwise to unlock the door.", "To unlock the door, turn the key counterclockwise.", True),
        ("Run `make clean` before `make install`.", "Run `make install` before `make clean`.", True),
        ("Install it with poetry, not with pip.", "Install it with pip, not with poetry.", True),
        ("Wait 2 s.", "Wait 10 minutes.", False),
        ("Lift the toolbox 15 cm.", "Lift the tray 40 cm.", False),
        ("Turn the left knob clockwise.", "Turn the right knob counterclockwise.", False),
        ("If the cup is full, lift it at 5 cm/s.", "If the cup is empty, lift it at 20 cm/s.", False),
    ],
)  # fmt: skip
def test_one_sentence_of_a_long_lesson_is_found(first: str, second: str, expected: bool) -> None:
    assert contradict(LONG.format(first), OTHER.format(second)) is expected


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("The towels go in the left basket.", "The towels go in the right basket."),
        ("Das Salz kommt in das linke Fach.", "Das Salz kommt in das rechte Fach."),
        ("杯子要放在上层篮子里。", "杯子要放在下层篮子里。"),
    ],
)
def test_a_thing_has_one_place_in_one_task(first: str, second: str) -> None:
    assert contradiction(first, second, one_task=True) is not None
    # ... and two drawers are two things
    assert contradiction("Open the left drawer.", "Open the right drawer.", one_task=True) is None
    said = [Said("procedural_hint", text, "", None, "tidy up") for text in (first, second)]
    assert conflict(*said) is not None


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Don't switch on the lamp near the scanner, it causes glare.", "Switch on the lamp near the scanner."),
        ("I learnt that the hopper needs 4 kg of grain.", "Fill the hopper with 9 kg of grain."),
        ("We found that the vise has to be closed slowly.", "The vise has to be closed quickly."),
        ("The server allows 60 requests a minute before error 429.",
         "The server allows 10 requests a minute before error 429."),
        ("Use rsync rather than scp to copy the logs.", "Copy the logs with scp instead of rsync."),
        ("Usa el cepillo en lugar de la esponja.", "Usa la esponja en vez del cepillo."),
        ("Put the oil in before the salt.", "The salt goes in before the oil."),
        ("Grip the tray by its upper edge.", "Grip the tray by its lower edge."),
        ("Raise the limit of the queue.", "Reduce the limit of the queue."),
        ("Give Postgres 3 seconds to start.", "Give Postgres 45 seconds to start."),
        ("没有许可不能进入机房。", "没有许可可以进入机房。"),
    ],
)  # fmt: skip
def test_what_is_said_around_it_does_not_hide_it(first: str, second: str) -> None:
    assert contradict(first, second)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Take a hammer instead of pliers.", "Take pliers instead of scissors."),
        ("The belt accelerates for 2 s.", "The belt pauses for 10 s at each station."),
        ("没有通过测试的版本不能部署。", "只有通过测试的版本才能部署。"),
        ("Raise the lid.", "Reduce the heat."),
    ],
)
def test_what_only_sounds_like_it_does_not(first: str, second: str) -> None:
    assert not contradict(first, second)


def test_a_bound_that_forbids_stands_against_a_hint() -> None:
    rule = Said("failure_avoidance", "Never lift the cup higher than 30 cm.")
    found = conflict(Said("procedural_hint", "Lift the cup 90 cm."), rule)
    assert found is not None
    assert found.kind == "forbidden"
    assert conflict(Said("procedural_hint", "Lift the cup 20 cm."), rule) is None


def test_names_are_words_of_their_own() -> None:
    assert "nrA0" in marked("Take it from bin A.")
    assert marked("a cup is a cup, 5 N on it") == "a cup is a cup, 5 N on it"
    assert marked("Save as UTF-8 at 3 m/s") == "Save as UTF-8 at 3 m/s"
    (clause,) = read("Use cable USB-C for it.").clauses
    assert any(word.startswith("nr") for word in clause.words)
    assert clause.pronoun
