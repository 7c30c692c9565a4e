"""Forms of a word are one word, words that merely begin alike are two, and the quick test never says more."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gvla2.memory.meaning.concepts import stem_of
from gvla2.memory.meaning.word_forms import Language, alike, common, language_of, split_alike, starts_of

WORDS = st.frozensets(
    st.sampled_from(
        [
            "grip",
            "grippe",
            "gripper",
            "grid",
            "turn",
            "turnt",
            "nr1x",
            "nr12x",
            "side+",
            "side-",
            "a",
            "杯",
            "hände",
        ]
    )
)


@given(WORDS, WORDS, st.sampled_from(["en", "de", "fr", "es", ""]))
def test_what_begins_apart_is_left_over(
    first: frozenset[str], second: frozenset[str], language: Language
) -> None:
    _, left, right = split_alike(first, second, language)
    assert starts_of(first) <= starts_of(second) or left
    assert starts_of(second) <= starts_of(first) or right


@pytest.mark.parametrize(
    ("first", "second", "language"),
    [
        ("tasse", "tassen", "de"), ("greife", "greift", "de"), ("öffne", "öffnet", "de"), ("hand", "hände", "de"),
        ("arbeite", "arbeitet", "de"), ("löte", "löten", "de"), ("roten", "rote", "de"),
        ("poser", "posez", "fr"), ("percé", "percer", "fr"), ("vertes", "vert", "fr"), ("saisir", "saisis", "fr"),
        ("soulève", "soulever", "fr"), ("remplir", "remplissez", "fr"),
        ("taza", "tazas", "es"), ("agarra", "agarrar", "es"), ("rojo", "roja", "es"), ("cerrado", "cerradas", "es"),
        ("configur", "configure", "en"), ("drehe", "drehen", ""), ("visser", "vissez", ""),
    ],
)  # fmt: skip
def test_inflections_are_one_word(first: str, second: str, language: Language) -> None:
    assert alike(first, second, language)
    assert alike(second, first, language)


@pytest.mark.parametrize(
    ("pairs", "language"),
    [
        ("screw/screen button/butter card/cart knob/knot spoon/spool towel/tower table/tablet fork/form peg/peel "
         "nut/nutmeg tub/tube pan/pane tap/tape rule/ruler slide/slider plan/planet list/listen connector/connection "
         "jack/jacket mark/market bank/band", "en"),
        ("screw/screen card/cart knob/knot table/tablet fork/form blank/blanket coil/coin rope/robe tub/tub2", ""),
        ("schraube/schrauber bohre/bohrer rose/rost tasse/tasche karte/karton deckel/decke halter/halten "
         "stecker/stecke gabel/gabe messer/messe platte/platz teller/teil", "de"),
        ("verre/verrou bouton/bouteille pot/poteau carte/carton plat/plateau boule/boulon barre/barreau lampe/lame",
         "fr"),
        ("palo/pala plato/plata libro/libra tubo/tuba caja/cajon tornillo/torno bote/botella mango/manga silla/sillon",
         "es"),
        ("nr1x/nr12x side+/side- cam0/cam1 m6x20/m6x25 nra0/nrb0", ""),
    ],
)  # fmt: skip
def test_words_that_begin_alike_are_two(pairs: str, language: Language) -> None:
    for pair in pairs.split():
        first, second = pair.split("/")
        assert not alike(first, second, language), pair
        assert not alike(second, first, language), pair


def test_spanish_adjectives_agree_in_gender_and_number() -> None:
    for form in ("ambigua", "ambiguos", "ambiguas"):
        assert alike("ambiguo", form, "es")


def test_english_verbs_have_one_stem() -> None:
    table = {
        "tape": "taping taped", "tap": "tapping tapped taps", "rotate": "rotating rotated", "handle": "handling",
        "measure": "measured", "pour": "pouring poured", "stir": "stirring", "box": "boxes boxing", "wipe": "wiped",
        "press": "pressing presses", "dry": "dries dried", "roll": "rolling rolled", "heat": "heating",
        "merge": "merging merged", "glass": "glass glasses", "wash": "washes washing",
    }  # fmt: skip
    for stem, forms in table.items():
        assert {stem_of(form) for form in forms.split()} == {stem}


def test_the_language_is_the_one_that_most_words_mark() -> None:
    assert language_of(frozenset(["lift", "the", "cup", "to", "the", "top"])) == "en"
    assert language_of(frozenset(["hebe", "die", "tasse", "vor", "dem", "drehen"])) == "de"
    assert language_of(frozenset(["posez", "le", "verre", "sur", "la", "table"])) == "fr"
    assert language_of(frozenset(["levanta", "el", "vaso", "antes", "del", "giro"])) == "es"
    assert language_of(frozenset(("cup", "tasse"))) == ""
    assert (common("en", "de"), common("", "fr"), common("de", "fr")) == ("en", "fr", "")
