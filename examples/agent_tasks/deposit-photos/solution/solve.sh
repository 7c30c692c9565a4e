#!/bin/bash
bash bin/deposit /app/photos --commit
