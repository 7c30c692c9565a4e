#!/bin/bash
bash bin/setlevel fan 0.40
