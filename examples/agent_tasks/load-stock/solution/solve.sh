#!/bin/bash
bash bin/load /app/inbox/stock.csv
