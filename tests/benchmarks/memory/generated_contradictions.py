"""Generated pairs of lessons that contradict one another, or only look so."""

from __future__ import annotations

import random


def generated(seed: int, count: int) -> list[tuple[str, str, bool]]:
    """Numbers in any unit, opposites, prohibitions, bounds; and pairs of two things, units, or fitting bounds."""
    rng = random.Random(seed)
    things = (
        "kettle",
        "crate",
        "wrench",
        "panel",
        "beaker",
        "carton of juice",
        "steel rod",
        "Schublade",
        "bouteille",
    )
    lengths = (("mm", 1000.0), ("cm", 100.0), ("m", 1.0), ("inches", 39.3701))
    times = (("ms", 1000.0), ("s", 1.0), ("minutes", 1 / 60), ("hours", 1 / 3600))
    frames = (
        "Lift the {t} {n} {u}.",
        "Keep the {t} {n} {u} away from the wall.",
        "The {t} needs {n} {u} of room.",
    )
    waits = ("Let the {t} soak for {n} {u}.", "Wait {n} {u} before using the {t}.")
    opposites = (
        ("left", "right"),
        ("clockwise", "counterclockwise"),
        ("forward", "backward"),
        ("slowly", "quickly"),
    )
    pairs: list[tuple[str, str, bool]] = []
    for _ in range(count):
        thing, other = rng.sample(things, 2)
        frame, units = rng.choice(((rng.choice(frames), lengths), (rng.choice(waits), times)))
        (u, by), (v, per) = rng.choice(units), rng.choice(units)
        value = rng.uniform(0.05, 3.0)
        far = value * rng.choice((rng.uniform(1.8, 6.0), 1 / rng.uniform(1.8, 6.0)))

        def say(words: str, name: str, amount: float, unit: str, factor: float) -> str:
            return words.format(t=name, n=f"{amount * factor:.6g}", u=unit)

        first = say(frame, thing, value, u, by)
        kind = rng.randrange(6)
        if kind == 0:
            pairs.append((first, say(frame, thing, far, v, per), True))
        elif kind == 1:
            pairs.append((first, say(frame, thing, value * rng.uniform(0.95, 1.05), v, per), False))
        elif kind == 2:
            pairs.append((first, say(frame, other, far, v, per), False))
        elif kind == 3:
            pole, anti = rng.choice(opposites)
            real = rng.random() < 0.5
            pairs.append((f"Turn the {thing} {pole}.", f"Turn the {thing if real else other} {anti}.", real))
        elif kind == 4:
            act = rng.choice(("grip", "tilt", "heat", "shake", "scan"))
            real = rng.random() < 0.5
            no = (
                rng.choice(("Never", "Do not", "Avoid to"))
                if real
                else rng.choice(("Do not forget to", "Never hesitate to"))
            )
            pairs.append((f"{act.capitalize()} the {thing}.", f"{no} {act} the {thing}.", real))
        else:
            real = rng.random() < 0.5
            low = value * (1.5 if real else 0.5)
            bound = say("at least {n} {u}", "", low, v, per)
            pairs.append(
                (f"Lift the {thing} {value * by:.6g} {u}.".replace(u, u), f"Lift the {thing} {bound}.", real)
                if units is lengths
                else (first, say(frame, other, far, v, per), False)
            )
    return pairs
