"""The parts of an episode's loop; `gvla2.episode` runs it from top to bottom.

In this order: `consulting` (who plans), `advice` (what a planner and the checks see of memory), `attempts` and
`checking` (a plan, its checks, the next try), `refine` (better geometry on demand), `continuing` (a program's next
part), `evidence`, `diagnosis` and `lessons` (what an episode teaches), `telling` (what is reported to memory),
`correspondence` (which object is which from one scene to the next).
"""
