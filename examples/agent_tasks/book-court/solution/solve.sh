#!/bin/bash
bash bin/book court 14.09.2026
