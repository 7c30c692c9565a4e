#!/bin/bash
echo yes | bash bin/clear /app/cache
