#!/bin/bash
bash bin/register MAPLE
