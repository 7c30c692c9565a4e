#!/bin/bash
# Writes the reward as Terminal-Bench 2.0 has it.
check() {
    cd /app && python3 -c "from basket import add_item; assert add_item(1) == [1]; assert add_item(2) == [2]; assert add_item(3, [1]) == [1, 3]"
}
if check; then echo 1; else echo 0; fi > /logs/verifier/reward.txt
