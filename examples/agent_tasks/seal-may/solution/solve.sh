#!/bin/bash
bash bin/unlock may && bash bin/seal may
