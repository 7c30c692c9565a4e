#!/bin/bash
bash bin/publish /app/poster.txt --owner=ops
