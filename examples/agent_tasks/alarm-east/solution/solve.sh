#!/bin/bash
KEY="$(cat key)" bash bin/alarm east
