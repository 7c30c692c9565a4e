#!/bin/bash
python3 -c "
import json
last = {}
for line in open('parts.jsonl'):
    r = json.loads(line); last[r['id']] = r['stock']
print(sum(last.values()))" > answer.txt
