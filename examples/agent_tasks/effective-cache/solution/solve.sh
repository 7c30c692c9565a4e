#!/bin/bash
cat etc/cache.conf etc/cache.conf.d/*.conf | grep -E '^ttl *=' | tail -1 | sed 's/.*= *//' > answer.txt
