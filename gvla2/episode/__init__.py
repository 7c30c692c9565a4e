"""One episode, from a sentence to a lesson.

Read :func:`gvla2.episode.loop.run_episode` first; it goes through the stages from top to bottom. In its order:
:mod:`refine` (better geometry for the objects of interest), :mod:`fallback` (planner, checks and fallback planner),
:mod:`advice` (what a planner and the checks see of memory), :mod:`multi_step` (a program's next part), :mod:`evidence`
(the verifier's input), :mod:`replan` (the next attempt), :mod:`failure_diagnosis` and :mod:`lessons` (what an episode
teaches), :mod:`memory_reporting` (what memory gets of it). :mod:`record` has the data.
"""
