"""Words that oppose one another, as lessons use them, and words that only look so."""

import pytest

from gvla2.memory.meaning.conflicts import contradiction
from gvla2.memory.meaning.inflections import pole_of
from gvla2.memory.meaning.lexicon import CONCEPTS, POLES, SEGMENTS
from gvla2.memory.meaning.number_words import spelled_numbers
from gvla2.memory.meaning.opposites import OPPOSITES
from gvla2.memory.meaning.phrases import join_phrases
from gvla2.memory.meaning.prefixes import reverses

ACTS = """
Raise Lower ~ Lift Lower ~ Insert Remove ~ Insert Withdraw ~ Push Pull ~ Open Close ~ Open Shut ~ Grasp Release
Hold Release ~ Grab Drop ~ Tighten Loosen ~ Attach Detach ~ Heat Cool ~ Fill Empty ~ Extend Retract ~ Lock Unlock
Engage Disengage ~ Start Stop ~ Wrap Unwrap ~ Fold Unfold ~ Expand Collapse ~ Include Exclude ~ Approve Reject
Commit Revert ~ Inflate Deflate ~ Wet Dry ~ Show Hide ~ Save Discard ~ Mount Unmount ~ Freeze Thaw ~ Mute Unmute
Advance Retreat ~ Clamp Unclamp ~ Pin Unpin ~ Enable Disable ~ Load Unload ~ Install Uninstall ~ Upgrade Downgrade
Encrypt Decrypt ~ Pack Unpack ~ Seal Unseal ~ Cover Uncover ~ Dock Undock ~ Charge Discharge ~ Merge Split
Allow Forbid ~ Accept Refuse ~ Increase Reduce ~ Accelerate Decelerate ~ Register Unregister ~ Tie Untie
Plug Unplug ~ Connect Disconnect ~ Assemble Disassemble ~ Pause Resume ~ Add Delete ~ Wind Unwind ~ Bend Straighten
"""
STATES = """
open closed ~ wet dry ~ hot cold ~ full empty ~ long short ~ wide narrow ~ thick thin ~ dark bright ~ sharp blunt
soft hard ~ new old ~ high low ~ rigid flexible ~ smooth rough ~ safe dangerous ~ valid invalid ~ locked unlocked
necessary unnecessary ~ mandatory optional ~ allowed forbidden ~ visible hidden ~ enabled disabled ~ sealed unsealed
stable unstable ~ manual automatic ~ public private ~ encrypted unencrypted ~ clean dirty ~ raised lowered
extended retracted ~ upright inverted ~ fresh stale ~ synchronous asynchronous ~ tight loose ~ frozen thawed
"""
WAYS = """
slowly | quickly ~ inwards | outwards ~ vertically | horizontally ~ face up | face down ~ upright | upside down
in parallel | in series ~ forwards | backwards ~ facing north | facing south ~ by hand | automatically
upstream | downstream ~ clockwise | anticlockwise ~ firmly | gently ~ halfway | completely ~ early | late
tightly | loosely ~ locally | remotely ~ in ascending order | in descending order ~ indoors | outdoors
temporarily | permanently ~ together | separately ~ above the shelf | below the shelf ~ strictly | leniently
in front of the shelf | behind the shelf ~ on the left | on the right ~ near the wall | far from the wall
"""


def rows(table: str, by: str | None = None) -> list[tuple[str, str]]:
    """The pairs of a table."""
    made = []
    for pair in table.strip().replace("\n", "~").split("~"):
        first, second = pair.split(by)
        made.append((first.strip(), second.strip()))
    return made


CASES = [
    *(("{} the module before the camera is calibrated.", *pair) for pair in rows(ACTS)),
    *(("The module must be {} for the test.", *pair) for pair in rows(STATES)),
    *(("Store the module {}.", *pair) for pair in rows(WAYS, "|")),
]


@pytest.mark.parametrize(("frame", "first", "second"), CASES)
def test_opposites_in_english(frame: str, first: str, second: str) -> None:
    one, two = frame.format(first), frame.format(second)
    assert contradiction(one, two) is not None
    assert contradiction(two, one) is not None
    assert contradiction(one, one) is None


FOREIGN = """
Hebe die Kiste an. | Senke die Kiste ab. ~ Löse die Schraube. | Ziehe die Schraube fest.
Fahre den Greifer aus. | Fahre den Greifer ein. ~ Drehe den Knopf rechtsherum. | Drehe den Knopf linksherum.
Die Klappe muss offen bleiben. | Die Klappe muss geschlossen bleiben. ~ Schalte die Lampe an. | Schalte die Lampe aus.
Verriegle die Tür. | Entriegle die Tür. ~ Die Probe einfrieren. | Die Probe auftauen.
Lege das Glas aufrecht ab. | Lege das Glas kopfüber ab. ~ Starte die Pumpe manuell. | Starte die Pumpe automatisch.
Die Liste aufsteigend sortieren. | Die Liste absteigend sortieren. ~ Das Fett ist nötig. | Das Fett ist unnötig.
Pousser le levier. | Tirer le levier. ~ Laisser la lampe allumée. | Laisser la lampe éteinte.
Serrer la vis. | Desserrer la vis. ~ Monter le capteur. | Démonter le capteur.
Déplier la carte. | Plier la carte. ~ Tenir la corde. | Lâcher la corde.
Empuja el cajón. | Tira del cajón. ~ Agarra la taza. | Suelta la taza.
Deja la luz encendida. | Deja la luz apagada. ~ Bloquea la rueda. | Desbloquea la rueda.
Extiende el brazo. | Retrae el brazo. ~ Guarda el vaso boca abajo. | Guarda el vaso boca arriba.
抬起箱子。 | 放下箱子。 ~ 锁定车轮。 | 解锁车轮。
伸出手臂。 | 缩回手臂。 ~ 手动启动泵。 | 自动启动泵。
打开灯。 | 关闭灯。 ~ 握住绳子。 | 放开绳子。
Apri la valvola. | Chiudi la valvola. ~ Gire para a esquerda. | Gire para a direita.
Поверни ручку влево. | Поверни ручку вправо. ~ Закрой крышку. | Открой крышку.
"""


