"""From pictures with depth to named things: what perceivers share.

frames    which pixels can be used, and where their points lie above the table clusters  what is connected in 3D above
the table: the source of prompts for a segmentation model fusing    masks of several pictures, made one set of things by
what they share in 3D things    the seen points of a thing as an object of the scene labels the contract of labellers,
and how their answers are combined gallery   names and poses from a folder of known objects reader names from a
vision-language model that is shown crops clicks a vision-language model that points at the target, one click per round
"""
