#!/bin/bash
bash bin/setlevel lamp 0.75
