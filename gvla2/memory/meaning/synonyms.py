"""English words that lessons use for one another. Each line is a group; where two clauses have words of different
groups in each other's place, they speak of different things.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from gvla2.memory.meaning.stems import stem

_GROUPS = """
turn rotate twist spin revolve swivel
place put lay set-down deposit position rest
go drive travel ride proceed navigate move steer
take bring fetch carry transport deliver
squeeze grip grasp clutch grab
tilt incline lean slant
wait pause idle linger
pour tip-out dispense
wipe scrub rub clean wash rinse
cut slice saw chop trim
fix secure fasten attach mount
approach near come get-close
insert slide-in feed plug
pass overtake
watch look inspect examine check verify
cook boil simmer bake fry roast
tap touch contact
press push-down depress
shake agitate stir mix
throw toss fling
test suite
run execute
delete remove erase drop purge
copy clone duplicate transfer
save store persist keep archive
install setup deploy
fail crash abort
box carton crate case package parcel
cup mug beaker glass
bottle flask jar
lid cap cover
door gate hatch
shelf rack board
drawer tray
table desk bench
bin bucket
plate dish saucer
cloth rag towel
screw bolt nut
gripper finger hand jaw claw
camera lens imager
folder directory
timeout deadline
error fault
height altitude
speed velocity pace
force pressure effort
torque tightness
temperature heat
depth
width
length
angle
distance standoff clearance gap
delay
duration
rate frequency
size
count number amount
retry attempt
port
memory ram
worker job thread process
batch
cache
password secret credential
picture image photo shot
floor ground
ramp slope incline
corridor hallway aisle
lamp light
person human people
"""


def _canonical() -> dict[str, str]:
    return {
        stem(word): stem(line.split()[0])
        for line in reversed(_GROUPS.strip().split("\n"))
        for word in line.split()
    }


CANONICAL: Mapping[str, str] = MappingProxyType(_canonical())
"""Stem -> the stem that stands for its group."""
KNOWN = frozenset(CANONICAL.values())
"""The stems that stand for groups."""
