#!/bin/bash
bash bin/unlock march && bash bin/seal march
