"""From pictures with depth to named objects: what perceivers share.

* ``frames``: which pixels can be used, and where their points lie above the table;
* ``registration``: cameras that err, corrected until they agree on table and objects;
* ``clusters``: what is connected in 3D, and masks of several pictures fused into objects;
* ``objects``: seen points as an object of the scene;
* ``labels``: the contract of labellers, and names by a vision-language model that reads crops;
* ``gallery`` and ``scans``: names and poses from a folder of known objects;
* ``clicks``: a vision-language model that points at the target, one click a round.
"""
