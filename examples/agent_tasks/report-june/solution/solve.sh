#!/bin/bash
bash bin/report june --save
