#!/bin/bash
python3 -c "
import json
last = {}
for line in open('books.jsonl'):
    r = json.loads(line); last[r['id']] = r['pages']
print(sum(last.values()))" > answer.txt
