#!/bin/bash
(cat logs/backup.log logs/backup.log.1; gzip -dc logs/backup.log.2.gz) | grep -c ' RETRY ' > answer.txt
