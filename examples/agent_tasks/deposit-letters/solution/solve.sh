#!/bin/bash
bash bin/deposit letters --commit
