#!/bin/bash
comm -12 <(tr -d '\r' < stations_old.txt | sort -u) <(sort -u stations_new.txt) | wc -l > answer.txt
