#!/bin/bash
bash bin/deposit minutes --commit
