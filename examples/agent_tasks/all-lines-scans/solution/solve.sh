#!/bin/bash
find scans -name '*.txt' -print0 | xargs -0 cat | wc -l > answer.txt
