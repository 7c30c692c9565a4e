#!/bin/bash
bash bin/report january --save
