#!/bin/bash
bash bin/unlock april && bash bin/seal april
