#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
if grep -q "report of january: 12 visits" /app/reports/january.txt; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
