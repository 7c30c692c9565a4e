#!/bin/bash
comm -12 <(tr -d '\r' < members_old.txt | sort -u) <(sort -u members_new.txt) | wc -l > answer.txt
