#!/bin/bash
(cat logs/gateway.log logs/gateway.log.1; gzip -dc logs/gateway.log.2.gz) | grep -c ' TIMEOUT ' > answer.txt
