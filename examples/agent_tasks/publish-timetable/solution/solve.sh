#!/bin/bash
bash bin/publish /app/timetable.txt --owner=ops
