#!/bin/bash
bash bin/register BIRCH
