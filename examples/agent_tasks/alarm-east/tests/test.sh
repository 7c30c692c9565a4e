#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
if [ "$(cat /app/alarm-east)" = on ]; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
