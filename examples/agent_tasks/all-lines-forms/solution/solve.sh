#!/bin/bash
find forms -name '*.dat' -print0 | xargs -0 cat | wc -l > answer.txt
