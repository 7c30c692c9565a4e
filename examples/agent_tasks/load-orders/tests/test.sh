#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
if cmp -s /app/inbox/orders.csv /app/database.txt; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
