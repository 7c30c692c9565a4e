#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
if [ "$(cat /app/bookings.txt)" = "hall 17.03.2026" ]; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
