#!/bin/bash
comm -12 <(tr -d '\r' < titles_old.txt | sort -u) <(sort -u titles_new.txt) | wc -l > answer.txt
