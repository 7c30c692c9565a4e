#!/bin/bash
bash bin/setlevel heater 0.25
