#!/bin/bash
find songs -name '*.lst' -print0 | xargs -0 cat | wc -l > answer.txt
