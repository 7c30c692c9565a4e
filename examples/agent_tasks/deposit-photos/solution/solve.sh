#!/bin/bash
bash bin/deposit photos --commit
