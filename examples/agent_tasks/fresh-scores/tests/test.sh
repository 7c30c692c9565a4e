#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
check() {
    cd /app && python3 -c "from scores import record; assert record('a', 2) == {'a': 2}; assert record('b', 1) == {'b': 1}; assert record('a', 1, {'a': 1}) == {'a': 2}"
}
if check; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
