#!/bin/bash
bash bin/deposit /app/letters --commit
