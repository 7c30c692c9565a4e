#!/bin/bash
tail -n +2 invoices.csv | cut -d';' -f3 | tr , . | awk '{s+=$1; if($1>m)m=$1} END {printf "%.2f\n", s}' > answer.txt
