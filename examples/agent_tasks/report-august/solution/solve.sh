#!/bin/bash
bash bin/report august --save
