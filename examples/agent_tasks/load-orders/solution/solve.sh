#!/bin/bash
bash bin/load /app/inbox/orders.csv
