#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
if [ -s /app/sealed/april ]; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
