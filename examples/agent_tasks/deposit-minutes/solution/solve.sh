#!/bin/bash
bash bin/deposit /app/minutes --commit
