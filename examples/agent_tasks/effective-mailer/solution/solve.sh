#!/bin/bash
cat etc/mailer.conf etc/mailer.conf.d/*.conf | grep -E '^port *=' | tail -1 | sed 's/.*= *//' > answer.txt
