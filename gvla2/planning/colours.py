"""Twenty colour words, and how different two colours look under any light."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from gvla2.geometry.transform import FloatArray

COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (1.0, 0.0, 0.0),
    "maroon": (0.5, 0.0, 0.0),
    "lime": (0.0, 1.0, 0.0),
    "green": (0.0, 0.5, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "navy": (0.0, 0.0, 0.5),
    "yellow": (1.0, 1.0, 0.0),
    "cyan": (0.0, 1.0, 1.0),
    "magenta": (1.0, 0.0, 1.0),
    "silver": (0.75, 0.75, 0.75),
    "gray": (0.5, 0.5, 0.5),
    "orange": (1.0, 0.5, 0.0),
    "olive": (0.5, 0.5, 0.0),
    "purple": (0.5, 0.0, 0.5),
    "teal": (0.0, 0.5, 0.5),
    "azure": (0.0, 0.5, 1.0),
    "violet": (0.5, 0.0, 1.0),
    "rose": (1.0, 0.0, 0.5),
    "black": (0.0, 0.0, 0.0),
    "white": (1.0, 1.0, 1.0),
}
"""Colour words and their sRGB values in [0, 1]; the corners and edges of the colour cube."""

SYNONYMS = {"grey": "gray", "pink": "rose", "turquoise": "teal"}
"""Synonyms of the colour words."""
NEARLY = SYNONYMS | {f"{word}ish": word for word in (*COLOURS, "brown")}
NEARLY |= {"reddish": "red", "bluish": "blue", "purplish": "purple", "whitish": "white", "pinkish": "pink"}
"""What is nearly of a colour as well: in an instruction it distinguishes objects all the same."""

FAMILIES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(COLOURS, ()),
    "blue": ("azure", "navy", "cyan"), "light blue": ("azure", "cyan"), "sky blue": ("azure", "cyan"),
    "dark blue": ("navy",), "green": ("lime", "olive"), "light green": ("lime",), "lime green": ("lime",),
    "dark green": ("green",), "olive green": ("olive",), "purple": ("violet", "magenta"), "violet": ("purple",),
    "light purple": ("violet",), "dark purple": ("purple",), "pink": ("rose", "magenta"),
    "hot pink": ("magenta", "rose"), "bright pink": ("magenta", "rose"), "light gray": ("silver",),
    "gray": ("silver",), "dark gray": ("gray",), "brown": ("maroon", "olive", "orange"), "dark red": ("maroon",),
    "bright red": ("red",), "turquoise": ("teal", "cyan"), "blue green": ("teal", "cyan"), "gold": ("yellow",),
    "beige": ("silver",), "black": ("gray",), "white": ("silver",),
}  # fmt: skip
"""Words that people use for other colour words of :data:`COLOURS` if nothing has that very colour: basic terms for
their shades, never a shade for its basic term. Red is only red: maroon looks clearly different."""

DISTINCT = 30.0
"""Distance (see :func:`colour_distance`) above which two surfaces differ in any light: not two shades of one hue, nor
two neighbouring greys."""

LIGHTNESS_WEIGHT = 0.5
"""Lightness counts half, since shading changes it. Zero would make red and maroon the same."""

TINGE, DARK = 0.7, 0.25
"""Tuned so that each of the twenty words is nearest to itself in slightly white light, and pale and dark shades get the
names that people use. Below the brightness ``DARK`` a colour loses its saturation."""

BETWEEN, LEEWAY = 25.0, 2.2
"""A colour that is further from every word is between them: a word up to ``LEEWAY`` times as far may be meant."""


def appearance(rgb: ArrayLike) -> FloatArray:
    """Coordinates (..., 3) in which Euclidean distance measures how different two surfaces (sRGB (..., 3)) look.

    Dimming a surface scales a*, b* and L* + 16 of CIELAB by the same factor, so 100 a*/(L* + 16) and 100 b*/(L* + 16)
    stay: they give hue and saturation under any shading. Lightness comes third, weighted down. A difference of about 10
    is obvious to a person, one of 25 is not hidden by shading.
    """
    from gvla2.geometry.lab import looks_of

    values = np.clip(np.asarray(rgb, dtype=np.float64), 0.0, 1.0)
    return looks_of(values.reshape(-1, 3), LIGHTNESS_WEIGHT).reshape(values.shape)


def colour_distance(one: ArrayLike, other: ArrayLike) -> FloatArray:
    """Distances (...,) between the looks of colours (..., 3) in [0, 1]; see :func:`appearance`."""
    return np.asarray(np.linalg.norm(appearance(one) - appearance(other), axis=-1))


def naming_distance(one: ArrayLike, other: ArrayLike) -> FloatArray:
    """Distances (...,) of colours (..., 3) in [0, 1] for naming.

    On the colour circle, in per cent of its radius: hue as in HSV, and saturation, raised to :data:`TINGE`, since a
    slight tinge decides the name; brightness counts a third. CIELAB does not work here: a little white light moves pure
    blue to violet there, and red to maroon.
    """
    from skimage.color import rgb2hsv

    at = []
    for rgb in (one, other):
        values = np.clip(np.asarray(rgb, dtype=np.float64), 0.0, 1.0)
        most, least = values.max(axis=-1), values.min(axis=-1)
        # Only what is nearly black loses saturation: if all dark colours did, a bright red in
        # slightly white light would be nearer to maroon.
        tinged = ((most - least) / np.maximum(most, 1e-9) * np.minimum(1.0, most / DARK)) ** TINGE
        turn = 2.0 * np.pi * rgb2hsv(values.reshape(1, -1, 3)).reshape(values.shape)[..., 0]
        at.append(np.stack([tinged * np.cos(turn), tinged * np.sin(turn), 0.35 * most], axis=-1))
    return np.asarray(100.0 * np.linalg.norm(at[0] - at[1], axis=-1))


def nearest_colours(rgb: ArrayLike, k: int = 3) -> tuple[tuple[str, float], ...]:
    """The ``k`` colour words nearest to ``rgb`` (3,) in [0, 1], nearest first, each with its distance."""
    names = list(COLOURS)
    distances = naming_distance(np.array([COLOURS[name] for name in names]), rgb)
    order = np.argsort(distances, kind="stable")[:k]
    return tuple((names[i], float(distances[i])) for i in order)


def between(word: str, rgb: ArrayLike) -> bool:
    """Whether a colour (3,) is so far from every word that people differ about which it is, ``word`` among them."""
    ((_, off),) = nearest_colours(rgb, 1)
    return word in COLOURS and off >= BETWEEN and float(naming_distance(COLOURS[word], rgb)) < LEEWAY * off


def may_look(word: str, rgb: ArrayLike) -> bool:
    """Whether a surface that was seen in a colour (3,) may be called ``word`` in some light."""
    return word not in COLOURS or float(colour_distance(COLOURS[word], rgb)) < DISTINCT


def meant_by(word: str, present: Iterable[str]) -> str:
    """The one colour of ``present`` (words of :data:`COLOURS`) that people mean by ``word``; "" for none or several.

    An exact match comes first: if there is a blue one, "blue" never means the navy one.
    """
    here = set(present)
    if word in here:
        return word
    found = [name for name in FAMILIES.get(word, ()) if name in here]
    return found[0] if len(found) == 1 else ""


def first_colour(words: Sequence[str]) -> tuple[int, int, str] | None:
    """The span of the first colour that people name, two words before one, and its word in :data:`FAMILIES`."""
    plain = [w if w in FAMILIES else NEARLY.get(w, w) for w in words]
    spans = ((i, i + width) for width in (2, 1) for i in range(len(plain) - width + 1))
    return next(((i, j, said) for i, j in spans if (said := " ".join(plain[i:j])) in FAMILIES), None)


def colours_in(sentence: str) -> tuple[str, ...]:
    """The colour words of :data:`COLOURS` that a sentence contains, in its order, each once; synonyms resolved."""
    words = (SYNONYMS.get(word, word) for word in re.findall(r"[a-z]+", sentence.lower()))
    return tuple(dict.fromkeys(word for word in words if word in COLOURS))
