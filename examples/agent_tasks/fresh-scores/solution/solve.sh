#!/bin/bash
sed -i 's/table={}/table=None/' scores.py
sed -i '/"""Return/a\    table = {} if table is None else table' scores.py
