"""One episode, from a sentence to a lesson.

Read :func:`gvla2.episode.loop.run_episode` first; it goes through the stages from top to bottom. In its order:
:mod:`refine` (better geometry for the objects of interest), :mod:`planning` (planner with memory's advice, checks and
fallback planner), :mod:`attempts` (a program's next part, the next attempt), :mod:`evidence` (the verifier's input),
:mod:`failure_diagnosis` and :mod:`lessons` (what an episode teaches, and how memory gets it). :mod:`record` has the
data.
"""
