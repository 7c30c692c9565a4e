#!/bin/bash
(cat logs/printer.log logs/printer.log.1; gzip -dc logs/printer.log.2.gz) | grep -c ' JAM ' > answer.txt
