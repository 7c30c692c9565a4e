#!/bin/bash
python3 -c "
import json
last = {}
for line in open('trips.jsonl'):
    r = json.loads(line); last[r['id']] = r['km']
print(sum(last.values()))" > answer.txt
