#!/bin/bash
sed -i 's/tags=\[]/tags=None/' tags.py
sed -i '/"""Return/a\    tags = [] if tags is None else tags' tags.py
