#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
if [ "$(awk '{print $1 * 100}' /app/levels/fan)" = 40 ]; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
