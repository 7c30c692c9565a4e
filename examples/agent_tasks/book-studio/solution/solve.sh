#!/bin/bash
bash bin/book studio 22.05.2026
