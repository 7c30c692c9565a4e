"""What the loop of an episode is made of, beside `gvla2.episode`, which states it from top to bottom.

Asked in this order: `consulting` (what memory has to say), `advice` (what a planner and the checks see of
it), `attempts` and `checking` (a plan, its checks, the next try), `refine` (better geometry on demand),
`continuing` (a program's next part), `evidence`, `diagnosis` and `lessons` (what an episode teaches),
`telling` (what it tells memory), `correspondence` (whose object is whose from one scene to the next).
"""
