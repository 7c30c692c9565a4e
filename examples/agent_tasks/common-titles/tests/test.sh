#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
check() {
    [ "$(tr -d '[:space:]' < /app/answer.txt)" = "18" ]
}
if check; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