@pytest.mark.parametrize(("first", "second"), rows(FOREIGN, "|"))
def test_opposites_in_other_languages(first: str, second: str) -> None:
    assert contradiction(first, second) is not None
    assert contradiction(second, first) is not None


NONE = """
Open the valve for 5 s. | Clean the valve for 20 s. ~ Approach the dock at 5 cm/s. | Approach the lamp at 40 cm/s.
Attach the seal with 5 N. | Attach the clamp with 20 N.
Stop at the start of the track. | Start at the end of the track.
Lock the front wheel. | Unlock the rear wheel. ~ Hang the left lamp. | Hang the right lamp.
Use the inner bolt for the lid. | Use the outer bolt for the frame. ~ Raise the left arm. | Lower the right arm.
Fold the towel. | Seal the bag. ~ Wind the spring 3 times. | Charge the spring gun 9 times.
Put the lid down gently. | Gently lower the lid. ~ Heat the soup for 10 minutes. | Stir the soup for 3 minutes.
Install numpy 1.26 on the old host. | Install numpy 2.1 on the new host. ~ Use cam0 for depth. | Use cam1 for depth.
Keep the door shut. | The door must stay closed. ~ Turn the dial clockwise. | Turn the dial to the right side.
Entfetten vor dem Kleben. | Kleben nach dem Trocknen. ~ Poser le livre. | Déposer le livre.
"""


@pytest.mark.parametrize(("first", "second"), rows(NONE, "|"))
def test_what_only_looks_opposite(first: str, second: str) -> None:
    assert contradiction(first, second) is None
    assert contradiction(second, first) is None


def test_every_axis_has_two_sides_and_no_word_stands_on_both() -> None:
    sides: dict[str, set[str]] = {}
    for line in OPPOSITES.strip().replace("\n    ", " ").split("\n"):
        axis, _, words = line.partition(": ")
        first, second = (set(side.split()) for side in words.split(" / "))
        assert first
        assert second
        assert not first & second
        assert axis not in sides
        for word in first | second:
            assert CONCEPTS[word][:-1] == axis, word
        sides[axis] = first | second
    assert {axis for axis, _ in POLES.values()} == set(sides)
    assert all("\u3400" <= word[0] <= "\u9fff" for word in SEGMENTS)


@pytest.mark.parametrize(
    ("first", "second", "real"),
    [
        ("encrypt", "unencrypt", True),
        ("possible", "impossible", True),
        ("complete", "incomplete", True),
        ("serialize", "deserialize", True),
        ("sauber", "unsauber", True),
        ("visser", "dévisser", True),
        ("atornillar", "desatornillar", True),
        ("加密", "未加密", True),
        ("card", "discard", False),
        ("form", "inform", False),
        ("it", "unit", False),
        ("play", "display", False),
        ("placer", "déplacer", False),
        ("escribir", "describir", False),
        ("motor", "motors", False),
    ],
)
def test_prefixes_that_reverse(first: str, second: str, real: bool) -> None:
    assert reverses(first, second) is real
    assert reverses(second, first) is real


@pytest.mark.parametrize(
    ("word", "concept"),
    [
        ("unheated", "heat-"),
        ("unsealed", "sealing-"),
        ("uncovered", "covering-"),
        ("未密封", "sealing-"),
        ("trenne", "joining-"),
        ("dévissez", "screwing-"),
        ("desconectado", "joining-"),
        ("cache", None),
        ("tire", None),
        ("para", None),
        ("entre", None),
        ("united", None),
    ],
)
def test_forms_of_opposing_words(word: str, concept: str | None) -> None:
    assert (CONCEPTS.get(word) or pole_of(word)) == concept


def test_phrases_that_mean_more_than_their_words() -> None:
    assert join_phrases(["let", "go", "of", "it"]) == ["release", "of", "it"]
    assert join_phrases(["store", "it", "upside", "down", "now"]) == ["store", "it", "upsidedown", "now"]
    assert join_phrases(["go", "up"]) == ["go", "up"]
    assert join_phrases(["fahre", "den", "arm", "aus"]) == ["ausfahren", "den", "arm"]
    assert join_phrases(["fahrt", "des", "arms", "hinaus"]) == ["fahrt", "des", "arms", "hinaus"]
    assert join_phrases([]) == []


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("twenty-one and ninety nine", [21, 99]),
        ("two hundred fifty", [200, 50]),
        ("quatre-vingt-dix-neuf", [99]),
        ("soixante et onze", [71]),
        ("siebenundachtzig", [87]),
        ("treinta y dos", [32]),
        ("三百二十五克", [325]),
        ("十二个", [12]),
        ("three thousand", [3000]),
        ("the ones and the others", []),
    ],
)
def test_numbers_in_words(text: str, values: list[float]) -> None:
    assert [spelled.value for spelled in spelled_numbers(text)] == values
