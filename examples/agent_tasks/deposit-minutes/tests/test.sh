#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
check() {
    diff -r /app/minutes /app/store/minutes
}
if check; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
