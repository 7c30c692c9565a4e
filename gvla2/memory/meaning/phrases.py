"""Words that mean something together: "let go", "upside down", German verbs with their particle at the end."""

from __future__ import annotations

_PHRASES = """
let go = release
lets go = release
letting go = release
let it go = release
upside down = upsidedown
right side up = rightsideup
right way up = rightsideup
face up = faceup
face down = facedown
facing up = faceup
facing down = facedown
left hand side = left
right hand side = right
in order to = to
make sure to = must
make sure that = ensure
make sure = ensure
be sure to = must
need to = must
needs to = must
have to = must
has to = must
in series = sequentially
one by one = sequentially
one after another = sequentially
at once = simultaneously
at the same time = simultaneously
all the way = completely
in full = completely
half way = halfway
part way = halfway
by hand = manually
screw in = screwin
screwed in = screwin
screw on = screwin
zoom in = zoomin
zoom out = zoomout
log in = login
log out = logout
sign in = login
sign out = logout
roll back = rollback
rolled back = rollback
switched on = enabled
switched off = disabled
turned on = enabled
turned off = disabled
powered on = enabled
powered off = disabled
plugged in = plugged
on top = ontop
half open = halfway open
half closed = halfway closed
slow down = decelerate
slows down = decelerate
read only = readonly
read write = readwrite
counter clockwise = counterclockwise
anti clockwise = counterclockwise
take off = takeoff
put on = puton
auf dem kopf = kopfüber
von hand = manuell
an sein = eingeschaltet
aus sein = ausgeschaltet
an ist = eingeschaltet
aus ist = ausgeschaltet
an sind = eingeschaltet
aus sind = ausgeschaltet
an bleiben = eingeschaltet
aus bleiben = ausgeschaltet
an lassen = eingeschaltet
aus lassen = ausgeschaltet
gegen den uhrzeigersinn = gegenuhrzeigersinn
entgegen dem uhrzeigersinn = gegenuhrzeigersinn
à la main = manuellement
à l envers = renversé
tête en bas = renversé
sens inverse des aiguilles d une montre = antihoraire
sens des aiguilles d une montre = horaire
sens antihoraire = antihoraire
sens horaire = horaire
à moitié = halfway
en bas = abajo
en haut = arriba
boca abajo = bocaabajo
boca arriba = bocaarriba
a mano = manualmente
a medias = halfway
del todo = completamente
por completo = completamente
sentido contrario a las agujas del reloj = antihorario
sentido antihorario = antihorario
sentido horario = horario
sentido de las agujas del reloj = horario
"""


def _phrases() -> dict[str, list[tuple[tuple[str, ...], tuple[str, ...]]]]:
    found: dict[str, list[tuple[tuple[str, ...], tuple[str, ...]]]] = {}
    for line in _PHRASES.strip().split("\n"):
        said, meant = (tuple(part.split()) for part in line.split("="))
        found.setdefault(said[0], []).append((said[1:], meant))
    return {first: sorted(rests, key=lambda rest: -len(rest[0])) for first, rests in found.items()}


_JOINED = _phrases()


_SEPARATED = """
fahr aus=ausfahren ein=einfahren vor=vorfahren zurück=zurückfahren
zieh fest=festziehen an=anziehen ein=einziehen heraus=herausziehen zurück=zurückziehen
dreh auf=öffnen zu=schließen fest=festziehen los=lösen
mach auf=öffnen zu=schließen an=einschalten aus=ausschalten los=lösen fest=befestigen
klapp aus=ausklappen ein=einklappen auf=ausklappen zu=schließen
schraub fest=festschrauben an=anschrauben ein=festschrauben ab=abschrauben los=losschrauben heraus=herausschrauben
lass los=loslassen
halt fest=festhalten an=anhalten
steck ein=plug aus=unplug ab=unplug
pump auf=aufpumpen
blas auf=aufblasen
roll auf=aufwickeln ab=abwickeln
wickel ein=einwickeln aus=auswickeln auf=aufwickeln ab=abwickeln
pack ein=einpacken aus=auspacken
frier ein=einfrieren
tau auf=auftauen
blend ein=einblenden aus=ausblenden
rast ein=einrasten aus=ausrasten
kuppel ein=einkuppeln aus=auskuppeln
logg ein=einloggen aus=ausloggen
meld an=anmelden ab=abmelden
setz ein=einsetzen auf=aufsetzen ab=absetzen
nimm heraus=herausnehmen ab=abnehmen
nehm heraus=herausnehmen ab=abnehmen
füg ein=einfügen hinzu=hinzufügen
lad hoch=hochladen herunter=herunterladen auf=aufladen ab=abladen
bau zusammen=zusammenbauen
"""
_VERBS: dict[str, dict[str, str]] = {
    line.split()[0]: {part.split("=")[0]: part.split("=")[1] for part in line.split()[1:]}
    for line in _SEPARATED.strip().split("\n")
}
_PARTICLES = frozenset(particle for verbs in _VERBS.values() for particle in verbs)
_LONGEST_STEM = max(map(len, _VERBS))


def _separated(words: list[str]) -> list[str]:
    """German verbs with their particle, which stands at the end: "fahre den Arm aus" says "ausfahren"."""
    for index, word in enumerate(words[:-1]):
        for length in range(3, min(len(word), _LONGEST_STEM) + 1):
            verb = _VERBS.get(word[:length], {}).get(words[-1])
            if verb is not None and word[length:] in ("", "e", "en", "t", "st", "n", "est", "et"):
                return [*words[:index], verb, *words[index + 1 : -1]]
    return words


def join_phrases(words: list[str]) -> list[str]:
    """Words of a text with those phrases as one word that mean more than their words: "let go", "fahre ... aus"."""
    if words and words[-1] in _PARTICLES:
        words = _separated(words)
    if _JOINED.keys().isdisjoint(words):
        return words
    made: list[str] = []
    index = 0
    while index < len(words):
        for rest, meant in _JOINED.get(words[index], ()):
            if tuple(words[index + 1 : index + 1 + len(rest)]) == rest:
                made += meant
                index += 1 + len(rest)
                break
        else:
            made.append(words[index])
            index += 1
    return made
