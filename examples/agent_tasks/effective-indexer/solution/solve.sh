#!/bin/bash
cat etc/indexer.conf etc/indexer.conf.d/*.conf | grep -E '^workers *=' | tail -1 | sed 's/.*= *//' > answer.txt
