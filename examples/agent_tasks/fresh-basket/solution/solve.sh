#!/bin/bash
sed -i 's/items=\[]/items=None/' basket.py
sed -i '/"""Return/a\    items = [] if items is None else items' basket.py
