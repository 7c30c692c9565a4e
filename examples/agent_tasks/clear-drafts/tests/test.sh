#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
if [ -e /app/cleared ] && [ -z "$(ls /app/drafts)" ]; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
