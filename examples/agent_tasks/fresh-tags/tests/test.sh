#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
check() {
    cd /app && python3 -c "from tags import with_tag; assert with_tag('B') == ['b']; assert with_tag('a') == ['a']; assert with_tag('C', ['x']) == ['c', 'x']"
}
if check; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
