#!/bin/bash
bash bin/book hall 17.03.2026
