#!/bin/bash
bash bin/load /app/inbox/prices.csv
